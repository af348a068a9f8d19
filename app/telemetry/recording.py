"""Measured channels over time in SI units: as recorded, and on one clock."""

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
    derived: keys of channels that were derived, not measured.
    notes: sentences on assumptions and repairs, oldest first.
    look_ahead: how long a sample waits for later ones in flight [s].
    """

    t: Array
    y: Array
    attitude: dict[str, Array] = field(default_factory=dict)
    condition: dict[str, Array] = field(default_factory=dict)
    derived: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()
    look_ahead: float = 0.0


GAP_RATIO = 1.5
"""A longer step between samples, in usual steps, is a gap."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One channel. t: (n,) [s] as recorded, in any order.   values: (n,), NaN where missing.

    group: of the file; channels of one group share their times, as one array.
    source: signal or derivation in words.   derived: not measured.
    bias: subtracted from the recorded values, in `unit`.   unit: of the values, SI or g.
    why_missing: why no sample has a value, where that is known.
    sent: (n,) values by the sensor, where some are missing in `values` because no aircraft can
    reach them; else None.
    """

    t: Array
    values: Array
    group: str = ""
    source: str = ""
    derived: bool = False
    bias: float = 0.0
    unit: str = ""
    why_missing: str = ""
    sent: Array | None = None


@dataclass(frozen=True, eq=False)
class Traces:
    """Channels of a file by key. notes: assumptions and changes, oldest first.

    arrived: (n,) of the samples of a live flight, on their one clock [s]; None for others.
    """

    channels: dict[str, Trace]
    notes: tuple[str, ...] = field(default=())
    arrived: Array | None = None
