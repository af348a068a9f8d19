"""Resamples received samples to the monitor's times, using only those received by then.

The result depends only on the samples and their arrival times: resampling the same arrivals later
gives the same bits.
"""

from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import asdict, dataclass
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from app.telemetry.resampling.resampling import RATE_RATIO
from app.telemetry.traces import GAP_RATIO
from core.channels import N_CHANNELS
from core.types import Array

Angles = tuple[float, float, float]
ON_GRID = 1e-6
"""Part of an interval: a sample this close to a grid time is used as it is, bit for bit."""
DELAY_INTERVALS = 1.5
"""Longest wait for a sample by default, in intervals of the monitor."""
FASTER = 0.75
"""Part of the monitor's interval: a faster source is averaged over two intervals."""
STEP_S = 1.0
"""A source time that runs further ahead of its arrival is a clock step [s]."""
BACK_S, BACK_SAMPLES = 0.25, 3
"""After this time [s] and this many samples with only old or repeated times, the source has set its
clock back."""
INTERVALS, FEW_INTERVALS, REMEMBERED = 15, 3, 256
"""Source intervals that give its rate; fewer ones cannot make it slow; times remembered."""
UNKNOWN = np.full(N_CHANNELS, np.nan)


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


class CausalResampler:
    """Puts received samples, given to `push`, on the grid of the monitor.

    dt: of the monitor [s].   delay: longest wait of a grid time for samples, from when it was
    measured [s]. Arrivals are seconds of any monotonic clock.

    A sample on the grid passes bit for bit as soon as it arrives, and the grid follows it. A source
    with an interval below FASTER dt is averaged over dt to either side with Hann's weights and a
    local line, against aliasing; a slower one is interpolated linearly. Neighbours more than
    GAP_RATIO steps apart (of source or grid, whichever is longer) have a gap between them, which is
    never bridged: it waits for `delay`, then the grid restarts with the first sample after it. A
    source slower than RATE_RATIO dt gives unknown samples, with a reason.
    """

    def __init__(self, dt: float, delay: float) -> None:
        self.dt, self.delay, self.counts = dt, delay, Counts()
        self._rows: list[tuple[float, float, Sample]] = []
        self._grid: float | None = None
        self._newest = self._newest_arrived = -np.inf
        self._offset = 0.0
        self._steps: deque[float] = deque(maxlen=INTERVALS)
        self._interval = dt
        self._late: deque[float] = deque(maxlen=REMEMBERED)
        self._recent: deque[tuple[float, Array]] = deque(maxlen=REMEMBERED)
        self._leap: tuple[float, Sample] | None = None
        self._back: tuple[float, float, int] | None = None

    @property
    def interval(self) -> float:
        return self._interval

    @property
    def deadline(self) -> float | None:
        """Arrival time at which a waiting grid time is given up; None if none waits."""
        if self._grid is None or not self._came_up_to(self._grid):
            return None
        return self._deadline(self._grid, self._following(self._grid))

    def push(self, arrived: float, sample: Sample) -> list[Sample]:
        settled = self.advance(arrived)
        for when, accepted in self._in_time(arrived, sample):
            settled += self._accept(when, accepted)
        return settled

    def advance(self, now: float) -> list[Sample]:
        """Return the grid samples settled at `now`, in order."""
        settled: list[Sample] = []
        while (grid := self._grid) is not None and self._came_up_to(grid):
            if not self._settle(grid, now, settled):
                break
        return settled

    def flight_time(self, arrived: float, t: float) -> tuple[float, bool]:
        """Flight time of a source's time t [s], and whether that is plausible; if not, by arrival.

        Call it before the sample is pushed.
        """
        t += self._offset
        expected = self._newest + arrived - self._newest_arrived
        if self._grid is None or t <= expected + STEP_S:
            return t, True
        return expected, False

    # --- the source's clock -------------------------------------------------------------------

    def _in_time(self, arrived: float, sample: Sample) -> list[tuple[float, Sample]]:
        """Samples to use now, on the flight's clock: this one, none, or also a held one."""
        t = sample.t + self._offset
        if self._grid is None:
            return [(arrived, sample)]
        if (known := self._y_at(t)) is not None:
            if np.array_equal(known, sample.y, equal_nan=True):
                self.counts.repeated += 1
                return []
            return self._went_back(arrived, sample)
        if t - self._newest > arrived - self._newest_arrived + STEP_S:
            return self._leapt(arrived, sample)
        if t <= self._grid - self.dt:
            return self._went_back(arrived, sample)
        self._drop_leap()
        self._back = None
        is_as_sent = self._offset == 0.0 and t != 0.0
        return [(arrived, sample if is_as_sent else sample._replace(t=t))]

    def _y_at(self, t: float) -> Array | None:
        """Values of a recent sample with this time; None if there is none."""
        if t > self._newest:
            return None
        return next((y for known, y in reversed(self._recent) if known == t), None)

    def _leapt(self, arrived: float, sample: Sample) -> list[tuple[float, Sample]]:
        """A time far ahead is accepted once the next sample follows it."""
        held, self._leap = self._leap, (arrived, sample)
        if held is None:
            return []
        if not 0.0 < sample.t - held[1].t < STEP_S:
            self.counts.implausible_times += 1
            return []
        self._leap = None
        self._step(*held)
        return [
            (when, early._replace(t=early.t + self._offset))
            for when, early in (held, (arrived, sample))
        ]

    def _drop_leap(self) -> None:
        if self._leap is not None:
            self._leap = None
            self.counts.implausible_times += 1

    def _went_back(self, arrived: float, sample: Sample) -> list[tuple[float, Sample]]:
        """A past time is late, unless the source sends only such times: then its clock stepped."""
        begun, last, n = self._back or (arrived, -np.inf, 0)
        if sample.t <= last:
            begun, n = arrived, 0
        self._back = begun, sample.t, n + 1
        if n + 1 < BACK_SAMPLES or arrived - begun < BACK_S:
            self.counts.late += 1
            self._late.append(sample.t + self._offset)
            return []
        self._back = None
        self._step(arrived, sample)
        return [(arrived, sample._replace(t=sample.t + self._offset))]

    def _step(self, arrived: float, sample: Sample) -> None:
        """After a step of the source's clock, time continues by arrival times after a gap."""
        self.counts.clock_steps += 1
        passed = max(arrived - self._newest_arrived, 2.0 * self.dt)
        self._offset = self._newest + passed - sample.t
        self._grid = self._newest + passed
        self._rows.clear()
        self._recent.clear()
        self._steps.clear()
        self._late.clear()

    # --- the grid -----------------------------------------------------------------------------

    def _accept(self, arrived: float, sample: Sample) -> list[Sample]:
        t = sample.t
        self.counts.accepted += 1
        self._recent.append((t, sample.y))
        if self._grid is None:
            self._grid = t
        if t < self._newest:
            self.counts.out_of_order += 1
        else:
            if isfinite(self._newest):
                self._steps.append(t - self._newest)
                self._interval = sorted(self._steps)[(len(self._steps) - 1) // 2]
                if len(self._steps) < FEW_INTERVALS:
                    self._interval = min(self._interval, self.dt)
            self._newest, self._newest_arrived = t, arrived
        self._rows.insert(bisect_right(self._rows, (t, inf)), (t, arrived, sample))
        return self.advance(arrived)

    def _settle(self, grid: float, now: float, settled: list[Sample]) -> bool:
        """Settle one grid time that samples have reached, if possible. Returns whether it was."""
        following = self._following(grid)
        t, _, sample = self._rows[following]
        if self._interval <= FASTER * self.dt and not self._begins(following):
            is_early = self._newest < grid + self.dt - self._interval
            if is_early and now < self._deadline(grid, following):
                return False
            known = self._average(grid, following)
        elif abs(t - grid) <= ON_GRID * self.dt:
            known = sample
        else:
            known = self._between(grid, following)
        if known is None:
            if now < self._deadline(grid, following):
                return False
            self.counts.missing += max(1, round((t - grid) / self.dt))
            self._grid = t
            del self._rows[:following]
            return True
        slow = self._interval > RATE_RATIO * self.dt
        settled.append(known._replace(y=UNKNOWN, reason=self._too_few()) if slow else known)
        self._grid = known.t + self.dt
        if len(self._rows) > 1:
            del self._rows[: max(0, bisect_left(self._rows, (known.t - self.dt,)) - 1)]
        return True

    def _begins(self, following: int) -> bool:
        """Whether this row is the first one, at the start or after a gap."""
        return following == 0

    def _average(self, grid: float, following: int) -> Sample | None:
        """Hann's average with a local line; None across a gap."""
        first = bisect_left(self._rows, (grid - self.dt,))
        stop = bisect_left(self._rows, (grid + self.dt,))
        if not first < following < stop:
            return self._between(grid, following)
        after, before = self._rows[following], self._rows[following - 1]
        if after[0] - before[0] > GAP_RATIO * self.dt:
            return None
        rows = self._rows[first:stop]
        nearest = after if after[0] - grid < grid - before[0] else before
        tau = np.array([row[0] for row in rows]) - grid
        y = np.array([row[2].y for row in rows])
        weights = 1.0 + np.cos(np.pi * tau / self.dt)
        return Sample(grid, _local_line(weights, tau, y), nearest[2].attitude)

    def _between(self, grid: float, following: int) -> Sample | None:
        """Interpolated between two neighbours; None across a gap or if they came too late."""
        t, _, after = self._rows[following]
        if following == 0:
            return after if abs(t - grid) <= ON_GRID * self.dt else None
        t_before, _, before = self._rows[following - 1]
        is_gap = t - t_before > GAP_RATIO * max(self._interval, self.dt)
        if is_gap or t - grid > self.delay:
            return None
        share = (grid - t_before) / (t - t_before)
        y = before.y + share * (after.y - before.y)
        return Sample(grid, y, (after if share > 0.5 else before).attitude)

    def _came_up_to(self, grid: float) -> bool:
        """Whether a sample at or after a grid time was received."""
        return bool(self._rows) and self._rows[-1][0] >= grid - ON_GRID * self.dt

    def _following(self, grid: float) -> int:
        """Number of the first row at or after a grid time."""
        return bisect_left(self._rows, (grid - ON_GRID * self.dt,))

    def _deadline(self, grid: float, following: int) -> float:
        """Arrival time at which a grid time is given up: by the first arrival of a later sample."""
        t, arrived, _ = min(self._rows[following:], key=lambda row: row[1])
        return arrived + max(0.0, self.delay - (t - grid))

    def _too_few(self) -> str:
        """Why samples are too far apart: a slow source, or too many late samples."""
        span = sum(self._steps)
        n_late = len({t for t in self._late if self._newest - span < t < self._newest})
        if span / (n := len(self._steps) + n_late) <= RATE_RATIO * self.dt:
            return (
                f"{n_late} of the last {n} samples came too late to be used, when later ones had "
                f"been waited for {self.delay:.4g} s: mend the link, or start with a longer delay"
            )
        return (
            f"the source samples each {self._interval:.4g} s, the monitor needs a sample each "
            f"{self.dt:.4g} s: send at {1.0 / self.dt:.4g} Hz"
        )


def _local_line(weights: Array, tau: Array, y: Array) -> Array:
    """(k,) value at tau = 0 of the weighted line through each column; unknown values do not count.

    weights, tau: (n,).   y: (n, k), NaN where unknown.
    """
    known = np.isfinite(y)
    w = weights[:, None] * known
    s0, s1, s2 = w.sum(axis=0), tau @ w, (tau * tau) @ w
    values = np.where(known, y, 0.0)
    sum_y, sum_ty = (w * values).sum(axis=0), tau @ (w * values)
    determinant = s0 * s2 - s1 * s1
    with np.errstate(invalid="ignore", divide="ignore"):
        line = (s2 * sum_y - s1 * sum_ty) / determinant
        mean = sum_y / s0
    even = determinant <= 1e-12 * s0 * s2
    return np.where(s0 > 0.0, np.where(even, mean, line), np.nan)
