"""The recorder: everything into the store, whatever the store does meanwhile."""

import asyncio
import threading
from pathlib import Path

import numpy as np
import pytest

from app.flights import recorder as module
from app.flights.recorder import INTERVAL_S, JOURNALLED_S, Recorder
from app.store.store import StoreError, StoreHealth, open_store
from core.dataset import Dataset
from core.flight_events import Alarm
from core.monitor import train
from core.monitor.assessment import Assessment, State
from tests.support.flying import NoStore, ScriptedClock, SilentRecorder, as_store, store_with
from tests.support.oscillator import DT, Array
from tests.support.stored import alarm as stored_alarm


def said(k: int) -> Assessment:
    return Assessment(k * DT, 0.25, False, State.OK, "", np.full(6, float(k)))


def alarm(number: int, by: str | None = None) -> Alarm:
    return stored_alarm(number, 3, 0.15, raised="now", by=by)


def under_way(recorder: Recorder) -> list[asyncio.Task[bool]]:
    return [recorder._task] if recorder._task else []


def fill(recorder: Recorder, n: int, first: int = 0) -> None:
    for k in range(first, first + n):
        recorder.add(k, np.full(6, float(k)), said(k))


def test_every_sample_reaches_the_store_bit_for_bit(
    dataset: Dataset, flights: Array, tmp_path: Path
) -> None:
    monitor = train(dataset)
    store, monitor_id = store_with(monitor, tmp_path)
    flight_id = store.flights.add({}, monitor_id, 0.3)
    recorder = Recorder(store, flight_id, ScriptedClock())
    stream, y = monitor.stream(0.3), flights[0].copy()
    y[20, 2] = np.nan
    expected = [stream.update(k * DT, y[k]) for k in range(len(y))]

    async def record() -> None:
        for k, one in enumerate(expected):
            recorder.add(k, y[k], one)
        await recorder.flush()
        fill(recorder, 2500, first=len(y))
        await recorder.complete("ended")

    asyncio.run(record())
    stored = open_store(tmp_path / "store.db").flights.assessments(flight_id)
    assert stored.seq.tolist() == list(range(len(y) + 2500))
    batch = monitor.assess(DT * np.arange(len(y)), y, 0.3)
    np.testing.assert_array_equal(stored.y[: len(y)], y)
    np.testing.assert_array_equal(stored.p_value[: len(y)], batch.p_value)
    np.testing.assert_array_equal(stored.state[: len(y)], batch.state)
    np.testing.assert_array_equal(stored.alert[: len(y)], batch.alert)
    known = batch.state == 0
    np.testing.assert_array_equal(stored.y_hat[: len(y)][known], batch.y_hat[known])
    assert recorder.lost == 0


def test_samples_are_written_by_themselves_after_the_interval() -> None:
    store, clock = NoStore(), ScriptedClock()

    async def record() -> None:
        recorder = Recorder(as_store(store), "f", clock)
        fill(recorder, 10)
        clock.advance(INTERVAL_S - 0.1)
        assert not under_way(recorder)
        clock.advance(0.2)
        await asyncio.gather(*under_way(recorder))
        assert [chunk[1] for chunk in store.chunks] == [0]
        assert recorder.waiting(0, 100) == []

    asyncio.run(record())


def test_a_longer_interval_is_for_what_the_store_takes() -> None:
    store, clock = NoStore(), ScriptedClock()
    store.failures = 1

    async def record() -> None:
        recorder = Recorder(as_store(store), "f", clock)
        recorder.interval = JOURNALLED_S
        fill(recorder, 10)
        clock.advance(JOURNALLED_S - 0.1)
        assert not under_way(recorder)
        clock.advance(0.2)
        assert await asyncio.gather(*under_way(recorder)) == [False]
        fill(recorder, 5, first=10)
        clock.advance(INTERVAL_S)
        assert await asyncio.gather(*under_way(recorder)) == [True]
        assert recorder.unwritten == 0

    asyncio.run(record())


def test_flights_that_began_together_write_at_times_of_their_own() -> None:
    """The first batch of each within the interval, and the next an interval later."""
    store, clock = NoStore(), ScriptedClock()
    began, names = clock.now(), [f"flight {k}" for k in range(20)]

    async def record() -> list[float]:
        recorders = [Recorder(as_store(store), name, clock) for name in names]
        for recorder in recorders:
            recorder.is_spread = True
            fill(recorder, 10)
        due = [recorder._when - began for recorder in recorders]
        clock.advance(INTERVAL_S + 0.01)
        await asyncio.gather(*(task for one in recorders for task in under_way(one)))
        fill(recorders[0], 10, first=10)
        assert recorders[0]._when == pytest.approx(clock.now() + INTERVAL_S)
        return due

    due = asyncio.run(record())
    assert {chunk[0] for chunk in store.chunks} == {*names}
    assert 0.0 < min(due) < 0.3 * INTERVAL_S
    assert 0.7 * INTERVAL_S < max(due) <= INTERVAL_S
    assert len({*due}) > 10


