"""The segments of a recording to score, each with the rest that gives its trim."""

from typing import NamedTuple

import numpy as np

from app.assessment.manoeuvres import Activity, detect
from app.assessment.planned_test import SURFACES, PlannedTest
from app.assessment.recipe import Interval, ScoringRecipe, in_words
from app.assessment.scored import MOST_MANOEUVRES
from app.telemetry.recording import Recording, TelemetryError
from core.types import Array

ON_GRID = 1e-6
"""Share of a step within which a time counts as the sample's."""
AFTERWARDS = 3.0
"""[s] A manoeuvre of unknown length continues this long after its last input."""


class Segment(NamedTuple):
    """Samples first..last of a recording, both included, scored as a flight of their own.

    onset: sample at which a surface starts to move; None where not detected.
    rest: samples whose mean is the trim; None where no trim is subtracted.
    requested: length of rest requested [s], if the recording has less; else None.
    """

    name: str
    first: int
    last: int
    onset: int | None = None
    rest: slice | None = None
    requested: float | None = None


def segments(
    recording: Recording, planned: PlannedTest, recipe: ScoringRecipe
) -> tuple[tuple[Segment, ...], tuple[str, ...]]:
    """The segments of a recipe, and notes on their detection.

    recording: on the grid of planned.dt.   TelemetryError for intervals outside it.
    """
    if isinstance(recipe.manoeuvres, tuple):
        _check_number(len(recipe.manoeuvres))
        return tuple(
            _marked(recording, planned, recipe, interval) for interval in recipe.manoeuvres
        ), ()
    entire = Interval(float(recording.t[0]), float(recording.t[-1]), "entire recording")
    if recipe.manoeuvres == "entire":
        return (_marked(recording, planned, recipe, entire),), ()
    detected, notes = _detected(recording, planned, recipe)
    return detected or (_marked(recording, planned, recipe, entire),), notes


def _detected(
    recording: Recording, planned: PlannedTest, recipe: ScoringRecipe
) -> tuple[tuple[Segment, ...], tuple[str, ...]]:
    surfaces = recording.y[:, SURFACES]
    if np.isnan(surfaces).all():
        note = "No manoeuvre can be detected without aileron and rudder"
        return (), (f"{note}: the entire recording is scored as one.",)
    inputs = detect(surfaces, planned)
    if not inputs:
        return (), ("No control input detected: the entire recording is scored as one.",)
    _check_number(len(inputs))
    n, n_trim = len(recording.t), round(planned.trim_segment_s / planned.dt)
    ends = [_length(activity, planned) for activity in inputs]
    starts = [max(0, activity.onset - n_trim) for activity in inputs]
    result, notes = [], [f"Manoeuvres detected by control activity: {len(inputs)}."]
    before = 0
    for number, (activity, start, length) in enumerate(zip(inputs, starts, ends, strict=True)):
        following = starts[number + 1] if number + 1 < len(inputs) else n
        start = max(start, before)
        last = min(activity.onset - n_trim + length, following, n) - 1
        rest = _rest(activity.onset, start, before, planned, recipe)
        requested = _request_unmet(rest, planned, recipe)
        name = f"manoeuvre {number + 1}"
        result.append(Segment(name, start, last, activity.onset, rest, requested))
        if activity.times > 1:
            notes.append(
                f"{name} holds the planned inputs {activity.times} times, too close together to "
                "separate: mark each by hand to score it alone."
            )
        before = last + 1
    return tuple(result), tuple(notes)


def _check_number(n: int) -> None:
    if n > MOST_MANOEUVRES:
        raise TelemetryError(
            f"{n} manoeuvres exceed the {MOST_MANOEUVRES} that one scoring holds: split the "
            "recording, or mark fewer by hand"
        )


def _length(activity: Activity, planned: PlannedTest) -> int:
    """Number of samples of a detected manoeuvre, from its planned start."""
    if planned.duration is not None:
        return round(planned.duration / planned.dt) + 1
    moving = activity.end - activity.onset + 1
    return moving + round((planned.trim_segment_s + AFTERWARDS) / planned.dt)


def _rest(
    onset: int, start: int, before: int, planned: PlannedTest, recipe: ScoringRecipe
) -> slice | None:
    """The trim segment, or the requested seconds before the first input, if recorded."""
    if recipe.trim is None:
        return None
    if isinstance(recipe.trim, float | int):
        start = max(before, onset - round(recipe.trim / planned.dt))
    return slice(max(0, min(start, onset - 1)), max(onset, 1))


def _request_unmet(rest: slice | None, planned: PlannedTest, recipe: ScoringRecipe) -> float | None:
    """The requested seconds of rest, if the recording has fewer."""
    if rest is None or not isinstance(recipe.trim, float | int):
        return None
    return recipe.trim if rest.stop - rest.start < round(recipe.trim / planned.dt) else None


def _marked(
    recording: Recording, planned: PlannedTest, recipe: ScoringRecipe, interval: Interval
) -> Segment:
    """The samples within an interval, as a segment that starts with its rest."""
    t, dt = recording.t, planned.dt
    if interval.start < t[0] - 0.5 * dt or interval.end > t[-1] + 0.5 * dt:
        raise TelemetryError(
            f"the manoeuvre {in_words(interval)} is not inside the recording, which lasts from "
            f"{t[0]:.10g} to {t[-1]:.10g} s; give times within it"
        )
    near = ON_GRID * dt
    first, stop = np.searchsorted(t, (interval.start - near, interval.end + near)).tolist()
    if stop - first < 2:
        raise TelemetryError(
            f"the manoeuvre {in_words(interval)} holds fewer than two samples of the monitor's "
            f"{dt:g} s; give a longer one"
        )
    rest = None
    if recipe.trim is not None:
        seconds = planned.trim_segment_s if isinstance(recipe.trim, str) else recipe.trim
        length = (stop - first - 1) * dt
        if seconds > length + near and seconds == recipe.trim:
            raise TelemetryError(
                f"a trim segment of {seconds:g} s is longer than {interval.name} ({length:.4g} s); "
                "give a shorter one"
            )
        rest = slice(first, min(first + max(1, round(seconds / dt)), stop))
    return Segment(interval.name, first, stop - 1, None, rest)


def mean_of_rest(rest: Array) -> Array:
    """Trim from a rest (n, 6): (6,) mean of each channel's known samples, NaN without any."""
    known = np.isfinite(rest)
    count = known.sum(axis=0)
    total = np.where(known, rest, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
