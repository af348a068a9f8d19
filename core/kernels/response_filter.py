"""The response filter: the rest of a test card, forecast from the samples so far.

The outputs of a manoeuvre made of steps are a sum of step responses, one per switch of the input.
The aircraft's step response is unknown, but its distribution is known: a mean and a few principal
components. A Kalman filter in information form estimates their coefficients from the samples. The
surface shows when the pilot switches, a sample or so late.
"""

from math import erf, log, sqrt
from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.assessing import INVALID, OK, STALE
from core.kernels.compiled import brief, in_chunks, inlined, jit
from core.kernels.lanes import (
    WIDTH,
    add,
    address,
    fma,
    load,
    multiply,
    pick,
    splat,
    store,
    total,
)
from core.types import Array, Indices

FLIGHTS_A_TASK = 32
NONE = -np.inf
"""Danger before the card begins and after it ends."""
TAKEN, SWITCHED, SIGN, LOST = range(4)
"""Counts of a flight: samples; switches seen; sign of its first step relative to the card's, 0
until it is seen; whether a switch may have been missed."""
FINEST_SHARE = 1e-4
MARGIN_WEIGHT = 0.02
"""Shares closer to 0 or 1 than FINEST_SHARE are ranked by the mean margin, with MARGIN_WEIGHT."""


class CardResponses(NamedTuple):
    """A card, and the distribution of responses to its first step.

    mean: (n_lags, 6).   components: (n_lags, 6, 8), with coefficients of unit variance.
    residual: (n_lags, 6) variance not in the components.   noise: (6,) variance of a sample.
    steps: (n_switches,) each step as a multiple of the first.
    shares: (n_switches, 8) the same for each component; other ones for unequal inputs.
    apart: (n_switches,) planned samples since the previous switch.
    later: (n_switches, n_lags, n_cases) the same for equally likely pilots, after that many samples
    without the switch.
    tail: samples to forecast after the last switch.   surface: channel that the card moves.
    seen_after: samples until a switch is visible.   share: of the mean response at that sample,
    above which it is visible.   least_apart: minimum samples between switches.   limits: (6,).
    h: lead.   window: samples that the score looks ahead; 0 for the rest of the card.
    """

    mean: Array
    components: Array
    residual: Array
    noise: Array
    steps: Array
    shares: Array
    apart: Indices
    later: Indices
    tail: int
    surface: int
    seen_after: int
    share: float
    least_apart: int
    limits: Array
    h: int
    window: int


class CardEstimate(NamedTuple):
    """Estimate of one flight's coefficients from its samples.

    information: (8, 8).   vector: (8,).   root: (8, 8) transpose of R, with R'R their covariance.
    mean: (8,).   switches, plan: (n_switches,) samples: switches seen, and with future ones.
    counts: see TAKEN.   work: (8,).
    """

    information: Array
    vector: Array
    root: Array
    mean: Array
    switches: Indices
    plan: Indices
    counts: Indices
    work: Array


@jit
def begin(n_switches):
    """Estimate before the first sample: the prior distribution."""
    return CardEstimate(
        np.eye(WIDTH),
        np.zeros(WIDTH),
        np.eye(WIDTH),
        np.zeros(WIDTH),
        np.zeros(n_switches, np.int64),
        np.zeros(n_switches, np.int64),
        np.zeros(4, np.int64),
        np.zeros(WIDTH),
    )


@inlined
def _respond(card, components, shares, switches, n, sample, c):
    """Mean of channel c after n switches, variance not in the components, and their weights."""
    longest = card.mean.shape[0] - 1
    mean, variance, weights = 0.0, 0.0, splat(0.0)
    for j in range(n):
        lag = min(sample - switches[j], longest)
        if lag > 0:
            step = card.steps[j]
            mean += step * card.mean[lag, c]
            variance += step * step * card.residual[lag, c]
            at = (lag * N_CHANNELS + c) * WIDTH
            weights = fma(load(shares, j * WIDTH), load(components, at), weights)
    return mean, variance, weights


@inlined
def _spread(root, weights):
    """Variance of the estimated combination of coefficients."""
    even, odd = splat(0.0), splat(0.0)
    for k in range(0, WIDTH, 2):
        even = fma(load(root, k * WIDTH), splat(pick(weights, k)), even)
        odd = fma(load(root, (k + 1) * WIDTH), splat(pick(weights, k + 1)), odd)
    both = add(even, odd)
    return total(multiply(both, both))


