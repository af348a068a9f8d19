"""Received samples on the grid of the monitor, by those received so far.

The result depends only on the samples and their arrival times, so the same arrivals give the same
bits later: from a flight's journal, or from a recording, all at once.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import isnan, nan
from typing import NamedTuple

import numpy as np

from app.telemetry.recording import ATTITUDE
from core.channels import LATERAL
from core.kernels import causal_grid as kernel
from core.kernels.causal_grid import GridState
from core.kernels.compiled import entry
from core.types import Array, Indices

Angles = tuple[float, float, float]
"""Bank, pitch and heading [rad]; NaN where unknown."""
UNKNOWN: Angles = nan, nan, nan


class IntegratedAngles(NamedTuple):
    """Angles [rad] of which at least one is not measured but integrated from rates."""

    phi: float
    theta: float
    psi: float


DELAY_INTERVALS = 1.5
"""Longest wait for a sample by default, in intervals of the monitor."""
WAITING, ROOM = 512, 64
"""Room for rows that wait and for samples settled at once; it grows where that is not enough."""
MOST_REASONS = 1024
OUT_OF_ORDER = 0.25
"""Share of samples out of order from which the steps between the others are no sample rate."""


class Sample(NamedTuple):
    """One sample. t: [s].   y: (n_channels,), NaN where unknown.   attitude: phi, theta, psi [rad],
    NaN where unknown.

    reason: why it is unknown; empty if known.   condition: values of CONDITION_KEYS sent with it,
    NaN if unknown, None if not sent; None for no condition.   shown: arrival time at which it was
    settled [s], on the grid.   sent: y with the values that are missing because no aircraft can
    reach them; None without any.
    """

    t: float
    y: Array
    attitude: Angles = UNKNOWN
    reason: str = ""
    condition: tuple[float | None, ...] | None = None
    shown: float = nan
    sent: Array | None = None


class Arrivals(NamedTuple):
    """Received samples, in order of arrival.

    arrived: (n,) [s] of any monotonic clock.   t: (n,) of the source [s].   values: (n,
    n_channels + 3) the channels, then the attitude [rad]; NaN where unknown.
    """

    arrived: Array
    t: Array
    values: Array


class GridRows(NamedTuple):
    """Samples on the grid.

    t: (n,) [s].   shown: (n,) arrival time at which each was settled [s].   values: as received.
    """

    t: Array
    shown: Array
    values: Array


@dataclass
class Counts:
    """Received samples by kind."""

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

    def __init__(self, dt: float, delay: float, n_channels: int = len(LATERAL)) -> None:
        self.dt, self.delay = dt, delay
        n_values = n_channels + len(ATTITUDE)
        self._width = kernel.SETTLED_VALUES + n_values
        clock = np.full(kernel.N_CLOCK + n_values, np.nan)
        clock[[kernel.DT, kernel.DELAY, kernel.OFFSET, kernel.INTERVAL]] = dt, delay, 0.0, dt
        clock[[kernel.NEWEST, kernel.NEWEST_ARRIVED]] = -np.inf
        self._state = GridState(
            clock,
            np.zeros(kernel.N_COUNT, np.int64),
            rows=np.empty((WAITING, kernel.VALUES + n_values)),
            steps=np.empty((2, kernel.INTERVALS)),
            recent=np.empty((kernel.REMEMBERED, 1 + n_channels)),
            late=np.empty(kernel.REMEMBERED),
        )
        self._settled = self._room(ROOM)
        self._values = np.empty(n_values)
        compiled = self._state, self._settled
        sample = 0.0, np.empty(n_channels), *UNKNOWN, self._values
        self._receive_one = entry(kernel.receive_one, *compiled, 0.0, *sample)
        self._advance_to = entry(kernel.advance, *compiled, 0.0)
        self._reasons: dict[int, str] = {}
        self.pushed_at = nan, False
        """Flight time of the sample pushed last [s], and whether the source's time is plausible;
        if it is not, the time is by arrival."""

    @property
    def interval(self) -> float:
        """Usual interval of the source [s]."""
        return float(self._state.clock[kernel.INTERVAL])

    @property
    def counts(self) -> Counts:
        return Counts(*self._state.counts[kernel.ACCEPTED :].tolist())

    @property
    def n_accepted(self) -> int:
        return self._state.counts.item(kernel.ACCEPTED)

    @property
    def n_clock_steps(self) -> int:
        return self._state.counts.item(kernel.CLOCK_STEPS)

    @property
    def deadline(self) -> float | None:
        """Arrival time at which a waiting grid time is given up; None if none waits."""
        due = float(self._state.clock[kernel.DUE])
        return None if isnan(due) else due

    def push(self, arrived: float, sample: Sample) -> list[Sample]:
        """Add a received sample; return the grid samples settled by then, in order."""
        if sample.reason:
            self._note(int(self._state.counts[kernel.N_RECEIVED]), sample.reason)
        received = sample.t, np.ascontiguousarray(sample.y), *sample.attitude, self._values
        settled = list[Sample]()
        while True:
            n_settled, room, t, is_plausible = self._receive_one(
                self._state, self._settled, arrived, *received
            )
            if n_settled:
                settled += self._samples(n_settled)
            if not room:
                self.pushed_at = t, is_plausible > 0.0
                return settled
            self._make_room(room)

    def advance(self, now: float) -> list[Sample]:
        """Return the grid samples settled at `now`, in order."""
        return [sample for n in self._settle(now) for sample in self._samples(n)]

    def receive(self, received: Arrivals) -> tuple[GridRows, Array]:
        """Add received samples all at once, and settle them up to the last arrival.

        Returns the samples on the grid, and the flight time of each received one (n,) [s].
        """
        self._settled = self._room(2 * len(received.t) + ROOM)
        flight_t = np.empty((len(received.t), 2))
        # a read-only array compiles the kernel again
        writable = Arrivals(*(np.require(part, requirements="W") for part in received))
        added = self._add(writable, flight_t)
        return joined([self._part(n) for n in added] or [self._part(0)]), flight_t[:, 0]

    def settle(self, now: float) -> GridRows:
        """The samples that are settled at `now`, all at once."""
        return joined([self._part(n) for n in self._settle(now)] or [self._part(0)])

    def _add(self, received: Arrivals, flight_t: Array) -> Iterator[int]:
        """Add samples; yield how many are settled, each time that there are some."""
        first, n = 0, len(received.t)
        while first < n:
            first, n_settled, room = kernel.receive(
                self._state, self._settled, *received, first, flight_t
            )
            if n_settled:
                yield n_settled
            self._make_room(room)

    def _settle(self, now: float) -> Iterator[int]:
        more = True
        while more:
            n_settled, more = self._advance_to(self._state, self._settled, float(now))
            if n_settled:
                yield n_settled

    def _room(self, n: int) -> Array:
        return np.empty((n, self._width))

    def _make_room(self, room: int) -> None:
        """Make room for settled samples; below 0, double that of the waiting rows."""
        if room < 0:
            old = self._state.rows
            rows = np.empty((2 * len(old), old.shape[1]))
            rows[: len(old)] = old
            self._state = self._state._replace(rows=rows)
        elif room > len(self._settled):
            self._settled = self._room(2 * room)

    def _samples(self, n: int) -> list[Sample]:
        settled = self._settled[:n]
        channels = settled[:, kernel.SETTLED_VALUES : -len(ATTITUDE)].copy()
        return [
            Sample(
                row[kernel.T],
                y,
                (row[-3], row[-2], row[-1]),
                self._reason(row) if row[kernel.FAULT] or self._reasons else "",
                None,
                row[kernel.SHOWN],
            )
            for row, y in zip(settled.tolist(), channels, strict=True)
        ]

    def _part(self, n: int) -> GridRows:
        """The settled samples; the next ones are settled in another array."""
        settled, self._settled = self._settled[:n], self._room(ROOM)
        values = settled[:, kernel.SETTLED_VALUES :]
        return GridRows(settled[:, kernel.T], settled[:, kernel.SHOWN], values)

    def _reason(self, row: list[float]) -> str:
        """Why a settled sample is unknown; empty if it is known."""
        number, fault, interval, n_late, n = row[kernel.NUMBER : kernel.SETTLED_VALUES]
        if fault == kernel.FINE:
            return self._reasons.get(int(number), "")
        if fault == kernel.TOO_MANY_LATE:
            return (
                f"{n_late:.0f} of the last {n:.0f} samples came too late to be used, when later "
                f"ones had been waited for {self.delay:.4g} s: mend the link, or start with a "
                "longer delay"
            )
        counts = self.counts
        if OUT_OF_ORDER * counts.accepted <= counts.out_of_order:
            return (
                f"{counts.out_of_order} of {counts.accepted} samples came after a later one: send "
                "them in order"
            )
        return (
            f"the source samples each {interval:.4g} s, the monitor needs a sample each "
            f"{self.dt:.4g} s: send at {1.0 / self.dt:.4g} Hz"
        )

    def _note(self, number: int, reason: str) -> None:
        self._reasons[number] = reason
        if len(self._reasons) > MOST_REASONS:
            del self._reasons[next(iter(self._reasons))]


def joined(parts: list[GridRows]) -> GridRows:
    """The samples of several parts, in order; one or more."""
    return parts[0] if len(parts) == 1 else GridRows(*map(np.concatenate, zip(*parts, strict=True)))


def missing_after(t: Array, dt: float) -> Indices:
    """Times without a sample after each sample of the grid. t: (n,) [s].   dt: [s]."""
    steps = np.diff(t, append=t[-1]) / dt
    return np.where(steps > kernel.GAP_RATIO, np.rint(steps) - 1.0, 0.0).astype(np.int64)
