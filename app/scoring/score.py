"""Scoring: from channels as recorded to a verdict on each manoeuvre. The same in, the same out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from app.scoring.assessed_segment import AssessedSegment
from app.scoring.outcome import SAME_TIME, Exceedance, Limited, against_limits, outcome, runs
from app.scoring.outside import MOST_OUTSIDE, outside, outside_note
from app.scoring.ready import Ready
from app.scoring.recipe import Interval, ScoringRecipe
from app.scoring.scored import (
    BETWEEN,
    OBSERVATIONS,
    ScoredManoeuvre,
    ScoredRecording,
    Validity,
    packed,
)
from app.scoring.seen import could_not_warn, not_seen
from app.scoring.segments import Segment, segments
from app.scoring.validity import validity
from app.scoring.wording import guarantee, remarks, withdrawn
from app.telemetry.recording import ATTITUDE, Recording
from app.telemetry.timing.repair import RepairedTraces
from core.channels import KEYS
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State
from core.types import Array

INVALID = STATES.index(State.INVALID)


def score(
    monitor: Monitor, recorded: RepairedTraces, recipe: ScoringRecipe | None = None
) -> ScoredRecording:
    """Score a recording.

    recorded: in SI units.   TelemetryError where the monitor cannot be given what it
    needs, or the recipe does not fit the recording; ValueError for an epsilon it cannot serve.
    """
    recipe = recipe or ScoringRecipe()
    return score_at_each(monitor, recorded, recipe, (recipe.epsilon,))[0]


def score_at_each(
    monitor: Monitor,
    recorded: RepairedTraces,
    recipe: ScoringRecipe,
    epsilons: Sequence[float | None],
) -> tuple[ScoredRecording, ...]:
    """Score once at each miss rate, for the price of one: only alerts depend on it."""
    checked = [monitor.check_epsilon(epsilon) for epsilon in epsilons]
    flight = Ready.of(monitor, recorded)
    planned, notes = segments(flight.recording, flight.plan, recipe)
    judged = [_judge(flight, segment) for segment in planned]
    reached = _outside(flight, judged)
    notes = (*flight.notes, *notes, *outside_note(reached))
    return tuple(_scored(flight, judged, epsilon, notes, reached) for epsilon in checked)


def manoeuvres_in(monitor: Monitor, recorded: RepairedTraces) -> tuple[Interval, ...]:
    """The manoeuvres that scoring would find; none where there are none."""
    flight = Ready.of(monitor, recorded)
    found, _ = segments(flight.recording, flight.plan, ScoringRecipe())
    t = flight.recording.t
    return tuple(
        Interval(float(t[one.first]), float(t[one.last]), one.name)
        for one in found
        if one.onset is not None
    )


@dataclass(frozen=True, eq=False)
class _Judged:
    """A segment with everything that does not depend on epsilon.

    said: of all its samples.   withdrawn: sample from which on nothing is said; None for none.
    """

    segment: Segment
    trim: Array
    y: Array
    said: Assessments
    limited: Limited
    validity: Validity
    withdrawn: int | None


def _judge(flight: Ready, segment: Segment) -> _Judged:
    """Assess a segment as a flight of its own, then ask whether that was right."""
    part = slice(segment.first, segment.last + 1)
    t, recorded = flight.recording.t[part], flight.recording.y
    trim = np.zeros(len(KEYS)) if segment.rest is None else _mean(recorded[segment.rest])
    y = recorded[part] - trim
    assessed = np.where(flight.needed, y, 0.0) if not flight.needed.all() else y
    said = flight.monitor.assess(t, assessed, withdraw=False)
    limited = against_limits(flight.traces, flight.plan.limits, trim, float(t[0]), float(t[-1]))
    end = len(t) - 1
    if limited.exceedance is not None:
        end = min(end, int(np.searchsorted(t, limited.exceedance.t - SAME_TIME)))
    flown = AssessedSegment(
        flight.monitor,
        flight.plan,
        flight.traces,
        flight.recording,
        segment,
        flight.needed,
        y,
        assessed,
        said,
        end,
        {channel.key: channel.held for channel in flight.quality.channels},
    )
    verdict = validity(flown)
    return _Judged(segment, trim, y, said, limited, verdict, _withdrawn(flown, verdict))


def _withdrawn(flown: AssessedSegment, verdict: Validity) -> int | None:
    """First sample of which nothing is said: as of a stream; the first of all for a failed check.

    A check knows more than a stream does: the airspeed, say, or which manoeuvre was flown.
    """
    if any(check.ok is False for check in verdict.checks if check.name != OBSERVATIONS):
        return 0
    if verdict.valid is not False:
        return None
    lost = flown.monitor.withdrawal(flown.said.t, flown.assessed, flown.said)
    return None if lost is None else lost.first


def _outside(flight: Ready, judged: list[_Judged]) -> tuple[Exceedance, ...]:
    t = flight.recording.t
    intervals = [(float(t[one.segment.first]), float(t[one.segment.last])) for one in judged]
    return outside(flight.traces, flight.plan.limits, intervals, [one.trim for one in judged])


def _mean(rest: Array) -> Array:
    """(6,) mean of each channel's known samples, NaN where there is none."""
    known = np.isfinite(rest)
    count = known.sum(axis=0)
    total = np.where(known, rest, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _scored(
    flight: Ready,
    judged: list[_Judged],
    epsilon: float,
    notes: tuple[str, ...],
    reached: tuple[Exceedance, ...],
) -> ScoredRecording:
    fields = _between(flight.recording, judged)
    for number, one in enumerate(judged):
        part = slice(one.segment.first, one.segment.last + 1)
        fields["y"][part], fields["y_hat"][part] = one.y, one.said.y_hat
        fields["manoeuvre"][part] = number
        last = one.segment.last + 1 if one.withdrawn is None else one.segment.first + one.withdrawn
        said, lost = slice(one.segment.first, last), slice(last, one.segment.last + 1)
        n_said = last - one.segment.first
        fields["withdrawn"][lost] = one.said.p_value[n_said:]
        fields["y_hat"][lost] = np.nan
        fields["state"][said], fields["p_value"][said] = (
            one.said.state[:n_said],
            one.said.p_value[:n_said],
        )
        fields["alert"][said] = one.said.p_value[:n_said] > epsilon
    samples = packed(fields)
    scored = [
        _verdict(flight, one, samples[one.segment.first : one.segment.last + 1], epsilon)
        for one in judged
    ]
    return ScoredRecording(
        samples,
        tuple(scored),
        flight.monitor.dt,
        epsilon,
        flight.quality,
        notes,
        reached[:MOST_OUTSIDE],
    )


def _between(recording: Recording, judged: list[_Judged]) -> dict[str, npt.NDArray[Any]]:
    """The fields of SAMPLE where nothing is said yet.

    Channels are from the trim of the segment before; ahead of the first, from its own.
    """
    n, unknown = len(recording.t), np.full(len(recording.t), np.nan)
    attitude = [recording.attitude.get(key, unknown) for key in ATTITUDE]
    y = np.empty((n, len(KEYS)))
    starts = [0, *(one.segment.last + 1 for one in judged), n]
    for one, begin, end in zip((judged[0], *judged), starts, starts[1:], strict=False):
        np.subtract(recording.y[begin:end], np.nan_to_num(one.trim), out=y[begin:end])
    return {
        "t": recording.t,
        "y": y,
        "p_value": unknown.copy(),
        "withdrawn": unknown.copy(),
        "alert": np.zeros(n, bool),
        "state": np.full(n, INVALID, np.uint8),
        "manoeuvre": np.full(n, BETWEEN, np.int16),
        "y_hat": np.full((n, len(KEYS)), np.nan),
        "attitude": np.column_stack(attitude),
    }


def _verdict(
    flight: Ready, one: _Judged, part: npt.NDArray[np.void], epsilon: float
) -> ScoredManoeuvre:
    known = np.isfinite(part["p_value"])
    peak = int(np.nanargmax(part["p_value"])) if known.any() else None
    alerts = runs(part["t"], part["alert"])
    exceedance, promised = one.limited.exceedance, flight.monitor.lead
    what, lead = outcome(alerts, exceedance, promised)
    is_withdrawn = one.withdrawn is not None
    if not flight.plan.limits_known:
        what, lead = "unknown", None
    elif is_withdrawn and not alerts:
        what, lead = "invalid", None
    first = [withdrawn(one.said, one.limited, epsilon)] if is_withdrawn else []
    why = ""
    if not flight.plan.limits_known:
        pass
    elif exceedance is None:
        why = not_seen(one.limited, one.said, alerts, flight.monitor.dt)
    elif not is_withdrawn:
        why = could_not_warn(one.limited, exceedance, one.said, alerts, promised)
    if why:
        what, lead = "unseen", None
        first.append(why)
    return ScoredManoeuvre(
        name=one.segment.name,
        start=float(part["t"][0]),
        end=float(part["t"][-1]),
        first=one.segment.first,
        last=one.segment.last,
        trim=tuple(None if np.isnan(value) else float(value) for value in one.trim),
        validity=one.validity,
        outcome="invalid" if peak is None else what,
        guarantee=guarantee(flight.monitor, one.validity, epsilon),
        peak_risk=None if peak is None else float(part["p_value"][peak]),
        peak_t=None if peak is None else float(part["t"][peak]),
        alerts=alerts,
        exceedance=exceedance,
        lead=lead,
        withdrawn_t=None if one.withdrawn is None else float(part["t"][one.withdrawn]),
        remarks=(*first, *remarks(flight.plan, one.segment, one.limited, one.said)),
    )
