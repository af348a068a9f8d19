"""Export a scored recording as CSV, Parquet or MAT, with units.

Channels are as assessed, in SI units, N_y in g: from trim where their reference is trim. In CSV the
names contain both, so that the file can be scored again; the other formats store them beside each
column.
"""

import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import numpy.typing as npt

from core.channels import LATERAL, Dictionary
from core.monitor.assessment import STATES

if TYPE_CHECKING:
    import pyarrow as pa

ANGLES = ("phi", "theta", "psi")
MAT_TITLE = b"MATLAB 5.0 MAT-file, written by Forewarn"
MATLAB_LETTERS = 31
"""Longest name of a variable."""
MAT_TITLE_BYTES = 116
"""scipy writes the time of day there; we replace it, so that equal flights give equal files."""
BLOCK = 65_536
"""Rows in memory at once, for formats that are written row by row."""


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
        suffix = "" if self.unit == "1" else re.sub(r"[^\w%]", "", self.unit.replace("/", "p"))
        return re.sub(r'[",\r\n]', " ", f"{name}_{suffix}" if suffix else name)


@dataclass(frozen=True)
class ExportFormat:
    """A format of exports. write: writes columns and plain data about them to a file."""

    media_type: str
    write: Callable[[list[ExportColumn], Mapping[str, Any], BinaryIO], object]


def export(
    samples: npt.NDArray,
    about: Mapping[str, Any],
    form: str,
    file: BinaryIO,
    dictionary: Dictionary = LATERAL,
) -> None:
    """Write stored samples (see app.assessment) in a format of EXPORTS.

    about: plain data stored with them if the format allows it: hashes, epsilon, monitor.
    """
    EXPORTS[form].write(columns(samples, dictionary), about, file)


def columns(
    samples: npt.NDArray,
    dictionary: Dictionary = LATERAL,
    *,
    always_attitude: bool = False,
) -> list[ExportColumn]:
    """The columns of stored samples in order; attitude only if recorded, and no channel.

    always_attitude: also if it is not recorded.
    """
    measured, predicted = (
        [
            ExportColumn(
                f"{prefix}{channel.key}",
                channel.unit,
                samples[field][:, c],
                channel.reference == "trim",
            )
            for c, channel in enumerate(dictionary.channels)
        ]
        for prefix, field in (("", "y"), ("predicted_", "y_hat"))
    )
    attitude = [
        ExportColumn(angle, "rad", samples["attitude"][:, c])
        for c, angle in enumerate(ANGLES)
        if angle not in dictionary.keys
        and (always_attitude or np.isfinite(samples["attitude"][:, c]).any())
    ]
    return [
        ExportColumn("t", "s", samples["t"]),
        *measured,
        ExportColumn("state", "", samples["state"], words=tuple(state.value for state in STATES)),
        ExportColumn("p_value", "", samples["p_value"]),
        ExportColumn("alert", "", samples["alert"]),
        ExportColumn("manoeuvre", "", samples["manoeuvre"].astype(np.int32)),
        ExportColumn("in_manoeuvre", "", samples["manoeuvre"] >= 0),
        ExportColumn("withdrawn_p_value", "", samples["withdrawn"]),
        *predicted,
        *attitude,
    ]


def _table(export_columns: list[ExportColumn], names: list[str], rows: slice) -> "pa.Table":
    import pyarrow as pa

    arrays = []
    for column in export_columns:
        values = np.ascontiguousarray(column.values[rows])
        if column.words:
            words = pa.array(column.words)
            arrays.append(pa.DictionaryArray.from_arrays(values, words).cast(pa.string()))
        else:
            arrays.append(pa.array(values, from_pandas=True))
    return pa.table(arrays, names=names)


def _csv(export_columns: list[ExportColumn], about: Mapping[str, Any], file: BinaryIO) -> None:
    from pyarrow.csv import CSVWriter, WriteOptions

    names = [column.long_name for column in export_columns]
    options = WriteOptions(quoting_style="none", quoting_header="none")
    schema = _table(export_columns, names, slice(0)).schema
    with CSVWriter(file, schema, write_options=options) as writer:
        for begin in range(0, len(export_columns[0].values), BLOCK):
            writer.write_table(_table(export_columns, names, slice(begin, begin + BLOCK)))


def _parquet(export_columns: list[ExportColumn], about: Mapping[str, Any], file: BinaryIO) -> None:
    import pyarrow as pa
    from pyarrow.parquet import write_table

    table = _table(export_columns, [column.name for column in export_columns], slice(None))
    fields = [
        field.with_metadata({"unit": column.unit, "reference": "trim" if column.from_trim else ""})
        for field, column in zip(table.schema, export_columns, strict=True)
    ]
    schema = pa.schema(fields, metadata={"forewarn": _text(about)})
    write_table(table.cast(schema), file)


def _mat(export_columns: list[ExportColumn], about: Mapping[str, Any], file: BinaryIO) -> None:
    from scipy.io import savemat

    named = dict(zip(_matlab_names(export_columns), export_columns, strict=True))
    data = {name: np.ascontiguousarray(column.values) for name, column in named.items()}
    states = next(column for column in export_columns if column.words)
    names, data["state"] = np.unique(np.array(states.words)[states.values], return_inverse=True)
    units = {name: column.unit for name, column in named.items() if column.unit}
    data["state"] = data["state"].astype(np.uint8) + 1  # MATLAB counts from 1
    content = {
        **data,
        "state_names": names.astype(object),
        "units": units,
        "from_trim": np.array([name for name, column in named.items() if column.from_trim], object),
        "about": _text(about),
    }
    buffer = io.BytesIO()
    savemat(buffer, content, oned_as="column")
    file.write(MAT_TITLE.ljust(MAT_TITLE_BYTES))
    file.write(buffer.getbuffer()[MAT_TITLE_BYTES:])


def _matlab_names(export_columns: list[ExportColumn]) -> list[str]:
    """The columns' names as MATLAB allows them, each once."""
    names: list[str] = []
    for column in export_columns:
        name = re.sub(r"\W", "_", column.name, flags=re.ASCII)
        name = (name if name[:1].isalpha() else f"x{name}")[:MATLAB_LETTERS]
        suffix = f"_{len(names)}" if name in names else ""
        names.append(name[: MATLAB_LETTERS - len(suffix)] + suffix)
    return names


def _text(about: Mapping[str, Any]) -> str:
    return json.dumps(about, sort_keys=True)


EXPORTS: dict[str, ExportFormat] = {
    "csv": ExportFormat("text/csv", _csv),
    "parquet": ExportFormat("application/vnd.apache.parquet", _parquet),
    "mat": ExportFormat("application/x-matlab-data", _mat),
}
