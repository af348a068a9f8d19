"""The headline of a flight: the worst that is true of it, decided here and nowhere else.

Levels are those of 14 CFR 25.1322: a warning asks for action now, a caution for attention now.
"""

from enum import StrEnum
from functools import lru_cache
from typing import Literal, NamedTuple

from core.monitor.assessment import Cause, State


class Status(StrEnum):
    """What a headline can say, the worst first."""

    EXCEEDING = "exceeding"
    ALARM = "alarm"
    RISK = "risk"
    STALE = "stale"
    INVALID = "invalid"
    CAUTION = "caution"
    WARMING_UP = "warming_up"
    NOT_CALIBRATED = "not_calibrated"
    EXCEEDED = "exceeded"
    OK = "ok"


class Level(StrEnum):
    """How urgent something is: red is for warnings, amber for cautions."""

    WARNING = "warning"
    CAUTION = "caution"
    ADVISORY = "advisory"
    NONE = "none"


class Facts(NamedTuple):
    """What is known of a flight at a moment.

    exceeds: its newest sample exceeds a limit.   alarm: a warning waits for its acknowledgement.
    alert: the newest risk lies above the alert level.   stale: no sample comes, or no new one.
    invalid: the monitor is not applicable.   warming_up: its history is not full yet.
    calibrated: whether its validity is.   caution: one waits for its acknowledgement.
    exceeded_t: first exceedance that it has come to [s], sought back since or not; None for none.
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


class Headline(NamedTuple):
    """The worst that is true, its level, and what stands beside it: stale and invalid.

    exceeded_t: first exceedance that the flight has come to [s]; said whatever the status.
    """

    status: Status
    level: Level
    beside: tuple[Status, ...] = ()
    exceeded_t: float | None = None


LEVELS = {
    Status.EXCEEDING: Level.WARNING,
    Status.ALARM: Level.WARNING,
    Status.RISK: Level.WARNING,
    Status.STALE: Level.CAUTION,
    Status.INVALID: Level.CAUTION,
    Status.CAUTION: Level.CAUTION,
    Status.WARMING_UP: Level.ADVISORY,
    Status.NOT_CALIBRATED: Level.ADVISORY,
    Status.EXCEEDED: Level.CAUTION,
    Status.OK: Level.NONE,
}

WORDS = {
    Status.EXCEEDING: "EXCEEDING",
    Status.ALARM: "ALARM",
    Status.RISK: "ALERT",
    Status.STALE: "STALE",
    Status.INVALID: "INVALID",
    Status.CAUTION: "CAUTION",
    Status.WARMING_UP: "WARMING UP",
    Status.NOT_CALIBRATED: "NOT CALIBRATED",
    Status.EXCEEDED: "EXCEEDED",
    Status.OK: "OK",
}
BETWEEN = "between manoeuvres"
"""Reason of a sample that is invalid since nothing was to be assessed there."""
NOT_APPLICABLE, LIMITS_UNKNOWN = "not applicable", "limits unknown"
"""What reasons begin with where other limits are in force than the monitor's, or nobody knows which
are."""
CAUSE_WORDS = {
    Cause.BETWEEN: "NOT ASSESSED",
    Cause.NOT_APPLICABLE: "NOT APPLICABLE",
    Cause.LIMITS_UNKNOWN: "LIMITS UNKNOWN",
}
"""What stands in place of INVALID."""


def cause_of(state: State, reason: str) -> Cause | None:
    """The cause of an assessment that was stored, of which the reason in words is kept alone."""
    if state is not State.INVALID:
        return None
    if reason == BETWEEN:
        return Cause.BETWEEN
    if reason.startswith(f"{NOT_APPLICABLE}:"):
        return Cause.NOT_APPLICABLE
    return Cause.LIMITS_UNKNOWN if reason.startswith(f"{LIMITS_UNKNOWN}:") else None


AlarmKind = Literal["risk", "limit", "invalid", "stale"]
"""A predicted exceedance, a measured one, a monitor that is not applicable, a late source."""
ALARM_LEVELS: dict[AlarmKind, Level] = {
    "risk": Level.WARNING,
    "limit": Level.WARNING,
    "invalid": Level.CAUTION,
    "stale": Level.CAUTION,
}


@lru_cache(maxsize=1024)
def headline(facts: Facts) -> Headline:
    """The worst that is true. What a stale sample shows is past: it is never "now"."""
    fresh = not facts.stale
    holds = {
        Status.EXCEEDING: facts.exceeds and fresh,
        Status.ALARM: facts.alarm,
        Status.RISK: facts.alert and fresh,
        Status.STALE: facts.stale,
        Status.INVALID: facts.invalid,
        Status.CAUTION: facts.caution,
        Status.WARMING_UP: facts.warming_up,
        Status.NOT_CALIBRATED: not facts.calibrated,
        Status.EXCEEDED: facts.exceeds or facts.exceeded_t is not None,
        Status.OK: True,
    }
    worst = next(status for status in Status if holds[status])
    always = (status for status in (Status.STALE, Status.INVALID) if holds[status])
    level = LEVELS[worst]
    if holds[Status.EXCEEDED] and level in (Level.ADVISORY, Level.NONE):
        level = LEVELS[Status.EXCEEDED]
    beside = tuple(status for status in always if status != worst)
    return Headline(worst, level, beside, facts.exceeded_t)


def in_words(said: Headline, cause: Cause | None = None) -> str:
    """A headline as every view words it: `ALARM · STALE · EXCEEDED first at 8.76 s`.

    cause: of the newest sample, by which INVALID has a word of its own.
    """
    words = [_word(status, said, cause) for status in (said.status, *said.beside)]
    if said.exceeded_t is not None and said.status not in (Status.EXCEEDING, Status.EXCEEDED):
        words.append(_word(Status.EXCEEDED, said, cause))
    return " · ".join(words)


def _word(status: Status, said: Headline, cause: Cause | None) -> str:
    if status is Status.INVALID and cause is not None:
        return CAUSE_WORDS[cause]
    if status is Status.EXCEEDED and said.exceeded_t is not None:
        return f"{WORDS[status]} first at {said.exceeded_t:.2f} s"
    return WORDS[status]
