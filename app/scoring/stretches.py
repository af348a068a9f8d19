"""The stretches of a recording that are scored, each with the rest that its trim is taken from."""

from typing import NamedTuple

import numpy as np

from app.scoring.manoeuvres import Activity, find
from app.scoring.order import ScoringOrder, Span, said
from app.scoring.plan import SURFACES, Plan
from app.scoring.scored import MOST_STRETCHES
from app.telemetry.recording import Recording, TelemetryError

ON_GRID = 1e-6
"""Of a step: times so close to a sample are the sample's."""
AFTERWARDS = 3.0
"""[s] that a manoeuvre of unknown length goes on after the last input."""


class Stretch(NamedTuple):
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


def stretches(
    recording: Recording, plan: Plan, order: ScoringOrder
) -> tuple[tuple[Stretch, ...], tuple[str, ...]]:
    """The stretches that an order asks for, and notes on how they were found.

    recording: on the grid of plan.dt.   TelemetryError for spans that are not in the recording.
    """
    if isinstance(order.manoeuvres, tuple):
        _check_number(len(order.manoeuvres))
        return tuple(_marked(recording, plan, order, span) for span in order.manoeuvres), ()
    whole = Span(float(recording.t[0]), float(recording.t[-1]), "whole recording")
    if order.manoeuvres == "whole":
        return (_marked(recording, plan, order, whole),), ()
    found, notes = _found(recording, plan, order)
    return found or (_marked(recording, plan, order, whole),), notes


def _found(
    recording: Recording, plan: Plan, order: ScoringOrder
) -> tuple[tuple[Stretch, ...], tuple[str, ...]]:
    surfaces = recording.y[:, SURFACES]
    if np.isnan(surfaces).all():
        note = "Neither surface is recorded, so no manoeuvre can be found"
        return (), (f"{note}: the whole recording is scored as one.",)
    inputs = find(surfaces, plan)
    if not inputs:
        return (), ("No control input was found: the whole recording is scored as one.",)
    _check_number(len(inputs))
    n, lead_in = len(recording.t), round(plan.lead_in / plan.dt)
    ends = [_length(activity, plan) for activity in inputs]
    starts = [max(0, activity.onset - lead_in) for activity in inputs]
    result, notes = [], [f"Manoeuvres found by control activity: {len(inputs)}."]
    before = 0
    for number, (activity, start, length) in enumerate(zip(inputs, starts, ends, strict=True)):
        following = starts[number + 1] if number + 1 < len(inputs) else n
        start = max(start, before)
        last = min(activity.onset - lead_in + length, following, n) - 1
        rest = _rest(activity.onset, start, before, plan, order)
        asked = _lacking(rest, plan, order)
        name = f"manoeuvre {number + 1}"
        result.append(Stretch(name, start, last, activity.onset, rest, asked))
        before = last + 1
    return tuple(result), tuple(notes)


def _check_number(n: int) -> None:
    if n > MOST_STRETCHES:
        raise TelemetryError(
            f"{n} stretches are more than the {MOST_STRETCHES} that a scoring holds: split the "
            "recording, or mark fewer by hand"
        )


def _length(activity: Activity, plan: Plan) -> int:
    """Samples of a found manoeuvre from the planned start on."""
    if plan.duration is not None:
        return round(plan.duration / plan.dt) + 1
    moving = activity.end - activity.onset + 1
    return moving + round((plan.lead_in + AFTERWARDS) / plan.dt)


def _rest(onset: int, start: int, before: int, plan: Plan, order: ScoringOrder) -> slice | None:
    """The lead-in, or so many seconds before the first input, as far as they are there."""
    if order.trim is None:
        return None
    if isinstance(order.trim, float | int):
        start = max(before, onset - round(order.trim / plan.dt))
    return slice(max(0, min(start, onset - 1)), max(onset, 1))


def _lacking(rest: slice | None, plan: Plan, order: ScoringOrder) -> float | None:
    """The seconds that were asked for, where fewer are there."""
    if rest is None or not isinstance(order.trim, float | int):
        return None
    return order.trim if rest.stop - rest.start < round(order.trim / plan.dt) else None


def _marked(recording: Recording, plan: Plan, order: ScoringOrder, span: Span) -> Stretch:
    """A stretch from the first to the last sample within a span; its rest is its beginning."""
    t, dt = recording.t, plan.dt
    if span.start < t[0] - 0.5 * dt or span.end > t[-1] + 0.5 * dt:
        raise TelemetryError(
            f"the stretch {said(span)} is not inside the recording, which lasts from {t[0]:.10g} "
            f"to {t[-1]:.10g} s; give times within it"
        )
    near = ON_GRID * dt
    first, stop = np.searchsorted(t, (span.start - near, span.end + near)).tolist()
    if stop - first < 2:
        raise TelemetryError(
            f"the stretch {said(span)} holds fewer than two samples of the monitor's {dt:g} s; "
            "give a longer one"
        )
    rest = None
    if order.trim is not None:
        seconds = plan.lead_in if isinstance(order.trim, str) else order.trim
        length = (stop - first - 1) * dt
        if seconds > length + near and seconds == order.trim:
            raise TelemetryError(
                f"a trim stretch of {seconds:g} s was asked of {length:.4g} s ({span.name}); give "
                "a shorter one"
            )
        rest = slice(first, min(first + max(1, round(seconds / dt)), stop))
    return Stretch(span.name, first, stop - 1, None, rest)
