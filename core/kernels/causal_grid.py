"""Puts received samples on an even grid of times, using only those received by then.

One compiled state machine serves a live source, one sample at a time, and a recording, all rows at
once: both give the same bits.
"""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import brief, inlined, jit
from core.types import Array, Indices

ON_GRID = 1e-6
"""Part of an interval: a sample this close to a grid time is used as it is, bit for bit."""
FASTER = 0.75
"""Part of the grid's interval: a faster source is averaged over two intervals."""
STEP_S = 1.0
"""A source time that runs further ahead of its arrival is a clock step [s]."""
BACK_S, BACK_SAMPLES = 0.25, 3
"""After this time [s] and this many samples with only old or repeated times, the source has set its
clock back."""
INTERVALS, FEW_INTERVALS, REMEMBERED = 15, 3, 256
"""Source intervals that give its rate; fewer ones cannot make it slow; times remembered."""
GAP_RATIO = 1.5
"""A longer step between samples, in usual steps, is a gap."""
RATE_RATIO = 1.5
"""Longest interval of a source, in steps of the grid."""

DT, DELAY, GRID, NEWEST, NEWEST_ARRIVED, OFFSET, INTERVAL = range(7)
LEAP_ARRIVED, LEAP_T, BACK_BEGUN, BACK_LAST, DUE = range(7, 12)
N_CLOCK = 12
"""Numbers of `clock`; NaN where there is none: no grid before the first sample, no held sample, no
grid time that waits (DUE is the arrival time at which it is given up)."""
START, STOP, N_STEPS, N_RECENT, N_LATE, N_BACK, N_RECEIVED, LEAP_NUMBER = range(8)
ACCEPTED, REPEATED, OUT_OF_ORDER, LATE, MISSING, CLOCK_STEPS, IMPLAUSIBLE = range(8, 15)
N_COUNT = 15
"""Numbers of `counts`. Rows START to STOP wait; the others count samples by kind."""
T, ARRIVED, NUMBER, VALUES = range(4)
"""Columns of a waiting row; the values are last."""
SHOWN, FAULT, ABOUT, SETTLED_VALUES = 1, 3, 4, 7
"""Columns of a settled sample beside T and NUMBER; the values are last."""
FINE, SLOW_SOURCE, TOO_MANY_LATE = range(3)
"""Whether a settled sample is known, and why not."""
MADE = -1
"""Number of a settled sample that is no received one."""


class GridState(NamedTuple):
    """The state of one source, in few arrays, since each call counts references to all of them.

    clock: (N_CLOCK + k,), the values of the held sample last.   counts: (N_COUNT,).
    rows: (n, VALUES + k) the waiting rows by time: time, arrival [s], number, values; the first
    n_channels values are averaged, the others taken from the nearest row.
    steps: (2, INTERVALS) the newest intervals by arrival, and by length [s].
    recent: (REMEMBERED, 1 + n_channels) newest samples: time [s], channels.
    late: (REMEMBERED,) times of late samples [s].
    """

    clock: Array
    counts: Indices
    rows: Array
    steps: Array
    recent: Array
    late: Array


@jit
def receive(state, settled, arrived, t, values, first, flight_t):
    """Add received samples from number `first` on.

    settled: (n, SETTLED_VALUES + k) filled: time, arrival time at which it was settled [s], number
    of the received sample that it is, or MADE, fault; where it is not FINE, the interval [s], late
    samples and all samples; values.
    arrived, t: (n,) [s].   values: (n, k).   flight_t: (n, 2) filled with the flight time of each
    sample, and whether the source's time is plausible; if not, it is by arrival.
    Returns (next sample to add, settled samples, room that the next one may need).
    """
    n = np.int64(0)
    for i in range(first, t.shape[0]):
        n, room, flight_t[i, 0], flight_t[i, 1] = _receive(
            state, settled, n, arrived[i], t[i], values[i]
        )
        if room:
            return i, n, room
    return t.shape[0], n, 0


@brief
def receive_one(state, settled, arrived, t, y, phi, theta, psi, values):
    """Add one received sample. y: (k - 3,) its channels.   values: (k,) room for all its values.

    Returns (settled samples, room that it needs before it can be added, 0 once it is added, flight
    time, whether the source's time is plausible).
    """
    n = y.shape[0]
    for c in range(n):
        values[c] = y[c]
    values[n], values[n + 1], values[n + 2] = phi, theta, psi
    return _receive(state, settled, np.int64(0), arrived, t, values)


