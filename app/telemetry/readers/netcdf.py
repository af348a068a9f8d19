"""Read NetCDF 3, and NetCDF 4 through HDF5; a group is a dimension."""

from functools import partial
from pathlib import Path
from typing import Any

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.cf import Conventions
from app.telemetry.readers.library_errors import library_errors
from app.telemetry.readers.matrices import Matrix, matrix, to_tables
from app.telemetry.readers.signal_tables import listed, write_tables

TITLE = "NetCDF"
CLASSIC = b"CDF"


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a NetCDF file of either generation, with missing and packed values."""
    with library_errors(TITLE):
        with path.open("rb") as file:
            classic = file.read(len(CLASSIC)) == CLASSIC
        return _read_classic(path, writer) if classic else _read_hdf5(path, writer)


def _read_hdf5(path: Path, writer: ColumnWriter) -> Contents:
    import h5py

    from app.telemetry.readers.hdf5_files.netcdf4 import read_open

    with h5py.File(path, "r", locking=False, rdcc_nbytes=0) as file:
        return read_open(file, writer)


def _read_classic(path: Path, writer: ColumnWriter) -> Contents:
    """Read memory-mapped, so that only the part being written is in memory."""
    from scipy.io import netcdf_file

    ignored: list[str] = []
    conventions = Conventions()
    matrices = []
    with path.open("rb") as opened, netcdf_file(opened, mmap=True) as file:
        for name, variable in file.variables.items():
            if variable.data.dtype.kind not in "iuf":
                ignored.append(f"{name}: text")
                continue
            column, unpack = conventions.variable(
                name, partial(_attribute, variable), variable.data.dtype
            )
            data = variable.data
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
    start = conventions.start.iso if conventions.start else ""
    return writer.finish("netcdf", start=start, ignored=listed(ignored))


def _attribute(variable: Any, name: str) -> Any:
    value = getattr(variable, name, None)
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value
