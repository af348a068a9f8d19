"""Export a scored recording as CSV, Parquet or MAT, with units.

Channels are as assessed: from trim, in SI units, N_y in g. In CSV the names contain both, so that
the file can be scored again; the other formats store them beside each column.
"""

import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import numpy.typing as npt

from app.assessment.limits_history import pieces_of
from core.channels import CHANNELS
from core.monitor.assessment import STATES
from core.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

SUFFIXES = {"rad": "rad", "rad/s": "radps", "g": "g", "s": "s"}
ANGLES = ("phi", "theta", "psi")
MAT_TITLE = b"MATLAB 5.0 MAT-file, written by Forewarn"
MAT_TITLE_BYTES = 116
"""scipy writes the time of day there; we replace it, so that equal flights give equal files."""
BLOCK = 65_536
"""Rows in memory at once, for formats that are written row by row."""
ALL = slice(None)


@dataclass(frozen=True, eq=False)
class ExportColumn:
    """One column of an export.

    unit: "" if none.   values: (n,); indices of `words` if there are words.
    from_trim: whether the trim is subtracted.
    """

    name: str
    unit: str
    values: npt.NDArray[Any]
    from_trim: bool = False
    words: tuple[str, ...] = ()

    @property
    def long_name(self) -> str:
        """Name with reference and unit, such as `beta_from_trim_rad`."""
        name = f"{self.name}_from_trim" if self.from_trim else self.name
        return f"{name}_{SUFFIXES[self.unit]}" if self.unit else name


@dataclass(frozen=True)
class ExportFormat:
    """A format of exports. write: writes columns and plain data about them to a file."""

    ending: str
    media_type: str
    write: Callable[[list[ExportColumn], Mapping[str, Any], BinaryIO], object]


def export(samples: npt.NDArray, about: Mapping[str, Any], form: str, file: BinaryIO) -> None:
    """Write stored samples (see app.assessment) in a format of EXPORTS.

    about: plain data stored with them if the format allows it: hashes, epsilon, monitor.
    """
    EXPORTS[form].write(columns(samples, about.get("limits_in_force")), about, file)


def columns(
    samples: npt.NDArray, in_force: Sequence[Mapping[str, Any]] | None = None
) -> list[ExportColumn]:
    """The columns of stored samples in order; attitude only if recorded.

    in_force: limits in force, see app.assessment.limits_history; one column per limited channel.
    """
    units = {channel.key: channel.unit for channel in CHANNELS}
    states = tuple(state.value for state in STATES)
    measured = [
        ExportColumn(key, unit, samples["y"][:, c], from_trim=True)
        for c, (key, unit) in enumerate(units.items())
    ]
    predicted = [
        ExportColumn(f"predicted_{key}", unit, samples["y_hat"][:, c], from_trim=True)
        for c, (key, unit) in enumerate(units.items())
    ]
    attitude = [
        ExportColumn(angle, "rad", samples["attitude"][:, c])
        for c, angle in enumerate(ANGLES)
        if np.isfinite(samples["attitude"][:, c]).any()
    ]
    return [
        ExportColumn("t", "s", samples["t"]),
        *measured,
        ExportColumn("state", "", samples["state"], words=states),
        ExportColumn("p_value", "", samples["p_value"]),
        ExportColumn("alert", "", samples["alert"]),
        ExportColumn("manoeuvre", "", samples["manoeuvre"].astype(np.int32)),
        ExportColumn("in_manoeuvre", "", samples["manoeuvre"] >= 0),
        ExportColumn("withdrawn_p_value", "", samples["withdrawn"]),
        *predicted,
        *attitude,
        *_limits(samples["t"], in_force or ()),
    ]


def _limits(t: Array, in_force: Sequence[Mapping[str, Any]]) -> list[ExportColumn]:
    """The limit in force of each channel that had one, over time; NaN if none applied."""
    pieces = pieces_of(np.full(len(CHANNELS), np.inf), in_force)
    limited = np.isfinite([piece.limits for piece in pieces]).any(axis=0)
    limit_columns = []
    for c in np.flatnonzero(limited):
        channel, limits = CHANNELS[c], np.full(len(t), np.nan)
        for piece in pieces:
            limit = piece.limits[c] if np.isfinite(piece.limits[c]) else np.nan
            limits[(t >= piece.start) & (t <= piece.end)] = limit
        if np.isfinite(limits).any():
            name = f"limit_{channel.key}"
            limit_columns.append(ExportColumn(name, channel.unit, limits, from_trim=True))
    return limit_columns


