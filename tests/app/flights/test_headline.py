"""The headline of a flight, the alarms of its channels, and what is said of it once it is over."""

import asyncio
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import app
from app.assessment.outcome import lead_words
from app.flights.alarms import Alarms
from app.flights.ended import Record, records
from app.flights.sources.recorded_playback import RecordedScript
from app.flights.verdict import (
    OUTSIDE,
    UNASSESSED,
    Circumstances,
    SampleCause,
    longest_manoeuvre,
    planned_length,
    unassessed,
    verdict,
)
from app.recipes.recipes import to_plain
from core.channels import KEYS
from core.flight_events import Alarm
from core.limits.exceedance import Exceeded, Judged, MeasuredExceedance, exceedance
from core.limits.limits import Limits
from core.monitor import Assessment, State
from core.monitor.assessment import REASONS, STATES, Cause
from core.monitor.status import BETWEEN, CAUSE_WORDS, WORDS, AlarmKind
from core.planned_test.collection import DatasetRecipe
from tests.app.flights.sources.test_live import Live, batch
from tests.support.flying import (
    EPSILON,
    Flown,
    ScriptedClock,
    Seen,
    T,
    exact_monitor,
    failing_flight,
    store_with,
)
from tests.support.oscillator import DT, N_SAMPLES, NY, Array
from tests.support.samples import SAMPLE_LIKE
from tests.support.stored import alarm

INVALID = STATES.index(State.INVALID)
WARMING_UP = STATES.index(State.WARMING_UP)
WARNED = "LIMIT EXCEEDED, warned 0.31 s before the limit"
MISSED = "LIMIT EXCEEDED, missed: no alert before the limit"
LIMITS = Limits(Ny=0.5).envelope


def ny(value: float) -> Array:
    y = np.zeros(6)
    y[NY] = value
    return y


def kinds(flown: Flown | Live) -> list[str]:
    return [message["alarm"]["kind"] for message in flown.seen.of("alarm")]


def statuses(flown: Flown | Live) -> list[str]:
    return [message["status"] for message in flown.seen.of("status")]


# --- the channels alone --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("from_trim", "recorded", "judged", "value"),
    [
        (0.529, 0.1, "from_trim", 0.529),
        (0.1, -0.529, "recorded", -0.529),
        (0.529, 0.6, "both", 0.529),
        (-0.5, 0.1, "from_trim", -0.5),
    ],
)
def test_either_value_beyond_the_limit_counts_and_it_says_which(
    from_trim: float, recorded: float, judged: Judged, value: float
) -> None:
    over = exceedance(KEYS, LIMITS, ny(from_trim), ny(recorded))
    assert over == MeasuredExceedance(channel="Ny", value=value, limit=0.5, judged=judged)


@pytest.mark.parametrize("value", [0.4999, np.nan])
def test_a_value_within_the_limit_or_missing_is_no_exceedance(value: float) -> None:
    assert exceedance(KEYS, LIMITS, ny(value), ny(value)) is None
    assert exceedance(KEYS, None, ny(9.0), ny(9.0)) is None


def test_a_recording_is_judged_with_its_trim_too() -> None:
    samples = np.zeros(4, SAMPLE_LIKE)
    samples["t"], samples["y"][:, NY] = DT * np.arange(4), [0.1, 0.3, 0.1, 0.3]
    manoeuvre = {
        "alerts": [],
        "exceedance": None,
        "validity": {"valid": True, "reasons": []},
    }
    trims = [[None, 0.0, 0.0, 0.1, 0.0, 0.0], [None, 0.0, 0.0, 0.3, 0.0, 0.0]]
    manoeuvres = [manoeuvre | {"first": 2 * k, "trim": trim} for k, trim in enumerate(trims)]
    biases = [0.0, 0.0, 0.0, -0.05, 0.0, 0.0]
    script = RecordedScript(samples, manoeuvres, DT, forecasts=False, biases=biases)
    found = [script.exceeded(k, LIMITS) for k in range(4)]
    assert found[:3] == [None, None, None]
    measured = MeasuredExceedance(channel="Ny", value=0.55, limit=0.5, judged="recorded")
    assert found[3] == Exceeded(3 * DT, measured)


