"""Finds manoeuvres and their trim, sample by sample, from the samples so far.

A manoeuvre begins when a surface first departs from rest; trim is the mean of the rest before it.
No rest in which a limit is exceeded becomes trim, unless a manoeuvre is begun by hand without one
or the trim so far is unknown or beyond the limit itself.
One compiled state machine serves a live source and a recording.
"""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import brief, jit
from core.types import Array, Flags, Indices

DEPARTED_SAMPLES = 2
"""Consecutive samples of a departure, so that one outlier is none."""
NOISES = 5.0
"""A departure exceeds this many standard deviations of the rest."""
LARGEST = 2.0
"""The usual motion raises a departure to this many times the planned one at most."""
TRAVEL = 2.0
"""Surfaces rest if they travel less than this many departures within the trim segment."""

MANOEUVRE, N_BEGUN, LENGTH, DEPARTED, N_SINCE, N_REST, N_FLOWN, N_CALM, HAS_TRIM, BEYOND = range(10)
N_COUNT = 10
"""Numbers of `counts`: the manoeuvre in progress, 0 at rest; manoeuvres begun; its samples;
samples departed; samples since trim was measured; samples in each memory; whether trim was measured
since the last manoeuvre; N_REST at the newest sample of the rest beyond a limit, 0 for none."""


class TrimRule(NamedTuple):
    """surfaces: (k,) columns of the surfaces.   threshold: (k,) departure of each [SI].
    moving: (n_channels,) a channel that moves further within the calm memory has no trim.
    absolute: (n_channels,) whether the limits of a channel apply to its value with trim.
    n_trim, n_between: samples of the rest that count, between two measurements.
    n_most: longest manoeuvre, if it is known; else 0.   n_settling: its shortest length if not.
    n_usual: memory of the usual motion [samples].
    """

    surfaces: Indices
    threshold: Array
    moving: Array
    absolute: Flags
    n_trim: int
    n_between: int
    n_most: int
    n_settling: int
    n_usual: int


class TrimState(NamedTuple):
    """counts: (N_COUNT,).   trim: (n_channels,) NaN where unknown.   low, high: (n_channels,) of
    the limits that apply.   limits: (k,) of a departure.
    usual: (k,) mean square of the motion about the trim at rest.
    rest, calm: (n, n_channels), flown: (n, k) the newest samples of the rest, of all, and of the
    manoeuvre's surfaces; each begins again at its end.
    """

    counts: Indices
    trim: Array
    low: Array
    high: Array
    limits: Array
    usual: Array
    rest: Array
    calm: Array
    flown: Array


@jit
def follow(rule, state, y, first, levels):
    """Follow samples from number `first` on, up to one with which a manoeuvre begins or is over.

    y: (n, n_channels) [SI].   levels: (n, n_channels) filled, see `level`.   Returns the number
    after it, or n.
    """
    for i in range(first, y.shape[0]):
        before = state.counts[MANOEUVRE]
        _update(rule, state, y[i])
        level(rule, state, levels[i])
        if state.counts[MANOEUVRE] != before:
            return i + 1
    return y.shape[0]


@brief
def follow_one(rule, state, y):
    """Follow one sample (n_channels,). Returns whether a manoeuvre begins with it."""
    before = state.counts[MANOEUVRE]
    _update(rule, state, y)
    return state.counts[MANOEUVRE] != before and state.counts[MANOEUVRE] != 0


@jit
def level(rule, state, trim):
    """Fill in the last trim (n_channels,), NaN where unknown; 0 where it is not subtracted.

    At rest a trim that is itself beyond the limit is unknown: it may be an exceedance.
    """
    at_rest = state.counts[MANOEUVRE] == 0
    for c in range(trim.shape[0]):
        known = state.trim[c]
        if rule.absolute[c]:
            trim[c] = 0.0
        elif at_rest and (known <= state.low[c] or known >= state.high[c]):
            trim[c] = np.nan
        else:
            trim[c] = known


@jit
def begin(rule, state):
    """Begin a manoeuvre with the trim so far. Returns False during a manoeuvre."""
    counts = state.counts
    if counts[MANOEUVRE] > 0:
        return False
    if not counts[HAS_TRIM]:
        first = max(0, counts[N_REST] - state.rest.shape[0])
        if counts[BEYOND] < counts[N_REST]:
            first = max(first, counts[BEYOND])
        _set_trim(rule, state, first, min(counts[N_REST] - first, rule.n_trim))
    counts[HAS_TRIM] = 1
    counts[N_BEGUN] += 1
    counts[MANOEUVRE] = counts[N_BEGUN]
    counts[DEPARTED] = counts[LENGTH] = counts[N_FLOWN] = 0
    return True


@jit
def _update(rule, state, y):
    counts = state.counts
    _remember(state.calm, counts, np.int64(N_CALM), y)
    if counts[MANOEUVRE] and not _is_over(rule, state, y):
        return
    if counts[HAS_TRIM] and _departs(rule, state, y):
        begin(rule, state)
        return
    _remember(state.rest, counts, np.int64(N_REST), y)
    if _exceeds(rule, state, y):
        counts[BEYOND] = counts[N_REST]
    counts[N_SINCE] += 1
    within = counts[N_REST] - counts[BEYOND]
    if counts[N_SINCE] >= rule.n_between and within >= state.rest.shape[0]:
        counts[N_SINCE] = 0
        _measure(rule, state)


