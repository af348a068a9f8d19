"""The flight of a live source: assessed sample by sample, stale as soon as the source is late."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any, NamedTuple, Protocol

from app.flights.exceedance import exceedance
from app.flights.flight import LEVEL, Flight, FlightPlan, patience
from app.flights.transport import NotPossible
from app.messages import TransportState
from core.monitor import State
from core.types import Array


class Sample(NamedTuple):
    """One sample of a live source. y: (6,).   attitude: phi, theta, psi [rad] where measured."""

    t: float
    y: Array
    attitude: tuple[float, float, float] | None = None


class LiveSource(Protocol):
    """Samples as they come; the flight ends when they do."""

    @property
    def dt(self) -> float:
        """Interval at which samples should come [s]."""
        ...

    @property
    def theta(self) -> dict[str, float] | None:
        """Parameters of a simulated aircraft, by name."""
        ...

    def __aiter__(self) -> AsyncIterator[Sample]:
        """Yield the samples, each as soon as it is there."""
        ...


class LiveFlight(Flight):
    """A flight that only plays, at the pace of its source, and is over when that ends."""

    def __init__(self, plan: FlightPlan, source: LiveSource, *about: Any, **more: Any) -> None:
        super().__init__(plan, *about, **more)
        self.dt, self.theta = source.dt, source.theta
        self.is_checked = plan.monitor.support is not None
        self._source = source
        self._patience = patience(source.dt)
        self._came = 0.0
        self._task: asyncio.Task[None] | None = None

    @property
    def transport(self) -> TransportState:
        """Where it is: at its newest sample."""
        return TransportState(
            playing=not self.is_over,
            speed=1.0,
            loop=False,
            start=0.0,
            position=self.t,
            duration=None,
            sample=self.head,
            n_samples=None,
            slipped=0.0,
            seekable=False,
        )

    def start(self) -> None:
        """Begin to take samples."""
        self._beat()
        self._came = self.clock.now()
        self._watch_out()
        self._task = asyncio.get_running_loop().create_task(self._fly_source())

    def act(self, action: str, value: float | bool | None = None) -> None:
        """Refuse: nobody steers a live source."""
        raise NotPossible(
            f"{action} was asked: a live flight cannot be steered, it plays as its samples come"
        )

    def source_frames(self, first: int, last: int) -> list[dict[str, Any]]:
        """Refuse: nobody knows a live source."""
        raise NotPossible("a live source has no samples but those that came: see assessments")

    async def stop(self, reason: str) -> None:
        """End the flight: the source is left, watchers are told, the record is completed."""
        self._halt(reason)
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        await super().stop(reason)

    async def _fly_source(self) -> None:
        stream = self.plan.monitor.stream(self.plan.epsilon)
        try:
            async for t, y, attitude in self._source:
                self._came = self.clock.now()
                assessment = stream.update(t, y)
                exceeded = exceedance(self.plan.monitor.limits, y, y)
                self._fly(y, assessment, exceeded, self._came, self.head + 1, attitude or LEVEL)
                self._show()
        except Exception:
            self._fail()
        else:
            self._end("ended", "the source ended")

    def _watch_out(self) -> None:
        """Say `stale` as soon as the source is late; look again when it could be."""
        now = self.clock.now()
        when = self._came + self._patience
        if when <= now:
            when = now + self._patience
            reason = f"no sample came for {self._patience:g} s"
            is_new = self.state is not State.STALE
            if is_new:
                self._set_state(State.STALE, reason)
            self._ring(self.alarms.note_late(self.head, self.t, reason, self.clock))
            if is_new:
                self._show()
        self._call_at("watch out", when, self._watch_out)
