"""How far a signal reaches, from one pass over its numbers: what a proposal goes by."""

from dataclasses import dataclass

import numpy as np

from core.types import Array

N_TILES = 2048
OUTLIERS = 2
"""Tiles that reach further than the peak: spikes are not motion."""
FEW = 20
"""With fewer values there is no telling spikes from motion, nor a dead channel from a still one."""


@dataclass(frozen=True, eq=False)
class Extent:
    """n: values.   known: finite ones among them.   low, high: (n_tiles,) of equal stretches."""

    n: int
    known: int
    low: Array
    high: Array

    @property
    def empty(self) -> bool:
        """Whether there is no number at all."""
        return not self.known

    @property
    def still(self) -> bool:
        """Whether there are numbers enough to say that it never changes."""
        return self.known >= FEW and self.lowest == self.highest

    @property
    def lowest(self) -> float:
        """The smallest number."""
        return float(np.fmin.reduce(self.low))

    @property
    def highest(self) -> float:
        """The largest number."""
        return float(np.fmax.reduce(self.high))

    @property
    def peak(self) -> float:
        """Magnitude that it reaches, but for single spikes; 0 where there is no number."""
        reach = np.fmax(np.abs(self.low), np.abs(self.high))
        reach = np.sort(reach[np.isfinite(reach)])
        if not len(reach):
            return 0.0
        return float(reach[-1 - OUTLIERS] if len(reach) >= FEW else reach[-1])

    @property
    def middle(self) -> float:
        """Where it mostly is: the median over the tiles; 0 where there is no number."""
        centre = 0.5 * (self.low + self.high)
        centre = centre[np.isfinite(centre)]
        return float(np.median(centre)) if len(centre) else 0.0


def extent(values: Array) -> Extent:
    """Return how far values (n,) reach; NaN and infinities are no numbers."""
    values, n = np.asarray(values), len(values)
    if not n:
        return Extent(0, 0, np.empty(0), np.empty(0))
    starts = np.linspace(0, n, min(n, N_TILES), endpoint=False).astype(np.intp)
    finite = np.isfinite(values)
    known = int(np.count_nonzero(finite))
    if np.isinf(values).any():
        values = np.where(finite, values, np.nan)
    return Extent(n, known, np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts))
