"""Validity of a manoeuvre: all conditions of the guarantee in one verdict."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from app.assessment.coverage import lost_samples
from app.assessment.outcome import LIMITS, OBSERVATIONS
from app.assessment.planned_test import PlannedTest, first_direction, read_channels
from app.assessment.recorded import RecordedFlight
from app.assessment.scored import Check, Validity
from app.assessment.segments import Segment
from app.assessment.trim import largest_at_rest, mean_of_rest, of_earlier_rest
from app.telemetry.recording import Recording
from core.channels import LATERAL, Dictionary
from core.kernels.causal_grid import RATE_RATIO
from core.monitor import Assessments, Monitor
from core.monitor.assessment import Withdrawal
from core.monitor.validity.verdict import ValidityVerdict, in_words
from core.types import Array, Flags


@dataclass(frozen=True, eq=False)
class AssessedSegment:
    """A segment of a recording and the monitor's assessments of it.

    trim: (n_channels,), NaN where unknown.   y: (n, n_channels) from trim, NaN where not recorded,
    with the samples before a manoeuvre that fill the history; n_history of them.   y_read: the
    same, 0 in unknown channels that the monitor does not read.   streamed: their assessments.
    """

    flight: RecordedFlight
    segment: Segment
    trim: Array
    y: Array
    y_read: Array
    streamed: Assessments
    n_history: int

    @property
    def monitor(self) -> Monitor:
        return self.flight.monitor

    @property
    def dictionary(self) -> Dictionary:
        return self.flight.monitor.dictionary

    @property
    def needed(self) -> Flags:
        return self.flight.needed

    @property
    def recording(self) -> Recording:
        return self.flight.recording

    @cached_property
    def assessments(self) -> Assessments:
        """Those of the segment itself."""
        return self.streamed.from_sample(self.n_history)

    @cached_property
    def counted(self) -> Assessments:
        """Those up to and including the first exceedance; all of them if there is none."""
        last = self.monitor.last_counted(self.y_read[self.n_history :])
        return self.assessments if last is None else self.assessments.from_sample(0, last + 1)

    @property
    def recorded(self) -> Array:
        """(n, n_channels) of the segment, with trim."""
        return self.recording.y[self.segment.first : self.segment.last + 1]

    @cached_property
    def largest(self) -> Array:
        """(n_channels,) largest magnitude of each, from trim; -inf where not recorded."""
        return largest(self.y)


def largest(y: Array) -> Array:
    """(k,) largest magnitude of each column of y (n, k), ignoring NaN; -inf if all are NaN."""
    columns = (column[np.isfinite(column)] for column in y.T)
    return np.array([np.abs(column).max(initial=-np.inf) for column in columns])


PART = Check("manoeuvre", None, "only a part of it, after the monitor came into use")


def validity(assessed: AssessedSegment) -> tuple[Validity, Withdrawal | None]:
    """Check a manoeuvre; return its validity and the withdrawal, if any.

    The withdrawal starts where a live stream withdraws. If another check fails (airspeed, wrong
    manoeuvre: a stream cannot know these), it starts at the first sample; but a flight that was
    shown is withdrawn only where its crew saw so. None if valid throughout.
    """
    verdict, withdrawal = support(assessed)
    enough = coverage(assessed)
    checks = (
        rate(assessed),
        enough,
        channels(assessed),
        *flight_condition(assessed),
        *(manoeuvre(assessed) if assessed.segment.joins is None else (PART,)),
        units(assessed),
        trim(assessed),
        Check(OBSERVATIONS, verdict.valid, _support_text(verdict)),
    )
    failed = tuple(check.text for check in checks[:-1] if check.ok is False)
    valid = False if failed else verdict.valid
    lacking = () if enough.ok or failed else (enough.text,)
    as_shown = verdict.reasons if withdrawal is None else (withdrawal.reason,)
    if lacking and valid:
        valid = None  # keep the assessments, but simulated flights have no such gaps
    result = Validity(
        valid=valid,
        p_value=verdict.p_value,
        residual_p=verdict.residual_p,
        distance_p=verdict.distance_p,
        reasons=failed + lacking + as_shown,
        checks=checks,
    )
    is_shown = assessed.flight.grid.shown is not None and not _without_trim(assessed)
    return result, Withdrawal(0, in_words(failed)) if failed and not is_shown else withdrawal


def ended_early(verdict: Validity, why: str) -> Validity:
    """Simulated flights go on to the end: without an exceedance, no promise covers a part."""
    check = Check("end", None, why)
    valid = None if verdict.valid else verdict.valid
    reasons = (*verdict.reasons, why)
    return replace(verdict, valid=valid, reasons=reasons, checks=(*verdict.checks, check))


def under_limits(verdict: Validity, in_force: Sequence[Mapping[str, Any]]) -> Validity:
    """Add the limit set's check: not applicable where its limits are not the monitor's.

    in_force: plain, see InForceTimeline.intervals.
    """
    reasons = tuple(dict.fromkeys(each["reason"] for each in in_force if each["reason"]))
    if not reasons:
        return verdict
    check = Check(LIMITS, False, "; ".join(reasons))
    checks, reasons = (*verdict.checks, check), (*reasons, *verdict.reasons)
    return replace(verdict, valid=False, reasons=reasons, checks=checks)


def support(assessed: AssessedSegment) -> tuple[ValidityVerdict, Withdrawal | None]:
    """Are the observations within training, by conformal rank; and from where not?"""
    monitor, absent = assessed.monitor, ~np.isfinite(assessed.y).any(axis=0)
    if missing := _keys(assessed, absent & read_channels(monitor)):
        unknown = [key for key in missing if key in _without_trim(assessed)]
        missing = [key for key in missing if key not in unknown]
        reasons = [f"{', '.join(missing)} not recorded"] if missing else []
        reasons += [f"trim of {', '.join(unknown)} unknown"] if unknown else []
        reason = f"not judged: {', '.join(reasons)}"
        return ValidityVerdict(None, reasons=(reason,)), None
    streamed = assessed.streamed
    return monitor.judge_and_withdraw(streamed.t, assessed.y_read, streamed)


def _support_text(verdict: ValidityVerdict) -> str:
    if verdict.p_value is None or verdict.level is None:
        return "; ".join(verdict.reasons)
    numbers = f"p = {verdict.p_value:.3g}, outside training at p ≤ {verdict.level:g}"
    parts = {"residual": verdict.residual_p, "distance": verdict.distance_p}
    each = ", ".join(f"{name} {p:.3g}" for name, p in parts.items() if p is not None)
    return f"{numbers} ({each})" + "".join(f"; {reason}" for reason in verdict.reasons)


SPEED_SHARE = 0.1
"""Share of the model's airspeed. Further off, the derivatives belong to another condition."""
LARGER, FAR_LARGER = 2.0, 10.0
"""Times the largest in training: above the first, a remark; above the second, a failed check."""
DEGREES = 30.0
"""Times as large: probably degrees read as radians."""
FLOWN_SHARE = 0.3
"""Share of the planned amplitude. A planned input that moves less was not flown; a surface that
should stay still and moves more makes it another manoeuvre."""
ASSESSED_SHARE = 0.9
"""Share of the counted samples that must be assessed for the guarantee to apply."""
LONGER = 2.0
"""Times the simulated duration. Longer segments hold more than one manoeuvre."""


