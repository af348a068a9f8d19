"""The range of a signal, and its unit by its magnitude: a sideslip of up to 8 is in degrees.

Each target has a usual peak, with lognormal scatter over aircraft and manoeuvres. The likelihood of
a unit is that of the resulting peak, times how common the unit is. An implausible peak excludes it.
"""

from dataclasses import dataclass
from math import exp, log

import numpy as np

from app.telemetry.contents import release
from app.telemetry.targets import TARGETS
from app.telemetry.units import choices, factor
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


@dataclass(frozen=True)
class Magnitude:
    """Usual peak of a target in its unit, factor of its scatter, and largest plausible peak.

    floor: least plausible value, for quantities that are never negative.
    seldom: larger peaks are rare; a person should check the unit.
    """

    usual: float
    scatter: float
    most: float
    floor: float = -float("inf")
    seldom: float = float("inf")


SURFACE = Magnitude(0.13, 3.5, 1.6, seldom=0.8)
QUATERNION = Magnitude(1.0, 3.0, 1.01)
MAGNITUDES: dict[str, Magnitude] = {
    "beta": Magnitude(0.07, 3.0, 1.6),
    "p": Magnitude(0.35, 3.0, 15.0),
    "r": Magnitude(0.12, 3.0, 12.0),
    "Ny": Magnitude(0.17, 3.0, 6.0),
    "delta_a": SURFACE,
    "delta_r": SURFACE,
    "phi": Magnitude(0.5, 3.0, 25.0),
    "theta": Magnitude(0.15, 3.0, 1.6),
    "psi": Magnitude(2.0, 4.0, 70.0),
    "V": Magnitude(110.0, 1.9, 1200.0, -20.0),
    "h": Magnitude(3000.0, 3.5, 40000.0, -1000.0),
    "v": Magnitude(6.0, 3.5, 300.0),
    "Ay": Magnitude(0.3, 3.0, 6.0),
    **dict.fromkeys(("delta_a_left", "delta_a_right", "delta_r_left", "delta_r_right"), SURFACE),
    **dict.fromkeys(("q0", "q1", "q2", "q3"), QUATERNION),
}
COMMON: dict[str, dict[str, float]] = {
    "rad": {"rad": 0.485, "deg": 0.485, "cdeg": 0.03},
    "rad/s": {"rad/s": 0.5, "deg/s": 0.5},
    "g": {"g": 0.6, "m/s^2": 0.35, "ft/s^2": 0.05},
    "m/s": {"m/s": 0.45, "kt": 0.4, "ft/s": 0.1, "km/h": 0.05},
    "m": {"m": 0.5, "ft": 0.5},
    "1": {"1": 1.0},
}
"""By unit of the target: possible units and how common they are, if the file gives none."""
RULED_OUT = 1e-6
LEAST_LIKELY = 1e-4


def likelihood(key: str, extent: Extent, per_unit: float) -> float:
    """Likelihood of the peak, 0 to 1. per_unit: one unit of the signal, in the target's unit."""
    magnitude = MAGNITUDES[key]
    if extent.peak * per_unit > magnitude.most or extent.middle * per_unit < magnitude.floor:
        return RULED_OUT
    if not extent.peak:
        return 1.0  # all zero: no information
    deviation = log(extent.peak * per_unit / magnitude.usual) / log(magnitude.scatter)
    return max(exp(-0.5 * deviation * deviation), LEAST_LIKELY)


def unit_weights(
    key: str, extent: Extent, common: dict[str, float] | None = None
) -> dict[str, float]:
    """Unit -> likelihood times how common it is, not normalised."""
    target = TARGETS[key].unit
    return {
        unit: share * likelihood(key, extent, factor(unit, target))
        for unit, share in (common or COMMON[target]).items()
    }


def is_seldom(key: str, extent: Extent, unit: str) -> bool:
    """Whether the peak is plausible in this unit, but rare."""
    return extent.peak * factor(unit, TARGETS[key].unit) > MAGNITUDES[key].seldom


def unit_is_plausible(key: str, extent: Extent, unit: str) -> bool:
    return likelihood(key, extent, factor(unit, TARGETS[key].unit)) > RULED_OUT


def plausible_units(key: str, extent: Extent) -> list[str]:
    """Units in which the values are plausible, the likeliest first."""
    target = TARGETS[key].unit
    weights = {
        unit: likelihood(key, extent, factor(unit, target)) * COMMON[target].get(unit, 0.02)
        for unit in choices(target)
    }
    fitting = [unit for unit, weight in weights.items() if weight > RULED_OUT]
    return sorted(fitting, key=lambda unit: -weights[unit])
