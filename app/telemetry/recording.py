"""A recording: measured channels over time in SI units."""

from dataclasses import dataclass, field

from core.types import Array

ATTITUDE = ("phi", "theta", "psi")


class TelemetryError(ValueError):
    """Unusable telemetry; one sentence: what was given, what is needed, what to do."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Measured telemetry; a missing value is NaN, never a number.

    t: (n,) [s] finite, strictly increasing, n >= 2.
    y: (n, 6) in the order of core.channels.CHANNELS [rad, rad/s, rad/s, g, rad, rad].
    attitude: "phi", "theta", "psi" -> (n,) [rad], if recorded.
    condition: "V" [m/s], "h" [m] -> (n,), if recorded.
    columns: channel key -> its source in words.
    derived: keys of channels that were derived, not measured.
    notes: sentences on assumptions and repairs, oldest first.
    look_ahead: how long a sample waits for later ones in flight [s].
    """

    t: Array
    y: Array
    attitude: dict[str, Array] = field(default_factory=dict)
    condition: dict[str, Array] = field(default_factory=dict)
    columns: dict[str, str] = field(default_factory=dict)
    derived: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()
    look_ahead: float = 0.0