def rate(assessed: AssessedSegment) -> Check:
    """Were the needed channels recorded fast enough, and how many samples were assessed?

    Without an assessed sample `coverage` fails, whatever the rates.
    """
    t, dt = assessed.assessments.t, assessed.monitor.dt
    repeats = {channel.key: channel.held for channel in assessed.flight.quality.channels}
    steps = {}
    for key in assessed.dictionary.sources(_keys(assessed, assessed.needed)):
        trace = assessed.flight.traces.channels[key]
        part = slice(*np.searchsorted(trace.t, (t[0] - dt, t[-1] + dt)).tolist())
        n_known = np.count_nonzero(np.isfinite(trace.values[part]))
        if n_known > 1:
            recorded = trace.t[part]
            step = float(recorded[-1] - recorded[0]) / (n_known - 1)
            steps[key] = step * repeats.get(key, 1)
    n_assessed, n = int(np.isfinite(assessed.assessments.p_value).sum()), len(t)
    text = f"{n_assessed} of {n} samples assessed"
    if not steps:
        return Check("rate", None, text)
    slowest = max(steps, key=lambda key: steps[key])
    rates = f"{slowest} recorded at {1 / steps[slowest]:.4g} Hz, monitor runs at {1 / dt:.4g} Hz"
    fast_enough = True if steps[slowest] <= 1.05 * dt else None
    if (rows := repeats.get(slowest, 1)) > 1:
        rates += f" (each value repeats in {rows} rows)"
        fast_enough = fast_enough if steps[slowest] <= RATE_RATIO * dt else False
    return Check("rate", fast_enough, f"{rates}; {text}")


