"""Read NetCDF 4: HDF5 with dimension scales and the CF conventions."""

from typing import Any

import h5py

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.cf import Conventions
from app.telemetry.readers.hdf5_files.arrays import Unpack, arrays
from app.telemetry.readers.hdf5_files.walk import attribute, datasets, text
from app.telemetry.readers.signal_tables import Column, listed, write_tables


def wrote(file: h5py.File) -> bool:
    """Whether the NetCDF library, or a program that writes like it, wrote a file."""
    return "_NCProperties" in file.attrs


def read_open(file: h5py.File, writer: ColumnWriter) -> Contents:
    ignored: list[str] = []
    conventions = Conventions()

    def describe(name: str, dataset: h5py.Dataset) -> tuple[Column, Unpack]:
        def value_of(key: str) -> Any:
            value = attribute(dataset, key)
            return text(value) or value

        return conventions.variable(name, value_of, dataset.dtype)

    contents = arrays(datasets(file, ignored), ignored, describe)
    write_tables(contents.all_tables(), writer, ignored)
    start = conventions.start.iso if conventions.start else ""
    return writer.finish("netcdf", start=start, ignored=listed(ignored))
