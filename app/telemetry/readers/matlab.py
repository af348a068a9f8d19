"""Read MATLAB files of version 5 and 7.3: variables and fields of structures.

Version 7.3 is HDF5 with dimensions stored last first and classes in attributes. The library trusts
the declarations of a version 5 file. If they are wrong it may run out of memory or crash, which
only ends the reader process.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.hdf5 import (
    Keys,
    arrays,
    attribute,
    datasets,
    not_stored,
    text,
    unreadable,
)
from app.telemetry.readers.signal_tables import (
    DESCRIPTION_NAMES,
    Column,
    Matrix,
    is_time_name,
    library_errors,
    matrix,
    to_tables,
    write_tables,
)

MOST_TEXT = 4096
MOST_OF_ARRAY = 256
"""Most elements of an array of structures."""
VALUE_NAMES = ("data", "values", "value")
UNIT_NAMES = ("unit", "units")
SIGNALS = "signals"
INTEGERS = (f"{sign}int{n}" for sign in ("", "u") for n in (8, 16, 32, 64))
NUMBERS = frozenset(("double", "single", "logical", *INTEGERS))
OBJECT = "an object; save its numbers as plain vectors"
SPARSE = "a sparse matrix"
REASONS = {
    "cell": "a cell array",
    "sparse": SPARSE,
    **dict.fromkeys(("function", "function_handle"), "a function"),
    **dict.fromkeys(("object", "opaque", "string", "datetime"), OBJECT),
    **dict.fromkeys(("table", "timetable", "timeseries"), OBJECT),
}
"""By class of a variable, why it is not read."""
MARK = b"MATLAB"
OWN = frozenset({"#refs#", "#subsystem#"})
SPARSE_FIELDS = ("data", "ir", "jc")


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a MATLAB 5 file; structures of time and data become groups."""
    with library_errors("MATLAB"):
        ignored, texts = list[str](), dict[Keys, str]()
        matrices = dict(_loaded(path, texts, ignored))
        write_tables(to_tables(as_signals(matrices, texts)), writer, ignored, ".")
        return writer.finish("matlab5", ignored=ignored)


def _loaded(
    path: Path, texts: dict[Keys, str], ignored: list[str]
) -> Iterator[tuple[Keys, Matrix]]:
    """Read the variables that can hold signals or describe them."""
    from scipy.io import loadmat, whosmat

    wanted = []
    for name, shape, kind in whosmat(path, appendmat=False):
        if name.startswith("__"):
            continue
        is_text = kind == "char" and math.prod(shape) <= MOST_TEXT
        if kind in NUMBERS or is_text or kind == "struct":
            wanted.append(name)
        else:
            ignored.append(f"{name}: {REASONS.get(kind, 'text')}")
    values = loadmat(path, appendmat=False, variable_names=wanted) if wanted else {}
    for keys, value in _fields([((name,), values[name]) for name in wanted if name in values]):
        name = ".".join(keys)
        if type(value) is not np.ndarray:
            ignored.append(f"{name}: {SPARSE if hasattr(value, 'nnz') else OBJECT}")
        elif value.dtype.kind == "U" and value.size == 1:
            texts[keys] = str(value.reshape(-1)[0]).strip()[:MOST_TEXT]
        elif value.dtype.kind in "biuf":
            array = matrix(keys[:-1], Column(name), value.shape, value.__getitem__)
            if isinstance(array, Matrix):
                yield keys, array
            else:
                ignored.append(array)
        elif value.size:
            kinds = {"c": "complex", "V": "an array of structures", "O": "a cell array"}
            ignored.append(f"{name}: {kinds.get(value.dtype.kind, 'text')}")


def _fields(pending: list[tuple[Keys, Any]]) -> Iterator[tuple[Keys, Any]]:
    """Every field of nested structures, in order."""
    pending.reverse()
    while pending:
        keys, value = pending.pop()
        names = value.dtype.names if type(value) is np.ndarray else None
        if not names or (value.size != 1 and keys[-1].lower() != SIGNALS):
            yield keys, value
            continue
        for number, element in reversed(list(enumerate(value.reshape(-1)))):
            place = keys if value.size == 1 else (*keys[:-1], f"{keys[-1]}[{number}]")
            pending += [((*place, name), element[name]) for name in reversed(names)]


def wrote(file: h5py.File) -> bool:
    """Whether MATLAB, or a program that writes like it, wrote an HDF5 file."""
    with open(file.filename, "rb") as raw:
        return bool(file.userblock_size) and raw.read(len(MARK)) == MARK


