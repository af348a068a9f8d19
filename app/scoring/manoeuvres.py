"""Manoeuvres detected by control activity: where the crew moved aileron or rudder on purpose.

Surfaces never rest altogether: trim drifts, sensors are noisy, a damper answers turbulence. So a
surface is active where it moves within WINDOW by more than a share of the planned input, and by
more than is usual there. An input begins with the first departure and is over when both surfaces
rest where they were before it, or have rested elsewhere for long.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from app.scoring.planned_test import PlannedTest
from app.scoring.windows import extent, medians_of_three, running_mean
from core.types import Array, Indices

WINDOW = 1.0
"""[s] in which a surface moves, and over which the level before an input is taken."""
SMOOTH = 0.2
"""[s] Faster motion than this is no hand's."""
RESTED = 1.5
"""[s] Between two manoeuvres the surfaces rest at least so long where they were before."""
SETTLED = 4.0
"""[s] Surfaces that rest so long elsewhere have a new trim."""
SHARE = 0.25
"""Of the planned amplitude: less is no input. Small steps of a build-up are."""
BEGINNING = 0.5
"""Of that: motion that belongs to an input if an input is there. It begins and ends one."""
OTHER = 2.0
"""Times as large as the planned input: an input of the surface that should not move."""
USUAL, TIMES_USUAL = 0.3, 10.0
"""Of all windows, this share moves less than is usual; an input moves so many times as much."""
SMALLEST = np.radians(0.1)
"""[rad] Motion of a surface that is never an input."""
NEIGHBOURHOOD = 300.0
"""[s] over which it is learned how much motion is usual."""
ALIKE = 0.5
"""Of the likeness with the planned inputs: what has as much is the same inputs once more."""
DEPARTED = 0.1
"""Of the threshold: where the first departure is sought, as far as noise allows."""


class Activity(NamedTuple):
    """Samples from the first departure of a surface to the end of its motion, both inclusive.

    times: how often the planned inputs lie in it, one after the other; 1 where they are not known.
    """

    onset: int
    end: int
    times: int = 1


def detect(surfaces: Array, planned: PlannedTest) -> tuple[Activity, ...]:
    """Inputs in a recording, in order; those that belong to one manoeuvre are one.

    surfaces: (n, 2) aileron and rudder [rad], a sample each planned.dt, NaN where unknown.
    """
    window = max(3, round(WINDOW / planned.dt) | 1)
    known = [column for column in range(2) if np.isfinite(surfaces[:, column]).any()]
    if not known:
        return ()
    u = np.column_stack([_despiked(surfaces[:, column]) for column in known])
    u = np.pad(u, ((window, 0), (0, 0)), mode="edge")  # before the first sample it rests
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
    """The surface with its gaps bridged by lines and without outliers of one sample."""
    known = np.isfinite(u)
    if not known.all():
        at = np.arange(len(u))
        u = np.interp(at, at[known], u[known])
    return medians_of_three(u)


def _input_sizes(motion: Array, planned: PlannedTest) -> Array:
    """(2,) what counts as a whole input of each surface [rad]."""
    if planned.amplitudes.any():
        return np.where(
            planned.amplitudes > 0.0, planned.amplitudes, OTHER * planned.amplitudes.max()
        )
    return np.full(2, 0.5 * motion.max())


def _threshold(motion: Array, size: float, dt: float) -> Array:
    """(n,) motion within a window from which on it is an input [rad]."""
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
    """Join moves of motion to inputs: between two of them the surfaces rest in trim.

    A run holds the samples around which a window has motion. So a surface passes the threshold half
    a window after a run begins, and comes to rest half a window before the run ends.
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
    """How often the planned inputs lie in the motion, by their correlation with it.

    u: (n, k) from the first departure on.   commands: (m, k) planned.
    Further ones count that are as large as ALIKE of the largest, in its direction.
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
    """Samples of the local maxima of at least a height, each higher than others near it.

    Those of scipy.signal.find_peaks, which takes a second to import: of a plateau its middle.
    x: (n,).   distance: samples at least between two of them; of equal ones the later stays.
    """
    changes = np.flatnonzero(np.diff(x))
    starts, ends = changes[:-1] + 1, changes[1:]
    is_peak = (x[starts] > x[starts - 1]) & (x[ends] > x[ends + 1]) & (x[starts] >= height)
    found = (starts[is_peak] + ends[is_peak]) // 2
    stays = np.ones(len(found), bool)
    for k in np.argsort(x[found])[::-1]:
        if stays[k]:
            stays &= (np.abs(found - found[k]) >= distance) | (found == found[k])
    return found[stays]


def _departure(u: Array, trim: Array, threshold: Array, begins: int, window: int) -> int:
    """The last sample at which every surface still rested before it passed the threshold.

    begins: the sample at which one has moved by the threshold within the window before.
    """
    start = max(0, begins - window)
    part = np.abs(u[start : begins + window] - trim)
    noise = 3.0 * np.median(part[: max(begins - start, 1)], axis=0)
    gone = np.flatnonzero((part > 0.75 * threshold).any(axis=1))
    first = int(gone[0]) if len(gone) else begins - start
    near = (part[: first + 1] <= np.maximum(noise, DEPARTED * threshold)).all(axis=1)
    rested = np.flatnonzero(near)
    return start + (int(rested[-1]) if len(rested) else 0)
