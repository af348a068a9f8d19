"""Contiguous stretches of a channel, and the rows of a time grid that lie within each."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.telemetry.resampling.low_pass import low_passed
from app.telemetry.resampling.uneven import interpolated
from core.types import Array, Indices

GAP_RATIO = 1.5
"""Neighbours further apart than this many steps, the longer of the two, have a gap between them."""
EVEN = 2e-4
"""A clock that keeps within this share of its step is even: then a sine of the pass band is wrong
by 0.05 % at most. Others are taken at the times they give."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Times start + k dt [s], 0 <= k < n.

    tolerance: a time this close to another is the same [s]. A clock with a large origin (seconds
    since 1970) cannot tell times apart any better than by 2.4e-7 s.
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
        """Rows from the first to behind the last one in a span of time."""
        begin = np.ceil((first - self.tolerance - self.start) / self.dt)
        end = np.floor((last + self.tolerance - self.start) / self.dt) + 1
        return max(0, int(begin)), max(0, min(self.n, int(end)))


@dataclass(frozen=True, eq=False)
class Stretch:
    """Samples begin to end (exclusive) and the rows first to last (exclusive) within them.

    index: where each sample belongs on an even clock of `step` [s]; None where it is uneven.
    """

    begin: int
    end: int
    first: int
    last: int
    step: float
    index: Indices | None


@dataclass(frozen=True, eq=False)
class Course:
    """The way from one clock to a grid; every channel that is whole on this clock shares it.

    t: (n,) [s] increasing.   step: the median one.   limit: longer steps are gaps [s].
    gaps: lengths of the gaps [s].   bridged: samples lost in holes that are no gaps.
    """

    t: Array
    grid: Grid
    step: float
    limit: float
    gaps: Array
    bridged: int
    stretches: tuple[Stretch, ...]

    @property
    def even(self) -> bool:
        """Whether every stretch of some length keeps an even clock."""
        return all(s.index is not None for s in self.stretches if s.end - s.begin > 3)

    def rows(self, x: Array) -> Array:
        """(grid.n,) from finite values (n,) on this clock; NaN in gaps and outside."""
        rows = np.full(self.grid.n, np.nan)
        for s in self.stretches:
            part = _even_rows if s.index is not None else _uneven_rows
            rows[s.first : s.last] = part(s, self.t[s.begin : s.end], x[s.begin : s.end], self.grid)
        return rows


def course(t: Array, grid: Grid) -> Course:
    """Find the stretches between gaps. t: (n >= 1,) increasing."""
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) else grid.dt
    limit = GAP_RATIO * max(grid.dt, step) + grid.tolerance
    breaks = np.flatnonzero(steps > limit)
    stretches = []
    bridged = 0
    for begin, end in zip([0, *(breaks + 1)], [*(breaks + 1), len(t)], strict=True):
        first, last = grid.within(t[begin], t[end - 1])
        if first < last:
            usual, index = _clock(t[begin:end], steps[begin : end - 1], step, grid.tolerance)
            stretches.append(Stretch(int(begin), int(end), first, last, usual, index))
        bridged += int(np.rint(steps[begin : end - 1] / step - 1.0).clip(0.0).sum())
    return Course(t, grid, step, limit, steps[breaks], bridged, tuple(stretches))


def _clock(t: Array, steps: Array, step: float, tolerance: float) -> tuple[float, Indices | None]:
    """The usual step of a stretch, and each sample's place if its clock is even."""
    if len(t) < 4:
        return step, None
    whole = steps <= GAP_RATIO * step
    span = t[-1] - t[0]
    n = round(span / float(steps.mean(where=whole))) if whole.any() else len(steps)
    usual = span / n
    place = (t - t[0]) / usual
    index = np.arange(len(t)) if n == len(steps) else np.rint(place).astype(np.intp)
    if np.abs(place - index).max() * usual > EVEN * usual + tolerance:
        return usual, None
    return usual, index


def _even_rows(s: Stretch, t: Array, x: Array, grid: Grid) -> Array:
    """Filtered to the slower of the two rates; a sample where the grid is not the slower one."""
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


def _uneven_rows(s: Stretch, t: Array, x: Array, grid: Grid) -> Array:
    """Cubics between the samples; going down onto a finer grid first, which is then filtered."""
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