@inlined
def _receive(state, settled, n, arrived, t, values):
    clock = state.clock
    while clock[DUE] <= arrived:
        n, is_full = _advance(state, settled, n, clock[DUE])
        if is_full:
            return n, settled.shape[0] + 1, np.nan, 0.0
    room = _room_for(state)
    if n + room > settled.shape[0]:
        return n, room, np.nan, 0.0
    if state.counts[STOP] + 2 > state.rows.shape[0] and not _compact(state):
        return n, -1, np.nan, 0.0
    flight_t, is_plausible = _flight_time(state, arrived, t)
    if _add(state, arrived, t, values):
        n, _ = _advance(state, settled, n, arrived)
    return n, 0, flight_t, is_plausible


@brief
def advance(state, settled, now):
    """Settle what is due at a time [s]. Returns (samples, whether there may be more)."""
    n = np.int64(0)
    while state.clock[DUE] <= now:
        n, is_full = _advance(state, settled, n, state.clock[DUE])
        if is_full:
            return n, True
    return n, False


@inlined
def _room_for(state):
    """Samples that the next received one may settle, at most."""
    clock, counts = state.clock, state.counts
    if np.isnan(clock[GRID]):
        return 4
    each = GAP_RATIO * max(clock[INTERVAL], clock[DT]) / clock[DT] + 1.0
    waiting = each * (counts[STOP] - counts[START] + 1)
    ahead = max(0.0, clock[NEWEST] - clock[GRID]) / clock[DT]
    return int(min(waiting, ahead) + each) + 8


@jit
def _compact(state):
    """Move the waiting rows to the front; false if they fill all the room."""
    start, stop = state.counts[START], state.counts[STOP]
    if start == 0:
        return False
    for i in range(start, stop):
        state.rows[i - start] = state.rows[i]
    state.counts[START], state.counts[STOP] = 0, stop - start
    return stop - start + 2 <= state.rows.shape[0]


@inlined
def _flight_time(state, arrived, t):
    clock = state.clock
    t += clock[OFFSET]
    expected = clock[NEWEST] + arrived - clock[NEWEST_ARRIVED]
    if np.isnan(clock[GRID]):
        return (t, 1.0) if _can_begin(clock, t) else (arrived, 0.0)
    if t <= expected + STEP_S:
        return t, 1.0
    return expected, 0.0


@inlined
def _can_begin(clock, t):
    """Whether times near t are fine enough for a grid: not those in nanoseconds since 1970."""
    return t + clock[DT] > t


@jit
def values_at(at, t, x, step, usual):
    """A channel at the times of another clock, as the grid would take it; NaN across gaps.

    at: (n,) increasing [s].   t, x: (m,) its samples, increasing in time.   step, usual: the usual
    interval of `at` and of t [s].
    """
    values, following, gap = np.empty(at.shape[0]), 0, GAP_RATIO * max(step, usual)
    first = stop = 0
    for k in range(at.shape[0]):
        while following < t.shape[0] and t[following] < at[k] - ON_GRID * step:
            following += 1
        values[k] = np.nan
        if following == t.shape[0]:
            continue
        if abs(t[following] - at[k]) <= ON_GRID * step and usual > FASTER * step:
            values[k] = x[following]
        elif following > 0 and t[following] - t[following - 1] <= gap:
            if usual <= FASTER * step:
                while first < t.shape[0] and t[first] < at[k] - step:
                    first += 1
                while stop < t.shape[0] and t[stop] < at[k] + step:
                    stop += 1
                tau = t[first:stop] - at[k]
                weights = 1.0 + np.cos(np.pi * tau / step)
                values[k] = _local_line(tau, x[first:stop], weights)
            else:
                before, after = t[following - 1], t[following]
                share = (at[k] - before) / (after - before)
                values[k] = x[following - 1] + share * (x[following] - x[following - 1])
        elif t[following] == at[k]:
            values[k] = x[following]
    return values


# --- the source's clock ---------------------------------------------------------------------------


