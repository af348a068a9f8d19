"""The telemetry dictionary: the channels of a sample y, their order and units."""

from dataclasses import dataclass
from math import degrees, pi

from core.kernels import N_CHANNELS


@dataclass(frozen=True)
class Channel:
    """One measured quantity, with its unit, label and display.

    unit: SI, or g; for computing, storing and sending.
    display_unit: for people; display_factor converts from `unit`.
    display_decimals: significant decimals in display_unit.
    """

    key: str
    symbol: str
    unit: str
    label: str
    display_unit: str
    display_factor: float
    display_decimals: int

    def read(self, value: float, digits: int = 3) -> str:
        """`4.98 deg`: a value in its display unit, to this many significant digits."""
        return f"{significant(value * self.display_factor, digits)} {self.display_unit}"


READABLE = 1e9
"""From this magnitude on, numbers are written with a power of ten."""


def significant(value: float, digits: int = 3) -> str:
    """A number to this many significant digits, but never fewer than before the point."""
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < READABLE else text


DISPLAY: dict[str, tuple[str, float, int]] = {
    "rad": ("deg", degrees(1.0), 2),
    "rad/s": ("deg/s", degrees(1.0), 1),
    "g": ("g", 1.0, 3),
}
"""Display unit, factor and decimals of a unit; other units are displayed unchanged."""

BEYOND_FLIGHT: dict[str, float] = {"rad": pi, "rad/s": 4.0 * pi}
"""Magnitudes that no aircraft reaches, by unit: a half turn, two turns a second."""


def channel(key: str, symbol: str, unit: str, label: str) -> Channel:
    """A channel with the display of its unit."""
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
