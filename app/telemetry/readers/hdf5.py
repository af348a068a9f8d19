"""Read HDF5: a signal is a dataset, a column of a matrix or a field of a table."""

from pathlib import Path

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers import matlab, netcdf
from app.telemetry.readers.hdf5_objects import arrays, datasets, opened
from app.telemetry.readers.signal_tables import library_errors, write_tables


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read an HDF5 file, with the conventions of MATLAB or NetCDF if one of them wrote it."""
    with library_errors("HDF5"), opened(path) as file:
        for dialect in (matlab, netcdf):
            if dialect.wrote(file):
                return dialect.read_hdf5(file, writer)
        ignored: list[str] = []
        contents = arrays(datasets(file, ignored), ignored)
        write_tables(contents.all_tables(), writer, ignored)
        return writer.finish("hdf5", ignored=ignored)
