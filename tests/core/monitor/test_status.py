"""The headline of a flight: the worst that is true, for every combination of facts."""

from itertools import product

from core.monitor.assessment import Cause
from core.monitor.status import (
    LEVELS,
    Facts,
    Headline,
    Level,
    Status,
    headline,
    in_words,
)

T = 8.76
FLAGS = [name for name in Facts._fields if not name.startswith("exceeded")]
EVERY = [
    Facts(exceeded_t=exceeded_t)._replace(**dict(zip(FLAGS, values, strict=True)))
    for values in product((False, True), repeat=len(FLAGS))
    for exceeded_t in (None, T)
]
WORST_FIRST = (
    "exceeding",
    "alarm",
    "risk",
    "stale",
    "invalid",
    "caution",
    "paused",
    "no_data",
    "warming_up",
    "not_assessed",
    "not_calibrated",
    "exceeded",
    "no_alert",
    "ok",
)


def true_of(facts: Facts) -> set[str]:
    """Words that may be said of these facts, each by its own definition."""
    said = {"ok"}
    said |= {"exceeding"} if facts.exceeds and not facts.stale else set()
    said |= {"alarm"} if facts.alarm else set()
    said |= {"risk"} if facts.alert and not facts.stale else set()
    said |= {"stale"} if facts.stale else set()
    said |= {"invalid"} if facts.invalid else set()
    said |= {"caution"} if facts.caution else set()
    exceeded = facts.exceeds or facts.exceeded_t is not None
    said |= {"paused"} if facts.paused and not exceeded else set()
    said |= {"no_data"} if facts.no_data else set()
    said |= {"warming_up"} if facts.warming_up else set()
    said |= {"not_assessed"} if facts.unassessed else set()
    said |= set() if facts.calibrated else {"not_calibrated"}
    said |= {"exceeded"} if facts.exceeds or facts.exceeded_t else set()
    said |= {"no_alert"} if facts.predicted else set()
    return said


def test_the_order_is_the_contract_s() -> None:
    assert tuple(Status) == WORST_FIRST


def test_the_headline_is_the_worst_that_is_true() -> None:
    for facts in EVERY:
        said = true_of(facts)
        if facts.ended and "exceeded" in said:
            said &= {"exceeding", "alarm", "risk", "exceeded"}
        assert headline(facts).status == next(word for word in WORST_FIRST if word in said), facts


def test_stale_invalid_and_paused_stand_in_the_headline_or_beside_it() -> None:
    for facts in EVERY:
        worst = headline(facts)
        shown = {worst.status, *worst.beside}
        always = tuple(status in shown for status in (Status.STALE, Status.INVALID, Status.PAUSED))
        assert always == (facts.stale, facts.invalid, facts.paused), facts
        assert worst.status not in worst.beside, facts


def test_a_stale_sample_is_never_now() -> None:
    for facts in EVERY:
        if facts.stale:
            assert headline(facts).status not in (Status.EXCEEDING, Status.RISK), facts


def test_a_flight_that_exceeded_is_never_calm_and_says_when() -> None:
    for facts in EVERY:
        if not facts.exceeds and facts.exceeded_t is None:
            continue
        said = headline(facts)
        assert said.status is not Status.OK, facts
        assert said.level in (Level.WARNING, Level.CAUTION), facts
        when = facts.exceeded_t is not None and said.status is not Status.EXCEEDING
        assert ("EXCEEDED first at 8.76 s" in in_words(said)) == when, facts


def test_between_manoeuvres_nothing_is_called_invalid() -> None:
    invalid = headline(Facts(invalid=True, stale=True))
    assert in_words(invalid) == "STALE · INVALID"
    assert in_words(invalid, Cause.BETWEEN) == "STALE · NOT ASSESSED"
    waiting = headline(Facts(warming_up=True))
    assert in_words(waiting, Cause.READY) == "NOT ASSESSED"
    assert in_words(waiting, Cause.REST) == "WARMING UP"


def test_nothing_looks_well_where_an_exceedance_is_predicted() -> None:
    predicted = headline(Facts(predicted=True))
    assert predicted == Headline(Status.NO_ALERT, Level.ADVISORY)
    assert in_words(predicted) == "NO ALERT · exceedance predicted"


def test_a_paused_flight_is_never_ok_and_an_exceedance_stays_its_headline() -> None:
    assert in_words(headline(Facts(paused=True))) == "PAUSED"
    predicted = headline(Facts(paused=True, predicted=True))
    assert in_words(predicted) == "PAUSED · NO ALERT · exceedance predicted"
    exceeded = headline(Facts(paused=True, exceeded_t=T))
    assert in_words(exceeded) == "EXCEEDED first at 8.76 s · PAUSED"
    raw = headline(Facts(paused=True, exceeded_t=T, exceeded_as_recorded=True))
    assert in_words(raw) == "EXCEEDED first at 8.76 s as recorded · PAUSED"


def test_red_is_for_warnings_that_ask_for_action_now() -> None:
    warnings = {status for status, level in LEVELS.items() if level is Level.WARNING}
    assert warnings == {Status.EXCEEDING, Status.ALARM, Status.RISK}
    assert headline(Facts()) == Headline(Status.OK, Level.NONE)
