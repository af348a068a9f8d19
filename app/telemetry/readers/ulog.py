"""Recordings of PX4 autopilots (ULog): a group is an instance of a topic, a signal its field."""

import io
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from app.telemetry.contents import MOST_SIGNALS, ColumnWriter, Contents
from app.telemetry.readers.library_errors import library_errors, too_deep
from app.telemetry.readers.signal_tables import (
    BLOCK,
    Column,
    Pieces,
    SignalTable,
    listed,
    write_tables,
)
from app.telemetry.recording import TelemetryError

TITLE = "ULog"
MOST_DEPTH = 16
MOST_FIELDS = 4096
"""Of one message, its nested ones unfolded."""
MOST_ELEMENTS = 64
"""Of an array in a message; a longer one is a map or a text."""
TIME = "timestamp"
MICROSECONDS = 1e6

Formats = Mapping[str, Any]


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a ULog file; times are seconds since the autopilot started."""
    with library_errors(TITLE):
        from pyulog import ULog

        with _Finite(path) as file:
            header = ULog(file, parse_header_only=True)
        for name in header.message_formats:
            _check_fields(header.message_formats, name)
        with path.open("rb") as file:
            log = ULog(file)
        ignored: list[str] = []
        tables = [_topic(data, log.data_list, ignored) for data in log.data_list]
        write_tables(_smallest(tables, ignored), writer, ignored)
        return writer.finish("ulog", ignored=listed(ignored), notes=_notes(log))


class _Finite(io.FileIO):
    """A file that is read as often as it has bytes.

    The library steps back from damage by more than it has read where the file ends too early.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._left = path.stat().st_size

    def read(self, size: int | None = -1) -> bytes:
        """Read as any file; EOFError where it has been read too often."""
        self._left -= 1
        if self._left < 0:
            raise EOFError("it ends within its definitions")
        return super().read(size)


def _check_fields(formats: Formats, name: str) -> None:
    """TelemetryError where a message is of itself, or of messages of messages without measure."""
    n_fields, stack = 0, [(name, 1, 0)]
    while stack:
        message, times, depth = stack.pop()
        if depth > MOST_DEPTH:
            raise TelemetryError(too_deep(TITLE))
        for kind, length, _ in formats[message].fields if message in formats else ():
            if kind in formats:
                stack.append((kind, times * (length or 1), depth + 1))
            else:
                n_fields += times * (length or 1)
            if n_fields > MOST_FIELDS or len(stack) > MOST_FIELDS:
                raise TelemetryError(
                    f"the message {name!r} of the ULog file unfolds to more than {MOST_FIELDS} "
                    "fields: it is damaged, copy it from the autopilot again"
                )


def _topic(data: Any, every: list[Any], ignored: list[str]) -> SignalTable:
    """The numeric fields of a topic, those of long arrays and texts left out."""
    alone = data.multi_id == 0 and sum(other.name == data.name for other in every) == 1
    group = data.name if alone else f"{data.name}_{data.multi_id}"
    long = {
        field.field_name.partition("[")[0]
        for field in data.field_data
        if field.field_name.endswith(f"[{MOST_ELEMENTS}]")
    }
    names, texts = [], set()
    for field in data.field_data:
        name, stem = field.field_name, field.field_name.partition("[")[0]
        if field.type_str == "char" or stem in long:
            texts.add(f"{group}/{stem}: {'an array' if stem in long else 'text'}")
        elif not name.split(".")[-1].startswith("_padding"):
            names.append(name)
    ignored += sorted(texts)
    columns = tuple(
        Column(f"{group}/{name}", "s" if name == TIME else "", time=name == TIME) for name in names
    )
    n_rows = len(next(iter(data.data.values())))
    return SignalTable((group,), columns, n_rows, partial(_pieces, data.data, names))


def _smallest(tables: list[SignalTable], ignored: list[str]) -> list[SignalTable]:
    """The topics with the fewest fields, where all have more than can be read."""
    chosen, n_signals = [], 0
    for table in sorted(tables, key=lambda table: len(table.columns)):
        n_signals += len(table.columns)
        if n_signals <= MOST_SIGNALS:
            chosen.append(table)
        else:
            ignored.append(f"{table.within[0]}: one of too many fields in the file")
    return [table for table in tables if table in chosen]


def _pieces(fields: Mapping[str, Any], names: list[str]) -> Pieces:
    for number, name in enumerate(names):
        values = fields[name]
        for first in range(0, len(values), BLOCK):
            block = values[first : first + BLOCK]
            yield number, block / MICROSECONDS if name == TIME else block


def _notes(log: Any) -> tuple[str, ...]:
    """What was lost on the way to the file."""
    notes = []
    if lost := [dropout.duration / 1e3 for dropout in log.dropouts]:
        notes.append(
            f"The logger dropped data: {len(lost)} dropouts, {sum(lost):.3g} s in all, the longest "
            f"{max(lost):.3g} s."
        )
    if log.file_corruption:
        notes.append("Parts of the file are damaged and were left out.")
    return tuple(notes)