@jit
def _look_for_switch(card, estimate, y):
    """Record the next switch of the card once the surface shows it."""
    counts, switches = estimate.counts, estimate.switches
    n, sample = counts[SWITCHED], counts[TAKEN]
    at, c = sample - card.seen_after, card.surface
    if n == switches.shape[0] or at < 0:
        return
    shown = card.mean[card.seen_after, c]
    if n == 0:
        if abs(y[c]) > card.share * abs(shown):
            counts[SIGN] = 1 if y[c] * shown > 0.0 else -1
            switches[0] = at
            counts[SWITCHED] = 1
    elif at - switches[n - 1] >= card.least_apart:
        mean, _, weights = _respond(
            card, address(card.components), address(card.shares), switches, n, sample, c
        )
        expected = mean + total(multiply(weights, load(address(estimate.mean), 0)))
        off = counts[SIGN] * y[c] - expected
        if off / (card.steps[n] * shown) > card.share:
            switches[n] = at
            counts[SWITCHED] = n + 1


@jit
def _learn(card, estimate, y):
    """Add a sample y (6,) to the information."""
    counts, components, shares = estimate.counts, address(card.components), address(card.shares)
    information, vector = address(estimate.information), address(estimate.vector)
    for c in range(N_CHANNELS):
        mean, variance, weights = _respond(
            card, components, shares, estimate.switches, counts[SWITCHED], counts[TAKEN], c
        )
        precision = 1.0 / (variance + card.noise[c])
        off = (counts[SIGN] * y[c] - mean) * precision
        store(vector, 0, fma(weights, splat(off), load(vector, 0)))
        for k in range(WIDTH):
            row = load(information, k * WIDTH)
            store(information, k * WIDTH, fma(weights, splat(pick(weights, k) * precision), row))


