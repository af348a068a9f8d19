"""The registry: several flights at once, capped, stopped and recorded."""

import asyncio
from collections.abc import Callable, Coroutine
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import pytest

from app.flights.flights import Flights, TooManyFlights
from app.flights.recorder import INTERVAL_S
from app.flights.request import FlightRequest
from app.flights.sources.simulated import SourceError
from app.flights.sources.source import Simulated
from app.store.flights import FlightInProgress
from app.store.store import NotFound, Store, StoreError, open_store
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.status import Level
from core.planned_test.collection import DatasetRecipe, collect
from core.simulation.attitude import SurfaceSigns
from tests.support.flying import ScriptedClock, Seen

RECIPE = DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)


@cache
def monitor() -> Monitor:
    dataset = collect(RECIPE)
    return train(dataset, MonitorRecipe(epsilon=0.3))


class Hangar:
    """Flights on a scripted clock over a real store."""

    def __init__(self, directory: Path, **choices: Any) -> None:
        self.store: Store = open_store(directory / "store.db")
        self.monitor_id = self.store.monitors.add(monitor(), "F-16 doublet").id
        self.clock = ScriptedClock()
        self.flights = Flights(self.store, clock=self.clock, **choices)

    def request(self, **choices: Any) -> FlightRequest:
        source = Simulated(kind="simulated", outcome="unsafe", seed=choices.pop("seed", 1))
        asked: dict[str, Any] = {"source": source, "monitor": self.monitor_id} | choices
        return FlightRequest(**asked)


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., None]:
    """Run a coroutine with a Hangar whose flights are closed at the end."""

    def running(test: Callable[[Hangar], Coroutine[Any, Any, None]], **choices: Any) -> None:
        async def main() -> None:
            hangar = Hangar(tmp_path, **choices)
            async with hangar.flights:
                await test(hangar)

        asyncio.run(main())

    return running


