"""Read ULog of PX4 autopilots: a group is an instance of a topic, a signal is a field of it."""

import io
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import (
    BLOCK,
    Column,
    Pieces,
    SignalTable,
    library_errors,
    write_tables,
)

MOST_ELEMENTS = 64
"""Longest array in a message; a longer one is a map or a text."""
TIME = "timestamp"
MICROSECONDS = 1e6


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a ULog file; times are seconds since the autopilot started."""
    with library_errors("ULog"):
        from pyulog import ULog

        with _Finite(io.FileIO(path)) as file:
            log = ULog(file)
        ignored: list[str] = []
        tables = [_topic(data, log.data_list, ignored) for data in log.data_list]
        write_tables(tables, writer, ignored)
        return writer.finish("ulog", ignored=ignored, notes=_notes(log))


class _Finite(io.BufferedReader):
    """A file that allows as many reads as it has bytes.

    If a file ends early, the library would go back and read it again without end.
    """

    def __init__(self, raw: io.FileIO) -> None:
        super().__init__(raw)
        self._n_remaining = raw.seek(0, io.SEEK_END)
        raw.seek(0)

    def read(self, size: int | None = -1) -> bytes:
        """Read as usual; EOFError after too many reads."""
        self._n_remaining -= 1
        if self._n_remaining < 0:
            raise EOFError("it ends within its definitions")
        return super().read(size)


def _topic(data: Any, every: list[Any], ignored: list[str]) -> SignalTable:
    """Numeric fields of a topic, without long arrays and texts."""
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


def _pieces(fields: Mapping[str, Any], names: list[str]) -> Pieces:
    for number, name in enumerate(names):
        values = fields[name]
        for first in range(0, len(values), BLOCK):
            block = values[first : first + BLOCK]
            yield number, block / MICROSECONDS if name == TIME else block


def _notes(log: Any) -> tuple[str, ...]:
    notes = []
    if lost := [dropout.duration / 1e3 for dropout in log.dropouts]:
        notes.append(
            f"The logger dropped data: {len(lost)} dropouts, {sum(lost):.3g} s in total, the "
            f"longest {max(lost):.3g} s."
        )
    if log.file_corruption:
        notes.append("Dropped damaged parts of the file.")
    return tuple(notes)
