"""The headline of a flight: the worst condition that applies, decided only here.

Levels follow 14 CFR 25.1322: a warning requires action now, a caution requires attention now.
"""

from enum import StrEnum
from functools import lru_cache
from typing import Literal, NamedTuple

from core.monitor.assessment import REASONS, Cause, State


class Status(StrEnum):
    """Possible headlines, worst first."""

    EXCEEDING = "exceeding"
    ALARM = "alarm"
    RISK = "risk"
    STALE = "stale"
    INVALID = "invalid"
    CAUTION = "caution"
    PAUSED = "paused"
    NO_DATA = "no_data"
    WARMING_UP = "warming_up"
    NOT_ASSESSED = "not_assessed"
    NOT_CALIBRATED = "not_calibrated"
    EXCEEDED = "exceeded"
    NO_ALERT = "no_alert"
    OK = "ok"


class Level(StrEnum):
    """Urgency: warnings are red, cautions amber."""

    WARNING = "warning"
    CAUTION = "caution"
    ADVISORY = "advisory"
    NONE = "none"


class Facts(NamedTuple):
    """State of a flight at a moment.

    exceeds: the newest sample exceeds a limit.   alarm: a warning is unacknowledged.
    alert: the newest risk is above the alert threshold.   stale: no new samples arrive.
    invalid: the monitor is not applicable.   warming_up: its history is not full yet.
    calibrated: whether validity is calibrated.   caution: one is unacknowledged, samples are in
    doubt, or data were missing in the manoeuvre or an ended flight.   paused: no next sample is
    played: it waits for a person, or is at the end of its source.   unassessed: it has ended
    without one assessed sample.   no_data: no sample has arrived.
    exceeded_t: first exceedance so far [s], even if the replay was moved back; None for none.
    exceeded_as_recorded: it is one of the value as recorded, not from trim.
    predicted: the newest forecast of the rest of the test card exceeds a limit.
    ended: the flight has; then an exceedance has precedence over the state of its newest sample.
    """

    exceeds: bool = False
    alarm: bool = False
    alert: bool = False
    stale: bool = False
    invalid: bool = False
    warming_up: bool = False
    calibrated: bool = True
    exceeded_t: float | None = None
    caution: bool = False
    paused: bool = False
    unassessed: bool = False
    predicted: bool = False
    exceeded_as_recorded: bool = False
    no_data: bool = False
    ended: bool = False


class Headline(NamedTuple):
    """The worst condition, its level, and what is shown beside it: stale, invalid, paused.

    While paused also the predicted exceedance.

    exceeded_t: first exceedance so far [s]; always shown.   exceeded_as_recorded: see Facts.
    """

    status: Status
    level: Level
    beside: tuple[Status, ...] = ()
    exceeded_t: float | None = None
    exceeded_as_recorded: bool = False


LEVELS = {
    Status.EXCEEDING: Level.WARNING,
    Status.ALARM: Level.WARNING,
    Status.RISK: Level.WARNING,
    Status.STALE: Level.CAUTION,
    Status.INVALID: Level.CAUTION,
    Status.CAUTION: Level.CAUTION,
    Status.PAUSED: Level.ADVISORY,
    Status.NO_DATA: Level.ADVISORY,
    Status.WARMING_UP: Level.ADVISORY,
    Status.NOT_ASSESSED: Level.ADVISORY,
    Status.NOT_CALIBRATED: Level.ADVISORY,
    Status.EXCEEDED: Level.CAUTION,
    Status.NO_ALERT: Level.ADVISORY,
    Status.OK: Level.NONE,
}

WORDS = {status: status.replace("_", " ").upper() for status in Status} | {Status.RISK: "ALERT"}
PREDICTED = "exceedance predicted"
"""Shown beside NO ALERT."""
BETWEEN = "between manoeuvres"
"""Reason of samples between manoeuvres, which are not assessed."""
NO_MANOEUVRE = "no manoeuvre is under way"
"""Start of that reason in a live flight, while it waits for the next input."""
FILLING = "filling the history"
"""Start of the reasons of a monitor that warms up within a manoeuvre."""
NOT_APPLICABLE, LIMITS_UNKNOWN = "not applicable", "limits unknown"
"""Start of the reason if other limits than the monitor's are in force, or if they are unknown."""
CAUSE_WORDS = {
    (Status.INVALID, Cause.BETWEEN): "NOT ASSESSED",
    (Status.WARMING_UP, Cause.READY): "NOT ASSESSED",
    (Status.INVALID, Cause.NOT_APPLICABLE): "NOT APPLICABLE",
    (Status.INVALID, Cause.LIMITS_UNKNOWN): "LIMITS UNKNOWN",
}
"""Words shown instead of INVALID or WARMING UP."""


