"""Segments of a channel between gaps, and the rows of a grid within each."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.telemetry.resampling.low_pass import low_passed
from app.telemetry.traces import GAP_RATIO
from core.types import Array, Indices

EVEN = 2e-4
"""A clock is even if its times deviate by less than this share of its step; the error of a sine in
the pass band is then at most 0.05 %. On other clocks samples keep their recorded times."""
CLOSE = 0.3
"""Share of the usual step: closer samples would make a cubic overshoot, so a line is used."""
BLOCK = 1 << 14
"""Rows at once, so that data stay in the cache."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Times start + k dt [s], 0 <= k < n.

    tolerance: closer times are equal [s]. A clock with a large origin (seconds since 1970) has a
    resolution of 2.4e-7 s.
    """

    start: float
    dt: float
    n: int
    tolerance: float

    @cached_property
    def t(self) -> Array:
        """(n,) [s]."""
        return self.start + self.dt * np.arange(self.n, dtype=np.float64)

    def within(self, first: float, last: float) -> tuple[int, int]:
        """Begin and end (exclusive) of the rows in an interval [s]."""
        begin = np.ceil((first - self.tolerance - self.start) / self.dt)
        end = np.floor((last + self.tolerance - self.start) / self.dt) + 1
        return max(0, int(begin)), max(0, min(self.n, int(end)))


@dataclass(frozen=True, eq=False)
class GapFreeRun:
    """Samples begin to end (exclusive) without a gap; rows first to last (exclusive) among them.

    index: position of each sample on an even clock of `step` [s]; None if the clock is uneven.
    """

    begin: int
    end: int
    first: int
    last: int
    step: float
    index: Indices | None


@dataclass(frozen=True, eq=False)
class ResamplingPlan:
    """Plan to resample from one clock to a grid, for channels with a value at every time.

    t: (n,) [s] increasing.   step: the median one.   limit: longer steps are gaps [s].
    gaps: lengths of the gaps [s].   bridged: samples lost in shorter holes.
    """

    t: Array
    grid: Grid
    step: float
    limit: float
    gaps: Array
    bridged: int
    segments: tuple[GapFreeRun, ...]

    @property
    def even(self) -> bool:
        """Whether each segment of more than three samples has an even clock."""
        return all(s.index is not None for s in self.segments if s.end - s.begin > 3)

    def rows(self, x: Array) -> Array:
        """(grid.n,) from finite values (n,) on this clock; NaN in gaps and outside."""
        rows = np.full(self.grid.n, np.nan)
        for s in self.segments:
            part = _even_rows if s.index is not None else _uneven_rows
            rows[s.first : s.last] = part(s, self.t[s.begin : s.end], x[s.begin : s.end], self.grid)
        return rows


def resampling_plan(t: Array, grid: Grid) -> ResamplingPlan:
    """Split a clock into segments at its gaps. t: (n >= 1,) increasing [s]."""
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) else grid.dt
    limit = GAP_RATIO * max(grid.dt, step) + grid.tolerance
    breaks = np.flatnonzero(steps > limit)
    segments = []
    bridged = 0
    for begin, end in zip([0, *(breaks + 1)], [*(breaks + 1), len(t)], strict=True):
        first, last = grid.within(t[begin], t[end - 1])
        if first < last:
            usual, index = _even_clock(t[begin:end], steps[begin : end - 1], step, grid.tolerance)
            segments.append(GapFreeRun(int(begin), int(end), first, last, usual, index))
        bridged += int(np.rint(steps[begin : end - 1] / step - 1.0).clip(0.0).sum())
    return ResamplingPlan(t, grid, step, limit, steps[breaks], bridged, tuple(segments))


def _even_clock(
    t: Array, steps: Array, step: float, tolerance: float
) -> tuple[float, Indices | None]:
    """Usual step of a segment, and the position of each sample if its clock is even."""
    if len(t) < 4:
        return step, None
    regular = steps <= GAP_RATIO * step
    duration = t[-1] - t[0]
    n = round(duration / float(steps.mean(where=regular))) if regular.any() else len(steps)
    usual = duration / n
    place = (t - t[0]) / usual
    index = np.arange(len(t)) if n == len(steps) else np.rint(place).astype(np.intp)
    if np.abs(place - index).max() * usual > EVEN * usual + tolerance:
        return usual, None
    return usual, index


def _even_rows(s: GapFreeRun, t: Array, x: Array, grid: Grid) -> Array:
    """Filtered to the slower rate; a row on a sample keeps it, unless the grid is slower."""
    assert s.index is not None
    n = int(s.index[-1]) + 1
    if n > len(x):
        full = np.full(n, np.nan)
        full[s.index] = x
        lost = np.flatnonzero(np.isnan(full))
        full[lost] = interpolated(s.index.astype(np.float64), x, lost.astype(np.float64), 1.0)
        x = full
    stride = grid.dt / s.step
    first = (grid.start - t[0] + s.first * grid.dt) / s.step
    rows = low_passed(x, first, stride, s.last - s.first)
    if grid.dt <= s.step + grid.tolerance:
        place = first + stride * np.arange(len(rows))
        near = np.clip(np.rint(place), 0, n - 1)
        on = np.abs(place - near) * s.step <= grid.tolerance
        rows[on] = x[near[on].astype(np.intp)]
    return rows


def _uneven_rows(s: GapFreeRun, t: Array, x: Array, grid: Grid) -> Array:
    """Cubics between samples; for a slower grid onto a finer one first, which is filtered."""
    if len(t) == 1:
        return np.full(s.last - s.first, x[0])
    finer = int(np.ceil(grid.dt / s.step - 1e-3)) if len(t) > 3 else 1
    if finer < 2:
        at = np.clip(grid.t[s.first : s.last], t[0], t[-1])
        near = np.clip(np.searchsorted(t, at - grid.tolerance), 0, len(t) - 1)
        at = np.where(np.abs(t[near] - at) <= grid.tolerance, t[near], at)
        return interpolated(t, x, at, s.step)
    begin = int(np.ceil((t[0] - grid.tolerance - grid.start) / grid.dt * finer))
    end = int(np.floor((t[-1] + grid.tolerance - grid.start) / grid.dt * finer)) + 1
    at = grid.start + grid.dt / finer * np.arange(begin, end, dtype=np.float64)
    fine = interpolated(t, x, np.clip(at, t[0], t[-1]), s.step)
    if len(fine) < 2:
        return fine
    return low_passed(fine, s.first * finer - begin, finer, s.last - s.first)


def interpolated(t: Array, x: Array, at: Array, step: float) -> Array:
    """Values at times within t[0] ... t[-1]; on a sample, that sample bit for bit.

    t: (n >= 2,) increasing, without gaps.   x: (n,) finite.   step: the usual one.
    The first and last step use the cubic through the four end samples. Straight lines are used for
    fewer than four samples, and if two of the four are CLOSE.
    """
    rows = np.empty(len(at))
    close = np.diff(t) < CLOSE * step
    close = close[:-2] | close[1:-1] | close[2:]
    for begin in range(0, len(at), BLOCK):
        part = at[begin : begin + BLOCK]
        after = np.clip(np.searchsorted(t, part), 1, len(t) - 1)
        if len(t) < 4:
            rows[begin : begin + BLOCK] = _line(t, x, part, after)
            continue
        start = np.clip(after - 2, 0, len(t) - 4)
        cubic = _cubic(t, x, part, start)
        if (line := close[start]).any():
            cubic[line] = _line(t, x, part[line], after[line])
        rows[begin : begin + BLOCK] = cubic
    return rows


def _cubic(t: Array, x: Array, at: Array, start: Indices) -> Array:
    """Lagrange's polynomial through the samples start ... start + 3."""
    nodes = [t[start + k] for k in range(4)]
    away = [at - node for node in nodes]
    rows = np.zeros(len(at))
    for k, node in enumerate(nodes):
        a, b, c = (other for other in range(4) if other != k)
        below = (node - nodes[a]) * (node - nodes[b]) * (node - nodes[c])
        rows += away[a] * away[b] * away[c] / below * x[start + k]
    return rows


def _line(t: Array, x: Array, at: Array, after: Indices) -> Array:
    before = after - 1
    share = (at - t[before]) / (t[after] - t[before])
    rows = x[before] + share * (x[after] - x[before])
    return np.where(share == 1.0, x[after], rows)
