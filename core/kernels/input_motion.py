"""The newest samples of a source: how far they move, and which ones repeat a sample or a time."""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import brief, inlined, jit
from core.types import Array, Flags, Indices

REACTS_S, SWINGS_S = 1.0, 3.0
"""The aircraft moves within the first window [s]; within the second it passes half a swing."""
KEPT = 160
"""Samples looked at: SWINGS_S of a fast source."""
GROWS = 2.0
"""A motion that no surface explains grows by this factor over the smallest one since."""

APART_S = 0.019
"""Least time between two samples that are looked at [s]; a faster source has more."""
LOOK_S, FIRST_LOOK = 0.1, 8
"""Time between two looks at the recent samples [s], and the least samples that show the noise."""
REMEMBERED = 1024
"""Newest samples that a later one may contradict."""
SAME_TIMES = 1e6
"""Parts of a second in which two times are equal."""

NEWEST, LOOKED, SINCE, LATEST = range(4)
"""Numbers of `times` [s]: newest sample looked at, last look, first of the identical samples, and
the latest time in parts of a second."""
FROZEN_S, FEWEST = 1.0, 3
"""Identical samples for longer than this [s], and more than this many, are frozen."""
VALUE, SINCE_T, HELD, LONGEST, CHANGES, LEAST, TOTAL, IS_FROZEN = range(8)
LOW, LOW_RUNS, HIGH, HIGH_RUNS, IS_AT_STOP, N_RUN = range(8, 14)
"""Numbers of a channel: newest value, when it came [s], samples with it, most samples with one
value before, number of changes, the least one, the sum of their sizes, and whether it is frozen;
its least value, how often it came to it, the same of its largest, and whether it is at a stop."""
WIDE = 20.0
"""A stop is an end of the range so far to which a channel comes twice, or whose other end is as far
from 0. The range is at least this many of its least changes: one at rest has no stop."""
MANY, LONGER, COARSE = 50, 3.0, 1.5
"""A channel with this many changes is frozen if its value lasts that many times longer than any
before. One that changes by less than COARSE steps on average may rest between two steps."""

N_RECENT, N_SAME, N_KNOWN = range(3)
"""Numbers of `counts`: samples in t and y, newest identical samples, and samples remembered."""
LOOKS, SAME, GOES_ON, HOLDS = 1, 2, 4, 8
"""Flags of a sample: it is time to look, it is identical to the last one, it is the latest, a
channel is frozen."""


class SurfaceRule(NamedTuple):
    """controls, outputs: their channels.   moves: (n_outputs,) motion of the aircraft.
    is_planned: (n_controls,).   least: least motion of a surface.   least_if_dead: (n_controls,)
    the same as long as a planned surface may be dead."""

    controls: Indices
    outputs: Indices
    moves: Array
    is_planned: Flags
    least: float
    least_if_dead: Array


class SurfaceState(NamedTuple):
    """has_changed: (n_controls,).   quiet: (n_outputs,) smallest swing since a surface moved.
    moved: (1,) when that was [s]."""

    has_changed: Flags
    quiet: Array
    moved: Array


class NewestSamples(NamedTuple):
    """The newest samples of a source, by time and by arrival.

    t: (2 KEPT,) [s].   y: (2 KEPT, n_channels).   times, counts: see above.   last: (n_channels,)
    bits of the newest sample.   runs: (n_channels, N_RUN) see above.   at: (REMEMBERED,) times in
    parts of a second.   sources: (REMEMBERED,).   known: (REMEMBERED, n_channels).
    """

    t: Array
    y: Array
    times: Array
    counts: Indices
    last: Indices
    runs: Array
    at: Array
    sources: Indices
    known: Array


@brief
def arrive(state, t, y, source):
    """Add a received sample. t: [s].   y: (n_channels,).   source: its number.

    Returns its flags, and the slot of `known` whose time it repeats, or -1.
    """
    times, counts, flags, repeated = state.times, state.counts, 0, -1
    bits, is_same = y.view(np.int64), True
    for c in range(bits.shape[0]):
        is_same &= bits[c] == state.last[c]
        state.last[c] = bits[c]
        if not np.isnan(y[c]):
            _note_value(state.runs[c], t, y[c])
        if state.runs[c, IS_FROZEN]:
            flags |= HOLDS
    if is_same and counts[N_SAME] > 0:
        counts[N_SAME], flags = counts[N_SAME] + 1, flags | SAME
    else:
        counts[N_SAME], times[SINCE] = 1, t
    if _is_looked_at(state, t, y):
        flags |= LOOKS
    at, n = np.rint(t * SAME_TIMES), counts[N_KNOWN]
    if at <= times[LATEST]:
        for i in range(min(n, REMEMBERED)):
            if state.at[i] == at:
                repeated = i
    if repeated < 0:
        slot = n % REMEMBERED
        state.at[slot], state.sources[slot], state.known[slot] = at, source, y
        counts[N_KNOWN] = n + 1
        if at > times[LATEST]:
            times[LATEST], flags = at, flags | GOES_ON
    return flags, repeated


@jit
def arrive_together(state, t, y, first, measured):
    """Add received samples from number `first` on, up to one in which something may be frozen, or
    that comes REACTS_S after `measured` [s].

    t: (n,) [s].   y: (n, n_channels).   Returns the number after it, or n, and the flags of the
    last one.
    """
    flags = 0
    for i in range(first, t.shape[0]):
        flags, _ = arrive(state, t[i], y[i], 0)
        if flags & (SAME | HOLDS) or t[i] - measured >= REACTS_S:
            return i + 1, flags
    return t.shape[0], flags