@jit
def _add(state, arrived, t_sent, values):
    """Add a received sample. Returns whether it is accepted."""
    clock, counts = state.clock, state.counts
    number = counts[N_RECEIVED]
    counts[N_RECEIVED] += 1
    t = t_sent + clock[OFFSET]
    if np.isnan(clock[GRID]):
        if _can_begin(clock, t):
            return _accept(state, arrived, t, values, number)
        counts[IMPLAUSIBLE] += 1
        return False
    known = _recent(state, t)
    if known >= 0:
        if _equal(state.recent[known, 1:], values):
            counts[REPEATED] += 1
            return False
        return _went_back(state, arrived, t_sent, values, number)
    if t - clock[NEWEST] > arrived - clock[NEWEST_ARRIVED] + STEP_S:
        return _leapt(state, arrived, t_sent, values, number)
    if t <= clock[GRID] - clock[DT]:
        return _went_back(state, arrived, t_sent, values, number)
    if not np.isnan(clock[LEAP_T]):
        clock[LEAP_T] = np.nan
        counts[IMPLAUSIBLE] += 1
    clock[BACK_BEGUN] = np.nan
    return _accept(state, arrived, t, values, number)


@inlined
def _recent(state, t):
    """Place of a recent sample with this time, the newest first; -1 if there is none."""
    if t > state.clock[NEWEST]:
        return -1
    n = state.counts[N_RECENT]
    for back in range(1, min(n, REMEMBERED) + 1):
        place = (n - back) % REMEMBERED
        if state.recent[place, 0] == t:
            return place
    return -1


@jit
def _equal(known, values):
    for c in range(known.shape[0]):
        if not (known[c] == values[c] or (np.isnan(known[c]) and np.isnan(values[c]))):
            return False
    return True


@jit
def _leapt(state, arrived, t, values, number):
    """A time far ahead is accepted once the next sample follows it."""
    clock, counts = state.clock, state.counts
    held_t, held_arrived = clock[LEAP_T], clock[LEAP_ARRIVED]
    if not 0.0 < t - held_t < STEP_S:
        if not np.isnan(held_t):
            counts[IMPLAUSIBLE] += 1
        clock[LEAP_ARRIVED], clock[LEAP_T], counts[LEAP_NUMBER] = arrived, t, number
        clock[N_CLOCK:] = values
        return False
    clock[LEAP_T] = np.nan
    _step(state, held_arrived, held_t)
    offset, held = clock[OFFSET], counts[LEAP_NUMBER]
    _accept(state, held_arrived, held_t + offset, clock[N_CLOCK:], held)
    return _accept(state, arrived, t + offset, values, number)


@jit
def _went_back(state, arrived, t, values, number):
    """A past time is late, unless the source sends only such times: then its clock stepped."""
    clock, counts = state.clock, state.counts
    if np.isnan(clock[BACK_BEGUN]) or t <= clock[BACK_LAST]:
        clock[BACK_BEGUN], counts[N_BACK] = arrived, 0
    clock[BACK_LAST] = t
    counts[N_BACK] += 1
    if counts[N_BACK] < BACK_SAMPLES or arrived - clock[BACK_BEGUN] < BACK_S:
        counts[LATE] += 1
        state.late[counts[N_LATE] % REMEMBERED] = t + clock[OFFSET]
        counts[N_LATE] += 1
        return False
    clock[BACK_BEGUN] = np.nan
    _step(state, arrived, t)
    return _accept(state, arrived, t + clock[OFFSET], values, number)


@jit
def _step(state, arrived, t):
    """After a step of the source's clock, time continues by arrival times after a gap."""
    clock, counts = state.clock, state.counts
    counts[CLOCK_STEPS] += 1
    passed = max(arrived - clock[NEWEST_ARRIVED], 2.0 * clock[DT])
    clock[OFFSET] = clock[NEWEST] + passed - t
    clock[GRID] = clock[NEWEST] + passed
    counts[START] = counts[STOP] = counts[N_RECENT] = counts[N_STEPS] = counts[N_LATE] = 0


# --- the grid -------------------------------------------------------------------------------------


@inlined
def _accept(state, arrived, t, values, number):
    clock, counts = state.clock, state.counts
    counts[ACCEPTED] += 1
    place = counts[N_RECENT] % REMEMBERED
    state.recent[place, 0] = t
    for c in range(state.recent.shape[1] - 1):
        state.recent[place, 1 + c] = values[c]
    counts[N_RECENT] += 1
    if np.isnan(clock[GRID]):
        clock[GRID] = t
    if t < clock[NEWEST]:
        counts[OUT_OF_ORDER] += 1
    else:
        if np.isfinite(clock[NEWEST]):
            _note_interval(state, t - clock[NEWEST])
        clock[NEWEST], clock[NEWEST_ARRIVED] = t, arrived
    at, rows = counts[STOP], state.rows
    while at > counts[START] and rows[at - 1, T] > t:
        rows[at] = rows[at - 1]
        at -= 1
    rows[at, T], rows[at, ARRIVED], rows[at, NUMBER] = t, arrived, number
    for c in range(values.shape[0]):
        rows[at, VALUES + c] = values[c]
    counts[STOP] += 1
    return True


