"""Arrivals samples on the grid of the monitor, by those received so far.

The result depends only on the samples and their arrival times, so the same arrivals give the same
bits later: from a flight's journal, or from a recording, all at once.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import isfinite, isnan, nan
from typing import NamedTuple

import numpy as np

from app.telemetry.recording import ATTITUDE
from core.channels import N_CHANNELS
from core.kernels import causal_grid as kernel
from core.kernels.causal_grid import GridState, Settled
from core.kernels.compiled import entry
from core.types import Array, Flags, Indices

Angles = tuple[float, float, float]
DELAY_INTERVALS = 1.5
"""Longest wait for a sample by default, in intervals of the monitor."""
WAITING, ROOM = 512, 64
"""Room for rows that wait and for samples settled at once; it grows where that is not enough."""
MOST_REASONS = 1024
N_VALUES = N_CHANNELS + len(ATTITUDE)


class Sample(NamedTuple):
    """One sample. t: [s].   y: (6,), NaN where unknown.   attitude: phi, theta, psi [rad].

    reason: why it is unknown; empty if known.   condition: values of CONDITION_KEYS sent with it,
    NaN if unknown, None if not sent; None for no condition.
    """

    t: float
    y: Array
    attitude: Angles | None = None
    reason: str = ""
    condition: tuple[float | None, ...] | None = None


class Arrivals(NamedTuple):
    """Arrivals samples, in order of arrival.

    arrived: (n,) [s] of any monotonic clock.   t: (n,) of the source [s].   values: (n, 9) the
    channels, then the attitude [rad]; NaN where unknown.
    """

    arrived: Array
    t: Array
    values: Array


class GridRows(NamedTuple):
    """Samples on the grid.

    t: (n,) [s].   shown: (n,) arrival time at which each was settled [s].   values: (n, 9).
    reasons: of the samples that are unknown, by their row.
    """

    t: Array
    shown: Array
    values: Array
    reasons: dict[int, str]


@dataclass
class Counts:
    """Arrivals samples by kind."""

    accepted: int = 0
    """samples used"""
    repeated: int = 0
    """repeated samples, dropped"""
    out_of_order: int = 0
    """samples received after a later one, used"""
    late: int = 0
    """samples received after their time was settled or taken by another, dropped"""
    missing: int = 0
    """times of the monitor without a sample"""
    clock_steps: int = 0
    """steps of the source's clock; each causes a gap"""
    implausible_times: int = 0
    """samples with an implausible time, dropped"""

    def to_plain(self) -> dict[str, int]:
        return asdict(self)