@inlined
def _note_value(run, t, y):
    """Whether the value of a channel lasts for longer than ever. run: (N_RUN,) see `VALUE`."""
    if y == run[VALUE] and run[HELD] > 0:
        run[HELD] += 1
        run[IS_FROZEN] = (
            run[HELD] > max(FEWEST, LONGER * run[LONGEST])
            and t - run[SINCE_T] > FROZEN_S
            and run[CHANGES] >= MANY
            and run[TOTAL] >= COARSE * run[LEAST] * run[CHANGES]
        )
        return
    if run[HELD] > 0:
        change = abs(y - run[VALUE])
        run[LEAST] = min(run[LEAST], change) if run[CHANGES] > 0 else change
        run[CHANGES], run[TOTAL] = run[CHANGES] + 1, run[TOTAL] + change
        if not (run[IS_FROZEN] or run[IS_AT_STOP]):
            run[LONGEST] = max(run[LONGEST], run[HELD])
    if run[HELD] == 0 or y < run[LOW]:
        run[LOW], run[LOW_RUNS] = y, 0
    if run[HELD] == 0 or y > run[HIGH]:
        run[HIGH], run[HIGH_RUNS] = y, 0
    run[LOW_RUNS] += y == run[LOW]
    run[HIGH_RUNS] += y == run[HIGH]
    times = run[LOW_RUNS] if y == run[LOW] else run[HIGH_RUNS] if y == run[HIGH] else 0
    run[IS_AT_STOP] = (
        times > 0
        and (times > 1 or run[LOW] == -run[HIGH])
        and run[HIGH] - run[LOW] > WIDE * run[LEAST]
    )
    run[VALUE], run[SINCE_T], run[HELD], run[IS_FROZEN] = y, t, 1, 0


@inlined
def _is_looked_at(state, t, y):
    """Keep a sample that is far enough from the last one. Returns whether it is time to look."""
    times, counts = state.times, state.counts
    if t - times[NEWEST] < APART_S:
        return False
    if counts[N_RECENT] == state.t.shape[0]:
        counts[N_RECENT] = KEPT
        state.t[:KEPT], state.y[:KEPT] = state.t[KEPT:], state.y[KEPT:]
    n = counts[N_RECENT]
    state.t[n], state.y[n] = t, y
    counts[N_RECENT], times[NEWEST] = n + 1, t
    if n + 1 < FIRST_LOOK or t - times[LOOKED] < LOOK_S:
        return False
    times[LOOKED] = t
    return True


@brief
def roughness(t, y, n, bends, steps):
    """Fill in the median bend and the smallest change of each channel over SWINGS_S.

    t: (m,) [s].   y: (m, n_channels).   n: samples in them.   bends, steps: (n_channels,); a bend
    is NaN where most samples are unknown, a step 0 where nothing changes.   Returns the number of
    samples.
    """
    first = _first(t, n, SWINGS_S)
    if n - first < 3:
        return n - first
    bent = np.empty(n - first - 2)
    for c in range(y.shape[1]):
        steps[c] = np.inf
        for i in range(first + 1, n):
            change = abs(y[i, c] - y[i - 1, c])
            if 0.0 < change < steps[c]:
                steps[c] = change
        if steps[c] == np.inf:
            steps[c] = 0.0
        for i in range(first + 2, n):
            bent[i - first - 2] = abs(y[i, c] - 2.0 * y[i - 1, c] + y[i - 2, c])
        bends[c] = np.sort(bent)[len(bent) // 2]
    return n - first


@brief
def look(rule, state, t, y, n, uncertainty, since):
    """Whether the aircraft moves while its surfaces rest.

    t, y, n: see `roughness`.   uncertainty: (n_channels,) motion that is noise and resolution.
    since: when it began to [s]; NaN if it did not.   Returns the new one.
    """
    now, reacts = t[n - 1], _first(t, n, REACTS_S)
    all_changed, surface_moves = True, False
    for k in range(rule.controls.shape[0]):
        state.has_changed[k] |= _extent(y, reacts, n, rule.controls[k]) > 0.0
        all_changed &= state.has_changed[k] or not rule.is_planned[k]
    for k in range(rule.controls.shape[0]):
        c = rule.controls[k]
        least = rule.least if all_changed else rule.least_if_dead[k]
        surface_moves |= _extent(y, reacts, n, c) > np.fmax(least, uncertainty[c])
    if surface_moves:
        state.moved[0], since = now, np.nan
    if now - state.moved[0] < SWINGS_S:
        state.quiet[:] = np.inf
        return since
    moves, swings, swing_first = False, False, _first(t, n, SWINGS_S)
    for k in range(rule.outputs.shape[0]):
        c = rule.outputs[k]
        swing = _extent(y, swing_first, n, c)
        state.quiet[k] = np.fmin(state.quiet[k], swing)
        least = np.fmax(rule.moves[k], uncertainty[c])
        moves |= _extent(y, reacts, n, c) > least and swing > GROWS * state.quiet[k]
        swings |= swing > rule.moves[k]
    if np.isnan(since):
        return now if moves else np.nan
    return since if swings else np.nan


@inlined
def _first(t, n, seconds):
    """First sample of the last seconds, of at most KEPT."""
    first, since = n, t[n - 1] - seconds - 1e-9
    while first > max(0, n - KEPT) and t[first - 1] >= since:
        first -= 1
    return first


@inlined
def _extent(y, first, n, c):
    """Largest less smallest value of a channel; NaN where all are unknown."""
    low, high = np.inf, -np.inf
    for i in range(first, n):
        low, high = np.fmin(low, y[i, c]), np.fmax(high, y[i, c])
    return high - low if high >= low else np.nan
