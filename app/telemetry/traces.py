"""Channels in SI units, each still on the times at which it was recorded."""

from dataclasses import dataclass, field

from core.types import Array

GAP_RATIO = 1.5
"""Neighbouring samples further apart than this many usual steps have a gap between them."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One channel. t: (n,) [s] as recorded, in any order.   values: (n,), NaN where missing.

    group: of the file; channels of one group share their times, as one array.
    source: what it was read or derived from, in words.   derived: not measured itself.
    bias: what was subtracted of what was recorded, in its unit.
    """

    t: Array
    values: Array
    group: str = ""
    source: str = ""
    derived: bool = False
    bias: float = 0.0


@dataclass(frozen=True, eq=False)
class Traces:
    """The channels of a file by key of TARGETS. notes: what was assumed and done, oldest first."""

    channels: dict[str, Trace]
    notes: tuple[str, ...] = field(default=())
