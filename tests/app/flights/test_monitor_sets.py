"""Flights on a monitor set: the monitor whose condition holds is used, with a fresh history."""

import asyncio
import json
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.flights.flight_monitors import stored_sets
from app.flights.flights import Flights
from app.flights.request import FlightRequest
from app.flights.sources.live import LiveFlight
from app.flights.sources.simulated import SourceError, times
from app.flights.transport import NotPossible
from app.store.monitors import MonitorInfo
from app.store.store import InUse, Store, open_store
from app.telemetry.journal import Journals
from app.telemetry.reading import read_file
from core.channels import KEYS
from core.limits.limits import Limits, SafeInterval
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.monitor_set import MonitorCase, MonitorSet
from tests.support import oscillator
from tests.support.flying import ScriptedClock, Seen, exact_monitor, failing_flight
from tests.support.oscillator import DT

Y = np.concatenate([failing_flight(), failing_flight(), failing_flight()])
N = len(Y)
T = times(N, DT)
SENT: dict[int, float | None] = {5: 0.6, **dict.fromkeys(range(20, 45), 0.9), 45: 1.3, 60: 0.7}
SENT |= {70: None, **dict.fromkeys(range(75, 95), 0.7)}
"""Mach by number of the sample. It was last sent with sample 94, so it is stale from 115 on."""
STALE_FROM = 115
PARTS = ((5, 20, "slow"), (20, 45, "fast"), (60, 70, "slow"), (75, STALE_FROM, "slow"))
"""Samples with a monitor in use, and the condition that holds."""
REASONS = {
    0: "not applicable: Mach number is missing",
    45: "not applicable: no monitor for this Mach number",
    70: "not applicable: Mach number is missing",
    STALE_FROM: "not applicable: Mach number is stale",
}


@cache
def fast_monitor() -> Monitor:
    dataset = oscillator.collect(np.random.default_rng(14), n_unsafe=25)
    return train(dataset, MonitorRecipe(epsilon=0.2))