@inlined
def _note_interval(state, step):
    """Update the usual interval: the lower median of the last steps."""
    clock, counts = state.clock, state.counts
    steps, ordered = state.steps[0], state.steps[1]
    place = counts[N_STEPS] % INTERVALS
    known = min(counts[N_STEPS], INTERVALS)
    if known == INTERVALS:
        known -= 1
        gone = 0
        while ordered[gone] != steps[place]:
            gone += 1
        for k in range(gone, known):
            ordered[k] = ordered[k + 1]
    at = known
    while at > 0 and ordered[at - 1] > step:
        ordered[at] = ordered[at - 1]
        at -= 1
    ordered[at], steps[place] = step, step
    counts[N_STEPS] += 1
    known += 1
    clock[INTERVAL] = ordered[(known - 1) // 2]
    if known < FEW_INTERVALS:
        clock[INTERVAL] = min(clock[INTERVAL], clock[DT])


@jit
def _advance(state, settled, n, now):
    """Settle grid times in order. Returns (settled samples, whether the room is full)."""
    clock = state.clock
    clock[DUE] = np.nan
    while not np.isnan(clock[GRID]) and _came_up_to(clock, state.counts, state.rows, clock[GRID]):
        if n == settled.shape[0]:
            clock[DUE] = now
            return n, True
        n += _settle(state, settled, n, clock[GRID], now)
        if not np.isnan(clock[DUE]):
            break
    return n, False


@inlined
def _settle(state, settled, n, grid, now):
    """Settle one grid time that samples have reached, or set DUE. Returns the samples, 0 or 1.

    Between neighbours too far apart is a gap, which is never bridged: after the longest wait the
    grid restarts with the first sample after it.
    """
    clock, counts = state.clock, state.counts
    dt, rows = clock[DT], state.rows
    following = _first_from(counts, rows, grid - ON_GRID * dt)
    t = rows[following, T]
    if clock[INTERVAL] <= FASTER * dt and following > counts[START]:
        is_early = clock[NEWEST] < grid + dt - clock[INTERVAL]
        if is_early and _waits(state, grid, following, now):
            return 0
        known = _average(state, settled, n, grid, following)
    elif abs(t - grid) <= ON_GRID * dt:
        known = _as_received(rows, settled, n, following)
    else:
        known = _between(state, settled, n, grid, following)
    if not known:
        if _waits(state, grid, following, now):
            return 0
        counts[MISSING] += max(1, int(np.rint((t - grid) / dt)))
        clock[GRID] = t
        counts[START] = following
        return 0
    settled[n, SHOWN], settled[n, FAULT] = now, FINE
    if clock[INTERVAL] > RATE_RATIO * dt:
        _too_few(state, settled, n)
    t = settled[n, T]
    clock[GRID] = t + dt
    if counts[STOP] - counts[START] > 1:
        counts[START] = max(counts[START], _first_from(counts, rows, t - dt) - 1)
    return 1


@inlined
def _as_received(rows, settled, n, row):
    settled[n, T], settled[n, NUMBER] = rows[row, T], rows[row, NUMBER]
    _copy_values(rows, settled, n, row)
    return True


@inlined
def _copy_values(rows, settled, n, row):
    for c in range(rows.shape[1] - VALUES):
        settled[n, SETTLED_VALUES + c] = rows[row, VALUES + c]


@jit
def _average(state, settled, n, grid, following):
    """Hann's average over the interval to either side, with a local line, against aliasing.

    Unknown values do not count. Returns whether the sample is known: not across a gap.
    """
    dt, counts, rows = state.clock[DT], state.counts, state.rows
    first, stop = _first_from(counts, rows, grid - dt), _first_from(counts, rows, grid + dt)
    if not first < following < stop:
        return _between(state, settled, n, grid, following)
    before, after = rows[following - 1, T], rows[following, T]
    if after - before > GAP_RATIO * dt:
        return False
    nearest = following if after - grid < grid - before else following - 1
    settled[n, T], settled[n, NUMBER] = grid, MADE
    _copy_values(rows, settled, n, nearest)
    tau = rows[first:stop, T] - grid
    weights = 1.0 + np.cos(np.pi * tau / dt)
    for c in range(state.recent.shape[1] - 1):
        x = rows[first:stop, VALUES + c]
        settled[n, SETTLED_VALUES + c] = _local_line(tau, x, weights)
    return True


@jit
def _local_line(times, x, weights):
    """Value at time 0 of the line through values; unknown ones do not count; NaN without any."""
    s0 = s1 = s2 = sum_x = sum_tx = 0.0
    for row in range(len(x)):
        if np.isfinite(x[row]):
            tau, w = times[row], weights[row]
            s0 += w
            s1 += tau * w
            s2 += tau * tau * w
            sum_x += w * x[row]
            sum_tx += tau * (w * x[row])
    if not s0 > 0.0:
        return np.nan
    determinant = s0 * s2 - s1 * s1
    if determinant <= 1e-12 * s0 * s2:
        return sum_x / s0
    return (s2 * sum_x - s1 * sum_tx) / determinant


@jit
def _between(state, settled, n, grid, following):
    """Interpolated between two neighbours; unknown across a gap or if they came too late."""
    clock, dt, rows = state.clock, state.clock[DT], state.rows
    t = rows[following, T]
    if following == state.counts[START]:
        return abs(t - grid) <= ON_GRID * dt and _as_received(rows, settled, n, following)
    before = rows[following - 1, T]
    is_gap = t - before > GAP_RATIO * max(clock[INTERVAL], dt)
    if is_gap or t - grid > clock[DELAY]:
        return False
    share = (grid - before) / (t - before)
    settled[n, T], settled[n, NUMBER] = grid, MADE
    _copy_values(rows, settled, n, following if share > 0.5 else following - 1)
    for c in range(state.recent.shape[1] - 1):
        y = rows[following - 1, VALUES + c]
        settled[n, SETTLED_VALUES + c] = y + share * (rows[following, VALUES + c] - y)
    return True


@jit
def _too_few(state, settled, n):
    """Mark a sample of a source that is too slow, or of which too many samples are late."""
    clock, counts = state.clock, state.counts
    known = min(counts[N_STEPS], INTERVALS)
    span = 0.0
    for k in range(known):
        span += state.steps[0, k]
    late = state.late[: min(counts[N_LATE], REMEMBERED)]
    n_late = _different(late, clock[NEWEST] - span, clock[NEWEST])
    is_late = span / (known + n_late) <= RATE_RATIO * clock[DT]
    settled[n, FAULT] = TOO_MANY_LATE if is_late else SLOW_SOURCE
    settled[n, ABOUT], settled[n, ABOUT + 1] = clock[INTERVAL], n_late
    settled[n, ABOUT + 2] = known + n_late
    settled[n, SETTLED_VALUES : SETTLED_VALUES + state.recent.shape[1] - 1] = np.nan


@jit
def _different(times, after, before):
    """Different times between two others."""
    n = 0
    for k in range(times.shape[0]):
        is_new = after < times[k] < before
        for earlier in range(k):
            is_new &= times[earlier] != times[k]
        n += is_new
    return n


@inlined
def _came_up_to(clock, counts, rows, grid):
    """Whether a sample at or after a grid time was received."""
    last = counts[STOP] - 1
    return last >= counts[START] and rows[last, T] >= grid - ON_GRID * clock[DT]


@inlined
def _first_from(counts, rows, t):
    """First waiting row at or after a time [s]."""
    low, high = counts[START], counts[STOP]
    while low < high:
        middle = (low + high) // 2
        if rows[middle, T] < t:
            low = middle + 1
        else:
            high = middle
    return low


@jit
def _waits(state, grid, following, now):
    """Whether a grid time may wait for samples: up to DELAY after the first arrival that passed it.

    Sets DUE if so.
    """
    first = following
    for row in range(following + 1, state.counts[STOP]):
        if state.rows[row, ARRIVED] < state.rows[first, ARRIVED]:
            first = row
    wait = state.clock[DELAY] - (state.rows[first, T] - grid)
    due = state.rows[first, ARRIVED] + max(0.0, wait)
    if now < due:
        state.clock[DUE] = due
    return now < due
