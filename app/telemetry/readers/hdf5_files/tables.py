"""Read tables in HDF5: datasets of a compound type, whose fields are signals."""

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import h5py
import numpy as np

from app.telemetry.readers.hdf5_files.walk import Path, attribute, not_numeric, text
from app.telemetry.readers.signal_tables import BLOCK, Column, Pieces, SignalTable, is_time_name

MOST_NESTING = 8
"""Deepest nesting of compound types."""

Keys = tuple[Any, ...]


def table(path: Path, name: str, dataset: h5py.Dataset, ignored: list[str]) -> SignalTable | str:
    """Make columns of a table's fields, or return why not; units from its attribute."""
    if dataset.ndim != 1:
        return f"{name}: a table of {dataset.ndim} dimensions"
    fields = list(_fields(dataset.dtype, (), name, ignored))
    units = attribute(dataset, "units")
    names = dataset.dtype.names
    unit_of = (
        dict(zip(names, map(text, units), strict=True)) if np.shape(units) == (len(names),) else {}
    )
    columns = tuple(
        Column(f"{name}/{label}", unit_of.get(keys[0], ""), "", is_time_name(label))
        for label, keys in fields
    )
    pieces = partial(_rows, dataset, [keys for _, keys in fields])
    return SignalTable(path, columns, len(dataset), pieces)


def _fields(
    dtype: np.dtype[Any], outer: Keys, place: str, ignored: list[str]
) -> Iterator[tuple[str, Keys]]:
    """(label, keys to reach it) of every number in a compound type, arrays by element."""
    for name in dtype.names or ():
        kind, label = dtype[name], ".".join((*outer, name))
        if len(outer) > MOST_NESTING:
            ignored.append(f"{place}/{label}: nested too deeply")
        elif reason := not_numeric(kind):
            ignored.append(f"{place}/{label}: {reason}")
        elif kind.names:
            yield from _fields(kind, (*outer, name), place, ignored)
        elif kind.subdtype and (len(kind.shape) > 1 or kind.base.names):
            ignored.append(f"{place}/{label}: several dimensions in one field")
        elif kind.subdtype:
            for k in range(math.prod(kind.shape)):
                yield f"{label}[{k}]", (*outer, name, (slice(None), k))
        else:
            yield label, (*outer, name)


def _rows(dataset: h5py.Dataset, fields: list[Keys]) -> Pieces:
    """Read a table in whole chunks of rows."""
    chunk = dataset.chunks[0] if dataset.chunks else 1
    step = max(8 * BLOCK // dataset.dtype.itemsize // chunk, 1) * chunk
    for first in range(0, len(dataset), step):
        block = dataset[first : first + step]
        for number, keys in enumerate(fields):
            values = block
            for key in keys:
                values = values[key]
            yield number, values
