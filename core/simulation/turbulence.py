"""Lateral gusts by altitude and airspeed, in the forms of MIL-F-8785C and MIL-HDBK-1797."""

from math import sqrt
from typing import Literal, NamedTuple

import numpy as np

from core.kernels.compiled import in_chunks
from core.kernels.imperfections import IWORK, QUANTILES, fill_gusts, gusts_work
from core.kernels.lanes import aligned
from core.types import Array

Turbulence = Literal["none", "smooth", "light", "moderate", "severe", "given"]

FOOT, KNOT = 0.3048, 0.514444
SMOOTH = 0.3
"""Intensity [m/s] of usual test air, about 1 ft/s: a tenth of the specification's light turbulence
near the ground, and far below the eddy dissipation rate of 0.1 m^(2/3)/s that is still smooth (ICAO
Annex 3)."""
WIND_AT_20_FT = {"light": 15 * KNOT, "moderate": 30 * KNOT, "severe": 45 * KNOT}
"""[m/s] W_20 of the classes of low-altitude turbulence (MIL-F-8785C, 3.7.3)."""
LOW, HIGH = 1000.0, 2000.0
"""[ft] Low-altitude form below the first, high-altitude form above the second, linear between."""
LOWEST = 10.0
"""[ft] Lowest height of the low-altitude form."""
SCALE_HIGH = 1750.0
"""[ft] L_v of MIL-F-8785C. MIL-HDBK-1797 uses half of it, with 2 L_v in the spectrum."""
ALTITUDES = (2000.0, 3750.0, 7500.0, 15e3, 25e3, 35e3, 45e3, 55e3, 65e3, 75e3, 80e3)
"""[ft] of INTENSITY_HIGH."""
INTENSITY_HIGH = {
    "light": (6.96, 7.4, 6.7, 4.6, 2.7, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    "moderate": (9.73, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0.0, 0.0, 0.0),
    "severe": (18.28, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1),
}
"""[ft/s] exceeded with probability 1e-2, 1e-3 and 1e-5 (MIL-F-8785C, figure 7)."""
CHUNK = 512
"""Gusts that a thread processes at a time."""


class LateralGust(NamedTuple):
    """sigma: 1 sigma of the gust, in m/s or, as sideslip, rad.   time_constant: L_v / V [s]."""

    sigma: float
    time_constant: float


def intensity(turbulence: Turbulence, altitude: float) -> float:
    """sigma_v [m/s] at an altitude [m]; below 1000 ft, height above ground."""
    if turbulence not in WIND_AT_20_FT:
        return SMOOTH if turbulence == "smooth" else 0.0
    feet = max(altitude / FOOT, LOWEST)
    near_ground = 0.1 * WIND_AT_20_FT[turbulence] / _roughness(min(feet, LOW)) ** 0.4
    high = FOOT * float(np.interp(feet, ALTITUDES, INTENSITY_HIGH[turbulence]))
    return float(np.interp(feet, (LOW, HIGH), (near_ground, high)))


def scale_length(altitude: float) -> float:
    """L_v [m] at an altitude [m]; below 1000 ft, height above ground."""
    feet = max(altitude / FOOT, LOWEST)
    low = min(feet, LOW)
    near_ground = low / _roughness(low) ** 1.2
    return FOOT * float(np.interp(feet, (LOW, HIGH), (near_ground, SCALE_HIGH)))


def _roughness(feet: float) -> float:
    return 0.177 + 0.000823 * feet


def sideslip_gusts(
    gust: LateralGust, step: float, n: int, n_samples: int, seed: np.uint64, number: int = 0
) -> Array:
    """Draw gusts (n, n_samples), each `step` s, with the autocovariance of Dryden's lateral form.

    number: of the first of these gusts among all of the seed.

    sigma^2 (1 - t / 2T) exp(-t / T), whose spectrum over angular frequency w is
    sigma^2 (T / pi) (1 + 3 (T w)^2) / (1 + (T w)^2)^2, one-sided.
    """
    from scipy.special import gammainc  # slow to import, and only needed here

    steps = step / gust.time_constant
    a = gust.sigma**2 * (0.5 * -np.expm1(-2 * steps))
    ab = gust.sigma**2 * gammainc(2, 2 * steps) / 4
    b = gust.sigma**2 * gammainc(3, 2 * steps) / 4
    out = np.empty((n, n_samples))

    def fill(first: int, last: int) -> None:
        fill_gusts(
            seed,
            number,
            np.exp(-steps),
            steps,
            gust.sigma * _triangle(0.5, 0.25, 0.25),
            _triangle(a, ab, b),
            QUANTILES,
            aligned(gusts_work(n_samples)),
            np.empty(IWORK, np.int64),
            out,
            first,
            last,
        )

    in_chunks(n, CHUNK, fill)
    return out


def _triangle(a: float, ab: float, b: float) -> Array:
    """Lower triangle (11, 21, 22) of the square root of a covariance."""
    first = sqrt(a)
    return np.array([first, ab / first, sqrt(b - ab * ab / a)])
