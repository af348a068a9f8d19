"""Scoring: from recorded channels to a verdict on each manoeuvre. Deterministic."""

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from math import inf
from typing import Any

import numpy as np
import numpy.typing as npt

from app.assessment.coverage import (
    why_exceedance_unknown,
    why_outcome_unknown,
    why_unflown_unknown,
    why_warning_unknown,
)
from app.assessment.limits_history import LimitsHistory, SetHistory
from app.assessment.outcome import (
    MOST_OUTSIDE,
    Limited,
    RecordedExceedance,
    against_limits,
    alert_times,
    exceedances_outside,
    lasting,
    lost_in,
    notes_on_outside,
    outcome,
)
from app.assessment.planned_test import input_of
from app.assessment.recorded import RecordedFlight, sizes_of
from app.assessment.scored import (
    BETWEEN,
    BLOCK,
    Level,
    ScoredManoeuvre,
    ScoredRecording,
    Validity,
    level_of,
    sample_type,
)
from app.assessment.segments import (
    ScoringRecipe,
    Segment,
    by_monitor,
    segments,
    until_end,
)
from app.assessment.trim import TrimSteps
from app.assessment.validity import (
    AssessedSegment,
    ended_early,
    final_withdrawal,
    under_limits,
    validity,
)
from app.assessment.wording import guarantee, limits_remarks, remarks, withdrawn
from app.telemetry.contents import release
from app.telemetry.mapping.motion import compatibility
from app.telemetry.recording import ATTITUDE, Recording
from app.telemetry.timing.repair import RepairedTraces
from core.channels import LATERAL
from core.evaluation.certificate import use_of
from core.limits.exceedance import SAME_TIME
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State, Withdrawal
from core.monitor.calibration import smallest_epsilon
from core.monitor.validity.flown_input import FlownInput, amplitude
from core.types import Array, Flags

JUDGED_TOGETHER = 64
"""Release the mapped columns from memory after this many segments."""
JUST_BEFORE = 20
"""Samples before an exceedance that decide whether a manoeuvre was flown by then."""
INVALID, WARMING_UP = STATES.index(State.INVALID), STATES.index(State.WARMING_UP)


def score(
    monitor: Monitor,
    recorded: RepairedTraces,
    recipe: ScoringRecipe | None = None,
    history: LimitsHistory | SetHistory | None = None,
    digest: str = "",
    calls: Sequence[float] = (),
) -> ScoredRecording:
    """Score a recording.

    recorded: in SI units.   history: limits that were in force; None for the monitor's own. They
    decide what an exceedance is; where they differ from the monitor's, it is not applicable. Or a
    monitor set: each sample is assessed by the monitor in use, `monitor` is the first of the set.
    digest: SHA-256 of its file, by which a flight that trained the monitor is known, beside its
    samples.   calls: times of ABORT and KNOCK IT OFF [s], beside those that the recording keeps.
    TelemetryError where the recording lacks what the monitor needs or the recipe does not fit it;
    ValueError for an epsilon that the monitor is too small for.
    """
    recipe = recipe or ScoringRecipe()
    about = recipe, (recipe.epsilon,), history, digest, calls
    return score_at_each(monitor, recorded, *about)[0]