def coverage(assessed: AssessedSegment) -> Check:
    """Were enough samples assessed, up to the first exceedance?"""
    counted = assessed.counted
    lost = lost_samples(counted.t, counted.state, assessed.monitor.dt).lost
    n_lost, n = int(lost.sum()), len(lost)
    if not np.isfinite(assessed.assessments.p_value).any():
        return Check("coverage", False, f"no sample was assessed{_most_missing(assessed)}")
    if n_lost <= (1.0 - ASSESSED_SHARE) * n:
        return Check("coverage", True, f"at least {ASSESSED_SHARE:.0%} of the samples")
    text = f"{n_lost} of {n} samples are missing or were not assessed"
    text += f"; the limit is {1.0 - ASSESSED_SHARE:.0%}{_most_missing(assessed)}"
    return Check("coverage", None, text)


def _most_missing(assessed: AssessedSegment) -> str:
    """Unknown trims, or the needed channel with the most samples missing; "" if none is."""
    if unknown := _without_trim(assessed):
        return f"; trim of {', '.join(unknown)} unknown"
    missing = np.where(assessed.needed, np.isnan(assessed.y).sum(axis=0), 0)
    worst = int(missing.argmax())
    if not missing[worst]:
        return ""
    return (
        f"; {assessed.dictionary.keys[worst]} is missing in {missing[worst]} of {len(assessed.y)}"
    )


def channels(assessed: AssessedSegment) -> Check:
    """Is every needed channel there, and which are derived?"""
    there = np.isfinite(assessed.recorded).any(axis=0)
    if lost := _keys(assessed, assessed.needed & ~there):
        return Check("channels", False, f"no sample of {', '.join(lost)} here")
    derived = [key for key in assessed.dictionary.keys if key in assessed.recording.derived]
    absent = _keys(assessed, ~there)
    remarks = [f"{', '.join(derived)} derived, not measured"] if derived else []
    remarks += [f"{', '.join(absent)} not recorded and not needed"] if absent else []
    return Check("channels", True, "; ".join(["all needed channels", *remarks]))


def _without_trim(assessed: AssessedSegment) -> list[str]:
    """Needed channels that were recorded, but whose trim is unknown."""
    there = np.isfinite(assessed.recorded).any(axis=0)
    return _keys(assessed, assessed.needed & there & np.isnan(assessed.trim))


def units(assessed: AssessedSegment) -> Check:
    """Are the values of the same order as in training? The support check is the fine one."""
    known = assessed.monitor.training_max_abs
    ratio = np.divide(assessed.largest, known, out=np.zeros_like(known), where=known > 0.0)
    worst = int(ratio.argmax())
    if ratio[worst] <= LARGER:
        return Check(
            "units", True, f"every channel within {LARGER:g} times its largest in training"
        )
    channel = assessed.dictionary.channels[worst]
    text = (
        f"{channel.key} peaks at {channel.read(assessed.largest[worst])}, {ratio[worst]:.3g} times "
        "its largest in training"
    )
    if ratio[worst] <= FAR_LARGER:
        return Check("units", None, text)
    is_degrees = channel.unit.startswith("rad") and DEGREES <= ratio[worst] <= 2 * np.degrees(1.0)
    hint = " (degrees read as radians?)" if is_degrees else ""
    return Check("units", False, f"{text}: check its unit and the manoeuvre{hint}")


def _keys(assessed: AssessedSegment, which: npt.ArrayLike) -> list[str]:
    """Keys of some channels. which: (n_channels,) bool."""
    return [assessed.dictionary.keys[c] for c in np.flatnonzero(which)]


def flight_condition(assessed: AssessedSegment) -> Iterator[Check]:
    """Did the aircraft fly at the model's airspeed? Only for a monitor that was simulated here."""
    if assessed.dictionary != LATERAL:
        return
    name, part = "flight condition", slice(assessed.segment.first, assessed.segment.last + 1)
    condition = {key: values[part] for key, values in assessed.recording.condition.items()}
    means = {key: v[np.isfinite(v)].mean() for key, v in condition.items() if np.isfinite(v).any()}
    height = f"; altitude {means['h']:.0f} m, not checked" if "h" in means else ""
    if "V" not in means:
        yield Check(name, None, f"no airspeed recorded{height}")
        return
    speed, model = means["V"], assessed.flight.planned.speed
    if model is None:
        yield Check(name, None, f"{speed:.1f} m/s; model airspeed unknown{height}")
        return
    off = speed / model - 1.0
    text = f"{speed:.1f} m/s, {off:+.1%} from the model's {model:.1f} m/s{height}"
    yield Check(name, bool(abs(off) <= SPEED_SHARE), text)


