"""Read NetCDF 3, and NetCDF 4 through HDF5; a group is a dimension.

Climate and Forecast metadata conventions, "Units", "Missing data" and "Packed data". A variable
without a _FillValue has the default of its type, as in the NetCDF library.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.hdf5 import Unpack, arrays, attribute, datasets, opened, text
from app.telemetry.readers.signal_tables import (
    Column,
    Matrix,
    declared_rate,
    is_time_name,
    library_errors,
    matrix,
    to_tables,
    write_tables,
)
from app.telemetry.units import factor, fits, spelled
from core.types import Array

CLASSIC = b"CDF"
SINCE = re.compile(
    r"(?P<unit>[a-z]+)\s+since\s+(?P<Y>\d{1,4})-(?P<m>\d\d?)-(?P<d>\d\d?)"
    r"(?:[T ]+(?P<H>\d\d?):(?P<M>\d\d?)(?::(?P<S>[0-5]?\d(?:\.\d+)?))?)?"
    r"\s*(?:Z|UTC|GMT|(?P<sign>[+-])(?P<hours>\d\d?):?(?P<minutes>\d\d)?)?",
    re.IGNORECASE,
)
DEFAULT_FILL: dict[str, float] = {
    "i2": -32767,
    "u2": 65535,
    "i4": -2147483647,
    "u4": 4294967295,
    "i8": -9223372036854775806,
    "u8": 18446744073709551614,
    "f4": 9.969209968386869e36,
    "f8": 9.969209968386869e36,
}
MOST_FILLS = 16


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a NetCDF file of either generation, with missing and packed values."""
    with library_errors("NetCDF"):
        with path.open("rb") as file:
            classic = file.read(len(CLASSIC)) == CLASSIC
        if classic:
            return _read_classic(path, writer)
        with opened(path) as file:
            return read_hdf5(file, writer)


def wrote(file: h5py.File) -> bool:
    """Whether the NetCDF library, or a program that writes like it, wrote a file."""
    return "_NCProperties" in file.attrs


def read_hdf5(file: h5py.File, writer: ColumnWriter) -> Contents:
    ignored: list[str] = []
    conventions = Conventions()

    def describe(name: str, dataset: h5py.Dataset) -> tuple[Column, Unpack]:
        def value_of(key: str) -> Any:
            value = attribute(dataset, key)
            return text(value) or value

        return conventions.variable(name, value_of, dataset.dtype)

    contents = arrays(datasets(file, ignored), ignored, describe)
    write_tables(contents.all_tables(), writer, ignored)
    return writer.finish("netcdf", start=conventions.start_text, ignored=ignored)


def _read_classic(path: Path, writer: ColumnWriter) -> Contents:
    """Read memory-mapped, so that only the part being written is in memory."""
    from scipy.io import netcdf_file

    ignored: list[str] = []
    conventions = Conventions()
    matrices = []
    with path.open("rb") as raw, netcdf_file(raw, mmap=True) as file:
        for name, variable in file.variables.items():
            data = variable.data
            if data.dtype.kind not in "iuf":
                ignored.append(f"{name}: text")
                continue
            value_of = partial(_classic_attribute, variable)
            column, unpack = conventions.variable(name, value_of, data.dtype)
            array = matrix(
                (),
                column,
                data.shape,
                lambda index, data=data, unpack=unpack: unpack(data[index]),
                clocks=tuple((dimension,) for dimension in variable.dimensions),
            )
            if isinstance(array, Matrix):
                matrices.append(array)
            else:
                ignored.append(array)
        write_tables(to_tables(matrices), writer, ignored)
    return writer.finish("netcdf", start=conventions.start_text, ignored=ignored)


def _classic_attribute(variable: Any, name: str) -> Any:
    value = getattr(variable, name, None)
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


@dataclass(frozen=True)
class Since:
    """Time counted from a moment, in UTC unless a zone is given. unit: of time."""

    unit: str
    moment: datetime


def since(unit: str) -> Since | None:
    """Parse "seconds since 2024-05-01 09:30:00"; None for other units."""
    match = SINCE.fullmatch(unit.strip())
    if not match or not fits(match["unit"], "s"):
        return None
    try:
        moment = datetime(*(int(match[part] or 0) for part in "YmdHM"), tzinfo=UTC)
    except ValueError:
        return None
    zone = timedelta(hours=int(match["hours"] or 0), minutes=int(match["minutes"] or 0))
    moment += timedelta(seconds=float(match["S"] or 0)) + (zone if match["sign"] == "-" else -zone)
    return Since(spelled(match["unit"]), moment)


@dataclass(frozen=True, eq=False)
class Packing:
    """How the numbers of a variable are stored. missing: stored values that mean missing.

    value = scale * stored + offset, valid for lowest <= stored <= highest.
    """

    missing: tuple[float, ...]
    scale: float
    offset: float
    lowest: float
    highest: float

    def unpack(self, stored: npt.NDArray[Any]) -> Array:
        values = stored.astype(np.float64)
        is_missing = (values < self.lowest) | (values > self.highest)
        for value in self.missing:
            is_missing |= values == value
        values[is_missing] = np.nan
        is_unscaled = (self.scale, self.offset) == (1.0, 0.0)
        return values if is_unscaled else self.scale * values + self.offset


@dataclass(eq=False)
class Conventions:
    """The variables of one file. start: origin of the first time variable."""

    start: Since | None = None

    @property
    def start_text(self) -> str:
        return self.start.moment.replace(tzinfo=None).isoformat() + "Z" if self.start else ""

    def variable(
        self, name: str, attribute: Callable[[str], Any], dtype: np.dtype[Any]
    ) -> tuple[Column, Unpack]:
        """The column of a variable, and a function that unpacks its numbers.

        Later times are shifted to the origin of the first. attribute: value by name, None if
        missing; text as str.
        """

        def words(key: str) -> str:
            value = attribute(key)
            return value.strip() if isinstance(value, str) else ""

        unit, packing = words("units"), _packing(attribute, dtype)
        if counted := since(unit):
            unit = counted.unit
            self.start = self.start or counted
            later = (counted.moment - self.start.moment).total_seconds() / factor(unit, "s")
            packing = replace(packing, offset=packing.offset + later)
        named = is_time_name(name.split("/")[-1]) or words("standard_name") == "time"
        time = counted is not None or named or words("axis").upper() == "T"
        column = Column(name, unit, words("long_name"), time, *declared_rate(attribute))
        return column, packing.unpack


def _packing(attribute: Callable[[str], Any], dtype: np.dtype[Any]) -> Packing:
    """Read the packing attributes of a variable; attributes that are not numbers are ignored."""

    def numbers(key: str) -> tuple[float, ...]:
        value = attribute(key)
        values = np.asarray(() if value is None else value).reshape(-1)[:MOST_FILLS]
        if values.dtype.kind not in "iuf":
            return ()
        return tuple(float(value) for value in values if not np.isnan(value))

    def first(key: str, default: float) -> float:
        return (*numbers(key), default)[0]

    fill = numbers("_FillValue")
    if not fill and (kind := dtype.str[1:]) in DEFAULT_FILL:
        fill = (float(dtype.type(DEFAULT_FILL[kind])),)
    valid = numbers("valid_range")
    low, high = valid if len(valid) == 2 else (-np.inf, np.inf)
    return Packing(
        fill + numbers("missing_value"),
        first("scale_factor", 1.0),
        first("add_offset", 0.0),
        first("valid_min", low),
        first("valid_max", high),
    )
