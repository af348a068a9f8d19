"""Flights that a waiting server follows: taken over as if replayed from their start."""

import asyncio
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.flights.flights import Flights
from app.flights.follower import Follower
from app.flights.preparation import Preparation
from app.flights.request import FlightRequest
from app.flights.sources.live import LiveFlight
from app.store.store import Store, StoreError, open_store, served_store
from app.telemetry.journal import Journals
from core.channels import KEYS
from tests.app.flights.test_flight_limits import OWN
from tests.support.flying import ScriptedClock, exact_monitor
from tests.support.oscillator import DT

N = 900
BEYOND = (100, 130), (700, 705)
"""Samples beyond the limit of Ny."""


class Range:
    """The owner of a database with one live flight, and a server that follows."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.clock = directory, ScriptedClock()
        self.store = open_store(directory / "store.db")
        self.monitor = self.store.monitors.add(exact_monitor(), "oscillator").id
        self.limits = self.store.limit_sets.add("own", OWN, "Ann").limit_set
        self.owner = self.flights(self.store, directory)
        self.follower = Follower(directory / "store.db", Journals(directory / "live"), self.clock)
        served = served_store(directory / "store.db")
        assert served is not None
        self.served = served

    def flights(self, store: Store, directory: Path, **more: Any) -> Flights:
        return Flights(store, clock=self.clock, journals=Journals(directory / "live"), **more)

    async def start(self) -> LiveFlight:
        asked = {"source": {"kind": "live", "trim": "none"}, "monitor": self.monitor}
        flight = await self.owner.start(FlightRequest.model_validate(asked), "Ann")
        assert isinstance(flight, LiveFlight)
        return flight

    async def push(self, flight: LiveFlight, k: int) -> None:
        channels = dict.fromkeys(KEYS, 1e-3 * (k % 5))
        if any(first <= k < stop for first, stop in BEYOND):
            channels["Ny"] = 0.6
        batch = json.dumps({"sequence": k, "t": DT * k, **channels})
        await flight.receive(batch, "rest").stored

    def read(self) -> None:
        self.follower.read(self.served)

    def copied(self, name: str) -> tuple[Store, Path]:
        """The database and the journals as a killed owner leaves them."""
        directory = self.directory / name
        directory.mkdir()
        shutil.copytree(self.directory / "live", directory / "live")
        for file in self.directory.glob("store.db*"):
            shutil.copy(file, directory)
        store = open_store(directory / "store.db")
        store.flights.recover()
        return store, directory

    async def taken_over(self, name: str, *flight_ids: str, follows: bool) -> list[Any]:
        """What another server shows, records and says of the flights that it takes over."""
        store, directory = self.copied(name)
        followed = self.follower.end() if follows else None
        shown: list[Any] = []
        async with self.flights(store, directory, followed=followed) as flights:
            for flight_id in flight_ids:
                flight = await flights.live(flight_id)
                watcher = flight.watch()
                hello = json.loads(watcher.next_message() or "")
                waiting = flight.recorder.waiting(0, N)
                shown += [hello, [(s.seq, s.assessment) for s in waiting], flight.alarms.at_hand]
                k = flight.live.last_sequence
                assert flight.receive(self.repeated(directory, flight_id), "rest").repeated
                assert k is not None
                await self.push(flight, k + 1)
                shown.append(flight.recorder.waiting(0, N)[-1].assessment)
        for flight_id in flight_ids:
            stored = store.flights.assessments(flight_id)
            shown.append([stored.t.tolist(), stored.p_value.tolist(), stored.y.tolist()])
        store.close()
        return json.loads(json.dumps(shown, default=str))

    def repeated(self, directory: Path, flight_id: str) -> str:
        lines = (directory / "live" / f"{flight_id}.jsonl").read_text().splitlines()
        newest = [line for line in map(json.loads, lines) if "b" in line][-1]
        return json.dumps({"sequence": newest["s"], **newest["b"]})


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., None]:
    def running(test: Callable[[Range], Any]) -> None:
        async def main() -> None:
            aerodrome = Range(tmp_path)
            async with aerodrome.owner:
                await test(aerodrome)
            aerodrome.store.close()

        asyncio.run(main())

    return running


def never(*_: object) -> None:
    raise AssertionError("it is replayed from its start")


def test_a_flight_that_was_followed_goes_on_as_one_replayed_from_its_start(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(at: Range) -> None:
        rng = np.random.default_rng(4)
        flight = await at.start()
        order = np.arange(N)
        order[300:310] = rng.permutation(order[300:310])
        for n, k in enumerate(order.tolist()):
            at.clock.advance(float(rng.exponential(DT)))
            await at.push(flight, k)
            if n == 500:
                await at.owner.put_in_force(flight.id, at.limits, None, {}, "Ann")
            if rng.random() < 0.02:
                at.read()
        journal = at.directory / "live" / f"{flight.id}.jsonl"
        with journal.open("ab") as file:
            file.write(b'{"v":"rest","s":9999,"b":{"t":[')
        at.read()
        again = await at.taken_over("replayed", flight.id, follows=False)
        monkeypatch.setattr(Preparation, "resumed", never)
        assert await at.taken_over("followed", flight.id, follows=True) == again

    run(test)


def test_flights_begin_end_and_are_deleted_while_they_are_followed(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(at: Range) -> None:
        ended, deleted = await at.start(), await at.start()
        for k in range(60):
            at.clock.advance(DT)
            for flight in (ended, deleted):
                await at.push(flight, k)
        at.read()
        later = await at.start()
        for flight in (ended, deleted):
            await at.owner.stop(flight.id)
        await at.owner.delete(deleted.id)
        for k in range(30):
            await at.push(later, k)
            at.read()
        again = await at.taken_over("replayed", later.id, follows=False)
        monkeypatch.setattr(Preparation, "resumed", never)
        assert await at.taken_over("followed", later.id, follows=True) == again
        assert [*at.follower.end()] == [later.id]

    run(test)


@pytest.mark.parametrize("how", ["renamed", "rewritten", "shortened", "unreadable", "cut"])
def test_a_flight_that_cannot_be_followed_is_replayed_from_its_start(
    run: Callable, how: str
) -> None:
    async def test(at: Range) -> None:
        flight = await at.start()
        for k in range(60):
            at.clock.advance(DT)
            await at.push(flight, k)
        at.read()
        journal = at.directory / "live" / f"{flight.id}.jsonl"
        whole, away = journal.read_bytes(), journal.with_name("away")
        lines = whole.splitlines(keepends=True)
        if how == "renamed":
            journal.rename(away)
            at.read()
            away.rename(journal)
        elif how == "unreadable":
            journal.write_bytes(whole + b"what is this\n")
            at.read()
            journal.write_bytes(whole)
        elif how == "cut":
            assert await flight.recorder.flush()
            at.read()
            at.store.flights.recover()
            at.store.flights.resume(flight.id, 9)
        elif how == "shortened":
            journal.write_bytes(b"".join(lines[:-20]))
        else:
            journal.write_bytes(b"".join([*lines[:-2], lines[-1].replace(b'"s":59', b'"s":58')]))
        again = await at.taken_over("replayed", flight.id, follows=False)
        assert await at.taken_over("followed", flight.id, follows=True) == again

    run(test)


def test_a_flight_whose_monitor_cannot_be_loaded_now_is_followed_later(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise StoreError("the database is too busy")

    async def test(at: Range) -> None:
        flight = await at.start()
        await at.push(flight, 0)
        with monkeypatch.context() as patch:
            patch.setattr(Preparation, "resumed", refuse)
            at.read()
        assert at.follower.end() == {}
        at.read()
        assert [*at.follower.end()] == [flight.id]

    run(test)
