"""Limits in force: versioned, by flight condition, changed in flight, monitors under them."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.assessment.batches import ChannelReader
from app.assessment.limits_history import LimitsHistory
from app.flights.flights import Flights
from app.flights.request import FlightRequest
from app.flights.shown_flight import ShownFlight
from app.flights.sources.live import LiveFlight, LiveSetup
from app.flights.transport import NotPossible
from app.messages import LimitsFrom, encode_frame
from app.routes.condition_sets import LimitsRequest
from app.store.store import Store, open_store
from app.telemetry.contents import open_columns
from app.telemetry.journal import Journals
from app.telemetry.mapping.mapping import Mapping, TimeSource
from app.telemetry.reading import read_file
from app.telemetry.recording import TelemetryError
from core.channels import KEYS
from core.limits.limit_sets import LimitSet, limit_set_from_plain
from core.limits.limits import Limits
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.status import Facts, headline, in_words
from core.planned_test.collection import DatasetRecipe, collect
from tests.support.flying import ScriptedClock, Seen, T, exact_monitor, failing_flight
from tests.support.oscillator import DT, N_SAMPLES
from tests.support.shown_record import is_as_shown


def limit_set(*cases: tuple[str, dict[str, Any], float]) -> LimitSet:
    return limit_set_from_plain(
        [{"name": name, "ranges": ranges, "limits": {"Ny": ny}} for name, ranges, ny in cases]
    )


OWN = limit_set(("all", {}, 0.5))
TIGHT = limit_set(("all", {}, 0.4))
BY_MACH = limit_set(("slow", {"mach": (None, 0.8)}, 0.5), ("fast", {"mach": (0.8, None)}, 0.4))


@cache
def monitor(t_early: float = 0.25) -> Monitor:
    recipe = DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)
    return train(collect(recipe), MonitorRecipe(t_early=t_early, epsilon=0.3))


class Range:
    """Flights over a real store, with a set of the monitor's own limits and more versions."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.clock = directory, ScriptedClock()
        self.store: Store = open_store(directory / "store.db")
        self.limits = self.store.limit_sets.add("envelope", OWN, "Ann").limit_set
        self.store.limit_sets.add_version(self.limits, TIGHT, "Ben", "after test point 6")
        self.store.limit_sets.add_version(self.limits, BY_MACH, "Ben")

    def flights(self) -> Flights:
        return Flights(self.store, clock=self.clock, journals=Journals(self.directory / "live"))

    def add(self, one: Monitor, name: str) -> str:
        return self.store.monitors.add(one, name).id

    async def fly(self, flights: Flights, **asked: Any) -> Any:
        source = {"kind": "simulated", "outcome": "unsafe", "seed": 4}
        request = {"source": source, "limit_set": self.limits} | asked
        return await flights.start(FlightRequest.model_validate(request), "Ann")


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., None]:
    def running(test: Callable[[Range], Coroutine[Any, Any, None]]) -> None:
        asyncio.run(test(Range(tmp_path)))

    return running


def test_a_version_is_never_changed(run: Callable) -> None:
    async def test(place: Range) -> None:
        stored = place.store.limit_sets.versions(place.limits)
        assert [one.version for one in stored] == [3, 2, 1]
        assert [one.limits for one in stored] == [BY_MACH, TIGHT, OWN]
        assert (stored[1].by, stored[1].text) == ("Ben", "after test point 6")
        assert [one.newest for one in place.store.limit_sets.all()] == [3]

    run(test)


def test_limits_that_no_value_can_exceed_are_not_put_in_force(run: Callable) -> None:
    """They may be stored by an earlier version, which accepted them."""

    async def test(place: Range) -> None:
        own = place.add(monitor(), "own")
        beyond = place.store.limit_sets.add("beyond", limit_set(("all", {}, 35.0)), "Ann").limit_set
        async with place.flights() as flights:
            flight = await place.fly(flights, monitor=own, limit_set_version=1)
            with pytest.raises(TelemetryError, match="35"):
                await flights.put_in_force(flight.id, beyond, None, {}, "Ben")
            assert flight.in_force.status.limit_set == place.limits
            with pytest.raises(TelemetryError, match="no value would exceed it"):
                await place.fly(flights, monitor=own, limit_set=beyond)

    run(test)


