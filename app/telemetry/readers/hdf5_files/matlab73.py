"""Read MATLAB 7.3: HDF5 with dimensions stored last first and classes in attributes."""

import math
from collections.abc import Iterator

import h5py
import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.hdf5_files.arrays import arrays
from app.telemetry.readers.hdf5_files.walk import (
    Path,
    attribute,
    datasets,
    not_stored,
    text,
    unreadable,
)
from app.telemetry.readers.matlab_structures import SIGNALS, as_signals
from app.telemetry.readers.matrices import to_tables
from app.telemetry.readers.signal_tables import listed, write_tables

MARK = b"MATLAB"
MOST_TEXT = 4096
MOST_OF_ARRAY = 256
"""Most elements of an array of structures."""
OWN = frozenset({"#refs#", "#subsystem#"})
SPARSE = ("data", "ir", "jc")
OBJECT = "an object; save its numbers as plain vectors"
REASONS = {"cell": "a cell array", "function_handle": "a function"}
REASONS |= dict.fromkeys(("table", "timetable", "string", "datetime", "timeseries"), OBJECT)

Item = tuple[Path, h5py.Dataset]


def wrote(file: h5py.File) -> bool:
    """Whether MATLAB, or a program that writes like it, wrote a file."""
    with open(file.filename, "rb") as raw:
        return bool(file.userblock_size) and raw.read(len(MARK)) == MARK


def read_open(file: h5py.File, writer: ColumnWriter) -> Contents:
    ignored: list[str] = []
    texts: dict[Path, str] = {}
    numbers: list[Item] = []
    for path, dataset in _members(file, ignored):
        kind = text(attribute(dataset, "MATLAB_class"))
        if kind == "char":
            texts[path] = _text(dataset)
        elif reason := _no_numbers(path, dataset, kind):
            ignored.append(f"{'.'.join(path)}: {reason}")
        else:
            numbers.append((path, dataset))
    contents = arrays(numbers, ignored, separator=".", reverse=True)
    signals = as_signals(contents.matrices, texts)
    write_tables([*to_tables(signals), *contents.tables], writer, ignored, ".")
    return writer.finish("hdf5", ignored=listed(ignored))


def _members(file: h5py.File, ignored: list[str]) -> Iterator[Item]:
    """Datasets of variables and fields; those in Simulink's array of signals one by one."""
    for path, dataset in datasets(file, ignored, OWN):
        if path[-2:-1] != (SIGNALS,) or not h5py.check_ref_dtype(dataset.dtype):
            yield path, dataset
            continue
        if math.prod(dataset.shape or ()) > MOST_OF_ARRAY or not_stored(dataset):
            ignored.append(f"{'.'.join(path)}: an array of {dataset.size} structures")
            continue
        for number, reference in enumerate(np.ravel(dataset[()])):
            field = file[reference] if reference else None
            if isinstance(field, h5py.Dataset):
                yield (*path[:-2], f"{SIGNALS}[{number}]", path[-1]), field


def _no_numbers(path: Path, dataset: h5py.Dataset, kind: str) -> str:
    """Why a dataset of a class holds no signals, "" if it may."""
    if attribute(dataset, "MATLAB_empty"):
        return "no value"
    if path[-1] in SPARSE and attribute(dataset.parent, "MATLAB_sparse") is not None:
        return "a sparse matrix"
    if attribute(dataset, "MATLAB_object_decode") is not None:
        return OBJECT
    if h5py.check_ref_dtype(dataset.dtype):
        return REASONS.get(kind, "an array of structures")
    return REASONS.get(kind, "")


def _text(dataset: h5py.Dataset) -> str:
    """A row of characters; "" if empty or too long."""
    if (
        unreadable(dataset)
        or math.prod(dataset.shape) > MOST_TEXT
        or attribute(dataset, "MATLAB_empty")
    ):
        return ""
    codes = np.ravel(dataset[()])
    return "".join(map(chr, codes)).strip() if codes.dtype.kind == "u" else ""
