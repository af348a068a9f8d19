"""How a flight was warned of the limit that it exceeded: one answer in flight and in the record."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from math import ceil, inf
from typing import Any, NamedTuple

import numpy as np

from app.assessment.coverage import lost_chance
from app.assessment.outcome import (
    EXCEEDED,
    OUTCOMES,
    OUTSIDE,
    Outcome,
    RecordedExceedance,
    after_recorded,
    exceedance_verdict,
    lasting,
    outcome,
    recorded_verdict,
    verdict_of,
    warned_at,
    warning_words,
)
from app.assessment.validity import LONGER
from app.messages import Verdict
from app.recipes.recipes import from_plain
from core.flight_events import Alarm
from core.limits.exceedance import SAME_TIME
from core.monitor import State
from core.monitor.assessment import DATA_MISSING, RESTS, Cause, code_of
from core.planned_test.collection import DatasetRecipe
from core.types import Array

BEFORE, JUMP = 20, 5.0
"""Samples before an exceedance that must have been flown; longer steps, in intervals, are jumps."""
WORST: tuple[Outcome, ...] = ("missed", "late_alert", "unseen", "invalid", "timely_alert")
"""Outcomes of the exceedances of a recording, of which the first here is the flight's."""
NOT_FLOWN = f"{EXCEEDED}, samples before it not flown"
UNASSESSED = exceedance_verdict("unseen", None)


class Circumstances(NamedTuple):
    """What else decides whether a flight was warned.

    promised: lead time that the monitor states [s]; a shorter warning is late.
    jumped: the samples just before the first exceedance were not flown, so an alarm raised with it
    could not warn.
    withdrawn: the monitor was not applicable by then; without an alarm it has not missed.
    unassessed: the verdict if no sample could warn of it in time, see `unassessed`; else empty.
    invalid_t: see `lasting`.
    live: alarms stored without `arrived` count from when they were raised.
    longest: [s] an earlier alert belongs to another manoeuvre.
    controls: their keys; where one was frozen, the monitor has not missed.
    """

    promised: float = 0.0
    jumped: bool = False
    withdrawn: bool = False
    unassessed: str = ""
    invalid_t: float = inf
    live: bool = False
    longest: float = inf
    controls: tuple[str, ...] = ()


AS_FLOWN = Circumstances()


class Before(NamedTuple):
    """Circumstances of an exceedance by the samples before it."""

    jumped: bool = False
    withdrawn: bool = False
    unassessed: str = ""
    invalid_t: float = inf


class SampleCause(NamedTuple):
    """A sample at t [s], and why it was not assessed.

    invalid_t: when the monitor became invalid [s]; infinite if it is not.
    """

    t: float
    state: State
    cause: Cause | None = None
    invalid_t: float = inf

    def after(self, before: "SampleCause | None") -> "SampleCause":
        """Data that are missing do not make a monitor valid again."""
        invalid_t = inf if before is None or self.cause not in DATA_MISSING else before.invalid_t
        if self.state is State.INVALID and self.cause is None:
            invalid_t = self.t if before is None else min(before.invalid_t, self.t)
        return self._replace(invalid_t=invalid_t)

    @property
    def is_withdrawn(self) -> bool:
        """Whether the monitor was not applicable; missing data withdraw nothing."""
        is_other = self.cause is Cause.BETWEEN or self.cause in DATA_MISSING
        return self.state is State.INVALID and not is_other


def verdict(alarms: Iterable[Alarm], circumstances: Circumstances = AS_FLOWN) -> Verdict | None:
    """How the first exceedance from trim was warned of; None without an exceedance.

    One as recorded that came before is named.
    """
    alarms = [*alarms]
    first, raw = first_exceedance(alarms), _first(alarms)
    if first is None or raw is None:
        return None if raw is None else _as_recorded(raw.t, raw)
    from_trim = _from_trim(first, alarms, circumstances)
    if raw.exceedance is None:
        return from_trim
    text, warning = after_recorded(from_trim.text, first.t, raw.t, raw.exceedance.doubt), ""
    if from_trim.warning and text != from_trim.text:
        warning = f"{from_trim.warning} from trim, exceeded as recorded earlier"
    return from_trim.model_copy(update={"text": text, "warning": warning or from_trim.warning})