def test_other_limits_hold_from_the_next_sample_on(run: Callable) -> None:
    """The exceedance is of the limits in force, and monitors of other limits say nothing."""

    async def test(place: Range) -> None:
        ids = [place.add(monitor(), "own"), place.add(monitor(0.5), "further")]
        serving = place.add(replace(monitor(), specification=Limits(Ny=0.4)), "tight")
        async with place.flights() as flights:
            asked = {"monitor": ids[0], "monitors": ids[1:], "limit_set_version": 1}
            flight = await place.fly(flights, **asked)
            place.clock.advance(0.995)
            changed = flight.head + 1
            await flights.put_in_force(flight.id, place.limits, 2, {}, "Ben")
            now = flight.in_force.status
            assert (now.version, now.by, now.seq) == (2, "Ben", changed)
            place.clock.advance(9.0)
            await flights.stop(flight.id)
            frames = await flights.records.frames(flight.id, 0, 1000)
            before, after = frames[:changed], frames[changed:]
            assert {frame["state"] for frame in before} == {"ok"}
            for frame in after:
                for said in (frame, frame["display"][0]):
                    assert (said["p_value"], said["alert"], said["state"]) == (
                        None,
                        None,
                        "invalid",
                    )
                    assert said["reason"] == (
                        "not applicable: |N_y| 0.4 g in force, the monitor warns of |N_y| 0.5 g; "
                        f"monitor tight ({serving}) would serve"
                    )
            ny = np.array([frame["y"][3] for frame in frames])
            alarms = [a for a in await flights.records.alarms(flight.id) if a.kind == "limit"]
            beyond = np.flatnonzero(np.abs(ny) >= np.where(np.arange(len(ny)) < changed, 0.5, 0.4))
            exceedance = alarms[0].exceedance
            assert exceedance is not None
            assert (alarms[0].seq, exceedance.limit) == (beyond[0], 0.4)
            put = place.store.limit_sets.of_flights([flight.id])[flight.id]
            assert [(one.number, one.version, one.seq, one.by) for one in put] == [
                (1, 1, 0, "Ann"),
                (2, 2, changed, "Ben"),
            ]

    run(test)


def test_the_set_s_own_limits_leave_every_bit_as_it_is(run: Callable) -> None:
    async def test(place: Range) -> None:
        own = place.add(monitor(), "own")
        async with place.flights() as flights:
            asked = {"monitor": own, "limit_set_version": 3, "condition": {"mach": 0.6}}
            flight = await place.fly(flights, **asked)
            place.clock.advance(9.0)
            plain = await place.fly(flights, monitor=own, limit_set=None)
            place.clock.advance(9.0)
            frames = [await flights.records.frames(f.id, 0, 1000) for f in (flight, plain)]
            said = [[encode_frame({**f, "sent": None}) for f in one] for one in frames]
            assert said[0] == said[1]
            alarms = [await flights.records.alarms(f.id) for f in (flight, plain)]
            assert [[a.kind for a in one] for one in alarms] == [["risk", "limit"]] * 2
            assert flight.in_force.status.case == "slow"

    run(test)


def test_limits_that_cannot_be_told_are_never_calm(run: Callable) -> None:
    async def test(place: Range) -> None:
        own = place.add(monitor(), "own")
        async with place.flights() as flights:
            flight = await place.fly(flights, monitor=own)
            place.clock.advance(1.0)
            assert flight.reason == "limits unknown: Mach number is missing"
            assert flight.in_force.status.limits is None
            said = headline(Facts(invalid=True))
            assert in_words(said, flight.cause) == "LIMITS UNKNOWN"
            assert [one.limits and one.limits["Ny"] for one in flight.monitors] == [0.5]
            assert [a.kind for a in flight.alarms.at_hand] == ["invalid"]
            await flights.put_in_force(flight.id, place.limits, None, {"mach": 0.9}, "Ben")
            place.clock.advance(0.1)
            assert in_words(said, flight.cause) == "NOT APPLICABLE"
            assert flight.reason.endswith("; no stored monitor would serve")

    run(test)


CONDITION_OF = {**dict.fromkeys(range(20), 0.6), **dict.fromkeys(range(30, 35), 0.9), 45: None}
"""Mach by number of the sample; it does not come with any other, and 45 says that it is unknown."""