def score_at_each(
    monitor: Monitor,
    recorded: RepairedTraces,
    recipe: ScoringRecipe,
    epsilons: Sequence[float | None],
    history: LimitsHistory | SetHistory | None = None,
    digest: str = "",
    calls: Sequence[float] = (),
) -> tuple[ScoredRecording, ...]:
    """Score at several miss rates in one pass: only the alerts depend on epsilon."""
    levels = [level_of(monitor, epsilon) for epsilon in epsilons]
    flight = RecordedFlight.of(monitor, recorded, history)
    flight = _with_use(flight, digest)
    usual = replace(recipe, epsilon=None) == ScoringRecipe()
    if recorded.flown is not None:
        calls = (*calls, *recorded.flown.calls)
        if recorded.flown.is_trimmed and usual:
            recipe = replace(recipe, trim=None, manoeuvres="entire")  # as in the flight
    followed = flight.manoeuvres if recipe.manoeuvres == "detected" else ()
    about = flight.recording, flight.planned, recipe, followed
    whole, notes = segments(*about, is_flight=recorded.flown is not None)
    selected = [until_end(segment, flight.recording, flight.planned) for segment in whole]
    members = [_with_use(flight.by(member), digest) for member in flight.members]
    parts = [(flight, segment) for segment in selected]
    if isinstance(history, SetHistory):
        parts, unused = by_monitor(flight, members, history.in_use, selected)
        notes = (*notes, *unused)
    as_flown = flight.trims if recorded.flown is not None and recipe.is_as_flown else None
    judged = _judge_all(flight, parts, as_flown)
    trims = as_flown or _trims_of(judged)
    outside = _outside(flight, judged, trims)
    unassessed = [each.validity.reasons[0] for each in judged if each.segment.is_rest]
    notes = (*notes, *(f"Not assessed: {why}." for why in unassessed))
    used = [f"{flight.use[0].upper()}{flight.use[1:]}."] if flight.use else []
    notes = (*used, *flight.notes, *notes, *notes_on_outside(outside, monitor.dictionary))
    notes += _missing_outside(flight, judged)
    checks = compatibility(flight.traces) if monitor.dictionary == LATERAL else ()
    t = flight.recording.t
    timeline = flight.timeline
    in_force = timeline and tuple(timeline.intervals(float(t[0]), float(t[-1])))
    return tuple(
        ScoredRecording(
            *_assessed(flight, judged, trims, None if members else (epsilon, above), calls),
            monitor.dt,
            epsilon,
            above,
            flight.quality,
            notes,
            outside[:MOST_OUTSIDE],
            checks,
            in_force,
        )
        for epsilon, above in levels
    )


def _with_use(flight: RecordedFlight, digest: str) -> RecordedFlight:
    """With the use of the flight in the training of its monitor."""
    evaluation = flight.monitor.evaluation
    if "flown" not in (evaluation or {}):
        return flight
    sizes = sizes_of(flight.traces, flight.monitor.dictionary)
    return replace(flight, use=use_of(evaluation, digest, sizes))


@dataclass(frozen=True, eq=False)
class JudgedSegment:
    """A segment with everything that does not depend on epsilon.

    begin: its first assessed sample; earlier ones are its rest.   withdrawal: the first sample of
    these without an assessment, and why; None if the monitor applies throughout.
    outside: the first sample outside training; None if none is.
    inputs: flown inputs of the planned surfaces.   silent: samples from `begin` on where other
    limits than the monitor's were in force.   in_force: those limits, in plain data.
    own: judged by the monitor's limits, where others were in force.
    unknown: of a rest, why a manoeuvre may have been flown in it; empty if none was.
    """

    assessed: AssessedSegment
    begin: int
    limited: Limited
    validity: Validity
    withdrawal: Withdrawal | None
    inputs: tuple[FlownInput, ...]
    silent: Flags
    in_force: tuple[dict[str, Any], ...] = ()
    own: Limited | None = None
    unknown: str = ""
    outside: int | None = None

    @property
    def assessments(self) -> Assessments:
        """From `begin` on."""
        return self.assessed.assessments

    @property
    def segment(self) -> Segment:
        return self.assessed.segment

    @property
    def first(self) -> int:
        return self.segment.first

    @property
    def stop(self) -> int:
        return self.segment.last + 1

    @property
    def interval(self) -> tuple[float, float]:
        """Its first and last time [s]."""
        t = self.assessed.recording.t
        return float(t[self.first]), float(t[self.stop - 1])

    @property
    def is_missing(self) -> bool:
        """Whether every sample lacks a channel that the monitor needs."""
        y = self.assessed.recording.y[self.begin : self.stop]
        return bool(np.isnan(y[:, self.assessed.needed]).any(axis=1).all())

    def was_before(self, k: int, exceedance: RecordedExceedance) -> bool:
        """Whether assessment k was shown before an exceedance; the first always was."""
        return k == 0 or self.assessed.flight.is_before(self.begin + k, exceedance)

    def withdrawn(self, part: slice) -> Flags:
        """Samples of a part at which the monitor is not applicable, for any reason."""
        silent = self.silent[part]
        if self.withdrawal is None:
            return silent
        return silent | (np.arange(part.start, part.stop) >= self.withdrawal.first)