def test_flights_fly_side_by_side_and_are_recorded_when_stopped(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        flights = [await hangar.flights.start(hangar.request(seed=seed)) for seed in range(3)]
        for _ in range(70):
            hangar.clock.advance(0.05)
        flights[1].act("pause")
        for _ in range(70):
            hangar.clock.advance(0.05)
        for flight in flights:
            await hangar.flights.stop(flight.id)
        stored = [hangar.store.flights.assessments(flight.id) for flight in flights]
        assert [len(one) for one in stored] == [121, 71, 121]
        assert {info.status for info in hangar.store.flights.all()} == {"ended"}
        assert (stored[0].y != stored[2].y).any()
        assert hangar.flights.under_way() == []

    run(test)


def test_the_end_of_the_server_stops_every_flight_and_completes_its_record(tmp_path: Path) -> None:
    async def main() -> None:
        hangar = Hangar(tmp_path)
        async with hangar.flights:
            flight = await hangar.flights.start(hangar.request())
            seen = Seen(flight.watch())
            hangar.clock.advance(1.0)
        assert seen.take()[-1] == {"type": "end", "reason": "the server is stopping"}
        assert len(hangar.store.flights.assessments(flight.id)) == 21
        assert hangar.store.flights.info(flight.id).status == "ended"
        with pytest.raises(TooManyFlights, match="the server is stopping"):
            await hangar.flights.start(hangar.request())

    asyncio.run(main())


def test_there_are_at_most_so_many_flights_even_when_started_at_once(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        starts = [hangar.flights.start(hangar.request(seed=seed)) for seed in range(4)]
        done = await asyncio.gather(*starts, return_exceptions=True)
        flights = hangar.flights.under_way()
        assert len(flights) == 2
        (first, second) = [error for error in done if isinstance(error, Exception)]
        assert isinstance(first, TooManyFlights)
        assert "2 flights are in progress" in str(second)
        await hangar.flights.stop(flights[0].id)
        await hangar.flights.start(hangar.request())

    run(test, max_flights=2)


def test_a_flight_that_cannot_start_leaves_nothing_behind(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        with pytest.raises(ValueError, match=r"epsilon=0\.01 needs at least"):
            await hangar.flights.start(hangar.request(epsilon=0.01))
        with pytest.raises(NotFound):
            await hangar.flights.start(hangar.request(monitor="none"))
        theta = Simulated(kind="simulated", theta={"C_n": 1.0})
        with pytest.raises(SourceError):
            await hangar.flights.start(hangar.request().model_copy(update={"source": theta}))
        assert hangar.store.flights.all() == []
        await hangar.flights.start(hangar.request())

    run(test, max_flights=1)


def test_frames_are_whole_before_and_after_they_reach_the_store(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        hangar.clock.advance(1.0)
        await flight.recorder.flush()
        hangar.clock.advance(1.0)
        half_stored = await hangar.flights.records.frames(flight.id, 5, 1000)
        await flight.recorder.flush()
        stored = await hangar.flights.records.frames(flight.id, 5, 1000)
        assert [frame["seq"] for frame in half_stored] == list(range(5, 41))
        expected = flight.source_frames(5, 40)
        for frames in (half_stored, stored):
            for frame, one in zip(frames, expected, strict=True):
                assert frame.keys() == one.keys()
                plain = ("t", "y", "y_hat", "p_value", "alert", "state", "reason")
                assert [frame[key] for key in plain] == [one[key] for key in plain]

    run(test)


def test_a_write_while_frames_are_read_repeats_none(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        hangar.clock.advance(1.0)
        loop, read = asyncio.get_running_loop(), hangar.store.flights.assessments

        def read_after_a_write(*what: Any) -> Any:
            asyncio.run_coroutine_threadsafe(flight.recorder.flush(), loop).result()
            return read(*what)

        monkeypatch.setattr(hangar.store.flights, "assessments", read_after_a_write)
        frames = await hangar.flights.records.frames(flight.id, 0, 1000)
        assert [frame["seq"] for frame in frames] == list(range(21))

    run(test)


def test_alarms_are_the_same_during_and_after_the_flight(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        flights = hangar.flights
        flight = await flights.start(hangar.request())
        for _ in range(130):
            hangar.clock.advance(0.05)
        (alarm,) = (await flights.records.alarms(flight.id))[:1]
        assert alarm.acknowledged is None
        told = await flights.records.acknowledge(flight.id, alarm.id, "FTE")
        assert told.by == "FTE"
        stored = hangar.store.alarms.of(flight.id)[0]
        assert (stored.number, stored.seq, stored.p_value) == (1, alarm.seq, alarm.p_value)
        assert stored.by == "FTE"
        await flights.stop(flight.id)
        after = (await flights.records.alarms(flight.id))[0]
        assert (after.id, after.seq, after.t, after.by) == (alarm.id, alarm.seq, alarm.t, "FTE")
        again = await flights.records.acknowledge(flight.id, alarm.id, "pilot")
        assert again.by == "FTE"
        with pytest.raises(NotFound, match="has no alarm 99"):
            await flights.records.acknowledge(flight.id, "99", "FTE")

    run(test)


def test_an_alarm_nobody_saw_can_be_acknowledged_after_the_flight(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        for _ in range(130):
            hangar.clock.advance(0.05)
        await hangar.flights.stop(flight.id)
        told = await hangar.flights.records.acknowledge(flight.id, "1", "FTE")
        assert told.by == hangar.store.alarms.of(flight.id)[0].by == "FTE"

    run(test)


def refuse(*what: Any) -> None:
    raise StoreError("the disk is full")


def test_an_acknowledgement_that_is_not_stored_is_not_made(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        for _ in range(130):
            hangar.clock.advance(0.05)
        with monkeypatch.context() as full:
            full.setattr(hangar.store.alarms, "acknowledge", refuse)
            with pytest.raises(StoreError, match="full"):
                await hangar.flights.records.acknowledge(flight.id, "1", "FTE")
        n_open = flight.alarms.n_open(Level.WARNING)
        assert hangar.store.alarms.of(flight.id)[0].by is None
        told = await hangar.flights.records.acknowledge(flight.id, "1", "FTE")
        assert (told.by, told.stored, flight.alarms.n_open(Level.WARNING)) == (
            "FTE",
            True,
            n_open - 1,
        )

    run(test)


def test_a_flight_is_ending_until_its_record_is_complete(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(hangar: Hangar) -> None:
        flights = hangar.flights
        flight = await flights.start(hangar.request())
        hangar.clock.advance(1.0)
        with monkeypatch.context() as full:
            full.setattr(hangar.store.flights, "append", refuse)
            for _ in range(2):
                with pytest.raises(StoreError, match="21 samples of flight"):
                    await flights.stop(flight.id)
            assert flight.is_over
            assert (flights.unwritten, flights.problem) == (21, "the disk is full")
            assert hangar.store.flights.info(flight.id).status == "running"
            with pytest.raises(FlightInProgress, match="its record is incomplete: 21 samples"):
                await flights.delete(flight.id)
            full.undo()
            full.setattr(hangar.store.flights, "end", refuse)
            with pytest.raises(StoreError):
                await flights.stop(flight.id)
            with pytest.raises(FlightInProgress, match="incomplete: status and time of its end"):
                await flights.delete(flight.id)
        hangar.clock.advance(INTERVAL_S)
        await asyncio.gather(*flights._stopping)
        assert flights.get(flight.id) is None
        assert hangar.store.flights.info(flight.id).status == "ended"
        assert len(hangar.store.flights.assessments(flight.id)) == 21

    run(test)


def test_samples_that_were_lost_are_told_of_the_record(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        hangar.clock.advance(1.0)
        await flight.recorder.flush()
        hangar.clock.advance(1.0)
        del flight.recorder._samples[:5]
        await hangar.flights.stop(flight.id)
        info = hangar.store.flights.info(flight.id)
        assert (info.head, info.lost) == (40, 5)

    run(test)


def test_a_flight_that_is_ended_twice_at_once_is_ended_once(run: Callable) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        hangar.clock.advance(1.0)
        await asyncio.gather(*(hangar.flights.stop(flight.id) for _ in range(5)))
        assert hangar.flights.get(flight.id) is None
        assert len(hangar.store.flights.assessments(flight.id)) == 21
        with pytest.raises(NotFound):
            hangar.flights.flying(flight.id)

    run(test)


def test_a_flight_that_fails_by_itself_is_stopped_and_noted(
    run: Callable, caplog: pytest.LogCaptureFixture
) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        flight._script = None  # pyright: ignore
        hangar.clock.advance(1.0)
        await asyncio.gather(*hangar.flights._stopping)
        assert hangar.flights.get(flight.id) is None
        assert hangar.store.flights.info(flight.id).status == "failed"
        assert len(hangar.store.flights.assessments(flight.id)) == 1

    run(test)
    assert "failed" in caplog.text


class Theatre:
    """Scenes that note what is opened and closed; `full` opens none."""

    def __init__(self, full: bool = False) -> None:
        self.full, self.opened, self.closed = full, [], []

    def open(self, *what: Any) -> Any:
        if self.full:
            raise RuntimeError("no scene is free")
        self.opened.append(what)
        return self

    def close(self, flight: str) -> None:
        self.closed.append(flight)

    def show(self, *what: Any) -> None:
        pass

    def restate(self, facts: object) -> None:
        pass


def test_a_scene_is_opened_with_the_aircrafts_signs_and_closed_with_the_flight(
    run: Callable,
) -> None:
    theatre = Theatre()

    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        (opened,) = theatre.opened
        assert opened[0] == flight.id
        assert isinstance(opened[1], SurfaceSigns)
        assert opened[2] == pytest.approx(0.037, abs=0.01)
        assert opened[3] == msgspec.json.decode(flight._hello())["stale_after"] == 0.25
        assert opened[4] == "fighter"
        await hangar.flights.stop(flight.id)
        assert theatre.closed == [flight.id]

    run(test, scenes=theatre)


def test_a_flight_flies_without_a_scene_where_there_can_be_none(
    run: Callable, caplog: pytest.LogCaptureFixture
) -> None:
    async def test(hangar: Hangar) -> None:
        flight = await hangar.flights.start(hangar.request())
        assert flight.scene is None
        hangar.clock.advance(1.0)
        assert flight.head == 20

    run(test, scenes=Theatre(full=True))
    assert "without a scene" in caplog.text