def assert_it_knows_its_limits_where_it_is_sought(replay: Any) -> None:
    """The replay of a flight of 0.5 g, 0.4 g from sample 30 on, of nobody knows what from 45 on."""
    seen = Seen(replay.watch())
    replay.act("pause")
    first, changes = replay.head + 1, [(None, 0.5), (T[30], 0.4), (T[45], None)]
    for k, n in ((47, 3), (35, 2), (10, 1), (31, 2)):
        replay.act("seek", float(T[k]))
        seen.take()
        hello = Seen(replay.watch()).take()[0]
        for held in (seen.of("reset")[-1]["held"], hello["held"]):
            told = [(one["t"], one["limits"] and one["limits"]["Ny"]) for one in held]
            assert told[-n:] == changes[:n]
        assert hello["limits"]["since"] == changes[n - 1][0]
        assert hello["channels"][3]["limit"] == changes[n - 1][1]
    now = seen.of("limits")[-1]["limits"]
    assert (now["case"], now["since"]) == ("fast", T[30])
    record = [one for one in replay.in_force.of_record if one.seq >= first]
    told = [(one.seq - first, one.limits and one.limits["Ny"]) for one in record]
    assert told == [(0, None), (1, 0.4), (2, 0.5), (3, 0.4)]


def test_limits_put_in_force_by_hand_carry_the_time_of_their_first_sample(run: Callable) -> None:
    """The next one is not known yet; it comes two intervals late."""

    async def test(place: Range) -> None:
        ids = place.add(exact_monitor(), "oscillator")
        async with place.flights() as flights:
            flight = await place.fly(
                flights, monitor=ids, source={"kind": "live", "trim": "none"}, limit_set=None
            )
            for k in (0, 1, 2, 5, 6):
                if k == 5:
                    await flights.put_in_force(flight.id, place.limits, 1, {"mach": 0.9}, "Ben")
                    assert flight.in_force.of_record[-1].t == pytest.approx(T[3])
                place.clock.advance(DT)
                sample = {"t": T[k]} | dict.fromkeys(KEYS, 0.0)
                await flight.receive(json.dumps(sample), "rest").stored
            held = [(one.seq, one.t) for one in flight.in_force.of_record]
            assert held == [(0, None), (3, T[5])]
            assert flight.in_force.status.since == T[5]
            earlier = {"t": 0.1, "limits": None, "first": 0.15, "seq": 3}
            assert LimitsFrom.model_validate(earlier).t == 0.15
            assert LimitsFrom.model_validate(earlier | {"first": None}).t == 0.1

    run(test)


def test_a_measured_condition_chooses_the_limits_and_the_journal_says_the_same(
    run: Callable,
) -> None:
    async def test(place: Range) -> None:
        ids = place.add(exact_monitor(), "oscillator")
        y, frames = failing_flight(), []

        def push(flight: LiveFlight, k: int) -> Any:
            place.clock.advance(DT)
            sample = {"t": T[k]} | dict(zip(KEYS, y[k].tolist(), strict=True))
            if k in CONDITION_OF:
                sample["air/M"] = CONDITION_OF[k]
            return flight.receive(json.dumps(sample), "rest").stored

        source = {"kind": "live", "trim": "none"}
        asked = {"monitor": ids, "source": source, "condition": {"mach": "air/M"}}
        async with place.flights() as flights:
            flight = await place.fly(flights, **asked)
            for k in range(40):
                await push(flight, k)
        async with place.flights() as flights:
            again = await flights.live(flight.id)
            assert again.in_force.status is not None
            assert (again.in_force.status.case, again.in_force.status.since) == ("fast", T[30])
            for k in range(40, 50):
                await push(again, k)
            await flights.put_in_force(flight.id, place.limits, 1, {}, "Ben")
            for k in range(50, N_SAMPLES):
                await push(again, k)
            await flights.stop(flight.id)
            frames = await flights.records.frames(flight.id, 0, 1000)
            put = place.store.limit_sets.of_flights([flight.id])[flight.id]
            assert [(one.version, one.seq) for one in put] == [(3, 0), (1, 50)]
            setup = LiveSetup(
                exact_monitor(),
                exact_monitor().recipe.epsilon,
                ChannelReader(None, {"mach": "air/M"}),
                Journals(place.directory / "live"),
                0.0,
                trim="none",
            )
            shown = ShownFlight(setup, flight.id)
            assert is_as_shown(shown, place.store.flights.assessments(flight.id))
            journal = place.directory / "live" / f"{flight.id}.jsonl"
            read_file(journal, place.directory / "columns", name="flown")
            mapping = Mapping({}, {"": TimeSource("t")})
            history = LimitsHistory.of(open_columns(place.directory / "columns"), mapping)
            assert history is not None
            timeline = history.timeline([exact_monitor().envelope])
            rulings = [timeline.ruling(frame["t"]) for frame in frames]
            assert [one and one.reasons[0] for one in rulings] == [f["reason"] for f in frames]
            asked = {"source": {"kind": "journal", "flight_id": flight.id}, "monitor": ids}
            replay = await flights.start(FlightRequest.model_validate(asked))
            with pytest.raises(NotPossible, match="keeps the limits"):
                await flights.put_in_force(replay.id, place.limits, 1, {}, "Ben")
            assert_it_knows_its_limits_where_it_is_sought(replay)
            source_frames = replay.source_frames(0, N_SAMPLES)
            assert [f["reason"] for f in source_frames] == [f["reason"] for f in frames]
        expected = exact_monitor().assess(T, y).columns()["p_value"]
        reasons = ["limits unknown: Mach number is", "not applicable", ""]
        for k, frame in enumerate(frames):
            slow, fast = k < 30 or k >= 50, 30 <= k < 45
            reason = "" if slow else reasons[1] if fast else f"{reasons[0]} missing"
            assert frame["reason"].startswith(reason), k
            assert frame["p_value"] == (expected[k] if slow else None), k

    run(test)