@jit
def _solve(estimate):
    """Compute mean and root from the information, by Cholesky decomposition."""
    lower, root, half = estimate.information.copy(), estimate.root, estimate.work
    for i in range(WIDTH):
        for j in range(i + 1):
            rest = lower[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = sqrt(rest) if i == j else rest / lower[j, j]
    for i in range(WIDTH):
        half[i] = 0.0
        for j in range(i + 1):
            rest = 1.0 if i == j else 0.0
            for k in range(j, i):
                rest -= lower[i, k] * root[j, k]
            root[j, i] = rest / lower[i, i]
            half[i] += root[j, i] * estimate.vector[j]
    for j in range(WIDTH):
        estimate.mean[j] = 0.0
        for i in range(j, WIDTH):
            estimate.mean[j] += root[j, i] * half[i]


@jit
def _plan_on(card, estimate, now, wait):
    """Write the switches seen by sample `now`, and future ones, into the plan.

    wait: samples from the last switch seen to the next.
    """
    counts, plan = estimate.counts, estimate.plan
    for j in range(plan.shape[0]):
        if j < counts[SWITCHED]:
            plan[j] = estimate.switches[j]
        elif j == counts[SWITCHED]:
            plan[j] = max(plan[j - 1] + wait, now)
        else:
            plan[j] = plan[j - 1] + card.apart[j]


@jit
def _largest_margin(card, estimate, first, last):
    """Largest exceedance of a limit in samples first..last, in standard deviations."""
    components, shares = address(card.components), address(card.shares)
    root = address(estimate.root)
    coefficients, n, largest = load(address(estimate.mean), 0), estimate.plan.shape[0], NONE
    for c in range(N_CHANNELS):
        limit = card.limits[c]
        if limit == np.inf:
            continue
        for sample in range(first, last + 1):
            mean, variance, weights = _respond(
                card, components, shares, estimate.plan, n, sample, c
            )
            mean += total(multiply(weights, coefficients))
            variance += _spread(root, weights)
            if variance > 0.0:
                largest = max(largest, (abs(mean) - limit) / sqrt(variance))
    return largest


@jit
def _danger_in_rest(card, estimate):
    """How certainly a limit will be exceeded; NONE before the card begins and after it."""
    counts, m = estimate.counts, estimate.switches.shape[0]
    n, sample = counts[SWITCHED], counts[TAKEN]
    if n == 0:
        return NONE
    _plan_on(card, estimate, sample, card.apart[n] if n < m else 0)
    return _largest_margin(card, estimate, sample + 1, estimate.plan[m - 1] + card.tail)


@jit
def _dangers_within(card, estimate, windows, dangers):
    """As `_danger_in_rest` within windows, over the possible times of the next switch.

    windows: (n,) samples, ascending, above 0.   dangers: (n,) output.
    """
    counts, m = estimate.counts, estimate.switches.shape[0]
    n, sample = counts[SWITCHED], counts[TAKEN]
    if n == 0:
        dangers[:] = NONE
        return
    pending = n < m
    passed = min(sample - estimate.switches[n - 1], card.later.shape[1] - 1)
    n_cases = card.later.shape[2] if pending else 1
    shares, margins = np.zeros(len(windows)), np.zeros(len(windows))
    for case in range(n_cases):
        _plan_on(card, estimate, sample, card.later[n, passed, case] if pending else 0)
        end, seen, margin = estimate.plan[m - 1] + card.tail, sample, NONE
        for k in range(len(windows)):
            last = min(sample + windows[k], end)
            margin = max(margin, _largest_margin(card, estimate, seen + 1, last))
            seen = max(seen, last)
            shares[k] += 0.5 * (1.0 + erf(margin / sqrt(2.0))) / n_cases
            margins[k] += margin / n_cases
    for k in range(len(windows)):
        odds = (shares[k] + FINEST_SHARE) / (1.0 - shares[k] + FINEST_SHARE)
        dangers[k] = log(odds) + MARGIN_WEIGHT * margins[k]


@jit
def _danger(card, estimate):
    """How certainly a limit will be exceeded within the score's window."""
    if card.window == 0:
        return _danger_in_rest(card, estimate)
    dangers = np.empty(1)
    _dangers_within(card, estimate, np.full(1, card.window), dangers)
    return dangers[0]


@jit
def _add_sample(card, estimate, y, known):
    """Add the next sample y (6,), which may be unknown; the caller counts it."""
    if known:
        _look_for_switch(card, estimate, y)
        if estimate.counts[SWITCHED] > 0:
            _learn(card, estimate, y)
            _solve(estimate)


@jit
def _forecast(card, estimate, ahead, y_hat):
    """Forecast the outputs `ahead` samples after the last one; NaN before the card begins."""
    counts, m = estimate.counts, estimate.switches.shape[0]
    n, sample = counts[SWITCHED], counts[TAKEN] - 1
    if n == 0:
        y_hat[:] = np.nan
        return
    _plan_on(card, estimate, sample, card.apart[n] if n < m else 0)
    components, shares = address(card.components), address(card.shares)
    coefficients = load(address(estimate.mean), 0)
    for c in range(N_CHANNELS):
        mean, _, weights = _respond(card, components, shares, estimate.plan, m, sample + ahead, c)
        y_hat[c] = counts[SIGN] * (mean + total(multiply(weights, coefficients)))


@jit
def look_ahead(card, estimate, mean, variance):
    """Forecast the measurements over the rest of the card; returns the number of samples.

    mean, variance: (n, 6) output, from the next sample on; over the possible times of the pilot's
    next switch.
    """
    counts, m = estimate.counts, estimate.switches.shape[0]
    n, sample = counts[SWITCHED], counts[TAKEN] - 1
    if n == 0:
        return 0
    _plan_on(card, estimate, sample, card.apart[n] if n < m else 0)
    n_left = max(min(estimate.plan[m - 1] + card.tail - sample, mean.shape[0]), 0)
    passed = min(sample - estimate.switches[n - 1], card.later.shape[1] - 1)
    n_cases = card.later.shape[2] if n < m else 1
    components, shares = address(card.components), address(card.shares)
    root, coefficients = address(estimate.root), load(address(estimate.mean), 0)
    mean[:n_left] = 0.0
    variance[:n_left] = 0.0
    for case in range(n_cases):
        _plan_on(card, estimate, sample, card.later[n, passed, case] if n < m else 0)
        for i in range(n_left):
            for c in range(N_CHANNELS):
                at, off, weights = _respond(
                    card, components, shares, estimate.plan, m, sample + 1 + i, c
                )
                at += total(multiply(weights, coefficients))
                mean[i, c] += at / n_cases
                variance[i, c] += (at * at + off + _spread(root, weights)) / n_cases
    for i in range(n_left):
        for c in range(N_CHANNELS):
            variance[i, c] = max(variance[i, c] - mean[i, c] ** 2, 0.0) + card.noise[c]
            mean[i, c] *= counts[SIGN]
    return n_left


@brief
def update(card, estimate, clock, dt, t, y, code, y_hat):
    """Process one sample of a flight and return its score; NaN for none.

    clock: (2,) time of the last sample; number of consecutive missing samples.
    code: its state.   y_hat: (6,) output, the outputs h samples later.
    The flight is lost (counts[LOST]) if a switch may have been missed.
    """
    counts, m = estimate.counts, estimate.switches.shape[0]
    y_hat[:] = np.nan
    if code == STALE or counts[LOST]:
        return np.nan
    if counts[TAKEN] > 0 and np.isfinite(t):
        skipped = max(int(round((t - clock[0]) / dt)) - 1, 0)
        counts[TAKEN] += skipped
        clock[1] += skipped
    if np.isfinite(t):
        clock[0] = t
    known = code != INVALID
    if known and clock[1] >= card.least_apart and counts[SWITCHED] < m:
        shown = card.mean[card.seen_after, card.surface]
        if counts[SWITCHED] > 0 or abs(y[card.surface]) > card.share * abs(shown):
            counts[LOST] = 1
            return np.nan
    clock[1] = 0.0 if known else clock[1] + 1.0
    _add_sample(card, estimate, y, known)
    danger = _danger(card, estimate)
    counts[TAKEN] += 1
    if code != OK:
        return np.nan
    _forecast(card, estimate, card.h, y_hat)
    return -danger


@jit
def follow(card, t, y, codes, dt, s, y_hat):
    """Score a trajectory as `update` does sample by sample; returns the first lost sample.

    t: (n,).   y: (n, 6).   codes: (n,).   s: (n,), y_hat: (n, 6) output.   Returns n for none.
    """
    estimate, clock = begin(card.steps.shape[0]), np.zeros(2)
    for i in range(t.shape[0]):
        s[i] = update(card, estimate, clock, dt, t[i], y[i], codes[i], y_hat[i])
        if estimate.counts[LOST]:
            s[i:] = np.nan
            y_hat[i:] = np.nan
            return i
    return t.shape[0]


@jit
def squares(card, y, off, expected):
    """Squared errors of one-step forecasts, and their expectation.

    y: (n, n_samples, 6) of whole flights.
    off, expected: (n * n_samples, 6) output; returns the number of rows written.
    """
    row = 0
    for i in range(y.shape[0]):
        estimate = begin(card.steps.shape[0])
        components, shares = address(card.components), address(card.shares)
        root = address(estimate.root)
        for t in range(y.shape[1]):
            _look_for_switch(card, estimate, y[i, t])
            if estimate.counts[SWITCHED] > 0:
                coefficients = load(address(estimate.mean), 0)
                for c in range(N_CHANNELS):
                    mean, variance, weights = _respond(
                        card, components, shares, estimate.switches, estimate.counts[SWITCHED], t, c
                    )
                    mean += total(multiply(weights, coefficients))
                    off[row, c] = (estimate.counts[SIGN] * y[i, t, c] - mean) ** 2
                    expected[row, c] = variance + card.noise[c] + _spread(root, weights)
                row += 1
                _learn(card, estimate, y[i, t])
                _solve(estimate)
            estimate.counts[TAKEN] += 1
    return row


@jit
def _scores_some(card, windows, y, last, start, stop, scores):
    rest = windows[0] == 0
    within, dangers = windows[1:] if rest else windows, np.empty(len(windows))
    for i in range(start, stop):
        estimate = begin(card.steps.shape[0])
        for t in range(last[i] + 1):
            _add_sample(card, estimate, y[i, t], True)
            if rest:
                dangers[0] = _danger_in_rest(card, estimate)
            if len(within) > 0:
                _dangers_within(card, estimate, within, dangers[len(windows) - len(within) :])
            scores[:, i, t] = -dangers
            estimate.counts[TAKEN] += 1


def scores_within(card: CardResponses, windows: Indices, y: Array, last: Indices) -> Array:
    """Score of each sample 0..last of flights for other windows of the card; +inf for the rest.

    windows: (n_windows,) samples, ascending; may start with 0 for the rest of the card.
    y: (n, n_samples, 6), finite over samples 0..last.   last: (n,).
    Returns (n_windows, n, n_samples).
    """
    scores = np.full((len(windows), *y.shape[:2]), np.inf)
    in_chunks(
        len(y), FLIGHTS_A_TASK, lambda a, b: _scores_some(card, windows, y, last, a, b, scores)
    )
    return scores