def _judge_all(
    flight: RecordedFlight,
    parts: Sequence[tuple[RecordedFlight, Segment]],
    trims: TrimSteps | None,
) -> list[JudgedSegment]:
    """trims: see _judge."""
    judged: list[JudgedSegment] = []
    for begin in range(0, len(parts), JUDGED_TOGETHER):
        judged += [_judge(*part, trims) for part in parts[begin : begin + JUDGED_TOGETHER]]
        for trace in flight.traces.channels.values():
            release(trace.values)
    return judged


def _judge(flight: RecordedFlight, segment: Segment, trims: TrimSteps | None) -> JudgedSegment:
    """Assess a segment as a stream in flight does, then check its validity.

    trims: of a rest, as followed in flight; None for that of the segment.
    """
    recorded, monitor = flight.recording, flight.monitor
    begin, stop = segment.first if segment.onset is None else segment.onset, segment.last + 1
    trim = segment.trim_of(recorded.y, monitor.dictionary)
    steps = TrimSteps.constant(trim)
    if segment.is_rest and trims is not None:
        steps, trim = trims, trims.values[-1]
    start = begin
    if segment.onset is not None:
        start = max(segment.since, begin - monitor.recipe.n_delay - 1)
    first = min(start, segment.first)
    from_trim = recorded.y[first:stop] - trim
    y, streamed = from_trim[segment.first - first :], from_trim[start - first :]
    y_read, t_read = input_of(streamed, flight.needed), recorded.t[start:stop]
    if segment.joins is not None:  # in a monitor set its history begins empty
        unknown = np.full((1, streamed.shape[1]), np.nan)
        t_read = np.append(t_read[0] - monitor.dt, t_read)
        y_read, streamed = np.append(unknown, y_read, 0), np.append(unknown, streamed, 0)
    if segment.unused or segment.is_rest:
        y_read = np.full_like(y_read, np.nan)
    n_history = len(t_read) - (stop - begin)
    whole = monitor.assess(t_read, y_read, withdraw=False)
    interval = float(recorded.t[segment.first]), float(recorded.t[segment.last])
    about = flight.judged, monitor.dictionary, flight.planned.limits
    arguments = *about, steps, *interval
    limited = against_limits(*arguments, flight.timeline)
    assessed = AssessedSegment(flight, segment, trim, streamed, y_read, whole, n_history)
    t = assessed.assessments.t
    verdict, withdrawal = validity(assessed)
    if withdrawal is not None:
        withdrawal = withdrawal._replace(first=max(0, withdrawal.first - n_history))
    outside = None if withdrawal is None else withdrawal.first
    silent, in_force, own = np.zeros(len(t), bool), (), None
    if flight.timeline is not None and flight.members:
        in_force = tuple(flight.timeline.intervals(float(t[0]), interval[1]))
        if segment.unused:
            verdict = Validity(False, reasons=(segment.unused,))
            withdrawal = Withdrawal(0, segment.unused)
        if segment.joins:
            withdrawal, outside = Withdrawal(0, segment.joins), None
            verdict = replace(verdict, valid=False, reasons=(segment.joins, *verdict.reasons))
    elif flight.timeline is not None:
        silent = flight.timeline.silent(t)
        in_force = tuple(flight.timeline.intervals(*interval))
        verdict = under_limits(verdict, in_force)
        own = against_limits(*arguments) if silent.any() else None
        withdrawal = final_withdrawal(silent, withdrawal, in_force)
    unknown, inputs = "", ()
    if segment.is_rest:
        unknown = _why_unflown_unknown(flight, limited.exceedance)
        verdict = Validity(None, reasons=(unknown or "no manoeuvre was flown",))
        withdrawal = None
    elif segment.ends_early and limited.exceedance is None:
        verdict = ended_early(verdict, segment.ends_early)
    if not segment.is_rest:
        inputs = monitor.flown_input(y, monitor.last_counted(y), flight.planned.amplitudes)
    about = limited, verdict, withdrawal, inputs, silent, in_force, own, unknown, outside
    return JudgedSegment(assessed, begin, *about)


