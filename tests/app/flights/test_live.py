"""Flights of live sources: scored as the batch, stale by the clock, over with their source."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from app.flights.live import LiveFlight, Sample
from app.flights.transport import NotPossible
from core.monitor import Monitor, State
from tests.support.flying import (
    EPSILON,
    ScriptedClock,
    Seen,
    SilentRecorder,
    T,
    plan,
)
from tests.support.oscillator import DT, N_SAMPLES, Array


class Scripted:
    """A live source that gives what a test puts in; None ends it, an exception is raised."""

    dt = DT
    theta = None

    def __init__(self) -> None:
        self.queue: asyncio.Queue[Sample | Exception | None] = asyncio.Queue()

    async def __aiter__(self) -> AsyncIterator[Sample]:
        while (item := await self.queue.get()) is not None:
            if isinstance(item, Exception):
                raise item
            yield item


class Live:
    """A live flight with its source, clock and watcher."""

    def __init__(self, monitor: Monitor) -> None:
        self.clock, self.source = ScriptedClock(), Scripted()
        self.over: list[tuple[str, str]] = []
        self.recorder = SilentRecorder(self.clock)
        self.flight = LiveFlight(
            plan(monitor),
            self.source,
            self.recorder,
            self.clock,
            lambda *how: self.over.append(how),
        )
        self.seen = Seen(self.flight.watch())
        self.flight.start()

    async def give(self, *items: Any) -> None:
        for item in items:
            self.source.queue.put_nowait(item)
        while not self.source.queue.empty():
            await asyncio.sleep(0)
        for _ in range(5):
            await asyncio.sleep(0)
        self.seen.take()

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        self.seen.take()


def test_a_live_source_is_scored_as_the_batch_and_ends_the_flight(
    exact: Monitor, failing: Array
) -> None:
    async def fly() -> None:
        live = Live(exact)
        for k in range(N_SAMPLES):
            live.clock.advance(DT)
            await live.give(Sample(k * DT, failing[k]))
        expected = exact.assess(T, failing, EPSILON)
        assert [f["p_value"] for f in live.seen.frames] == expected.p_value.tolist()
        assert len(live.seen.of("alarm")) == 1
        await live.give(None)
        assert live.over == [("ended", "the source ended")]
        assert live.seen.messages[-1] == {"type": "end", "reason": "the source ended"}
        assert len(live.recorder.waiting(0, 1000)) == N_SAMPLES

    asyncio.run(fly())


def test_a_late_source_is_stale_by_the_clock_and_recovers(exact: Monitor, failing: Array) -> None:
    async def fly() -> None:
        live = Live(exact)
        await live.give(Sample(0.0, failing[0]))
        live.advance(0.2)
        assert live.flight.state is State.OK
        live.advance(0.1)
        assert live.seen.of("state")[-1]["state"] == "stale"
        assert live.seen.of("state")[-1]["reason"] == "no sample came for 0.25 s"
        live.advance(10.0)
        assert [m["state"] for m in live.seen.of("state")].count("stale") == 1
        await live.give(Sample(10.3, failing[1]))
        assert live.seen.of("state")[-1]["state"] == "warming_up"
        await live.flight.stop("enough")

    asyncio.run(fly())


def test_a_source_that_never_comes_is_stale(exact: Monitor) -> None:
    async def fly() -> None:
        live = Live(exact)
        live.advance(0.3)
        assert live.seen.of("state")[-1]["state"] == "stale"
        await live.flight.stop("enough")
        live.advance(5.0)
        assert live.seen.messages[-1]["type"] == "end"

    asyncio.run(fly())


def test_a_source_that_breaks_fails_the_flight(
    exact: Monitor, caplog: pytest.LogCaptureFixture
) -> None:
    async def fly() -> None:
        live = Live(exact)
        await live.give(OSError("the cable is out"))
        assert live.over[0][0] == "failed"
        assert live.seen.messages[-1]["type"] == "end"

    asyncio.run(fly())
    assert "the cable is out" in caplog.text


def test_a_live_flight_cannot_be_steered(exact: Monitor) -> None:
    async def fly() -> None:
        live = Live(exact)
        with pytest.raises(NotPossible, match="cannot be steered"):
            live.flight.act("pause")
        with pytest.raises(NotPossible, match="see assessments"):
            live.flight.source_frames(0, 1)
        assert not live.flight.transport.seekable
        await live.flight.stop("enough")

    asyncio.run(fly())
