"""The standard atmosphere (ICAO Doc 7488, ISO 2533) up to 20 km."""

from math import exp, sqrt
from typing import NamedTuple

SEA_LEVEL_K, SEA_LEVEL_PA, LAPSE = 288.15, 101_325.0, 0.0065
TROPOPAUSE, GAS, GRAVITY, HEATS = 11_000.0, 287.05287, 9.80665, 1.4
HIGHEST = 20_000.0
"""[m]"""


class Air(NamedTuple):
    """density: [kg/m3].   sound: speed of sound [m/s].   thinning: relative decrease of density
    with height [1/m]."""

    density: float
    sound: float
    thinning: float


def air_at(altitude: float) -> Air:
    """Air at a geopotential altitude [m], 0 to HIGHEST."""
    lapse = LAPSE if altitude < TROPOPAUSE else 0.0
    kelvin = SEA_LEVEL_K - LAPSE * min(altitude, TROPOPAUSE)
    pressure = SEA_LEVEL_PA * (kelvin / SEA_LEVEL_K) ** (GRAVITY / (GAS * LAPSE))
    pressure *= exp(-GRAVITY * max(altitude - TROPOPAUSE, 0.0) / (GAS * kelvin))
    thinning = (GRAVITY / GAS - lapse) / kelvin
    return Air(pressure / (GAS * kelvin), sqrt(HEATS * GAS * kelvin), thinning)