def _why_unflown_unknown(flight: RecordedFlight, exceedance: RecordedExceedance | None) -> str:
    """See why_unflown_unknown; of an exceedance, why none may have been flown just before it."""
    t, y = flight.recording.t, flight.recording.y
    step = float(np.median(np.diff(next(iter(flight.judged.channels.values())).t)))
    if exceedance is not None:
        stop = max(2, int(np.searchsorted(t, exceedance.t)))
        part = slice(max(0, stop - JUST_BEFORE), stop)
        t, y = t[part], y[part]
    why = why_unflown_unknown(flight.monitor, t, y, step)
    return f"data missing: {why}" if why else ""


def _trims_of(judged: list[JudgedSegment]) -> TrimSteps:
    """That of each segment until the next one; the first before, too."""
    t = judged[0].assessed.recording.t
    return TrimSteps(
        t[[each.first for each in judged]], np.array([each.assessed.trim for each in judged])
    )


def _outside(
    flight: RecordedFlight, judged: list[JudgedSegment], trims: TrimSteps
) -> tuple[RecordedExceedance, ...]:
    t = flight.recording.t
    intervals = [(float(t[each.first]), float(t[each.stop - 1])) for each in judged]
    return exceedances_outside(
        flight.judged,
        flight.monitor.dictionary,
        flight.planned.limits,
        intervals,
        trims,
        flight.timeline,
    )


def _missing_outside(flight: RecordedFlight, judged: list[JudgedSegment]) -> tuple[str, ...]:
    """A note that a limit may have been exceeded outside every manoeuvre; empty if none was."""
    t = flight.recording.t
    start, end = float(t[0]), float(t[-1])
    inside = [(t[each.first], t[each.stop - 1]) for each in judged]
    keys = {peak.channel: None for each in judged for peak in each.limited.peaks}
    holes = [
        hole
        for hole in flight.holes(keys, start, end)
        if all(hole.end <= first or hole.start >= last for first, last in inside)
    ]
    why = why_exceedance_unknown(holes, end - start, flight.monitor.dt)
    return (f"Data missing outside every manoeuvre: {why}.",) if why else ()


def _assessed(
    flight: RecordedFlight,
    judged: list[JudgedSegment],
    trims: TrimSteps,
    level: Level | None,
    calls: Sequence[float],
) -> tuple[npt.NDArray[np.void], tuple[ScoredManoeuvre, ...]]:
    """Samples and manoeuvres at one miss rate and its alert threshold; None for each monitor's."""
    levels = [level or level_of(each.assessed.monitor, None) for each in judged]
    samples = _samples(flight, judged, trims, [above for _, above in levels])
    verdicts, earlier = list[ScoredManoeuvre](), list[tuple[float, float]]()
    for number, (each, of_each) in enumerate(zip(judged, levels, strict=True)):
        if not each.segment.part:
            earlier = []
        further = takewhile(lambda later: later.segment.part, judged[number + 1 :])
        goes_on = any(later.limited.exceedance for later in further)
        about = each.assessed.flight, each, samples, *of_each, calls, earlier, goes_on
        verdicts.append(_verdict(*about))
        earlier += verdicts[-1].alerts
    return samples, tuple(verdicts)


def _samples(
    flight: RecordedFlight,
    judged: list[JudgedSegment],
    trims: TrimSteps,
    alert_above: Sequence[float],
) -> npt.NDArray[np.void]:
    """(n,) of sample_type, filled block by block; also the times without a sample."""
    n = len(flight.recording.t)
    firsts, stops = [each.first for each in judged], [each.stop for each in judged]
    samples = np.empty(n, sample_type(len(flight.monitor.dictionary)))
    for first in range(0, n, BLOCK):
        rows = slice(first, min(first + BLOCK, n))
        fields = _between(flight.recording, rows, trims)
        for number in range(bisect_right(stops, first), bisect_left(firsts, rows.stop)):
            _fill(fields, rows, number, judged[number], alert_above[number])
        for name, values in fields.items():
            samples[name][rows] = values
    return flight.spread(samples)


