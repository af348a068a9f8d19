"""Recordings in ASAM MDF 3 and 4: a group is a channel group with its master."""

from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.library_errors import library_errors
from app.telemetry.readers.mdf_blocks import check_blocks
from app.telemetry.readers.mdf_channels import Channel, channel
from app.telemetry.readers.sources import Pieces, Source, listed, pour

TITLE = "MDF"
OPTIONS: dict[str, Any] = {"process_bus_logging": False, "use_display_names": False}
FRAGMENT = 8 << 20
"""Records that are read at a time [bytes]."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read an MDF file; times count from the moment that its header names."""
    with library_errors(TITLE):
        from asammdf import MDF

        # the library finishes a copy of a file that its writer did not, and wants its path
        finished = check_blocks(path)
        with (
            path.open("rb") as file,
            MDF(file if finished else path, temporary_folder=writer.folder, **OPTIONS) as mdf,
        ):
            mdf.configure(read_fragment_size=FRAGMENT)
            ignored: list[str] = []
            pour(path, list(_sources(mdf, ignored)), writer, ignored)
            start = mdf.header.start_time.isoformat()
        return writer.finish("mdf4", start=start, ignored=listed(ignored))


def _sources(mdf: Any, ignored: list[str]) -> Iterator[Source]:
    """The channel groups; those that share the master of another are of its clock."""
    names = _group_names(mdf)
    count = Counter(c.name for group in mdf.groups for c in group.channels)
    newer = mdf.version >= "4"
    for number, group in enumerate(mdf.groups):
        chosen = []
        for index, raw in enumerate(group.channels):
            name = raw.name if count[raw.name] == 1 else f"{names[number]}/{raw.name}"
            composed = bool(group.channel_dependencies[index])
            found = channel(index, raw, group.channel_group, name, composed, newer)
            if isinstance(found, Channel):
                chosen.append(found)
            else:
                ignored.append(found)
        master = mdf.virtual_groups_map.get(number, number) if newer else number
        n_rows = group.channel_group.cycles_nr
        if not chosen:
            continue
        if newer and n_rows:
            _check_record(group)
        pieces = partial(_pieces, mdf, number, chosen, n_rows)
        columns = tuple(one.column for one in chosen)
        yield Source((names[number],), columns, n_rows, pieces, (names[master],))


def _check_record(group: Any) -> None:
    """ValueError where one record is larger than all data: the library makes room for it."""
    record = group.channel_group.samples_byte_nr + group.channel_group.invalidation_bytes_nr
    if record > sum(block.original_size for block in group.data_blocks):
        raise ValueError("it ends within its data")


def _pieces(mdf: Any, group: int, channels: list[Channel], n_rows: int) -> Pieces:
    """Read the records of a group by fragments, every channel from each."""
    left = n_rows
    for fragment in mdf._mdf._load_data(mdf.groups[group]):
        values = None
        for number, one in enumerate(channels):
            raw, invalid = mdf.get(
                group=group,
                index=one.index,
                data=fragment,
                raw=True,
                samples_only=True,
                ignore_invalidation_bits=True,
            )
            values = one.physical(raw, invalid)
            yield number, values
        left -= 0 if values is None else len(values)
    if left:
        raise ValueError("it ends within its data")


def _group_names(mdf: Any) -> list[str]:
    """A name for each channel group: what acquired it or its comment; a number where two agree."""
    named = []
    for number, group in enumerate(mdf.groups):
        of_group = group.channel_group
        said = getattr(of_group, "acq_name", "") or getattr(of_group, "comment", "") or ""
        plain = "" if str(said).startswith("<") else str(said).strip()
        named.append(plain[:80] or f"group {number}")
    count = Counter(named)
    return [n if count[n] == 1 else f"{n} {number}" for number, n in enumerate(named)]
