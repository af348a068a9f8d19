"""Read TDMS of LabVIEW and DIAdem: each channel has its own interval or its group's times."""

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
    is_time_name,
    library_errors,
    write_tables,
)

NUMERIC = "biuf"
TIMES = "M"
UNITS = ("unit_string", "unit", "NI_UnitDescription")
"""Properties with the unit of a channel."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a TDMS file. Times without a date count from the start of the waveform [s]."""
    with library_errors("TDMS"):
        from nptdms import TdmsFile

        ignored: list[str] = []
        with path.open("rb") as opened, TdmsFile.open(opened) as file:
            if file.file_status.incomplete_final_segment:
                raise ValueError("it ends within its data")
            channels = [channel for group in file.groups() for channel in group.channels()]
            tables = [table for each in channels if (table := _table(each, ignored)) is not None]
            write_tables(tables, writer, ignored)
            starts = {str(each.properties.get("wf_start_time", "")) for each in channels} - {""}
        return writer.finish("tdms", start=min(starts, default=""), ignored=ignored)


def _table(channel: Any, ignored: list[str]) -> SignalTable | None:
    """A channel to read; None if it is no signal."""
    kind = np.dtype(channel.dtype).kind
    name = f"{channel.group_name}/{channel.name}"
    if kind not in NUMERIC + TIMES:
        ignored.append(f"{name}: text or bytes")
        return None
    properties = channel.properties
    unit = next((str(properties[key]) for key in UNITS if properties.get(key)), "")
    step, start = (float(properties.get(f"wf_{key}", 0.0)) for key in ("increment", "start_offset"))
    is_time = kind == TIMES or is_time_name(channel.name)
    column = Column(
        name,
        "s" if kind == TIMES else unit,
        str(properties.get("description", "")),
        time=is_time,
        rate=1.0 / step if step > 0.0 and not is_time else 0.0,
        start=start,
    )
    return SignalTable(
        (channel.group_name,), (column,), len(channel), partial(_pieces, channel, kind)
    )


def _pieces(channel: Any, kind: str) -> Pieces:
    for chunk in channel.data_chunks():
        values: npt.NDArray[Any] = chunk[:]
        yield 0, values.astype("datetime64[ns]").astype(np.int64) / 1e9 if kind == TIMES else values