def manoeuvre(assessed: AssessedSegment) -> Iterator[Check]:
    """Was it the planned manoeuvre: surface, direction, length?"""
    planned = assessed.flight.planned
    if planned.duration is None:
        yield Check("manoeuvre", None, "the monitor does not record its planned test")
        return
    surfaces = surfaces_flown(planned, assessed.y, assessed.monitor.training_max_abs)
    yield Check("manoeuvre", *surfaces)
    first, last = assessed.recording.t[[assessed.segment.first, assessed.segment.last]]
    length = float(last - first)
    text = f"{length:.2f} s, simulated {planned.duration:.2f} s"
    longer = length - planned.duration > 0.5 * planned.dt
    if length > LONGER * planned.duration:
        yield Check("length", False, f"{text}: mark the manoeuvre by itself")
    elif longer:
        yield Check("length", None, f"{text}: the rest is not covered")
    else:
        yield Check("length", True, text)


def surfaces_flown(planned: PlannedTest, y: Array, usual: Array) -> tuple[bool | None, str]:
    """Did the surfaces move as planned? None where not recorded; and the finding in words.

    y: (n, n_channels) from trim, NaN where unknown.   usual: (n_channels,) largest in training.
    """
    amplitudes, texts, oks = planned.amplitudes, [], []
    flown = largest(y[:, list(planned.controls)])
    for column, c in enumerate(planned.controls):
        channel = planned.dictionary.channels[c]
        name, moved, amplitude = channel.label, flown[column], amplitudes[column]
        if not np.isfinite(moved):
            oks.append(None)
            texts.append(f"{name} not recorded")
            continue
        text = f"{name} moved by {channel.read(moved, 2)}"
        oks.append(True)
        if amplitude > 0.0:
            text += f", planned {channel.read(amplitude, 2)}"
            flown_first = first_direction(y[:, c])
            planned_first = first_direction(planned.commands[:, column])
            if moved < FLOWN_SHARE * amplitude:
                oks[-1] = False
                text += ": barely flown"
            elif planned_first and flown_first != planned_first:
                oks[-1] = False
                text += ": moved the other way first, or its sign is reversed"
        elif moved > max(FLOWN_SHARE * amplitudes.max(initial=0.0), LARGER * usual[c]):
            oks[-1] = False
            text += ", although the planned manoeuvre does not use it"
        elif moved > LARGER * usual[c]:
            known = channel.read(usual[c], 2)
            text += f", at most {known} in training"
        texts.append(text)
    ok = False if False in oks else None if None in oks else True
    return ok, "; ".join(texts)


def trim(assessed: AssessedSegment) -> Check:
    """Was the aircraft trimmed before the first input?"""
    segment = assessed.segment
    if unknown := _without_trim(assessed):
        why = (
            "no sample to take it from" if segment.onset is None else "the aircraft moved before it"
        )
        return Check("trim", False, f"trim of {', '.join(unknown)} unknown: {why}")
    if segment.rest is None:
        text = "measured before this part" if assessed.trim.any() else "no trim subtracted"
        return Check("trim", None, text)
    length = (segment.rest.stop - segment.rest.start) * assessed.monitor.dt
    text = f"mean of the first {length:.2f} s"
    if segment.onset is not None:
        text = f"mean of the {length:.2f} s before the first input"
    outputs = list(assessed.dictionary.of_role("output"))
    if not outputs:
        return Check("trim", True, text)
    rest = assessed.recording.y[segment.rest][:, outputs]
    known = np.isfinite(rest)
    spread = rest.max(0, initial=-np.inf, where=known) - rest.min(0, initial=np.inf, where=known)
    most = largest_at_rest(assessed.monitor.training_max_abs[outputs])
    if segment.trim is not None:
        level = mean_of_rest(assessed.recording.y[segment.rest])
        _, earlier = of_earlier_rest(assessed.monitor, segment.trim, level)
        if earlier:
            return Check("trim", False, f"{earlier}: the flight does not begin in trim")
    share = np.where(assessed.needed[outputs], spread / most, 0.0)
    worst = int(share.argmax())
    channel = assessed.dictionary.channels[outputs[worst]]
    moved = f"{channel.key} moves by {channel.read(spread[worst], 2)} in it"
    if share[worst] > 1.0:
        return Check("trim", False, f"{text}, but {moved}: the flight does not begin in trim")
    return Check("trim", True, text)


def final_withdrawal(
    silent: Flags, withdrawal: Withdrawal | None, in_force: Sequence[Mapping[str, Any]]
) -> Withdrawal | None:
    """The withdrawal that lasts to the end: by validity, or earlier by the limits in force."""
    if not silent[-1]:
        return withdrawal
    first = int(np.flatnonzero(~silent)[-1]) + 1 if not silent.all() else 0
    if withdrawal is not None and withdrawal.first <= first:
        return withdrawal
    return Withdrawal(first, in_force[-1]["reason"])