# --- under way -----------------------------------------------------------------------------------


def test_paused_beyond_the_limit_it_is_exceeding_until_within_then_exceeded() -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:25, NY] = 0.529
    flown = Flown(exact_monitor(), y, epsilon=0.99).start()
    flown.flight.act("pause")
    flown.flight.act("seek", 22 * DT)
    flown.seen.take()
    assert (flown.flight.headline.status, flown.flight.headline.level) == ("exceeding", "warning")
    assert kinds(flown) == ["limit"]
    flown.flight.acknowledge("1", "FTE", "now")
    assert flown.flight.headline.status == "exceeding"
    flown.flight.act("seek", 40 * DT)
    flown.seen.take()
    assert flown.flight.headline.status == "not_calibrated"
    flown.flight.is_checked = True
    assert flown.flight.headline.status == "exceeded"
    assert statuses(flown)[-2:] == ["exceeding", "not_calibrated"]
    for back in (10 * DT, 0.0):
        flown.flight.act("seek", back)
        said = flown.flight.headline
        assert (said.status, said.level, said.exceeded_t) == ("exceeded", "caution", 20 * DT)
    flown.seen.take()
    assert flown.seen.of("status")[-1]["exceeded_t"] == 20 * DT


def test_an_exceedance_that_a_seek_passes_is_an_alarm_and_the_flight_s_for_good() -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:25, NY], y[30:35, NY] = 0.529, 0.6
    flown = Flown(exact_monitor(), y, epsilon=0.99).start()
    flown.flight.is_checked = True
    flown.flight.fail_t = 5 * DT  # of the true outputs, which nobody measures
    flown.flight.act("pause")
    flown.flight.act("seek", 15 * DT)
    assert flown.flight.headline.status == "paused"  # it has not come to it
    flown.flight.act("seek", 40 * DT)
    flown.seen.take()
    assert flown.flight.headline.status == "alarm"
    (alarm,) = [message["alarm"] for message in flown.seen.of("alarm")]
    assert (alarm["kind"], alarm["t"]) == ("limit", 20 * DT)
    assert alarm["exceedance"]["value"] == 0.529
    for to in (41 * DT, 10 * DT):  # no strip shows a calm value beside the headline
        assert flown.flight.headline.exceeded_t == 20 * DT
        (latched,) = flown.seen.of("status")[-1]["latched"]
        assert (latched["channel"], latched["t"], latched["over"]) == ("Ny", 20 * DT, False)
        assert latched["skipped"]
        flown.flight.act("seek", to)
        flown.seen.take()
    flown.flight.act("seek", 22 * DT)
    flown.seen.take()
    (latched,) = flown.seen.of("status")[-1]["latched"]
    assert latched["over"]
    assert not latched["skipped"]
    flown.flight.act("seek", 40 * DT)
    flown.flight.acknowledge("1", "FTE", "now")
    flown.seen.take()
    assert flown.seen.of("status")[-1]["latched"] == []
    for back in (10 * DT, 40 * DT):  # what was met does not ring again by being passed
        flown.flight.act("seek", back)
        assert flown.flight.headline[:2] == ("exceeded", "caution")
        assert flown.flight.headline.exceeded_t == 20 * DT


def test_an_alarm_stays_the_headline_until_it_is_acknowledged() -> None:
    flown = Flown(exact_monitor(), failing_flight()).start()
    flown.flight.act("next_alert")
    flown.flight.act("pause")
    flown.flight.act("seek", 0.0)
    flown.seen.take()
    assert flown.flight.headline.status == "alarm"
    assert statuses(flown)[-1] == "alarm"
    flown.flight.acknowledge("1", "FTE", "now")
    flown.seen.take()
    assert flown.flight.headline.status == statuses(flown)[-1] == "paused"
    flown.flight.act("play")
    flown.seen.take()
    assert flown.flight.headline.status == statuses(flown)[-1] == "not_calibrated"