def _table(export_columns: list[ExportColumn], names: list[str], rows: slice = ALL) -> "pa.Table":
    """An Arrow table with nulls for missing values."""
    import pyarrow as pa

    return pa.table([_arrow(column, rows) for column in export_columns], names=names)


def _arrow(column: ExportColumn, rows: slice = ALL) -> "pa.Array":
    """Some rows of a column as an Arrow array; Arrow's own conversion imports pandas first."""
    import pyarrow as pa

    values = column.values[rows]
    if column.words:
        return _texts(values, column.words)
    if values.dtype.kind == "b":
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, _bits(values)])
    known = None if values.dtype.kind != "f" else ~np.isnan(values)
    validity = None if known is None or known.all() else _bits(known)
    numbers = pa.py_buffer(np.ascontiguousarray(values))
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [validity, numbers])


def _bits(flags: npt.NDArray[np.bool_]) -> "pa.Buffer":
    import pyarrow as pa

    return pa.py_buffer(np.packbits(flags, bitorder="little"))


def _texts(values: npt.NDArray[Any], words: tuple[str, ...]) -> "pa.Array":
    """Words by index; built from runs, because neighbours are usually equal."""
    import pyarrow as pa

    changes = np.ones(len(values), bool)
    changes[1:] = values[1:] != values[:-1]
    starts = np.flatnonzero(changes)
    runs = np.diff(np.append(starts, len(values)))
    texts = [words[values[start]].encode() for start in starts]
    ends = np.cumsum(np.repeat([len(text) for text in texts], runs), dtype=np.int32)
    offsets = np.concatenate([np.zeros(1, np.int32), ends], dtype=np.int32)
    content = b"".join(text * run for text, run in zip(texts, runs.tolist(), strict=True))
    return pa.Array.from_buffers(
        pa.string(), len(values), [None, pa.py_buffer(offsets), pa.py_buffer(content)]
    )


def _csv(export_columns: list[ExportColumn], about: Mapping[str, Any], file: BinaryIO) -> None:
    from pyarrow.csv import CSVWriter, WriteOptions

    names = [column.long_name for column in export_columns]
    options = WriteOptions(quoting_style="none", quoting_header="none")
    first = _table(export_columns, names, slice(0, BLOCK))
    with CSVWriter(file, first.schema, write_options=options) as writer:
        writer.write_table(first)
        for begin in range(BLOCK, len(export_columns[0].values), BLOCK):
            writer.write_table(_table(export_columns, names, slice(begin, begin + BLOCK)))


def _parquet(export_columns: list[ExportColumn], about: Mapping[str, Any], file: BinaryIO) -> None:
    import pyarrow as pa
    from pyarrow.parquet import write_table

    table = _table(export_columns, [column.name for column in export_columns])
    fields = [
        field.with_metadata({"unit": column.unit, "reference": "trim" if column.from_trim else ""})
        for field, column in zip(table.schema, export_columns, strict=True)
    ]
    schema = pa.schema(fields, metadata={"forewarn": _text(about)})
    write_table(table.cast(schema), file)


def _mat(export_columns: list[ExportColumn], about: Mapping[str, Any], file: BinaryIO) -> None:
    from scipy.io import savemat

    data = {column.name: np.ascontiguousarray(column.values) for column in export_columns}
    states = next(column for column in export_columns if column.words)
    names, data["state"] = np.unique(np.array(states.words)[states.values], return_inverse=True)
    units = {column.name: column.unit for column in export_columns if column.unit}
    data["state"] = data["state"].astype(np.uint8) + 1  # MATLAB counts from 1
    content = {
        **data,
        "state_names": names.astype(object),
        "units": units,
        "from_trim": np.array(
            [column.name for column in export_columns if column.from_trim], object
        ),
        "about": _text(about),
    }
    buffer = io.BytesIO()
    savemat(buffer, content, oned_as="column")
    file.write(MAT_TITLE.ljust(MAT_TITLE_BYTES))
    file.write(buffer.getbuffer()[MAT_TITLE_BYTES:])


def _text(about: Mapping[str, Any]) -> str:
    return json.dumps(about, sort_keys=True)


EXPORTS: dict[str, ExportFormat] = {
    "csv": ExportFormat("csv", "text/csv", _csv),
    "parquet": ExportFormat("parquet", "application/vnd.apache.parquet", _parquet),
    "mat": ExportFormat("mat", "application/x-matlab-data", _mat),
}
