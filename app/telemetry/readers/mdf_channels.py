"""Which channels of an MDF file are signals of numbers, and how they become physical values.

A conversion by formula is a text that the library evaluates as a program: it is never asked to.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.readers.sources import Column
from core.types import Flags

NUMERIC_4 = frozenset(range(6))
"""Data types of MDF 4: integers and floating-point numbers of either byte order."""
NOT_NUMERIC_3 = frozenset((7, 8))
SAFE_4 = frozenset((0, 1, 2, 4, 5, 6))
"""Conversions of MDF 4: none, linear, rational, and tables from number to number."""
SAFE_3 = frozenset((65535, 0, 1, 2, 6, 7, 8, 9))
FORMULA_4, FORMULA_3 = 3, 10
MASTER_TYPES = (2, 3)
TIME_SYNC = 1
VIRTUAL_TYPES = (3, 6)
"""Channels that are counted, not recorded."""
INVALIDATION = 2
"""Flag: a bit of each record says whether it is invalid."""


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel that is read. index: in its group.   conversion: None where values are raw."""

    index: int
    column: Column
    conversion: Any

    def physical(self, raw: npt.NDArray[Any], invalid: Flags | None) -> npt.NDArray[Any]:
        """Return values in the unit of the channel, NaN where the file calls them invalid."""
        values = self.conversion.convert(raw) if self.conversion else raw
        if invalid is None or not invalid.any():
            return values
        return np.where(np.asarray(invalid, bool), np.nan, values)


def channel(
    index: int, channel: Any, group: Any, name: str, composed: bool, newer: bool
) -> Channel | str:
    """Look at a channel of the library's, or say why it is no signal.

    group: its channel group.   composed: it is made of other channels.   newer: of MDF 4.
    """
    if composed:
        return f"{name}: made of channels, which are read one by one"
    kind = channel.data_type
    if (kind not in NUMERIC_4) if newer else (kind in NOT_NUMERIC_3):
        return f"{name}: text or bytes"
    if _lies_outside(channel, group, newer):
        return f"{name}: lies outside the records of its group"
    if newer and channel.channel_type == 1:
        return f"{name}: values of different lengths"
    conversion = channel.conversion
    rule = conversion.conversion_type if conversion else 0
    if rule == (FORMULA_4 if newer else FORMULA_3):
        return f"{name}: converted by a formula, which is not evaluated"
    if newer and any(
        hasattr(other, "conversion_type")
        for other in (getattr(conversion, "referenced_blocks", None) or {}).values()
    ):
        return f"{name}: converted by one of several rules"
    unit = channel.unit or getattr(conversion, "unit", "") or ""
    time = (
        channel.channel_type in MASTER_TYPES and channel.sync_type == TIME_SYNC
        if newer
        else (channel.channel_type == 1)
    )
    safe = rule in (SAFE_4 if newer else SAFE_3)
    comment = "" if str(channel.comment).startswith("<") else str(channel.comment or "")
    column = Column(name, str(unit).strip() or ("s" if time else ""), comment[:200], time)
    return Channel(index, column, conversion if safe else None)


def _lies_outside(channel: Any, group: Any, newer: bool) -> bool:
    """Whether its bits are not all in the records; the library would read and write out of them."""
    if not newer:
        more = 8 * getattr(channel, "additional_byte_offset", 0)
        return channel.start_offset + more + channel.bit_count > 8 * group.samples_byte_nr
    if channel.channel_type in VIRTUAL_TYPES:
        return False
    if channel.flags & INVALIDATION and (
        channel.pos_invalidation_bit >= 8 * group.invalidation_bytes_nr
    ):
        return True
    end = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
    return end > 8 * group.samples_byte_nr