def test_a_live_flight_that_stops_is_stale_not_exceeding_and_keeps_its_alarm(
    tmp_path: Path,
) -> None:
    async def fly() -> None:
        live = Live(tmp_path)
        for k in range(6):
            live.push(k, ny(0.529 if k == 5 else 0.0))
        assert live.flight.headline.status == "exceeding"
        live.advance(5.0)
        assert live.flight.headline.status == "alarm"
        assert live.flight.headline.beside == ("stale",)
        live.flight.acknowledge("1", "FTE", "now")
        assert live.flight.headline.status == "stale"
        assert live.flight.state is State.STALE
        live.seen.take()
        assert statuses(live)[-3:] == ["exceeding", "alarm", "stale"]
        assert kinds(live) == ["limit", "stale", "limit"]
        await live.close()

    asyncio.run(fly())


def test_a_caution_waits_in_amber_after_its_cause_has_ended(tmp_path: Path) -> None:
    async def fly() -> None:
        live = Live(tmp_path)
        live.push(0, ny(0.0))
        live.advance(0.3)
        for k in range(1, 7):  # late, but none is missing
            live.flight.receive(batch(k, ny(0.0)), "rest")
        live.seen.take()
        assert (live.flight.headline.status, live.flight.headline.level) == ("caution", "caution")
        (told,) = live.seen.of("alarm")
        assert (told["alarm"]["seq"], told["alarm"]["level"]) == (0, "caution")
        assert told["alarm"]["reason"] == "no sample came for 0.25 s"
        live.flight.acknowledge("1", "FTE", "now")
        live.seen.take()
        assert statuses(live)[-3:] == ["stale", "caution", "not_calibrated"]
        await live.close()

    asyncio.run(fly())


def test_the_headline_says_how_early_it_was_warned_as_soon_as_a_limit_is_exceeded() -> None:
    y = failing_flight().copy()
    y[-5:, NY] = 0.6
    flown = Flown(exact_monitor(), y).start()
    flown.advance(N_SAMPLES * DT)
    risk, limit = (message["alarm"]["t"] for message in flown.seen.of("alarm")[:2])
    first = next(message for message in flown.seen.of("status") if message["verdict"])
    assert (first["status"], first["exceeded_t"]) == ("exceeding", limit)
    assert first["verdict"]["lead"] == pytest.approx(limit - risk)
    assert first["verdict"]["warning"] == f"Warned {lead_words(limit - risk)} s before the limit"
    verdicts = [message["verdict"] for message in flown.seen.of("status")]
    assert verdicts[: verdicts.index(first["verdict"])].count(None) > 0
    joined = Seen(flown.flight.watch()).take()[0]
    assert joined["verdict"] == first["verdict"] == verdicts[-1]


def test_a_status_tells_what_the_strips_latch_until_it_is_acknowledged_and_over() -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:25, NY] = 0.529
    flown = Flown(exact_monitor(), y, epsilon=0.99).start()
    flown.advance(22 * DT)
    (latched,) = flown.seen.of("status")[-1]["latched"]
    assert (latched["channel"], latched["value"], latched["over"]) == ("Ny", 0.529, True)
    flown.advance(N_SAMPLES * DT)
    (latched,) = flown.seen.of("status")[-1]["latched"]
    assert not latched["over"]
    flown.flight.acknowledge("1", "FTE", "now")
    flown.seen.take()
    assert flown.seen.of("status")[-1]["latched"] == []


def test_the_headline_says_that_an_exceedance_without_an_alert_was_missed() -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:25, NY] = 0.529
    flown = Flown(exact_monitor(), y, epsilon=0.99).start()
    flown.advance(19 * DT)
    assert flown.flight.verdict is None
    flown.advance(2 * DT)
    assert flown.seen.of("status")[-1]["verdict"]["warning"] == "Missed: no alert before the limit"


def test_a_late_alert_is_shown_with_the_lead_time_that_was_promised() -> None:
    found = verdict([stored("risk", 1.2), stored("limit", 1.3)], Circumstances(promised=0.25))
    assert found is not None
    assert found.warning == "Warned too late, 0.10 s before the limit (0.25 s promised)"


def test_an_alert_of_an_earlier_manoeuvre_is_no_warning() -> None:
    alarms = [stored("risk", 2.0), stored("limit", 47.3)]
    missed = verdict(alarms, Circumstances(promised=0.25, longest=12.0))
    assert missed is not None
    assert missed.warning == "Missed: no alert before the limit"
    warned = verdict([*alarms, stored("risk", 46.9)], Circumstances(promised=0.25, longest=12.0))
    assert warned is not None
    assert warned.lead == pytest.approx(0.4)