@jit
def _exceeds(rule, state, y):
    """Whether a sample exceeds a limit from the trim so far, if that itself is within."""
    for c in range(y.shape[0]):
        low, high = state.low[c], state.high[c]
        trim = 0.0 if rule.absolute[c] else state.trim[c]
        is_known = rule.absolute[c] or low < trim < high
        if is_known and (y[c] - trim <= low or y[c] - trim >= high):
            return True
    return False


@jit
def _remember(memory, counts, which, y):
    memory[counts[which] % memory.shape[0]] = y
    counts[which] += 1


@jit
def _departs(rule, state, y):
    """Whether a surface has left its trim."""
    departed = False
    for k in range(rule.surfaces.shape[0]):
        c = rule.surfaces[k]
        moved = abs(y[c] - state.trim[c])
        departed |= moved > state.limits[k]
        if moved <= state.limits[k]:
            state.usual[k] += (moved * moved - state.usual[k]) / rule.n_usual
    state.counts[DEPARTED] = state.counts[DEPARTED] + 1 if departed else 0
    return state.counts[DEPARTED] >= DEPARTED_SAMPLES


@jit
def _measure(rule, state):
    """Measure trim from the rest without its newest part; unknown while the surfaces move."""
    rests = True
    for k in range(rule.surfaces.shape[0]):
        known, lowest, highest, deviation = _spread(state.rest, state.counts[N_REST], rule, k)
        if known == 0:
            continue
        rests &= known == rule.n_trim
        usual = min(NOISES * np.sqrt(state.usual[k]), LARGEST * rule.threshold[k])
        state.limits[k] = max(rule.threshold[k], NOISES * deviation, usual)
        rests &= highest - lowest <= TRAVEL * rule.threshold[k]
    if rests:
        _set_trim(rule, state, state.counts[N_REST] - state.rest.shape[0], rule.n_trim)
        state.counts[HAS_TRIM] = 1
    elif state.counts[DEPARTED] == 0:
        state.counts[HAS_TRIM] = 0


@jit
def _spread(rest, n_rest, rule, k):
    """Known values, lowest, highest and standard deviation of a surface in the counted rest."""
    known, lowest, highest, total, size = 0, np.inf, -np.inf, 0.0, rest.shape[0]
    for i in range(rule.n_trim):
        value = rest[(n_rest + i) % size, rule.surfaces[k]]
        if np.isfinite(value):
            known += 1
            lowest, highest, total = min(lowest, value), max(highest, value), total + value
    mean, squares = total / max(known, 1), 0.0
    for i in range(rule.n_trim):
        value = rest[(n_rest + i) % size, rule.surfaces[k]]
        if np.isfinite(value):
            squares += (value - mean) ** 2
    return known, lowest, highest, np.sqrt(squares / max(known, 1))


@jit
def _set_trim(rule, state, first, n):
    """Trim of each channel: the mean of n samples of the rest from number `first` on.

    A channel that moves before the newest part keeps the trim of an earlier rest; without one it
    is unknown.
    """
    size = state.rest.shape[0]
    guard = size - rule.n_trim
    for c in range(state.trim.shape[0]):
        if _moves(state.calm, state.counts[N_CALM], guard, c, rule.moving[c]):
            continue
        total, known = 0.0, 0
        for i in range(n):
            value = state.rest[(first + i) % size, c]
            if np.isfinite(value):
                total += value
                known += 1
        state.trim[c] = total / known if known else np.nan


@jit
def _moves(calm, n_calm, guard, c, most):
    """Whether a channel moves further than `most` over the calm memory, by its known values.

    guard: newest samples that do not count, since a departure may have begun.
    """
    if most == np.inf:
        return False
    lowest, highest, size = np.inf, -np.inf, calm.shape[0]
    at = max(0, n_calm - size) % size
    for _ in range(max(0, n_calm - size), n_calm - guard):
        value = calm[at, c]
        lowest = value if value < lowest else lowest
        highest = value if value > highest else highest
        at = at + 1 if at + 1 < size else 0
    return highest - lowest > most


@jit
def _is_over(rule, state, y):
    """Whether the manoeuvre ended before this sample; then trim is measured again."""
    counts = state.counts
    counts[LENGTH] += 1
    size = state.flown.shape[0]
    for k in range(rule.surfaces.shape[0]):
        value = y[rule.surfaces[k]]
        state.flown[counts[N_FLOWN] % size, k] = value if np.isfinite(value) else 0.0
    counts[N_FLOWN] += 1
    if rule.n_most:
        over = counts[LENGTH] > rule.n_most
    else:
        over = counts[LENGTH] > rule.n_settling and _rests(rule, state)
    if over:
        counts[MANOEUVRE] = counts[HAS_TRIM] = counts[N_REST] = counts[BEYOND] = 0
    return over


@jit
def _rests(rule, state):
    if state.counts[N_FLOWN] < state.flown.shape[0]:
        return False
    for k in range(rule.surfaces.shape[0]):
        if np.ptp(state.flown[:, k]) > TRAVEL * rule.threshold[k]:
            return False
    return True
