"""Read a folder with one file for each flight, as one long table with the column `flight`."""

import tempfile
from importlib import import_module
from pathlib import Path

import numpy as np

from app.telemetry.contents import Columns, ColumnWriter, Contents, open_columns
from app.telemetry.formats import READERS, files_of, format_of
from app.telemetry.recording import TelemetryError

FLIGHT = "flight"
"""Column of the number of a file, from 0, in the order of their names."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read all files; each must have one table with the signals of the first one."""
    files = files_of(path)
    if not files:
        raise TelemetryError(f"{path} is empty: give a folder with one file for each flight")
    names: dict[str, int] = {}
    for number, file in enumerate(files):
        with tempfile.TemporaryDirectory(dir=writer.folder) as place:
            try:
                columns = _columns(file, Path(place), writer)
            except TelemetryError as error:
                raise TelemetryError(f"{file.name}: {error}") from None
            signals = columns.contents.signals
            if not names:
                group = writer.add_group()
                names = {FLIGHT: writer.add_signal(group, FLIGHT)}
                for signal in signals:
                    names[signal.name] = writer.add_signal(group, signal.name, signal.unit)
            if missing := names.keys() - {FLIGHT, *(signal.name for signal in signals)}:
                raise TelemetryError(
                    f"{file.name} has no {', '.join(sorted(missing))}, as {files[0].name} has: "
                    "write the same signals for each flight"
                )
            rows = columns.contents.groups[0].n_rows
            writer.append(names[FLIGHT], np.full(rows, float(number)))
            for signal in signals:
                if signal.name in names:
                    writer.append(names[signal.name], columns.values(signal.name))
    return writer.finish("folder")


def _columns(file: Path, place: Path, writer: ColumnWriter) -> Columns:
    known, _ = format_of(file, file.name)
    inner = ColumnWriter(place, writer.most_bytes, writer.bad_share)
    import_module(known.reader, READERS).read(file, inner)
    columns = open_columns(place)
    if len(columns.contents.groups) != 1:
        raise TelemetryError("it has several tables: give one for each flight")
    return columns