def _fill(
    fields: dict[str, npt.NDArray[Any]],
    rows: slice,
    number: int,
    judged: JudgedSegment,
    alert_above: float,
) -> None:
    """Fill in the assessments of a segment, valid and withdrawn ones, and its rest."""
    if judged.segment.is_rest:
        return
    begin, end = max(rows.start, judged.first), min(rows.stop, judged.stop)
    target = _shifted(begin, end, rows.start)
    fields["manoeuvre"][target] = number
    is_invalid = judged.withdrawal is not None and judged.withdrawal.first == 0
    fields["state"][target] = INVALID if is_invalid else WARMING_UP
    begin = max(begin, judged.begin)
    if begin >= end:
        return
    target, source = _shifted(begin, end, rows.start), _shifted(begin, end, judged.begin)
    assessments, gone = judged.assessments, judged.withdrawn(source)
    p_value = assessments.p_value[source]
    fields["y_hat"][target] = np.where(gone[:, None], np.nan, assessments.y_hat[source])
    fields["withdrawn"][target] = np.where(gone, p_value, np.nan)
    fields["state"][target] = np.where(gone, INVALID, assessments.state[source])
    fields["p_value"][target] = np.where(gone, np.nan, p_value)
    fields["alert"][target] = ~gone & (p_value > alert_above)


def _shifted(begin: int, end: int, by: int) -> slice:
    return slice(begin - by, end - by)


def _between(recording: Recording, rows: slice, trims: TrimSteps) -> dict[str, npt.NDArray[Any]]:
    """The fields of sample_type in some rows, without assessments.

    Channels are from trim, as recorded where that is unknown.
    """
    n, trim = rows.stop - rows.start, trims.at(recording.t[rows])
    unknown = np.full(n, np.nan)
    attitude = [
        recording.attitude[key][rows] if key in recording.attitude else unknown for key in ATTITUDE
    ]
    return {
        "t": recording.t[rows],
        "y": recording.y[rows] - np.nan_to_num(trim),
        "p_value": unknown.copy(),
        "withdrawn": unknown.copy(),
        "alert": np.zeros(n, bool),
        "state": np.full(n, INVALID, np.uint8),
        "manoeuvre": np.full(n, BETWEEN, np.int16),
        "y_hat": np.full(recording.y[rows].shape, np.nan),
        "attitude": np.column_stack(attitude),
        "trim": trim,
    }


