"""The segments of a recording that are scored, each with the rest that its trim is taken from."""

from typing import NamedTuple

import numpy as np

from app.scoring.manoeuvres import Activity, detect
from app.scoring.planned_test import SURFACES, PlannedTest
from app.scoring.recipe import Interval, ScoringRecipe, in_words
from app.scoring.scored import MOST_MANOEUVRES
from app.telemetry.recording import Recording, TelemetryError
from core.types import Array

ON_GRID = 1e-6
"""Of a step: times so close to a sample are the sample's."""
AFTERWARDS = 3.0
"""[s] that a manoeuvre of unknown length goes on after the last input."""


class Segment(NamedTuple):
    """Samples first..last of a recording, both included, scored as a flight of their own.

    onset: sample from which a surface moves; None where it was not looked for.
    rest: samples before it, of which trim is the mean; None where nothing is subtracted.
    asked: length of the rest [s] where it was asked for and is not there; else None.
    """

    name: str
    first: int
    last: int
    onset: int | None = None
    rest: slice | None = None
    asked: float | None = None


def segments(
    recording: Recording, planned: PlannedTest, recipe: ScoringRecipe
) -> tuple[tuple[Segment, ...], tuple[str, ...]]:
    """The segments that a recipe asks for, and notes on how they were detected.

    recording: on the grid of planned.dt.   TelemetryError for intervals outside of it.
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
        note = "Neither surface is recorded, so no manoeuvre can be detected"
        return (), (f"{note}: the entire recording is scored as one.",)
    inputs = detect(surfaces, planned)
    if not inputs:
        return (), ("No control input was detected: the entire recording is scored as one.",)
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
        asked = _lacking(rest, planned, recipe)
        name = f"manoeuvre {number + 1}"
        result.append(Segment(name, start, last, activity.onset, rest, asked))
        if activity.times > 1:
            notes.append(
                f"The planned inputs lie {activity.times} times in {name}, too close together to "
                "be told apart: mark each by hand to have it scored by itself."
            )
        before = last + 1
    return tuple(result), tuple(notes)


def _check_number(n: int) -> None:
    if n > MOST_MANOEUVRES:
        raise TelemetryError(
            f"{n} manoeuvres are more than the {MOST_MANOEUVRES} that a scoring holds: split the "
            "recording, or mark fewer by hand"
        )


def _length(activity: Activity, planned: PlannedTest) -> int:
    """Samples of a detected manoeuvre from the planned start on."""
    if planned.duration is not None:
        return round(planned.duration / planned.dt) + 1
    moving = activity.end - activity.onset + 1
    return moving + round((planned.trim_segment_s + AFTERWARDS) / planned.dt)


def _rest(
    onset: int, start: int, before: int, planned: PlannedTest, recipe: ScoringRecipe
) -> slice | None:
    """The trim segment, or so many seconds before the first input, as far as they are there."""
    if recipe.trim is None:
        return None
    if isinstance(recipe.trim, float | int):
        start = max(before, onset - round(recipe.trim / planned.dt))
    return slice(max(0, min(start, onset - 1)), max(onset, 1))


def _lacking(rest: slice | None, planned: PlannedTest, recipe: ScoringRecipe) -> float | None:
    """The seconds that were asked for, where fewer are there."""
    if rest is None or not isinstance(recipe.trim, float | int):
        return None
    return recipe.trim if rest.stop - rest.start < round(recipe.trim / planned.dt) else None


def _marked(
    recording: Recording, planned: PlannedTest, recipe: ScoringRecipe, interval: Interval
) -> Segment:
    """A segment from the first to the last sample within an interval; its rest is its beginning."""
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
                f"a trim segment of {seconds:g} s was asked of {length:.4g} s ({interval.name}); "
                "give a shorter one"
            )
        rest = slice(first, min(first + max(1, round(seconds / dt)), stop))
    return Segment(interval.name, first, stop - 1, None, rest)


def mean_of_rest(rest: Array) -> Array:
    """Trim of a rest (n, 6): (6,) mean of each channel's known samples, NaN where there is none."""
    known = np.isfinite(rest)
    count = known.sum(axis=0)
    total = np.where(known, rest, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