class CausalGrid:
    """Puts received samples on the grid of the monitor.

    dt: of the monitor [s].   delay: longest wait of a grid time for samples, from when it was
    measured [s]. Arrivals are seconds of any monotonic clock.

    A sample on the grid passes bit for bit as soon as it arrives, and the grid follows it. A source
    with an interval below 0.75 dt is averaged over dt to either side with Hann's weights and a
    local line, against aliasing; a slower one is interpolated linearly. Neighbours more than 1.5
    steps apart (of source or grid, whichever is longer) have a gap between them, which is never
    bridged: it waits for `delay`, then the grid restarts with the first sample after it. A source
    slower than 1.5 dt gives unknown samples, with a reason.
    """

    def __init__(self, dt: float, delay: float) -> None:
        self.dt, self.delay = dt, delay
        clock = np.full(kernel.N_CLOCK, np.nan)
        clock[[kernel.DT, kernel.DELAY, kernel.OFFSET, kernel.INTERVAL]] = dt, delay, 0.0, dt
        clock[[kernel.NEWEST, kernel.NEWEST_ARRIVED]] = -np.inf
        self._state = GridState(
            clock,
            np.zeros(kernel.N_COUNT, np.int64),
            *_rows(WAITING),
            leap=np.empty(N_VALUES),
            steps=np.empty(kernel.INTERVALS),
            ordered=np.empty(kernel.INTERVALS),
            recent_t=np.empty(kernel.REMEMBERED),
            recent=np.empty((kernel.REMEMBERED, N_CHANNELS)),
            late=np.empty(kernel.REMEMBERED),
        )
        self._settled = _room(ROOM)
        self._one = Arrivals(np.empty(1), np.empty(1), np.empty((1, N_VALUES)))
        self._when = np.empty(1), np.empty(1, bool)
        compiled = self._state, self._settled
        self._receive_one = entry(kernel.receive, *compiled, *self._one, 0, *self._when)
        self._advance_to = entry(kernel.advance, *compiled, 0.0)
        self._deadline = entry(kernel.deadline, self._state)
        self._flight_time = entry(kernel.flight_time, self._state, 0.0, 0.0)
        self._reasons: dict[int, str] = {}

    @property
    def interval(self) -> float:
        """Usual interval of the source [s]."""
        return float(self._state.clock[kernel.INTERVAL])

    @property
    def counts(self) -> Counts:
        return Counts(*self._state.counts[kernel.ACCEPTED :].tolist())

    @property
    def n_clock_steps(self) -> int:
        return int(self._state.counts[kernel.CLOCK_STEPS])

    @property
    def deadline(self) -> float | None:
        """Arrival time at which a waiting grid time is given up; None if none waits."""
        due = self._deadline(self._state)
        return None if isnan(due) else due

    def flight_time(self, arrived: float, t: float) -> tuple[float, bool]:
        """Flight time of a source's time t [s], and whether that is plausible; if not, by arrival.

        Call it before the sample is pushed.
        """
        return self._flight_time(self._state, float(arrived), float(t))

    def push(self, arrived: float, sample: Sample) -> list[Sample]:
        """Add a received sample; return the grid samples settled by then, in order."""
        if sample.reason:
            self._note(int(self._state.counts[kernel.N_RECEIVED]), sample.reason)
        one = self._one
        one.arrived[0], one.t[0] = arrived, sample.t
        one.values[0, :N_CHANNELS] = sample.y
        one.values[0, N_CHANNELS:] = sample.attitude or nan
        settled: list[Sample] = []
        about = one, lambda n: settled.extend(self._samples(n)), *self._when
        self._receive(self._receive_one, *about)
        return settled

    def advance(self, now: float) -> list[Sample]:
        """Return the grid samples settled at `now`, in order."""
        settled: list[Sample] = []
        self._advance(now, lambda n: settled.extend(self._samples(n)))
        return settled

    def receive(self, received: Arrivals) -> tuple[GridRows, Array, Flags]:
        """Add received samples all at once, and settle them up to the last arrival.

        Returns the samples on the grid, and of each received one its flight time (n,) [s] and
        whether that is plausible; if not, it is by arrival.
        """
        self._settled = _room(2 * len(received.t) + ROOM)
        parts, n = [], len(received.t)
        flight_t, dated = np.empty(n), np.empty(n, bool)
        about = received, lambda n: parts.append(self._part(n)), flight_t, dated
        self._receive(kernel.receive, *about)
        return joined(parts), flight_t, dated

    def settle(self, now: float) -> GridRows:
        """The samples that are settled at `now`, all at once."""
        parts: list[GridRows] = []
        self._advance(now, lambda n: parts.append(self._part(n)))
        return joined(parts)

    def _receive(
        self,
        receive: Callable[..., tuple[int, int, int]],
        received: Arrivals,
        add: Callable[[int], object],
        flight_t: Array,
        dated: Flags,
    ) -> None:
        first, n = 0, len(received.t)
        while first < n:
            first, n_settled, room = receive(
                self._state, self._settled, *received, first, flight_t, dated
            )
            if n_settled:
                add(n_settled)
            if room < 0:
                self._grow()
            elif room > len(self._settled.t):
                self._settled = _room(2 * room)

    def _advance(self, now: float, add: Callable[[int], object]) -> None:
        more = True
        while more:
            n_settled, more = self._advance_to(self._state, self._settled, float(now))
            if n_settled:
                add(n_settled)

    def _grow(self) -> None:
        """Double the room of the waiting rows."""
        old = self._state
        rows = _rows(2 * len(old.t))
        for before, after in zip((old.t, old.arrived, old.number, old.values), rows, strict=True):
            after[: len(before)] = before
        t, arrived, number, values = rows
        self._state = old._replace(t=t, arrived=arrived, number=number, values=values)

    def _samples(self, n: int) -> list[Sample]:
        settled = self._settled
        return [
            Sample(t, y, _angles(values[N_CHANNELS:].tolist()), self._reason(k, number))
            for k, (t, number) in enumerate(
                zip(settled.t[:n].tolist(), settled.number[:n].tolist(), strict=True)
            )
            for values in (settled.values[k].copy(),)
            for y in (values[:N_CHANNELS],)
        ]

    def _part(self, n: int) -> GridRows:
        """A copy of the settled samples."""
        settled = self._settled
        faulty = np.flatnonzero(settled.fault[:n])
        reasons = {k: self._reason(k, MADE) for k in faulty.tolist()}
        return GridRows(
            settled.t[:n].copy(), settled.shown[:n].copy(), settled.values[:n].copy(), reasons
        )

    def _reason(self, k: int, number: int) -> str:
        """Why settled sample k is unknown; empty if it is known."""
        fault = int(self._settled.fault[k])
        if not fault:
            return self._reasons.get(number, "") if self._reasons else ""
        interval, n_late, n = self._settled.about[k].tolist()
        if fault == kernel.TOO_MANY_LATE:
            return (
                f"{n_late:.0f} of the last {n:.0f} samples came too late to be used, when later "
                f"ones had been waited for {self.delay:.4g} s: mend the link, or start with a "
                "longer delay"
            )
        return (
            f"the source samples each {interval:.4g} s, the monitor needs a sample each "
            f"{self.dt:.4g} s: send at {1.0 / self.dt:.4g} Hz"
        )

    def _note(self, number: int, reason: str) -> None:
        self._reasons[number] = reason
        if len(self._reasons) > MOST_REASONS:
            del self._reasons[next(iter(self._reasons))]


MADE = kernel.MADE


def _angles(angles: list[float]) -> Angles | None:
    phi, theta, psi = angles
    return (phi, theta, psi) if isfinite(phi) and isfinite(theta) else None


def _rows(n: int) -> tuple[Array, Array, Indices, Array]:
    return np.empty(n), np.empty(n), np.empty(n, np.int64), np.empty((n, N_VALUES))


def _room(n: int) -> Settled:
    return Settled(
        np.empty(n),
        np.empty(n),
        np.empty((n, N_VALUES)),
        np.empty(n, np.int64),
        np.empty(n, np.int64),
        np.empty((n, 3)),
    )


def joined(parts: list[GridRows]) -> GridRows:
    """The samples of several parts, in order."""
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return GridRows(np.empty(0), np.empty(0), np.empty((0, N_VALUES)), {})
    starts = np.cumsum([0, *(len(part.t) for part in parts)]).tolist()
    reasons = {
        start + k: reason
        for start, part in zip(starts, parts, strict=False)
        for k, reason in part.reasons.items()
    }
    t, shown, values = (
        np.concatenate([getattr(part, name) for part in parts]) for name in GridRows._fields[:3]
    )
    return GridRows(t, shown, values, reasons)
