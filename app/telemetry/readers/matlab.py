"""Read MATLAB files of version 4, 5 and 7.3: variables and fields of structures.

The library trusts the declarations of a version 5 file. If they are wrong it may run out of memory
or crash, which only ends the reader process.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.library_errors import library_errors, too_deep
from app.telemetry.readers.matlab_structures import SIGNALS, as_signals
from app.telemetry.readers.matrices import Matrix, matrix, to_tables
from app.telemetry.readers.signal_tables import Column, listed, write_tables
from app.telemetry.recording import TelemetryError

TITLE = "MATLAB"
MOST_MEMORY = 1 << 30
"""Most memory for the variables of a file, which are read whole [bytes]."""
MOST_TEXT = 4096
MOST_DEPTH = 32
INTEGERS = (f"{sign}int{n}" for sign in ("", "u") for n in (8, 16, 32, 64))
NUMBERS = frozenset(("double", "single", "logical", *INTEGERS))
REASONS = {
    "cell": "a cell array",
    "sparse": "a sparse matrix",
    "function": "a function",
    "object": "an object; save its numbers as plain vectors",
    "opaque": "an object; save its numbers as plain vectors",
}

Keys = tuple[str, ...]


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a MATLAB file; structures of time and data become groups."""
    with library_errors(TITLE):
        from scipy.io.matlab import matfile_version

        version = matfile_version(path, appendmat=False)[0]
        if version == 2:
            return _read_hdf5(path, writer)
        loaded = _load(path, min(MOST_MEMORY, writer.most_bytes))
        tables = to_tables(as_signals(loaded.arrays, loaded.texts))
        write_tables(tables, writer, loaded.ignored, ".")
        return writer.finish("matlab5", ignored=listed(loaded.ignored))


def _read_hdf5(path: Path, writer: ColumnWriter) -> Contents:
    import h5py

    from app.telemetry.readers.hdf5_files.matlab73 import read_open

    with h5py.File(path, "r", locking=False, rdcc_nbytes=0) as file:
        return read_open(file, writer)


@dataclass(eq=False)
class Loaded:
    """The variables of a file by the path of their field."""

    arrays: dict[Keys, Matrix] = field(default_factory=dict)
    texts: dict[Keys, str] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)


def _load(path: Path, most_bytes: int) -> Loaded:
    """Read the variables that can hold signals or describe them."""
    from scipy.io import loadmat, whosmat

    loaded, wanted = Loaded(), []
    for name, shape, kind in whosmat(path, appendmat=False):
        n = math.prod(shape)
        if name.startswith("__"):
            continue
        if kind in NUMBERS and n > most_bytes:
            loaded.ignored.append(f"{name}: {n} numbers, more than can be read")
        elif kind in NUMBERS or (kind == "char" and n <= MOST_TEXT) or kind == "struct":
            wanted.append(name)
        else:
            loaded.ignored.append(f"{name}: {REASONS.get(kind, 'text')}")
    values = loadmat(path, appendmat=False, variable_names=wanted) if wanted else {}
    for keys, value in _fields(((name,), values[name]) for name in wanted if name in values):
        _add(loaded, keys, value)
    return loaded


def _fields(stack: Any) -> Iterator[tuple[Keys, Any]]:
    """Every field of nested structures, in order."""
    pending = list(stack)[::-1]
    while pending:
        keys, value = pending.pop()
        if len(keys) > MOST_DEPTH:
            raise TelemetryError(too_deep(TITLE))
        names = value.dtype.names if type(value) is np.ndarray else None
        if not names or (value.size != 1 and keys[-1].lower() != SIGNALS):
            yield keys, value
            continue
        for number, element in reversed(list(enumerate(value.reshape(-1)))):
            place = keys if value.size == 1 else (*keys[:-1], f"{keys[-1]}[{number}]")
            pending += [((*place, name), element[name]) for name in reversed(names)]


def _add(loaded: Loaded, keys: Keys, value: Any) -> None:
    name = ".".join(keys)
    if type(value) is not np.ndarray:
        loaded.ignored.append(f"{name}: {REASONS['sparse' if hasattr(value, 'nnz') else 'object']}")
    elif value.dtype.kind == "U" and value.size == 1:
        loaded.texts[keys] = str(value.reshape(-1)[0]).strip()[:MOST_TEXT]
    elif value.dtype.kind in "biuf":
        array = matrix(keys[:-1], Column(name), value.shape, value.__getitem__)
        if isinstance(array, Matrix):
            loaded.arrays[keys] = array
        else:
            loaded.ignored.append(array)
    elif value.size:
        kinds = {"c": "complex", "V": "an array of structures", "O": "a cell array"}
        loaded.ignored.append(f"{name}: {kinds.get(value.dtype.kind, 'text')}")