@lru_cache(maxsize=1024)
def cause_of(state: State, reason: str) -> Cause | None:
    """Cause of an assessment that was stored without one, from its reason."""
    if state is State.WARMING_UP and not reason.startswith(FILLING):
        return Cause.READY if reason.startswith(f"{NO_MANOEUVRE}:") else Cause.REST
    if state is not State.INVALID:
        return None
    if reason in REASONS:
        return Cause.LOST
    if reason.endswith(("is missing", "are missing")):
        return Cause.MISSING
    if reason == BETWEEN:
        return Cause.BETWEEN
    if reason.startswith(f"{NOT_APPLICABLE}:"):
        return Cause.NOT_APPLICABLE
    return Cause.LIMITS_UNKNOWN if reason.startswith(f"{LIMITS_UNKNOWN}:") else None


AlarmKind = Literal[
    "risk", "limit", "invalid", "stale", "surfaces", "frozen", "contradiction", "trim"
]
"""Predicted exceedance, measured exceedance, monitor not applicable, late source, and samples that
are no picture of the aircraft: its surfaces seem dead, channels are frozen, two samples of one time
contradict, or the trim that is subtracted is a large part of a limit."""
ALARM_LEVELS: dict[AlarmKind, Level] = {
    "risk": Level.WARNING,
    "limit": Level.WARNING,
    "invalid": Level.CAUTION,
    "stale": Level.CAUTION,
    "surfaces": Level.CAUTION,
    "frozen": Level.CAUTION,
    "contradiction": Level.CAUTION,
    "trim": Level.CAUTION,
}


@lru_cache(maxsize=1024)
def headline(facts: Facts) -> Headline:
    """The worst condition. A stale sample shows the past, so it never exceeds or alerts now.

    An earlier exceedance has precedence over a pause.
    """
    fresh = not facts.stale
    exceeded = facts.exceeds or facts.exceeded_t is not None
    holds = {
        Status.EXCEEDING: facts.exceeds and fresh,
        Status.ALARM: facts.alarm,
        Status.RISK: facts.alert and fresh,
        Status.STALE: facts.stale,
        Status.INVALID: facts.invalid,
        Status.CAUTION: facts.caution,
        Status.PAUSED: facts.paused and not exceeded,
        Status.NO_DATA: facts.no_data,
        Status.WARMING_UP: facts.warming_up,
        Status.NOT_ASSESSED: facts.unassessed,
        Status.NOT_CALIBRATED: not facts.calibrated,
        Status.EXCEEDED: exceeded,
        Status.NO_ALERT: facts.predicted,
        Status.OK: True,
    }
    worst = next(status for status in Status if holds[status])
    if facts.ended and exceeded and LEVELS[worst] is not Level.WARNING:
        worst = Status.EXCEEDED
    always = {
        Status.STALE: facts.stale,
        Status.INVALID: facts.invalid,
        Status.PAUSED: facts.paused,
        Status.NO_ALERT: facts.predicted and worst is Status.PAUSED,
    }
    level = LEVELS[worst]
    if holds[Status.EXCEEDED] and level in (Level.ADVISORY, Level.NONE):
        level = LEVELS[Status.EXCEEDED]
    beside = tuple(status for status in always if always[status] and status != worst)
    return Headline(worst, level, beside, facts.exceeded_t, facts.exceeded_as_recorded)


def in_words(summary: Headline, cause: Cause | None = None) -> str:
    """Text of a headline in all views: `ALARM · STALE · EXCEEDED first at 8.76 s`.

    cause: of the newest sample, which may replace the words INVALID and WARMING UP.
    """
    words = [_word(status, summary, cause) for status in (summary.status, *summary.beside)]
    if summary.exceeded_t is not None and summary.status not in (Status.EXCEEDING, Status.EXCEEDED):
        words.append(_word(Status.EXCEEDED, summary, cause))
    if Status.NO_ALERT in (summary.status, *summary.beside):
        words.append(PREDICTED)
    return " · ".join(words)


def _word(status: Status, summary: Headline, cause: Cause | None) -> str:
    if cause is not None and (status, cause) in CAUSE_WORDS:
        return CAUSE_WORDS[status, cause]
    if status is Status.EXCEEDED and summary.exceeded_t is not None:
        kind = " as recorded" if summary.exceeded_as_recorded else ""
        return f"{WORDS[status]} first at {summary.exceeded_t:.2f} s{kind}"
    return WORDS[status]