def test_the_alerts_of_the_manoeuvre_that_exceeds_a_limit_are_kept_as_evidence() -> None:
    alarms = Alarms(longest=12.0)
    for number, t in enumerate((2.0, 46.9, 46.95), 1):
        alert = Assessment(t, 0.9, True, State.OK, "")
        quiet = Assessment(t + 0.01, 0.1, False, State.OK, "")
        alarms.update(number, number, alert, None, ScriptedClock())
        alarms.acknowledge(alarms.at_hand[-1].id, "Ann", "now")
        alarms.update(number, number, quiet, None, ScriptedClock())
    assert [alarm.t for alarm in alarms.evidence] == [46.9, 46.95]


def test_the_longest_manoeuvre_is_twice_the_planned_one() -> None:
    assert longest_manoeuvre(planned_length({})) == np.inf
    planned = to_plain(DatasetRecipe())
    assert longest_manoeuvre(planned_length(planned)) == 2.0 * DatasetRecipe().maneuver.duration_s


def test_a_flight_that_was_sought_to_its_exceedance_neither_warned_nor_missed() -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:25, NY] = 0.529
    flown = Flown(exact_monitor(), y, epsilon=0.99).start()
    flown.flight.act("seek", 22 * DT)
    assert flown.flight.verdict is not None
    assert (flown.flight.verdict.exceeded_t, flown.flight.verdict.warning) == (20 * DT, "")
    assert "not flown" in flown.flight.verdict.text


def test_hello_says_the_headline() -> None:
    flown = Flown(exact_monitor(), np.full((N_SAMPLES, 6), 0.529)).start()
    hello = flown.seen.of("hello")[0]
    assert (hello["status"], hello["level"], hello["beside"]) == ("no_data", "advisory", [])
    assert statuses(flown) == ["exceeding"]


# --- over ----------------------------------------------------------------------------------------


def test_a_caution_that_waits_is_no_alarm_of_a_flight_that_is_over(tmp_path: Path) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
    store.alarms.add(flight, alarm(1, 3, 0.3, "stale", reason="late"))
    info = store.flights.end(flight)
    assert store.alarms.of(flight)[0].reason == "late"
    record = records(store, [info])[flight]
    assert (record.headline.status, record.verdict) == ("caution", None)
    assert record.headline.exceeded_t is None
    store.alarms.acknowledge(flight, 1, "FTE")
    assert records(store, [info])[flight].headline.status == "no_data"


@pytest.mark.parametrize(("state", "status"), [(WARMING_UP, "not_assessed"), (0, "not_calibrated")])
def test_a_flight_that_ended_before_it_was_assessed_is_not_said_to_be_well(
    tmp_path: Path, state: int, status: str
) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
    info = store.flights.end(flight)
    record = records(store, [info])[flight]
    assert (record.headline.status, record.reason) == ("no_data", "no sample came")
    none = np.full(1, np.nan)
    about = none, none == 0, [state], None, ["too few samples" if state else ""]
    store.flights.append(flight, 0, np.zeros(1), np.zeros((1, 6)), *about)
    record = records(store, [info])[flight]
    assert record.headline.status == status


def test_a_flight_that_ended_at_rest_after_its_manoeuvre_was_assessed(tmp_path: Path) -> None:
    """Its newest sample has no assessment, but earlier ones have."""
    store, monitor = store_with(exact_monitor(), tmp_path)
    flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
    info = store.flights.end(flight)
    about = np.array([0.01, np.nan]), np.zeros(2, bool), [0, WARMING_UP], None, ["", "rests"]
    store.flights.append(flight, 0, np.arange(2.0), np.zeros((2, 6)), *about)
    assert records(store, [info])[flight].headline.status == "not_calibrated"


