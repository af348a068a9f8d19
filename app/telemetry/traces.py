"""Channels in SI units, each at its recorded times."""

from dataclasses import dataclass, field

from core.types import Array

GAP_RATIO = 1.5
"""A longer step between samples, in usual steps, is a gap."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One channel. t: (n,) [s] as recorded, in any order.   values: (n,), NaN where missing.

    group: of the file; channels of one group share their times, as one array.
    source: signal or derivation in words.   derived: not measured.
    bias: subtracted from the recorded values, in the channel's unit.
    """

    t: Array
    values: Array
    group: str = ""
    source: str = ""
    derived: bool = False
    bias: float = 0.0


@dataclass(frozen=True, eq=False)
class Traces:
    """Channels of a file by key of TARGETS. notes: assumptions and changes, oldest first."""

    channels: dict[str, Trace]
    notes: tuple[str, ...] = field(default=())
