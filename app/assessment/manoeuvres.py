"""Detect manoeuvres by control activity: where the crew moved aileron or rudder on purpose.

Surfaces are never completely still: trim drifts, sensors are noisy, a damper reacts to turbulence.
A surface is active where it moves within WINDOW by more than a share of the planned input and by
more than its usual motion nearby. An input starts at the first departure. It ends when both
surfaces rest at their earlier position, or have rested elsewhere for SETTLED.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from app.assessment.planned_test import PlannedTest
from app.assessment.windows import extent, medians_of_three, running_mean
from core.types import Array, Indices

WINDOW = 1.0
"""[s] Motion is measured within this window; so is the level before an input."""
SMOOTH = 0.2
"""[s] Faster motion does not come from a hand."""
RESTED = 1.5
"""[s] Shortest rest at the earlier position between two manoeuvres."""
SETTLED = 4.0
"""[s] Surfaces that rest this long elsewhere have a new trim."""
SHARE = 0.25
"""Share of the planned amplitude that makes an input, small enough for a build-up."""
BEGINNING = 0.5
"""Share of the input threshold at which motion next to an input belongs to it."""
OTHER = 2.0
"""Times the planned input: size of an input on a surface that should not move."""
USUAL, TIMES_USUAL = 0.3, 10.0
"""Usual motion is this quantile over all windows; an input moves this many times as much."""
SMALLEST = np.radians(0.1)
"""[rad] Smaller motion is never an input."""
NEIGHBOURHOOD = 300.0
"""[s] Length of the parts in which usual motion is measured."""
ALIKE = 0.5
"""Share of the best match with the planned inputs that counts as another repetition."""
DEPARTED = 0.1
"""Share of the threshold at which a departure starts, where noise is lower."""


class Activity(NamedTuple):
    """Samples from the first departure of a surface to the end of its motion, both inclusive.

    times: repetitions of the planned inputs in it; 1 where the inputs are unknown.
    """

    onset: int
    end: int
    times: int = 1


def detect(surfaces: Array, planned: PlannedTest) -> tuple[Activity, ...]:
    """Control inputs in a recording, in order; inputs of one manoeuvre count as one.

    surfaces: (n, 2) aileron and rudder [rad], one sample each planned.dt, NaN where unknown.
    """
    window = max(3, round(WINDOW / planned.dt) | 1)
    known = [column for column in range(2) if np.isfinite(surfaces[:, column]).any()]
    if not known:
        return ()
    u = np.column_stack([_despiked(surfaces[:, column]) for column in known])
    u = np.pad(u, ((window, 0), (0, 0)), mode="edge")  # at rest before the first sample
    motion = extent(running_mean(u, round(SMOOTH / planned.dt) | 1), window)
    largest = _input_sizes(motion, planned)[known]
    threshold = np.column_stack(
        [_threshold(motion[:, i], size, planned.dt) for i, size in enumerate(largest)]
    )
    commands = planned.commands[:, known]
    return tuple(
        Activity(max(0, onset - window), max(0, end - window), _times(u[onset : end + 1], commands))
        for onset, end, _ in _activities(u, motion, threshold, window, planned)
    )


def _despiked(u: Array) -> Array:
    """Bridge gaps by lines and remove outliers of one sample."""
    known = np.isfinite(u)
    if not known.all():
        at = np.arange(len(u))
        u = np.interp(at, at[known], u[known])
    return medians_of_three(u)


def _input_sizes(motion: Array, planned: PlannedTest) -> Array:
    """(2,) size of a full input of each surface [rad]."""
    if planned.amplitudes.any():
        return np.where(
            planned.amplitudes > 0.0, planned.amplitudes, OTHER * planned.amplitudes.max()
        )
    return np.full(2, 0.5 * motion.max())


def _threshold(motion: Array, size: float, dt: float) -> Array:
    """(n,) motion within a window that makes an input [rad]."""
    length = max(1, round(NEIGHBOURHOOD / dt))
    n_parts = max(1, round(len(motion) / length))
    usual = np.array([np.quantile(part, USUAL) for part in np.array_split(motion, n_parts)])
    least = np.maximum(TIMES_USUAL * usual, max(SHARE * size, SMALLEST))
    if n_parts == 1:
        return np.broadcast_to(least, len(motion))
    middles = (np.arange(n_parts) + 0.5) * len(motion) / n_parts
    return np.interp(np.arange(len(motion)), middles, least)


def _activities(
    u: Array, motion: Array, threshold: Array, window: int, planned: PlannedTest
) -> Iterator[Activity]:
    """Join moves to inputs: between two inputs the surfaces rest in trim.

    A run holds the samples with motion in the window around them. So a surface passes the threshold
    half a window after a run begins and comes to rest half a window before it ends.
    """
    least = BEGINNING * threshold
    moving = (motion > least).any(axis=1).view(np.int8)
    inputs = np.concatenate([[0], np.cumsum((motion > threshold).any(axis=1))])
    moves = np.flatnonzero(np.diff(moving, prepend=0, append=0)).reshape(-1, 2)
    passed = np.minimum(moves[:, 0] + window // 2, len(u) - 1)
    ended = np.maximum(moves[:, 1] - window // 2, passed + 1)
    ended[moves[:, 1] == len(u)] = len(u)
    rested, settled = round(RESTED / planned.dt), round(SETTLED / planned.dt)
    n_inputs = round(planned.inputs_last / planned.dt)
    activity, is_input, trim = Activity(-1, -1), False, np.empty(u.shape[1])
    for begins, stops in zip(passed.tolist(), ended.tolist(), strict=True):
        level = np.median(u[max(0, begins - window) : begins], axis=0)
        onset = _departure(u, level, least[begins], begins, window)
        if activity.onset >= 0:
            rest = np.median(u[activity.end : activity.end + window], axis=0)
            back = (np.abs(rest - trim) <= least[activity.end]).all()
            apart = onset - activity.end >= (rested if back else settled)
            if not apart or (is_input and onset < activity.onset + n_inputs):
                activity = Activity(activity.onset, stops - 1)
                is_input |= bool(inputs[stops] > inputs[begins])
                continue
            if is_input:
                yield activity
        activity, trim = Activity(onset, stops - 1), level
        is_input = bool(inputs[stops] > inputs[onset])
    if is_input:
        yield activity


def _times(u: Array, commands: Array) -> int:
    """How often the planned inputs occur in the motion, by correlation.

    u: (n, k) from the first departure on.   commands: (m, k) planned.
    A repetition counts from ALIKE of the best match, in the same direction.
    """
    moved = np.flatnonzero(commands.any(axis=1))
    if not len(moved):
        return 1
    inputs = commands[moved[0] : moved[-1] + 1]
    n = len(inputs)
    flown = np.pad(u - u[0], ((n, n), (0, 0)), mode="edge")
    flown[-n:] = 0.0
    each = [np.correlate(flown[:, k], inputs[:, k]) for k in range(u.shape[1])]
    likeness = np.sum(each, axis=0)
    likeness *= np.sign(likeness[np.abs(likeness).argmax()])
    return max(1, len(peaks(likeness, ALIKE * likeness.max(), n)))


def peaks(x: Array, height: float, distance: int) -> Indices:
    """Local maxima of at least a height, at least a distance apart; the higher one stays.

    As scipy.signal.find_peaks, which takes a second to import: the middle of a plateau counts.
    x: (n,).   distance: [samples]; of two equal maxima the later stays.
    """
    changes = np.flatnonzero(np.diff(x))
    starts, ends = changes[:-1] + 1, changes[1:]
    is_peak = (x[starts] > x[starts - 1]) & (x[ends] > x[ends + 1]) & (x[starts] >= height)
    maxima = (starts[is_peak] + ends[is_peak]) // 2
    stays = np.ones(len(maxima), bool)
    for k in np.argsort(x[maxima])[::-1]:
        if stays[k]:
            stays &= (np.abs(maxima - maxima[k]) >= distance) | (maxima == maxima[k])
    return maxima[stays]


def _departure(u: Array, trim: Array, threshold: Array, begins: int, window: int) -> int:
    """The last sample at which every surface was still at rest.

    begins: sample at which one surface has moved by the threshold within the window before.
    """
    start = max(0, begins - window)
    part = np.abs(u[start : begins + window] - trim)
    noise = 3.0 * np.median(part[: max(begins - start, 1)], axis=0)
    gone = np.flatnonzero((part > 0.75 * threshold).any(axis=1))
    first = int(gone[0]) if len(gone) else begins - start
    near = (part[: first + 1] <= np.maximum(noise, DEPARTED * threshold)).all(axis=1)
    rested = np.flatnonzero(near)
    return start + (int(rested[-1]) if len(rested) else 0)