def ended_live(directory: Path, y: Array, t: Array, kind: str = "live") -> Record:
    """The record of an ended flight whose alert was acknowledged."""
    store, monitor = store_with(exact_monitor(), directory)
    flight = store.flights.add({"kind": kind}, monitor, EPSILON)
    store.alarms.add(flight, alarm(1, 10, 10 * DT))
    store.alarms.acknowledge(flight, 1, "FTE")
    is_known = np.isfinite(y).all(axis=1)
    state = np.where(is_known, 0, INVALID)
    about = np.where(is_known, 0.1, np.nan), np.zeros(len(y), bool), state
    store.flights.append(flight, 0, t, y, *about)
    return records(store, [store.flights.end(flight)])[flight]


@pytest.mark.parametrize("kind", ["live", "journal"])
def test_a_record_says_that_a_limited_channel_was_missing(tmp_path: Path, kind: str) -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:24, NY] = np.nan
    record = ended_live(tmp_path, y, T, kind)
    assert (record.headline.status, record.headline.level) == ("caution", "caution")
    assert (record.headline.exceeded_t, record.open_cautions) == (None, 0)
    assert record.verdict is not None
    assert (record.verdict.exceeded_t, record.verdict.warning) == (None, "")
    assert record.verdict.text == (
        "DATA MISSING: no sample of Ny from 0.95 to 1.20 s, 0.20 s missing in total; a limit may "
        "have been exceeded there"
    )


def test_a_record_says_that_no_sample_came_for_a_while(tmp_path: Path) -> None:
    t = np.where(np.arange(N_SAMPLES) < 20, T, T + 1.0)
    record = ended_live(tmp_path, np.zeros((N_SAMPLES, 6)), t)
    assert record.verdict is not None
    assert "no sample of Ny from 0.95 to 2.00 s" in record.verdict.text


@pytest.mark.parametrize(("channel", "n"), [(NY, 0), (NY, 1), (NY, 2), (0, 20)])
def test_one_or_two_lost_samples_leave_no_doubt_and_many_of_any_channel_do(
    tmp_path: Path, channel: int, n: int
) -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20 : 20 + n, channel] = np.nan
    record = ended_live(tmp_path, y, T)
    if n <= 2:
        assert (record.headline.status, record.verdict) == ("not_calibrated", None)
        return
    assert record.verdict is not None
    assert "DATA MISSING: no sample assessed from 1.00 to 1.95 s" in record.verdict.text


OVER = MeasuredExceedance("Ny", 0.529, 0.5, "both")


def stored(kind: AlarmKind, t: float, judged: Judged = "both") -> Alarm:
    over = replace(OVER, judged=judged) if kind == "limit" else None
    return alarm(1, 0, t, kind, p_value=None, exceedance=over)


@pytest.mark.parametrize(
    ("alarms", "text"),
    [
        ([stored("risk", 1.0), stored("limit", 1.31)], WARNED),
        ([stored("limit", 1.31)], MISSED),
        ([stored("limit", 1.31), stored("risk", 1.5)], MISSED),
        (
            [stored("risk", 0.1), stored("risk", 1.0), stored("limit", 2.0), stored("limit", 1.5)],
            "LIMIT EXCEEDED, warned 1.40 s before the limit",
        ),
    ],
)
def test_the_verdict_of_a_flight_that_exceeded_says_how_it_was_warned(
    alarms: list[Alarm], text: str
) -> None:
    found = verdict(alarms)
    assert found is not None
    assert found.text == text


def test_a_live_flight_was_warned_when_the_alarm_was_raised_not_when_its_sample_was_taken() -> None:
    raised: dict[AlarmKind, tuple[float, str]] = {
        "risk": (6.25, "2030-01-01T00:00:09.494Z"),
        "limit": (7.7, "2030-01-01T00:00:09.514Z"),
    }
    alarms = [replace(stored(kind, t), raised=when) for kind, (t, when) in raised.items()]
    found = verdict(alarms, Circumstances(promised=0.25, live=True))
    assert found is not None
    assert (
        found.text == "LIMIT EXCEEDED, warned too late, 0.02 s before the limit (0.25 s promised)"
    )


@pytest.mark.parametrize(("promised", "late"), [(0.25, False), (0.31, False), (0.5, True)])
def test_less_than_the_promised_warning_lead_time_is_too_late(promised: float, late: bool) -> None:
    found = verdict([stored("risk", 1.0), stored("limit", 1.31)], Circumstances(promised))
    assert found is not None
    assert ("promised" in found.text) == late


