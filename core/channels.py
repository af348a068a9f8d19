"""The telemetry dictionary: what a sample y holds, in which order and in which units."""

from dataclasses import dataclass
from math import degrees, pi

from core.kernels import N_CHANNELS


@dataclass(frozen=True)
class Channel:
    """One quantity as control rooms name, draw and label it.

    unit: SI, or g; of what is computed, stored and sent.
    display_unit: what people read it in; display_factor times the value in `unit`.
    display_decimals: digits behind the point that mean something there.
    """

    key: str
    symbol: str
    unit: str
    label: str
    display_unit: str
    display_factor: float
    display_decimals: int

    def read(self, value: float, digits: int = 3) -> str:
        """`4.98 deg`: a value in `unit` as people read it, to so many significant digits."""
        return f"{significant(value * self.display_factor, digits)} {self.display_unit}"


READABLE = 1e9
"""From here on a number is written with its power of ten."""


def significant(value: float, digits: int = 3) -> str:
    """A number to so many significant digits; one of more digits before the point as it is."""
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < READABLE else text


DISPLAY: dict[str, tuple[str, float, int]] = {
    "rad": ("deg", degrees(1.0), 2),
    "rad/s": ("deg/s", degrees(1.0), 1),
    "g": ("g", 1.0, 3),
}
"""Unit, factor and decimals that people read a unit with; any other one is read as it is."""

BEYOND_FLIGHT: dict[str, float] = {"rad": pi, "rad/s": 4.0 * pi}
"""Magnitudes that no aircraft comes near, by unit: a half turn, two turns a second."""


def channel(key: str, symbol: str, unit: str, label: str) -> Channel:
    """A channel in a unit, displayed as DISPLAY says."""
    return Channel(key, symbol, unit, label, *DISPLAY.get(unit, (unit, 1.0, 2)))


CHANNELS: tuple[Channel, ...] = (
    channel("beta", "β", "rad", "sideslip"),
    channel("p", "p", "rad/s", "roll rate"),
    channel("r", "r", "rad/s", "yaw rate"),
    channel("Ny", "N_y", "g", "lateral acceleration"),
    channel("delta_a", "δ_a", "rad", "aileron"),
    channel("delta_r", "δ_r", "rad", "rudder"),
)
BY_KEY: dict[str, Channel] = {known.key: known for known in CHANNELS}
KEYS: tuple[str, ...] = tuple(BY_KEY)
if len(CHANNELS) != N_CHANNELS:
    raise AssertionError(f"{len(CHANNELS)} channels: the kernels compute with {N_CHANNELS}")