def _from_trim(first: Alarm, alarms: Sequence[Alarm], circumstances: Circumstances) -> Verdict:
    promised, jumped, withdrawn, unassessed, invalid_t, live, longest, controls = circumstances
    jumped &= not live
    alerts = sorted(
        _warned(alarm, first, live)
        for alarm in alarms
        if alarm.kind == "risk"
        and lasting(((alarm.t, alarm.t),), invalid_t, first.t, promised)
        and first.t - longest <= alarm.t <= first.t
        and (None in (alarm.manoeuvre, first.manoeuvre) or alarm.manoeuvre == first.manoeuvre)
        and not (jumped and alarm.seq >= first.seq)
    )
    if jumped and not alerts:
        return not_flown(first.t)
    if any(
        alarm.kind == "frozen"
        and first.t - longest <= alarm.t < first.t
        and not {*controls}.isdisjoint(alarm.channels or ())
        for alarm in alarms
    ):
        unassessed = UNASSESSED
    exceedance = RecordedExceedance(first.t, "", 0.0)
    result, lead = outcome(tuple((t, t) for t in alerts), exceedance, promised)
    if unassessed and not withdrawn and result != "timely_alert":
        return Verdict(exceeded_t=first.t, lead=None, text=unassessed)
    result = "invalid" if withdrawn and not alerts else result
    text = exceedance_verdict(result, lead, promised)
    return _verdict(first.t, lead, text, result, promised)


def planned_length(dataset_recipe: Mapping[str, Any]) -> float | None:
    """Length of the planned manoeuvre [s]; None if unknown, as of own rollouts."""
    plain = dataset_recipe.get("maneuver")
    return from_plain(DatasetRecipe().maneuver, plain).duration_s if plain else None


def longest_manoeuvre(planned_s: float | None) -> float:
    """Longest time that may be one manoeuvre of the planned test [s]; infinite if unknown.

    planned_s: see planned_length.
    """
    return inf if planned_s is None else LONGER * planned_s


def verdict_of_recording(
    manoeuvres: Sequence[Mapping[str, Any]],
    alarms: Sequence[Alarm],
    reached: Sequence[float],
    dt: float,
    promised: float,
) -> Verdict:
    """The worst verdict of the scored exceedances that a replay has come to.

    manoeuvres: as scored, plain.   reached: times of the exceedances it has come to [s], one or
    more.   dt: sample interval [s].   promised: see Circumstances.
    """
    by_trim = [
        manoeuvre
        for manoeuvre in manoeuvres
        if manoeuvre["exceedance"] and manoeuvre["exceedance"]["t"] <= max(reached) + dt
    ]
    if by_trim:
        worst = min(by_trim, key=lambda m: (_rank(m["outcome"]), m["exceedance"]["t"]))
        t, lead, text = worst["exceedance"]["t"], worst["lead"], verdict_of(worst, promised)
        return _verdict(t, lead, text, worst["outcome"], promised)
    if (first := first_exceedance(alarms)) is not None:
        return Verdict(exceeded_t=first.t, lead=None, text=OUTSIDE)
    return _as_recorded(min(reached), _first(alarms))


def not_flown(t: float) -> Verdict:
    return Verdict(exceeded_t=t, lead=None, text=NOT_FLOWN)


def no_verdict(result: Outcome, why: str) -> Verdict:
    """Of a flight without a measured exceedance."""
    return Verdict(exceeded_t=None, lead=None, text=f"{OUTCOMES[result].word}: {why}")


def first_exceedance(alarms: Iterable[Alarm]) -> Alarm | None:
    """The alarm of the earliest exceedance from trim."""
    return _first(filter(exceeds_from_trim, alarms))