def test_the_verdict_is_the_monitor_s_own_from_trim_and_else_names_what_was_recorded() -> None:
    found = verdict([stored("limit", 1.0, "recorded"), stored("risk", 0.5)])
    assert found is not None
    assert (found.exceeded_t, found.lead) == (1.0, None)
    assert found.text == "LIMIT EXCEEDED as recorded, not from trim"
    both = verdict([stored("limit", 1.0, "recorded"), stored("limit", 1.5)])
    assert both is not None
    assert both.text == MISSED
    assert verdict([]) is None


def test_an_exceedance_where_the_monitor_was_withdrawn_is_neither_missed_nor_caught() -> None:
    found = verdict([stored("limit", 1.31)], Circumstances(withdrawn=True))
    assert found is not None
    assert found.text == "LIMIT EXCEEDED, INVALID, no verdict"
    warned = verdict([stored("risk", 1.0), stored("limit", 1.31)], Circumstances(withdrawn=True))
    assert warned is not None
    assert warned.text == WARNED  # before it was withdrawn


OK, WARMING = State.OK, State.WARMING_UP


@pytest.mark.parametrize(
    ("samples", "text"),
    [
        ([], UNASSESSED),
        ([SampleCause(1.3, OK)], UNASSESSED),  # the first sample exceeds
        ([SampleCause(1.25, WARMING), SampleCause(1.3, OK)], UNASSESSED),
        ([SampleCause(t, WARMING, Cause.READY) for t in (1.25, 1.3)], OUTSIDE),
        ([SampleCause(1.2, OK), SampleCause(1.25, WARMING)], MISSED),
        ([SampleCause(1.2, OK), SampleCause(1.25, WARMING, Cause.REST)], OUTSIDE),  # it just ended
    ],
)
def test_an_exceedance_is_missed_only_if_a_sample_before_it_was_assessed(
    samples: list[SampleCause], text: str
) -> None:
    found = verdict([stored("limit", 1.3)], Circumstances(unassessed=unassessed(1.3, samples)))
    assert found is not None
    assert found.text == text
    alarms = [stored("risk", 1.2), stored("limit", 1.3)]
    warned = verdict(alarms, Circumstances(unassessed=unassessed(1.3, samples)))
    assert warned is not None
    assert warned.lead == pytest.approx(0.1)


def test_the_record_of_a_flight_that_starts_beyond_its_limit_says_so(tmp_path: Path) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
    about = np.full(3, 0.1), np.zeros(3, bool), [0] * 3, None, [""] * 3
    store.flights.append(flight, 0, DT * np.arange(3), np.full((3, 6), 0.6), *about)
    store.alarms.add(flight, alarm(1, 0, 0.0, "limit", exceedance=OVER))
    found = records(store, [store.flights.end(flight)])[flight].verdict
    assert found is not None
    assert (found.text, found.warning) == (UNASSESSED, "")


def test_a_flight_knows_by_its_samples_that_its_monitor_was_withdrawn(tmp_path: Path) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    texts = {}
    for why in ("outside training", REASONS[INVALID]):
        flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
        n = np.full(3, np.nan)
        states, reasons = [0, INVALID, INVALID], ["", why, why]
        store.flights.append(
            flight, 0, DT * np.arange(3), np.zeros((3, 6)), n, n == 0, states, None, reasons
        )
        store.alarms.add(flight, alarm(1, 2, 2 * DT, "limit", exceedance=OVER))
        found = records(store, [store.flights.end(flight)])[flight].verdict
        assert found is not None
        texts[why] = found.text
    assert texts["outside training"] == "LIMIT EXCEEDED, INVALID, no verdict"
    assert texts[REASONS[INVALID]] == MISSED  # a lost sample


def scored(word: str, lead: float | None, t: float, **more: Any) -> dict[str, Any]:
    over = {"t": t, "channel": "Ny", "value": 0.529}
    return {"outcome": word, "lead": lead, "exceedance": over} | more