def _verdict(
    flight: RecordedFlight,
    judged: JudgedSegment,
    samples: npt.NDArray[np.void],
    epsilon: float,
    alert_above: float,
    calls: Sequence[float],
    earlier: Sequence[tuple[float, float]],
    goes_on: bool,
) -> ScoredManoeuvre:
    """earlier: alerts in the parts of the manoeuvre before.   goes_on: a later part exceeds."""
    first, last = flight.place[[judged.first, judged.stop - 1]].tolist()
    part = samples[first : last + 1]
    known = np.isfinite(part["p_value"])
    peak = int(np.nanargmax(part["p_value"])) if known.any() else None
    rises = peak is not None and part["p_value"][peak] > smallest_epsilon(flight.monitor.n_unsafe)
    alerts = alert_times(part["t"], part["alert"])
    is_missing = peak is None and judged.is_missing
    limited, exceedance, promised = judged.limited, judged.limited.exceedance, flight.promised
    withdrawal, own, onset = judged.withdrawal, judged.own, judged.segment.onset
    is_cut = goes_on or bool(judged.segment.ends_early)
    warned, is_withdrawn, invalid_t = alerts, withdrawal is not None, inf
    is_outside = False
    if exceedance is not None:
        begins_t = judged.assessments.t[0] if onset is not None else -inf
        is_outside = flight.grid.shown is not None and exceedance.t <= begins_t + SAME_TIME
        is_withdrawn = withdrawal is not None and judged.was_before(withdrawal.first, exceedance)
        if judged.outside is not None and judged.was_before(judged.outside, exceedance):
            invalid_t = float(judged.assessments.t[judged.outside])
        warned = lasting((*earlier, *alerts), invalid_t, exceedance.t, promised)
        warned = flight.warned(exceedance, warned)
    result, lead = outcome(warned, exceedance, promised, is_cut=is_cut, calls=calls)
    limits_known = flight.planned.limits_known or bool(judged.in_force)
    if not limits_known:
        result, lead = "unknown", None
    elif not warned and (is_withdrawn or _was_silent(judged)):
        result, lead = "invalid", None
    elif exceedance is None and (_were_unknown(judged) or (own and own.exceedance)):
        result, lead = "invalid", None  # the alert was about limits that may not be in force
    elif judged.segment.is_rest or is_outside:
        result, lead = "unassessed", None
    elif peak is None and lead is None:
        result = "invalid"
    lines = list(limits_remarks(judged.in_force, own, flight.planned))
    is_unused = bool(judged.segment.unused)
    if withdrawal is not None and not is_unused:
        lines.append(withdrawn(judged.assessments, withdrawal.first, limited, alert_above, warned))
    why = ""
    if not limits_known or is_unused:
        pass
    elif judged.unknown:
        why = judged.unknown
    elif exceedance is None:
        keys = {peak.channel for peak in limited.peaks}
        shown = limited._replace(holes=tuple(flight.holes(keys, *judged.interval)))
        about = judged.assessments, None if peak is None and not is_missing else alerts
        why = why_outcome_unknown(shown, *about, flight.monitor.dt)
        if why and lost_in(shown.holes) > limited.lost + 0.5 * flight.monitor.dt:
            lines.append("samples that came too late to be shown are recorded, judged here alone")
        why = why or _why_frozen(flight, part["t"], keys)
    elif (not is_withdrawn or is_missing) and not _was_silent(judged) and result != "unassessed":
        about = limited, exceedance, judged.assessments, warned, promised
        why = why_warning_unknown(*about, flight.monitor.dt)
    if not why and exceedance is not None and result in ("missed", "late_alert", "unassessed"):
        why = _why_frozen(flight, part["t"][part["t"] < exceedance.t - SAME_TIME])
    if why:
        result, lead = "unseen", None
        lines.append(why)
    return ScoredManoeuvre(
        name=judged.segment.name,
        start=float(part["t"][0]),
        end=float(part["t"][-1]),
        first=first,
        last=last,
        trim=tuple(None if np.isnan(value) else float(value) for value in judged.assessed.trim),
        validity=judged.validity,
        outcome=result,
        guarantee=guarantee(flight.monitor, judged.validity, epsilon, flight.use),
        peak_risk=None if peak is None else float(part["p_value"][peak]),
        peak_t=float(part["t"][peak]) if rises else None,
        alerts=alerts,
        exceedance=exceedance,
        recorded_exceedance=limited.recorded,
        lead=lead,
        promised=promised,
        look_ahead=flight.recording.look_ahead,
        withdrawn_t=None if withdrawal is None else float(judged.assessments.t[withdrawal.first]),
        withdrawn_reason="" if withdrawal is None else withdrawal.reason,
        limits_in_force=judged.in_force,
        own_exceedance=None if own is None else own.exceedance,
        remarks=(
            *lines,
            *(remark for flown in judged.inputs for remark in flown.remarks),
            *remarks(flight.planned, judged.segment, limited, judged.assessments),
        ),
        amplitude=amplitude(judged.inputs),
        monitor=judged.in_force[0]["monitor_name"] if flight.members else "",
        alert_above=alert_above if flight.members and not is_unused else None,
        worst=limited.worst,
        begins=None if onset is None else float(flight.recording.t[onset]),
        worst_recorded=limited.worst_recorded,
    )


def _why_frozen(flight: RecordedFlight, t: Array, keys: Collection[str] = ()) -> str:
    """Why there is no verdict, because a control or one of these was frozen at these times [s]."""
    keys = {*keys, *flight.planned.dictionary.controls}
    reasons = (
        f"data missing: {part.reason}"
        for part in flight.grid.frozen
        if not keys.isdisjoint(part.channels)
        and len(t)
        and part.start <= t[-1]
        and t[0] <= part.end
    )
    return next(reasons, "")


def _were_unknown(judged: JudgedSegment) -> bool:
    """Whether the limits of a limit set were unknown, for a part of it."""
    return judged.own is not None and any(each["limits"] is None for each in judged.in_force)


def _was_silent(judged: JudgedSegment) -> bool:
    """Whether other limits were in force before the exceedance, or at all without one."""
    exceedance, silent = judged.limited.exceedance, judged.silent
    if exceedance is None:
        return bool(silent.any())
    return bool(silent[judged.assessments.t <= exceedance.t + SAME_TIME].any())