def test_what_the_store_refuses_is_tried_again_and_not_lost(
    caplog: pytest.LogCaptureFixture,
) -> None:
    store, clock = NoStore(), ScriptedClock()
    store.failures = 2

    async def record() -> None:
        recorder = Recorder(as_store(store), "f", clock)
        fill(recorder, 10)
        assert not await recorder.flush()
        assert [sample.seq for sample in recorder.waiting(4, 6)] == [4, 5, 6]
        assert (recorder.unwritten, recorder.problem) == (10, "the disk is full")
        fill(recorder, 5, first=10)
        clock.advance(INTERVAL_S)
        assert await asyncio.gather(*under_way(recorder)) == [False]
        clock.advance(INTERVAL_S)
        assert await asyncio.gather(*under_way(recorder)) == [True]
        assert (recorder.lost, recorder.unwritten, recorder.problem) == (0, 0, "")

    asyncio.run(record())
    assert [(chunk[1], len(chunk[2])) for chunk in store.chunks] == [(0, 15)]
    assert "retrying" in caplog.text
    assert "recorded again" in caplog.text


def test_a_store_that_takes_nothing_is_a_problem_also_while_nothing_waits() -> None:
    store = NoStore()
    health = StoreHealth(as_store(store))

    async def record() -> None:
        recorder = Recorder(as_store(store), "f", ScriptedClock(), store_health=health)
        assert (recorder.unwritten, recorder.problem) == (0, "")
        await health.check()  # it has no jobs
        assert recorder.problem == health.fault

    asyncio.run(record())


def test_an_alarm_is_announced_once_it_is_stored() -> None:
    store, order = NoStore(), []

    async def record() -> None:
        recorder = Recorder(as_store(store), "f", ScriptedClock())
        for number in (1, 2):
            recorder.add_event(
                alarm(number), lambda stored: order.append((stored, len(store.notes)))
            )
        assert order == []
        await recorder.store_alarms()

    asyncio.run(record())
    assert [stored.number for _, stored in store.notes] == [1, 2]
    assert order == [(True, 1), (True, 2)]


def test_an_alarm_that_the_store_refuses_is_announced_as_not_stored_and_stored_later() -> None:
    store, clock = NoStore(), ScriptedClock()
    store.failures = 1

    async def record() -> list[bool]:
        said: list[bool] = []
        recorder = Recorder(as_store(store), "f", clock)
        recorder.add_event(alarm(1), said.append)
        assert recorder._alarms_task is not None
        await recorder._alarms_task
        assert (said, store.notes) == ([False], [])
        clock.advance(INTERVAL_S)
        await asyncio.gather(*under_way(recorder))
        return said

    assert asyncio.run(record()) == [False, True]
    assert store.notes == [("f", alarm(1))]


def test_a_disk_that_hangs_keeps_nobody_unwarned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ANNOUNCED_S", 0.0)
    store, free = NoStore(), threading.Event()
    monkeypatch.setattr(store, "add", lambda *alarm, **more: free.wait())

    async def record() -> None:
        said: asyncio.Queue[bool] = asyncio.Queue()
        recorder = Recorder(as_store(store), "f", ScriptedClock())
        recorder.add_event(alarm(1), said.put_nowait)
        assert await said.get() is False
        free.set()
        assert await said.get() is True

    asyncio.run(record())


def test_only_a_store_that_refuses_for_long_loses_the_oldest_and_counts_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MOST_WAITING", 100)
    monkeypatch.setattr(module, "BATCH", 30)
    recorder = SilentRecorder(ScriptedClock())
    fill(recorder, 150)
    assert recorder.lost == 60
    assert recorder.waiting(0, 1000)[0].seq == 60


def test_a_flight_whose_record_is_refused_is_not_completed_until_it_is_taken() -> None:
    store = NoStore()
    store.failures = 2
    recorder = SilentRecorder(ScriptedClock(), store)
    fill(recorder, 7)
    with pytest.raises(StoreError, match=r"7 samples of flight f wait .* \(the disk is full\)"):
        asyncio.run(recorder.complete("ended"))
    assert recorder.unwritten == 7

    async def refused_then_taken() -> None:
        again = SilentRecorder(ScriptedClock(), store)
        fill(again, 7)
        with pytest.raises(StoreError):
            await again.complete("ended")
        await again.complete("ended", 8.76)
        assert (again.unwritten, again.lost) == (0, 0)

    asyncio.run(refused_then_taken())
    assert store.notes == [("f", "ended", 8.76, [], None, None, None)]


def test_what_the_store_refuses_to_the_last_is_counted_as_lost() -> None:
    recorder = SilentRecorder(ScriptedClock())
    fill(recorder, 7)
    recorder.give_up()
    assert (recorder.lost, recorder.unwritten) == (7, 0)


def test_an_alarm_taken_twice_is_stored_once(dataset: Dataset, tmp_path: Path) -> None:
    store, monitor_id = store_with(train(dataset), tmp_path)
    flight_id = store.flights.add({}, monitor_id, 0.3)
    for raised in ("2030-01-01T00:00:00Z", "2031-01-01T00:00:00Z"):
        store.alarms.add(flight_id, stored_alarm(1, 3, 0.15, raised=raised))
    (stored,) = store.alarms.of(flight_id)
    assert (stored.number, stored.raised) == (1, "2030-01-01T00:00:00Z")