@pytest.mark.parametrize(
    ("manoeuvres", "text"),
    [
        ([scored("invalid", None, 2 * DT)], "LIMIT EXCEEDED, INVALID, no verdict"),
        (
            [scored("timely_alert", 0.31, DT), scored("missed", None, 2 * DT)],
            MISSED,
        ),
        (
            [scored("timely_alert", 0.31, DT), scored("missed", None, 90.0)],
            WARNED,  # it never came to the other one
        ),
        (
            [scored("quiet", None, 0.0, exceedance=None)],
            "LIMIT EXCEEDED outside every manoeuvre, where nothing was assessed",
        ),
    ],
)
def test_a_replay_s_verdict_is_the_recording_s_own(
    manoeuvres: list[dict[str, Any]],
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    known = SimpleNamespace(damage="", manoeuvres=manoeuvres)
    monkeypatch.setattr(store.scorings, "info", lambda *_: known)
    source = {"kind": "recording", "recording": "r", "scoring": "s"}
    flight = store.flights.add(source, monitor, EPSILON)
    store.alarms.add(flight, alarm(1, 2, 2 * DT, "limit", exceedance=OVER))
    found = records(store, [store.flights.end(flight)])[flight].verdict
    assert found is not None
    assert found.text == text


def test_a_flight_that_ended_between_manoeuvres_says_that_it_was_there(tmp_path: Path) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
    none, zeros = np.full(2, np.nan), np.zeros((2, 6))
    about = none, none == 0, [0, INVALID], None, ["", BETWEEN]
    store.flights.append(flight, 0, DT * np.arange(2), zeros, *about)
    record = records(store, [store.flights.end(flight)])[flight]
    assert (record.headline.status, record.reason) == ("invalid", BETWEEN)


def test_what_a_seek_had_passed_is_said_of_a_flight_that_is_over(tmp_path: Path) -> None:
    store, monitor = store_with(exact_monitor(), tmp_path)
    flight = store.flights.add({"kind": "scripted"}, monitor, EPSILON)
    record = records(store, [store.flights.end(flight, exceeded_t=8.76)])[flight]
    assert record.headline.exceeded_t == 8.76
    assert record.verdict is not None
    assert record.verdict.text == "LIMIT EXCEEDED, samples before it not flown"


def test_a_flight_that_was_sought_to_its_exceedance_is_not_said_to_have_had_no_warning() -> None:
    found = verdict([stored("limit", 1.31)], Circumstances(jumped=True))
    assert found is not None
    assert found.text == "LIMIT EXCEEDED, samples before it not flown"


def test_what_a_flight_that_is_over_showed_last_is_not_now() -> None:
    flown = Flown(exact_monitor(), np.full((N_SAMPLES, 6), 0.529)).start()
    flown.flight.act("pause")
    flown.flight.is_checked = True
    flown.flight.acknowledge("1", "FTE", "now")
    assert flown.flight.headline.status == "exceeding"
    flown.flight._halt("done")
    assert flown.flight.headline.status == "exceeded"


def test_the_page_and_open_mct_have_the_words_of_the_server() -> None:
    static = Path(app.__file__).parents[1] / "static"
    page = (static / "js/lib/states.js").read_text()
    words = dict(re.findall(r'^  (\w+): "([A-Z ]+)",$', page, re.MULTILINE))
    server = WORDS | {cause.value: word for (_, cause), word in CAUSE_WORDS.items()}
    assert WORDS.keys() <= words.keys()
    assert {key: words[key] for key in words.keys() & server.keys()}.items() <= server.items()
    mct = re.findall(r'"([A-Z ]+)"', (static / "openmct/forewarn.js").read_text())
    assert {*server.values()} - {"PAUSED"} <= {*mct}


def test_a_warning_names_that_the_limit_was_exceeded_as_recorded_before() -> None:
    """See `verdict`: the headline in flight is its warning."""
    raw, from_trim = (MeasuredExceedance("Ny", 0.6, 0.5, judged) for judged in ("recorded", "both"))
    alarms = [
        alarm(1, 10, 1.0, "limit", exceedance=raw),
        alarm(2, 40, 4.0),
        alarm(3, 50, 5.0, "limit", exceedance=from_trim),
    ]
    warned = verdict(alarms)
    assert warned is not None
    assert (
        warned.warning == "Warned 1.00 s before the limit from trim, exceeded as recorded earlier"
    )
