"""Scores of the coming peak of a manoeuvre, linear in the samples so far.

A phase counts samples since the input began. Each phase has its own weights; if a sample that they
need is missing, there is no score.
"""

from typing import NamedTuple

import numpy as np

from core.kernels.assessing import INVALID, OK, STALE, WARMING_UP
from core.kernels.compiled import brief, in_chunks, jit
from core.types import Array, Indices

FLIGHTS_A_TASK = 32
NONE = np.inf
"""Score before the input begins and after the last phase."""
BEFORE = -1
TAKEN, PHASE, SIGN, MISSING, LOST = range(5)
"""Counts of a flight: samples; phase of the last one, or BEFORE the input began; sign of the
input; whether the last sample was missing; whether the begin of the input was missed."""


class PeakWeights(NamedTuple):
    """Weights of the scores.

    weights: (n_scored, n_past, n_channels) of the samples, newest first, `stride` samples apart.
    offset: (n_scored,).   every: samples between scored phases; phases between use the last score.
    surface: channel that shows when the input begins; -1: at the first sample.
    threshold: deviation from `rest` at which the input has begun, in the SI unit.
    mirrored: whether an input to the other side is the mirror image, so that all samples of the
    flight change sign.
    """

    weights: Array
    offset: Array
    every: int
    stride: int
    surface: int
    threshold: float
    rest: float = 0.0
    mirrored: bool = True


class PeakHistory(NamedTuple):
    """Memory of one flight.

    samples: (n, n_channels) of the last n phases, with the sign of the input.   phases: (n,) of
    each, BEFORE for none.   counts: see TAKEN.   clock: (1,) time of the last sample [s].
    """

    samples: Array
    phases: Indices
    counts: Indices
    clock: Array


@jit
def begin(peaks):
    """History before the first sample."""
    n_channels = peaks.weights.shape[2]
    n = (peaks.weights.shape[1] - 1) * peaks.stride + peaks.every
    counts = np.zeros(5, np.int64)
    counts[PHASE] = BEFORE
    return PeakHistory(np.zeros((n, n_channels)), np.full(n, BEFORE), counts, np.zeros(1))


@jit
def _add_sample(peaks, history, y, known):
    """Add the next sample y (n_channels,), which may be unknown."""
    counts = history.counts
    if counts[PHASE] >= 0:
        counts[PHASE] += 1
    elif peaks.surface < 0:
        counts[PHASE], counts[SIGN] = counts[TAKEN], 1
    elif known and abs(y[peaks.surface] - peaks.rest) >= peaks.threshold:
        if counts[TAKEN] == 0 or counts[MISSING] != 0:
            counts[LOST] = 1
        counts[PHASE], counts[SIGN] = 0, 1
        if peaks.mirrored and not y[peaks.surface] > peaks.rest:
            counts[SIGN] = -1
    counts[TAKEN] += 1
    counts[MISSING] = 0 if known else 1
    if known and counts[PHASE] >= 0:
        at = counts[PHASE] % history.phases.shape[0]
        history.phases[at] = counts[PHASE]
        for c in range(y.shape[0]):
            history.samples[at, c] = counts[SIGN] * y[c]


@jit
def _score(peaks, history):
    """Score at the last sample; NaN if a sample that it needs is missing."""
    phase, n = history.counts[PHASE], history.phases.shape[0]
    k = phase // peaks.every
    if phase < 0 or k >= peaks.offset.shape[0]:
        return NONE
    s = peaks.offset[k]
    for j in range(peaks.weights.shape[1]):
        past = k * peaks.every - j * peaks.stride
        if past < 0:
            break
        at = past % n
        if history.phases[at] != past:
            return np.nan
        for c in range(peaks.weights.shape[2]):
            s += peaks.weights[k, j, c] * history.samples[at, c]
    return s


@brief
def update(peaks, history, dt, t, y, code):
    """Process one sample of a flight; returns its score, NaN for none, and its state.

    code: state before; the result is WARMING_UP if a sample that the score needs is missing.
    The flight is lost (counts[LOST]) if the begin of the input was missed.
    """
    counts, clock = history.counts, history.clock
    if code == STALE or counts[LOST] != 0:
        return np.nan, code
    if counts[TAKEN] > 0 and np.isfinite(t):
        skipped = max(int(round((t - clock[0]) / dt)) - 1, 0)
        counts[TAKEN] += skipped
        if skipped > 0:
            counts[MISSING] = 1
            if counts[PHASE] >= 0:
                counts[PHASE] += skipped
    if np.isfinite(t):
        clock[0] = t
    _add_sample(peaks, history, y, code != INVALID)
    if code != OK or counts[LOST] != 0:
        return np.nan, code
    s = _score(peaks, history)
    return s, (WARMING_UP if np.isnan(s) else OK)


@jit
def follow(peaks, t, y, codes, dt, s):
    """Score a trajectory as `update` does sample by sample; returns the first lost sample.

    t: (n,).   y: (n, n_channels).   codes: (n,) in and out.   s: (n,) output.   Returns n for none.
    """
    history = begin(peaks)
    for i in range(t.shape[0]):
        s[i], codes[i] = update(peaks, history, dt, t[i], y[i], codes[i])
        if history.counts[LOST] != 0:
            s[i:] = np.nan
            return i
    return t.shape[0]


@jit
def _scores_some(peaks, y, last, start, stop, scores):
    for i in range(start, stop):
        history = begin(peaks)
        for t in range(last[i] + 1):
            _add_sample(peaks, history, y[i, t], np.bool_(True))
            if history.counts[LOST] != 0:
                break
            scores[i, t] = _score(peaks, history)


def scores(peaks: PeakWeights, y: Array, last: Indices) -> Array:
    """Scores (n, n_samples) of samples 0..last of each flight; +inf for the rest.

    y: (n, n_samples, n_channels), finite over samples 0..last.   last: (n,).
    """
    all_scores = np.full(y.shape[:2], np.inf)
    in_chunks(len(y), FLIGHTS_A_TASK, lambda a, b: _scores_some(peaks, y, last, a, b, all_scores))
    return all_scores