def exceeds_from_trim(alarm: Alarm) -> bool:
    return alarm.exceedance is not None and alarm.exceedance.judged != "recorded"


def is_jump(t: Array, dt: float) -> bool:
    """Whether a flight was sought or looped within these samples. t: (n,) [s]."""
    steps = np.diff(t)
    return bool(((steps <= 0.0) | (steps > JUMP * dt)).any())


def n_before(lead: float, dt: float) -> int:
    """Samples before an exceedance that decide whether it could be warned of."""
    return max(BEFORE, ceil(2.0 * lead / dt) + 1)


def before_exceedance(t: float, samples: Sequence[SampleCause], lead: float, dt: float) -> Before:
    """See `unassessed`; samples: n_before of them or more, and that of the exceedance."""
    newest = samples[-1:]
    samples = samples[-n_before(lead, dt) - 1 :]
    jumped = is_jump(np.array([sample.t for sample in samples[-BEFORE - 1 :]]), dt)
    withdrawn = any(sample.is_withdrawn for sample in newest)
    invalid_t = min((sample.invalid_t for sample in newest), default=inf)
    return Before(jumped, withdrawn, unassessed(t, samples, lead, dt), invalid_t)


def unassessed(t: float, samples: Iterable[SampleCause], lead: float = 0.0, dt: float = 1.0) -> str:
    """The verdict on an exceedance that no sample could warn of in time; else empty.

    t: of the exceedance [s].   samples: the newest ones by then.   lead: promised [s].   dt: of
    the monitor [s].
    """
    before = [sample for sample in samples if sample.t < t - SAME_TIME]
    known = [sample for sample in before if sample.cause not in DATA_MISSING]
    if known and known[-1].cause in RESTS:
        return OUTSIDE
    if not any(sample.state is State.OK for sample in known):
        return UNASSESSED
    if t - before[-1].t > JUMP * dt:  # the limit was exceeded somewhere in between
        return UNASSESSED
    rests = [k for k, sample in enumerate(before) if sample.cause in RESTS]
    part = before[rests[-1] + 1 if rests else 0 :]
    if not part:
        return ""
    codes = [code_of(State.OK if each.is_withdrawn else each.state) for each in part]
    times = np.array([each.t for each in part])
    return UNASSESSED if len(lost_chance(times, np.array(codes, np.int64), t, lead, dt)) else ""


def _verdict(t: float, lead: float | None, text: str, result: Outcome, promised: float) -> Verdict:
    warning = warning_words(result, lead, promised)
    decided = result in ("timely_alert", "late_alert", "missed")
    warning = warning[:1].upper() + warning[1:] if decided else ""
    return Verdict(exceeded_t=t, lead=lead, text=text, warning=warning)


def _as_recorded(t: float, alarm: Alarm | None) -> Verdict:
    measured = None if alarm is None else alarm.exceedance
    doubt = "" if measured is None else measured.doubt
    return Verdict(exceeded_t=t, lead=None, text=recorded_verdict(doubt))


def _warned(risk: Alarm, exceedance: Alarm, live: bool) -> float:
    """Flight time at which an alarm warned of an exceedance [s]."""
    if risk.arrived is not None and exceedance.arrived is not None:
        return warned_at(risk.t, risk.arrived, exceedance.t, exceedance.arrived)
    if not live:
        return risk.t
    raised = [datetime.fromisoformat(alarm.raised).timestamp() for alarm in (risk, exceedance)]
    return warned_at(risk.t, raised[0], exceedance.t, raised[1])


def _first(alarms: Iterable[Alarm]) -> Alarm | None:
    measured = (alarm for alarm in alarms if alarm.kind == "limit")
    return min(measured, key=lambda alarm: alarm.t, default=None)


def _rank(result: Outcome) -> int:
    return WORST.index(result) if result in WORST else len(WORST)
