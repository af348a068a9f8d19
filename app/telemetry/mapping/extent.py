"""The range of a signal's values, from one pass over them."""

from dataclasses import dataclass

import numpy as np

from app.telemetry.contents import release
from core.types import Array

N_TILES = 2048
OUTLIERS = 2
"""Tiles that are ignored for the peak, because spikes are not motion."""
FEW = 20
"""Fewer values cannot tell spikes from motion, or a dead channel from a still one."""


@dataclass(frozen=True, eq=False)
class Extent:
    """n: values.   n_finite: finite ones.   low, high: (n_tiles,) extremes of equal parts."""

    n: int
    n_finite: int
    low: Array
    high: Array

    @property
    def empty(self) -> bool:
        return not self.n_finite

    @property
    def still(self) -> bool:
        """Whether it never changes, over at least FEW values."""
        return self.n_finite >= FEW and self.lowest == self.highest

    @property
    def lowest(self) -> float:
        return float(np.fmin.reduce(self.low))

    @property
    def highest(self) -> float:
        return float(np.fmax.reduce(self.high))

    @property
    def peak(self) -> float:
        """Largest magnitude without single spikes; 0 if no value is finite."""
        largest = np.fmax(np.abs(self.low), np.abs(self.high))
        largest = np.sort(largest[np.isfinite(largest)])
        if not len(largest):
            return 0.0
        return float(largest[-1 - OUTLIERS] if len(largest) >= FEW else largest[-1])

    @property
    def middle(self) -> float:
        """Median over the tiles; 0 if no value is finite."""
        centre = 0.5 * (self.low + self.high)
        centre = centre[np.isfinite(centre)]
        return float(np.median(centre)) if len(centre) else 0.0


def extent_of(values: Array) -> Extent:
    """Extent of a column (n,), ignoring NaN and infinities; releases its memory."""
    column, n = values, len(values)
    values = np.asarray(column)
    if not n:
        return Extent(0, 0, np.empty(0), np.empty(0))
    starts = np.linspace(0, n, min(n, N_TILES), endpoint=False).astype(np.intp)
    finite = np.isfinite(values)
    n_finite = int(np.count_nonzero(finite))
    if np.isinf(values).any():
        values = np.where(finite, values, np.nan)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    release(column)
    return Extent(n, n_finite, low, high)
