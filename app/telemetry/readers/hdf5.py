"""Read HDF5: a signal is a dataset, a column of a matrix or a field of a table."""

from pathlib import Path

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.library_errors import library_errors
from app.telemetry.readers.signal_tables import listed, write_tables

TITLE = "HDF5"


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read an HDF5 file, with the conventions of MATLAB or NetCDF if one of them wrote it."""
    with library_errors(TITLE):
        import h5py

        from app.telemetry.readers.hdf5_files import matlab73, netcdf4
        from app.telemetry.readers.hdf5_files.arrays import arrays
        from app.telemetry.readers.hdf5_files.walk import datasets

        with h5py.File(path, "r", locking=False, rdcc_nbytes=0) as file:
            for dialect in (matlab73, netcdf4):
                if dialect.wrote(file):
                    return dialect.read_open(file, writer)
            ignored: list[str] = []
            contents = arrays(datasets(file, ignored), ignored)
            write_tables(contents.all_tables(), writer, ignored)
            return writer.finish("hdf5", ignored=listed(ignored))
