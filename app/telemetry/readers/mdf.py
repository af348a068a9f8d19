"""Read ASAM MDF 4: a group is a channel group with its master.

The library would evaluate a conversion formula as a program, so formulas are never used. It follows
pointers between blocks blindly: if they form a circle, the limits of the process end it.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import (
    Column,
    Pieces,
    SignalTable,
    library_errors,
    write_tables,
)
from app.telemetry.recording import TelemetryError
from core.types import Flags

TITLE = "MDF"
OPTIONS: dict[str, Any] = {"process_bus_logging": False, "use_display_names": False}
FINISHED = b"MDF"
FRAGMENT = 8 << 20
"""Size of the records that are read at once [bytes]."""
NUMERIC = frozenset(range(6))
"""Data types: integers and floating-point numbers of either byte order."""
SAFE = frozenset((0, 1, 2, 4, 5, 6))
"""Conversions: none, linear, rational, and numeric tables."""
FORMULA = 3
MASTER_TYPES = (2, 3)
TIME_SYNC = 1
VIRTUAL_TYPES = (3, 6)
"""Channels that are computed, not recorded."""
INVALIDATION = 2
"""Flag: each record has a bit for invalid values."""


@dataclass(frozen=True, eq=False)
class MdfChannel:
    """A channel to read. index: in its group.   conversion: None for raw values."""

    index: int
    column: Column
    conversion: Any

    def physical(self, raw: npt.NDArray[Any], invalid: Flags | None) -> npt.NDArray[Any]:
        """Values in the channel's unit, NaN if marked invalid."""
        values = self.conversion.convert(raw) if self.conversion else raw
        if invalid is None or not invalid.any():
            return values
        return np.where(np.asarray(invalid, bool), np.nan, values)


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read an MDF file; times count from the start time in its header."""
    with library_errors(TITLE):
        from asammdf import MDF

        with (
            path.open("rb") as file,
            # for an unfinished file the library needs a path, and finishes a copy
            MDF(
                file if file.peek().startswith(FINISHED) else path,
                temporary_folder=writer.folder,
                **OPTIONS,
            ) as mdf,
        ):
            if mdf.version < "4":
                raise TelemetryError(f"it has MDF version {mdf.version}: convert it to MDF 4")
            mdf.configure(read_fragment_size=FRAGMENT)
            ignored: list[str] = []
            write_tables(list(_sources(mdf, ignored)), writer, ignored)
            start = mdf.header.start_time.isoformat()
        return writer.finish("mdf4", start=start, ignored=ignored)


def _sources(mdf: Any, ignored: list[str]) -> Iterator[SignalTable]:
    """The channel groups; groups that share a master share a clock."""
    names = _group_names(mdf)
    count = Counter(c.name for group in mdf.groups for c in group.channels)
    for number, group in enumerate(mdf.groups):
        chosen = []
        for index, raw in enumerate(group.channels):
            name = raw.name if count[raw.name] == 1 else f"{names[number]}/{raw.name}"
            composed = bool(group.channel_dependencies[index])
            result = _channel(index, raw, group.channel_group, name, composed)
            if isinstance(result, MdfChannel):
                chosen.append(result)
            else:
                ignored.append(result)
        master = mdf.virtual_groups_map.get(number, number)
        n_rows = group.channel_group.cycles_nr
        if not chosen:
            continue
        if n_rows:
            _check_record(group)
        pieces = partial(_pieces, mdf, number, chosen, n_rows)
        columns = tuple(channel.column for channel in chosen)
        yield SignalTable((names[number],), columns, n_rows, pieces, (names[master],))


def _check_record(group: Any) -> None:
    """ValueError if one record is larger than all data: the library would allocate it."""
    record = group.channel_group.samples_byte_nr + group.channel_group.invalidation_bytes_nr
    if record > sum(block.original_size for block in group.data_blocks):
        raise ValueError("it ends within its data")


def _pieces(mdf: Any, group: int, channels: list[MdfChannel], n_rows: int) -> Pieces:
    """Read the records of a group in fragments, every channel from each."""
    n_remaining = n_rows
    for fragment in mdf._mdf._load_data(mdf.groups[group]):
        values = None
        for number, channel in enumerate(channels):
            raw, invalid = mdf.get(
                group=group,
                index=channel.index,
                data=fragment,
                raw=True,
                samples_only=True,
                ignore_invalidation_bits=True,
            )
            values = channel.physical(raw, invalid)
            yield number, values
        n_remaining -= 0 if values is None else len(values)
    if n_remaining:
        raise ValueError("it ends within its data")


def _group_names(mdf: Any) -> list[str]:
    """Names of channel groups: source or comment, with a number if two are equal."""
    named = []
    for number, group in enumerate(mdf.groups):
        of_group = group.channel_group
        name = getattr(of_group, "acq_name", "") or getattr(of_group, "comment", "") or ""
        plain = "" if _is_xml(name) else str(name).strip()
        named.append(plain[:80] or f"group {number}")
    count = Counter(named)
    return [n if count[n] == 1 else f"{n} {number}" for number, n in enumerate(named)]


def _channel(index: int, channel: Any, group: Any, name: str, composed: bool) -> MdfChannel | str:
    """A channel to read, or the reason why it is not a signal.

    group: its channel group.   composed: made of other channels.
    """
    if composed:
        return f"{name}: made of other channels, which are read separately"
    if channel.data_type not in NUMERIC:
        return f"{name}: text or bytes"
    if _lies_outside(channel, group):
        return f"{name}: lies outside the records of its group"
    if channel.channel_type == 1:
        return f"{name}: values of different lengths"
    conversion = channel.conversion
    rule = conversion.conversion_type if conversion else 0
    if rule == FORMULA:
        return f"{name}: converted by a formula, which is not evaluated"
    if any(
        hasattr(other, "conversion_type")
        for other in (getattr(conversion, "referenced_blocks", None) or {}).values()
    ):
        return f"{name}: converted by one of several rules"
    unit = channel.unit or getattr(conversion, "unit", "") or ""
    time = channel.channel_type in MASTER_TYPES and channel.sync_type == TIME_SYNC
    comment = "" if _is_xml(channel.comment) else str(channel.comment or "")
    column = Column(name, str(unit).strip() or ("s" if time else ""), comment[:200], time)
    return MdfChannel(index, column, conversion if rule in SAFE else None)


def _is_xml(comment: Any) -> bool:
    """Whether a comment is an XML document, which MDF 4 allows."""
    return str(comment).startswith("<")


def _lies_outside(channel: Any, group: Any) -> bool:
    """Whether some of its bits are outside the records, which would crash the library."""
    if channel.channel_type in VIRTUAL_TYPES:
        return False
    if channel.flags & INVALIDATION and (
        channel.pos_invalidation_bit >= 8 * group.invalidation_bytes_nr
    ):
        return True
    end = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
    return end > 8 * group.samples_byte_nr