class Range:
    """A store with a set of two monitors."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.clock = directory, ScriptedClock()
        self.store: Store = open_store(directory / "store.db")
        self.slow = self.store.monitors.add(exact_monitor(), "slow one").id
        self.fast = self.store.monitors.add(fast_monitor(), "fast one").id
        self.set_id = self.set_of(self.slow, self.fast)

    def set_of(self, slow: str, fast: str, name: str = "doublet") -> str:
        info = self.store.monitors.info
        cases: tuple[MonitorCase[MonitorInfo], ...] = (
            MonitorCase("slow", {"mach": (None, 0.8)}, info(slow)),
            MonitorCase("fast", {"mach": (0.8, 1.2)}, info(fast)),
        )
        return self.store.monitor_sets.add(name, MonitorSet(cases), "Ann").id

    def set_with_two_limits(self) -> str:
        """The slow one's is 0.5 g, the other's 0.4 g."""
        other = replace(fast_monitor(), specification=Limits(Ny=0.4))
        return self.set_of(self.slow, self.store.monitors.add(other, "tight").id, "two limits")

    def flights(self) -> Flights:
        return Flights(self.store, clock=self.clock, journals=Journals(self.directory / "live"))

    async def fly(self, flights: Flights, **asked: Any) -> Any:
        request = {"source": {"kind": "live", "trim": "none"}, "monitor_set": self.set_id} | asked
        return await flights.start(FlightRequest.model_validate(request), "Ann")

    async def push(self, flight: LiveFlight, first: int, stop: int, name: str = "mach") -> None:
        for k in range(first, stop):
            self.clock.advance(DT)
            sample = {"t": T[k]} | dict(zip(KEYS, Y[k].tolist(), strict=True))
            if k in SENT:
                sample[name] = SENT[k]
            await flight.receive(json.dumps(sample), "rest").stored


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., None]:
    def running(test: Callable[[Range], Coroutine[Any, Any, None]]) -> None:
        asyncio.run(test(Range(tmp_path)))

    return running


def by_itself(monitor: Monitor, first: int, stop: int) -> Iterator[tuple[Any, ...]]:
    """What a monitor says of samples first to stop - 1 if the one before is missing."""
    stream = monitor.stream(exemplars=False)
    stream.update(T[first] - DT, np.full(len(KEYS), np.nan))
    for k in range(first, stop):
        said = stream.update(T[k], Y[k])
        yield said.state.value, said.p_value, said.alert


def assert_each_part_is_by_its_monitor_alone(frames: list[dict[str, Any]]) -> None:
    reason, used = "", {"slow": exact_monitor(), "fast": fast_monitor()}
    expected: dict[int, tuple[Any, ...]] = {}
    for first, stop, case in PARTS:
        expected |= dict(enumerate(by_itself(used[case], first, stop), first))
        n_delay = used[case].recipe.n_delay
        assert [expected[k][0] for k in range(first, first + n_delay)] == ["warming_up"] * n_delay
        assert f"condition, {case}, holds since {T[first]:.2f} s" in frames[first]["reason"]
    assert {said[1] is None for said in expected.values()} == {True, False}
    assert len(frames) == N
    for k, frame in enumerate(frames):
        said = frame["state"], frame["p_value"], frame["alert"]
        if k in expected:
            assert said == expected[k], k
            continue
        reason = REASONS.get(k, reason)
        assert (*said, frame["reason"], frame["cause"]) == (
            "invalid",
            None,
            None,
            reason,
            "not_applicable",
        )


def test_the_monitor_of_the_condition_is_used_with_a_fresh_history(run: Callable) -> None:
    """Also after the server was killed, in its journal, and in a replay of it."""

    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights, condition={"mach": "air/M"})
            assert (flight.in_force.monitor_set.case, flight.in_force.monitor_set.reason) == (
                "",
                "not applicable: Mach number is missing",
            )
            assert [signal.name for signal in flight.live.conditions] == ["air/M"]
            seen = Seen(flight.watch())
            await place.push(flight, 0, 30, "air/M")
            seen.take()
            assert seen.of("hello")[0]["monitor_set"]["case"] == ""
            changes = [
                (each["monitor"]["id"], each["epsilon"], each["monitor_set"]["case"])
                for each in seen.of("monitor")
            ]
            assert seen.of("hello")[0]["monitor"] is None
            slow, fast = exact_monitor(), fast_monitor()
            assert changes == [
                (place.slow, slow.recipe.epsilon, "slow"),
                (place.fast, fast.recipe.epsilon, "fast"),
            ]
            alert_above = [each["monitors"][0]["alert_above"] for each in seen.of("monitor")]
            assert alert_above == [slow.alert_above(), fast.alert_above()]
        async with place.flights() as flights:
            again = await flights.live(flight.id)
            assert again.in_force.monitor_set is not None
            assert again.in_force.monitor_set.case == "fast"
            await place.push(again, 30, N, "air/M")
            await flights.stop(flight.id)
            frames = await flights.records.frames(flight.id, 0, 1000)
            assert_each_part_is_by_its_monitor_alone(frames)
            held = place.store.flights.info(flight.id).limits_held or []
            ids = [each["monitor"] for each in held][1:]
            in_turn = [place.slow, place.fast, "", place.slow, "", place.slow, ""]
            assert ids == ["", *in_turn]
            journal = place.directory / "live" / f"{flight.id}.jsonl"
            contents = read_file(journal, place.directory / "columns", name="flown")
            assert any("used monitor set doublet" in note for note in contents.notes)
            replay = await place.fly(flights, source={"kind": "journal", "flight_id": flight.id})
            replayed = replay.source_frames(0, N)
            assert [f["reason"] for f in replayed] == [f["reason"] for f in frames]
            assert [f["p_value"] for f in replayed] == [f["p_value"] for f in frames]
            replay.act("seek", float(T[30]))
            assert replay.in_force.monitor_set.case == "fast"

    run(test)


def test_between_the_conditions_the_flight_is_never_calm(run: Callable) -> None:
    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights)
            await place.push(flight, 0, 3)
            assert flight.headline.level == "caution"
            assert [alarm.kind for alarm in flight.alarms.at_hand] == ["invalid"]
            limits: Any = None
            with pytest.raises(NotPossible, match="monitor set"):
                flight.put_in_force(limits, "Ben")

    run(test)


def test_lists_read_the_monitors_of_the_listed_sets_alone(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights)
            await flights.stop(flight.id)
        info = place.store.flights.info(flight.id)
        monkeypatch.setattr(place.store.monitors, "all", None)
        sets = stored_sets(place.store, [info])
        alert_above = [each.alert_above for each in sets[flight.id].conditions]
        assert alert_above == [exact_monitor().alert_above(), fast_monitor().alert_above()]

    run(test)


def test_a_watcher_costs_no_second_reading_of_the_planned_test(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights)
            monkeypatch.delattr("app.flights.flight.planned_length")
            seen = Seen(flight.watch())
            seen.take()
            assert seen.of("hello")[0]["planned_s"] is None

    run(test)


def test_a_declared_condition_is_not_asked_of_the_source(run: Callable) -> None:
    async def test(place: Range) -> None:
        async with place.flights() as flights:
            assert (await place.fly(flights, condition={"mach": 0.9})).live.conditions == []

    run(test)


def test_each_monitor_is_judged_by_its_own_limits(run: Callable) -> None:
    """Between the conditions the limits are those that all share, else unknown."""

    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights, monitor_set=place.set_with_two_limits())
            seen = Seen(flight.watch())
            await place.push(flight, 0, 50)
            seen.take()
            limits = [(each["held"]["limits"] or {}).get("Ny") for each in seen.of("monitor")]
            assert limits == [0.5, 0.4, None]
            assert seen.of("monitor")[-1]["channels"][3]["limit"] is None
            shared = await place.fly(flights)
            assert shared.watch() is not None
            assert next(c.limit for c in shared.in_force.channels if c.key == "Ny") == 0.5

    run(test)


def test_beyond_the_limit_of_every_monitor_exceeds_between_the_conditions(run: Callable) -> None:
    """The limits in force are unknown there, but not what exceeds each of them."""

    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights, monitor_set=place.set_with_two_limits())
            for k, (ny, exceeds) in enumerate([(0.39, False), (0.45, False), (0.51, True)] * 2):
                place.clock.advance(DT)
                sample = {"t": T[k], "mach": 1.3, **dict.fromkeys(KEYS, 0.0), "Ny": ny}
                await flight.receive(json.dumps(sample), "rest").stored
                assert (flight.headline.status == "exceeding") == exceeds, k
            (alarm,) = (each for each in flight.alarms.at_hand if each.kind == "limit")
            assert alarm.exceedance.limit == 0.5
            assert alarm.reason == "beyond the limit of every monitor of the set"
            assert flight.in_force.monitor_set.widest == {"Ny": SafeInterval(low=-0.5, high=0.5)}
            assert next(c.limit for c in flight.in_force.channels if c.key == "Ny") is None

    run(test)


def test_a_received_sample_is_judged_by_the_monitor_of_its_own_condition(run: Callable) -> None:
    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights, monitor_set=place.set_with_two_limits())
            for k, (mach, ny) in enumerate([(0.9, 0.39), (0.7, 0.45), (0.9, 0.39)] * 3):
                place.clock.advance(DT)
                sample = {"t": T[k], "mach": mach, **dict.fromkeys(KEYS, 0.0), "Ny": ny}
                await flight.receive(json.dumps(sample), "rest").stored
            assert flight.exceeded_t is None

    run(test)


def test_a_change_carries_the_time_of_its_first_sample(run: Callable) -> None:
    async def test(place: Range) -> None:
        async with place.flights() as flights:
            flight = await place.fly(flights)
            seen = Seen(flight.watch())
            await place.push(flight, 0, 50)
            seen.take()
            firsts = [each["held"]["t"] for each in seen.of("monitor")]
            assert firsts == [pytest.approx(T[k]) for k in (5, 20, 45)]
            assert [m.authority for m in flight.monitors] == [False]
            await flights.stop(flight.id)
            held = place.store.flights.info(flight.id).limits_held or []
            stored = {each["seq"]: each["t"] for each in held if each["t"] is not None}
            assert stored == {k: pytest.approx(T[k]) for k in stored}
            assert {5, 20, 45} <= set(stored)

    run(test)


def test_the_monitor_in_use_stays_in_use_while_conditions_overlap(run: Callable) -> None:
    """A condition that hovers at a boundary does not empty the history each time."""

    async def test(place: Range) -> None:
        info = place.store.monitors.info
        cases: tuple[MonitorCase[MonitorInfo], ...] = (
            MonitorCase("slow", {"mach": (None, 0.82)}, info(place.slow)),
            MonitorCase("fast", {"mach": (0.78, 1.2)}, info(place.fast)),
        )
        overlapping = place.store.monitor_sets.add("overlap", MonitorSet(cases), "Ann").id
        async with place.flights() as flights:
            flight = await place.fly(flights, monitor_set=overlapping)
            seen = Seen(flight.watch())
            hovering = [0.8, 0.79, 0.81, 0.819, 0.82, 0.81, 0.79, 0.781, 0.77, 0.8]
            for k, mach in enumerate(hovering):
                place.clock.advance(DT)
                sample = {"t": T[k], "mach": mach, **dict.fromkeys(KEYS, 0.0)}
                await flight.receive(json.dumps(sample), "rest").stored
            seen.take()
            used = [(e["held"]["t"], e["monitor_set"]["case"]) for e in seen.of("monitor")]
            expected = [(T[0], "slow"), (T[4], "fast"), (T[8], "slow")]
            assert used == [(pytest.approx(t), case) for t, case in expected]

    run(test)


def test_a_declared_condition_chooses_the_monitor_of_a_simulated_flight(run: Callable) -> None:
    async def test(place: Range) -> None:
        tested = place.store.monitors.info(place.slow)
        assert tested.dataset_recipe == {"aircraft": "oscillator"}
        dataset = place.store.datasets.add(
            oscillator.collect(np.random.default_rng(15), n_unsafe=3), "stored"
        )
        source = {"kind": "replay", "dataset": dataset.id, "outcome": "unsafe", "rollout": 0}
        async with place.flights() as flights:
            for condition, reason in (
                ({}, "Mach number is missing"),
                ({"mach": 1.3}, "no monitor"),
            ):
                with pytest.raises(SourceError, match=reason):
                    await place.fly(flights, source=source, condition=condition)
            flight = await place.fly(flights, source=source, condition={"mach": 0.9})
            place.clock.advance(5.0)
            await flights.stop(flight.id)
            assert flight.in_force.monitor_set.case == "fast"
            stored = place.store.flights.assessments(flight.id)
            expected = fast_monitor().assess(stored.t, stored.y)
            np.testing.assert_array_equal(stored.p_value, expected.p_value)
            assert place.store.flights.info(flight.id).monitor_id == place.fast

    run(test)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"monitor": "m"}, "both a monitor and a monitor_set"),
        ({"monitor_set": None}, "no monitor was given"),
        ({"epsilon": 0.1}, "leave out epsilon"),
        ({"limit_set": "l"}, "leave out limit_set"),
        ({"monitors": ["m"]}, "leave out monitors"),
    ],
)
def test_a_request_names_a_monitor_or_a_set(asked: Any, words: str) -> None:
    request = {"source": {"kind": "live"}, "monitor_set": "s"} | asked
    with pytest.raises(ValueError, match=words):
        FlightRequest.model_validate(request)


def test_what_is_in_use_is_not_deleted(run: Callable) -> None:
    async def test(place: Range) -> None:
        store = place.store
        with pytest.raises(InUse, match="monitor set doublet"):
            store.monitors.delete(place.fast)
        async with place.flights() as flights:
            flight = await place.fly(flights)
            with pytest.raises(InUse, match="running flight"):
                store.monitor_sets.delete(place.set_id)
        store.flights.delete(flight.id)
        store.monitor_sets.delete(place.set_id)
        assert store.monitor_sets.all() == []
        store.monitors.delete(place.fast)

    run(test)