async def push(place: Range, flight: LiveFlight, k: int, **condition: float) -> None:
    place.clock.advance(DT)
    sample = {"t": T[k], **dict.fromkeys(KEYS, 0.0), **condition}
    await flight.receive(json.dumps(sample), "rest").stored


def test_an_implausible_condition_counts_as_none(run: Callable) -> None:
    async def test(place: Range) -> None:
        source = {"kind": "live", "trim": "none"}
        async with place.flights() as flights:
            own = place.add(exact_monitor(), "oscillator")
            flight = await place.fly(flights, monitor=own, source=source)
            words = []
            for k, mach in enumerate((0.6, -1.0, 10.5, 0.7)):
                await push(place, flight, k, mach=mach)
                words.append((flight.in_force.status.case, flight.in_force.status.reason))
            assert flight.live.condition["mach"] == 0.7
        implausible = ("", "limits unknown: Mach number is implausible")
        assert words == [("slow", ""), implausible, implausible, ("slow", "")]

    run(test)


@pytest.mark.parametrize("condition", [{"mach": -1.0}, {"mach": 11.0}, {"altitude": 2e5}])
def test_an_implausible_condition_cannot_be_declared(condition: dict[str, float]) -> None:
    asked = {"source": {"kind": "live"}, "monitor": "m", "limit_set": "l"}
    with pytest.raises(ValueError, match="is implausible"):
        FlightRequest.model_validate(asked | {"condition": condition})
    with pytest.raises(ValueError, match="is implausible"):
        LimitsRequest.model_validate({"limit_set": "l", "fixed": condition})


def test_a_source_that_contradicts_a_declared_condition_is_a_caution(run: Callable) -> None:
    async def test(place: Range) -> None:
        source = {"kind": "live", "trim": "none"}
        asked: dict[str, Any] = {"source": source, "condition": {"mach": 0.6}}
        async with place.flights() as flights:
            asked["monitor"] = place.add(exact_monitor(), "oscillator")
            flight = await place.fly(flights, **asked)
            found = []
            for k, mach in enumerate((0.6, 0.7, 0.9, 0.91, 0.7)):
                await push(place, flight, k, mach=mach)
                assert flight.in_force.status.case == "slow"
                found.append([doubt.reason for doubt in flight.doubts])
            said = "at 0.10 s Mach number 0.6 is declared, the source sends 0.9"
            assert found == [[], [], [said], [said], []]
            (alarm,) = [one for one in flight.alarms.at_hand if one.kind == "contradiction"]
            assert (alarm.level, alarm.reason) == ("caution", said)

    run(test)