def read_hdf5(file: h5py.File, writer: ColumnWriter) -> Contents:
    ignored: list[str] = []
    texts: dict[Keys, str] = {}
    numbers: list[tuple[Keys, h5py.Dataset]] = []
    for keys, dataset in _members(file, ignored):
        kind = text(attribute(dataset, "MATLAB_class"))
        if kind == "char":
            texts[keys] = _characters(dataset)
        elif reason := _no_numbers(keys, dataset, kind):
            ignored.append(f"{'.'.join(keys)}: {reason}")
        else:
            numbers.append((keys, dataset))
    contents = arrays(numbers, ignored, separator=".", reverse=True)
    signals = as_signals(contents.matrices, texts)
    write_tables([*to_tables(signals), *contents.tables], writer, ignored, ".")
    return writer.finish("hdf5", ignored=ignored)


def _members(file: h5py.File, ignored: list[str]) -> Iterator[tuple[Keys, h5py.Dataset]]:
    """Datasets of variables and fields; those in Simulink's array of signals one by one."""
    for keys, dataset in datasets(file, ignored, OWN):
        if keys[-2:-1] != (SIGNALS,) or not h5py.check_ref_dtype(dataset.dtype):
            yield keys, dataset
            continue
        if math.prod(dataset.shape or ()) > MOST_OF_ARRAY or not_stored(dataset):
            ignored.append(f"{'.'.join(keys)}: an array of {dataset.size} structures")
            continue
        for number, reference in enumerate(np.ravel(dataset[()])):
            field = file[reference] if reference else None
            if isinstance(field, h5py.Dataset):
                yield (*keys[:-2], f"{SIGNALS}[{number}]", keys[-1]), field


def _no_numbers(keys: Keys, dataset: h5py.Dataset, kind: str) -> str:
    """Why a dataset of a class holds no signals, "" if it may."""
    if attribute(dataset, "MATLAB_empty"):
        return "no value"
    if keys[-1] in SPARSE_FIELDS and attribute(dataset.parent, "MATLAB_sparse") is not None:
        return SPARSE
    if attribute(dataset, "MATLAB_object_decode") is not None:
        return OBJECT
    is_reference = h5py.check_ref_dtype(dataset.dtype)
    return REASONS.get(kind, "an array of structures" if is_reference else "")


def _characters(dataset: h5py.Dataset) -> str:
    """A row of characters; "" if empty or too long."""
    is_empty = unreadable(dataset) or attribute(dataset, "MATLAB_empty")
    if is_empty or math.prod(dataset.shape) > MOST_TEXT:
        return ""
    codes = np.ravel(dataset[()])
    return "".join(map(chr, codes)).strip() if codes.dtype.kind == "u" else ""


def as_signals(matrices: Mapping[Keys, Matrix], texts: Mapping[Keys, str]) -> list[Matrix]:
    """Name the arrays of a file; find their times and units. Both arguments are by path of a field.

    A structure of time and data is a signal with the structure's name. The `signals` of a
    "Structure with time" are signals named by their labels. A structure of data without a time
    belongs to the group of its neighbours, and may be their time. Others have their MATLAB names.
    """
    lowered = {tuple(part.lower() for part in keys): text for keys, text in texts.items()}
    with_time = {keys[:-1] for keys in matrices if is_time_name(keys[-1])}
    return [_signal(keys, array, lowered, with_time) for keys, array in matrices.items()]


def _signal(
    keys: Keys, array: Matrix, texts: Mapping[Keys, str], with_time: Collection[Keys]
) -> Matrix:
    within, field = keys[:-1], keys[-1]
    low = tuple(part.lower() for part in keys)
    name = ".".join(keys)
    unit, description = (_beside(low, texts, names) for names in (UNIT_NAMES, DESCRIPTION_NAMES))
    if within and low[-1] in VALUE_NAMES:
        name = ".".join(within)
        unit = _within(low[:-1], texts, UNIT_NAMES) or unit
        description = _within(low[:-1], texts, DESCRIPTION_NAMES) or description
        if low[-2].startswith(SIGNALS):
            name = texts.get((*low[:-1], "label"), "") or name
        elif within not in with_time:
            within, field = within[:-1], within[-1]
    column = Column(name, unit, description, is_time_name(field))
    return replace(array, within=within, column=column)


def _within(low: Keys, texts: Mapping[Keys, str], names: tuple[str, ...]) -> str:
    """Text in a structure about its data, or in the DataInfo of a timeseries."""
    places = [(*low, *more, name) for more in ((), ("datainfo",)) for name in names]
    return next((texts[place] for place in places if place in texts), "")


def _beside(low: Keys, texts: Mapping[Keys, str], names: tuple[str, ...]) -> str:
    """Text in a neighbouring field: `beta_unit`, or `units.beta`."""
    *within, field = low
    places = [
        place for name in names for place in ((*within, f"{field}_{name}"), (*within, name, field))
    ]
    return next((texts[place] for place in places if place in texts), "")
