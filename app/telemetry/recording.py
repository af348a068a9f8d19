"""A recording: measured channels against time in SI units, and how they got there."""

from dataclasses import dataclass, field

from core.types import Array

ATTITUDE = ("phi", "theta", "psi")


class TelemetryError(ValueError):
    """Telemetry that cannot be used; one sentence: what was given, what is needed, what to do."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Telemetry of one manoeuvre as measured; a missing value is NaN, never a number.

    t: (n,) [s] finite, strictly increasing, n >= 2.
    y: (n, 6) in the order of core.channels.CHANNELS [rad, rad/s, rad/s, g, rad, rad].
    attitude: "phi", "theta", "psi" -> (n,) [rad], those that were recorded.
    condition: "V" [m/s], "h" [m] -> (n,), those that were recorded.
    columns: channel key -> what it was read or derived from.
    derived: keys of channels that were not measured but derived.
    notes: sentences on what was assumed and done, oldest first.
    look_ahead: how far resampling let y look into the future [s]; 0 for samples as recorded.
    """

    t: Array
    y: Array
    attitude: dict[str, Array] = field(default_factory=dict)
    condition: dict[str, Array] = field(default_factory=dict)
    columns: dict[str, str] = field(default_factory=dict)
    derived: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()
    look_ahead: float = 0.0
