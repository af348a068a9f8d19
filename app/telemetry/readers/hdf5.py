"""Read HDF5: a signal is a dataset, a column of a matrix or a field of a table.

Never reads other files, or a group twice.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial, reduce
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import (
    BLOCK,
    DESCRIPTION_NAMES,
    UNIT_NAMES,
    Clock,
    Column,
    Matrix,
    Pieces,
    SignalTable,
    declared_rate,
    is_time_name,
    library_errors,
    matrix,
    to_tables,
    write_tables,
)

MOST_TEXT = 1 << 12

Keys = tuple[str, ...]
"""Path of a dataset."""
Address = tuple[int, int]


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read an HDF5 file, with the conventions of MATLAB or NetCDF if one of them wrote it."""
    from app.telemetry.readers import matlab, netcdf  # which import this module

    with library_errors("HDF5"), opened(path) as file:
        for dialect in (matlab, netcdf):
            if dialect.wrote(file):
                return dialect.read_hdf5(file, writer)
        ignored: list[str] = []
        contents = arrays(datasets(file, ignored), ignored)
        write_tables(contents.all_tables(), writer, ignored)
        return writer.finish("hdf5", ignored=ignored)


def opened(path: Path) -> h5py.File:
    return h5py.File(path, "r", locking=False, rdcc_nbytes=0)


def datasets(
    file: h5py.File, ignored: list[str], skip: frozenset[str] = frozenset()
) -> Iterator[tuple[Keys, h5py.Dataset]]:
    """Every dataset of a file, each group once, in the order of names.

    Links to other files and soft links are not followed. skip: groups at the root to omit.
    """
    visited = {address(file)}
    stack: list[tuple[Keys, h5py.Group]] = [((), file)]
    while stack:
        path, group = stack.pop()
        inner = []
        for name in group:
            if isinstance(name, bytes):
                shown = name.decode("utf-8", "replace")
                ignored.append(f"{'/'.join((*path, shown))}: the name is not UTF-8")
                continue
            place = (*path, str(name))
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                ignored.append(f"{'/'.join(place)}: links to other files are not followed")
            if not isinstance(link, h5py.HardLink) or (not path and name in skip):
                continue
            member = group[name]
            if isinstance(member, h5py.Dataset):
                yield place, member
            elif isinstance(member, h5py.Group) and (at := address(member)) not in visited:
                visited.add(at)
                inner.append((place, member))
        stack += reversed(inner)


def unreadable(dataset: h5py.Dataset) -> str:
    """Why a dataset cannot be read, "" if it can."""
    if reason := not_stored(dataset):
        return reason
    try:
        dtype = dataset.dtype
    except TypeError:
        return "unreadable type"
    if not is_numeric(dtype):
        return "no numbers"
    if not dataset.id.get_storage_size():
        return "nothing written"
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(k) for k in range(properties.get_nfilters())]
    if missing := [f for f in filters if not h5py.h5z.filter_avail(f[0])]:
        name = missing[0][3].decode("utf-8", "replace") or missing[0][0]
        return f"compressed by {name}, which is not installed"
    return ""


def not_stored(dataset: h5py.Dataset) -> str:
    """Why a dataset has no values in its file, "" if it has."""
    if dataset.is_virtual or dataset.id.get_create_plist().get_external_count():
        return "its numbers are in other files"
    if dataset.shape is None or math.prod(dataset.shape) == 0:
        return "no value"
    return ""


def is_numeric(dtype: Any) -> bool:
    """Whether values of a type are real numbers, or those of a field of a table."""
    if dtype.names:
        is_complex = set(dtype.names) in ({"real", "imag"}, {"r", "i"})
        return not is_complex and any(is_numeric(dtype[name].base) for name in dtype.names)
    return dtype.base.kind in "biuf"


def attribute(holder: Any, name: str) -> Any:
    """An attribute as h5py returns it, None if missing or unreadable."""
    try:
        return holder.attrs.get(name)
    except (OSError, TypeError, UnicodeDecodeError):
        return None


def text(value: Any) -> str:
    """An attribute as text, "" if it is not a single text."""
    if hasattr(value, "reshape") and getattr(value, "size", 0) == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return str(value).strip(" \0")[:MOST_TEXT] if isinstance(value, str) else ""


def first_text(holder: Any, names: tuple[str, ...]) -> str:
    return next((value for name in names if (value := text(attribute(holder, name)))), "")


def address(holder: Any) -> Address:
    """Address of an object in its file, equal under all its names."""
    return h5py.h5g.get_objinfo(holder.id).objno


def table(keys: Keys, name: str, dataset: h5py.Dataset, ignored: list[str]) -> SignalTable | str:
    """Make columns of the fields of a compound type, or return why not."""
    if dataset.ndim != 1:
        return f"{name}: a table of {dataset.ndim} dimensions"
    fields = list(_fields(dataset.dtype, (), name, ignored))
    units, names = attribute(dataset, "units"), dataset.dtype.names
    given = map(text, units) if np.shape(units) == (len(names),) else [""] * len(names)
    unit_of = dict(zip(names, given, strict=True))
    columns = tuple(
        Column(f"{name}/{label}", unit_of[path[0]], "", is_time_name(label))
        for label, path in fields
    )
    return SignalTable(
        keys, columns, len(dataset), partial(_rows, dataset, [path for _, path in fields])
    )


def _fields(
    dtype: np.dtype[Any], outer: tuple[Any, ...], place: str, ignored: list[str]
) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """(label, keys to reach it) of every number in a compound type, arrays by element."""
    for name in dtype.names or ():
        kind, label = dtype[name], ".".join((*outer, name))
        if not is_numeric(kind):
            ignored.append(f"{place}/{label}: no numbers")
        elif kind.names:
            yield from _fields(kind, (*outer, name), place, ignored)
        elif kind.subdtype and (len(kind.shape) > 1 or kind.base.names):
            ignored.append(f"{place}/{label}: several dimensions in one field")
        elif kind.subdtype:
            for k in range(math.prod(kind.shape)):
                yield f"{label}[{k}]", (*outer, name, (slice(None), k))
        else:
            yield label, (*outer, name)


def _rows(dataset: h5py.Dataset, fields: list[tuple[Any, ...]]) -> Pieces:
    """Read a table in whole chunks of rows."""
    chunk = dataset.chunks[0] if dataset.chunks else 1
    step = max(8 * BLOCK // dataset.dtype.itemsize // chunk, 1) * chunk
    for first in range(0, len(dataset), step):
        block = dataset[first : first + step]
        for number, path in enumerate(fields):
            yield number, reduce(lambda values, key: values[key], path, block)


MOST_SCALES = 16
"""Most scales of a dimension; a damaged file may claim billions, which the library would visit."""
DATA, MASK = "data", "mask"
"""A parameter of a flight data recorder is a group of these, with a rate attribute."""
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"

Unpack = Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
Describe = Callable[[str, h5py.Dataset], tuple[Column, Unpack | None]]


@dataclass(eq=False)
class Arrays:
    """The numeric arrays of a file by path, and its tables."""

    matrices: dict[Keys, Matrix] = field(default_factory=dict)
    tables: list[SignalTable] = field(default_factory=list)

    def all_tables(self) -> list[SignalTable]:
        return [*to_tables(self.matrices.values()), *self.tables]


def plain(name: str, dataset: h5py.Dataset) -> tuple[Column, Unpack | None]:
    """Read unit, description and rate from the attributes of a dataset, or of its group for a
    parameter; a dimension scale is a time.
    """
    holder = dataset
    if _is_parameter(dataset):
        name, holder = name.rpartition("/")[0], dataset.parent
    unit, description = first_text(holder, UNIT_NAMES), first_text(holder, DESCRIPTION_NAMES)
    time = is_time_name(name.split("/")[-1]) or _is_scale(dataset)
    return Column(name, unit, description, time, *declared_rate(partial(attribute, holder))), None


def arrays(
    members: Iterable[tuple[Keys, h5py.Dataset]],
    ignored: list[str],
    describe: Describe = plain,
    *,
    separator: str = "/",
    reverse: bool = False,
) -> Arrays:
    """Collect datasets; those without numbers are added to `ignored` with the reason.

    describe: returns the column of a dataset, and a function that unpacks its numbers.
    reverse: whether dimensions are stored last first.
    """
    readable: dict[Keys, h5py.Dataset] = {}
    scales: dict[Address, Keys] = {}
    for keys, dataset in members:
        if _is_scale(dataset):
            scales[address(dataset)] = keys
            if NO_VARIABLE in text(attribute(dataset, "NAME")):
                continue
        if reason := unreadable(dataset):
            ignored.append(f"{separator.join(keys)}: {reason}")
        else:
            readable[keys] = dataset
    masks = {
        keys: (*keys[:-1], MASK)
        for keys, dataset in readable.items()
        if _is_parameter(dataset)
        and (mask := readable.get((*keys[:-1], MASK)))
        and mask.shape == dataset.shape
    }
    result, is_mask = Arrays(), set(masks.values())
    for keys, dataset in readable.items():
        name = separator.join(keys)
        if keys in is_mask:
            continue
        if dataset.dtype.names:
            array = table(keys, name, dataset, ignored)
        else:
            column, unpack = describe(name, dataset)
            array = matrix(
                keys[:-1],
                column,
                dataset.shape,
                partial(_take, dataset, unpack, readable[masks[keys]] if keys in masks else None),
                chunks=dataset.chunks,
                clocks=tuple(_clock(dataset, k, keys, scales) for k in range(dataset.ndim)),
                reverse=reverse,
            )
        if isinstance(array, str):
            ignored.append(array)
        elif isinstance(array, Matrix):
            result.matrices[keys] = array
        else:
            result.tables.append(array)
    return result


def _take(
    dataset: h5py.Dataset, unpack: Unpack | None, mask: h5py.Dataset | None, index: Any
) -> npt.NDArray[Any]:
    """Values at an index, NaN where the mask of a parameter is set."""
    values = unpack(dataset[index]) if unpack else dataset[index]
    return values if mask is None else np.where(mask[index], np.nan, values)


def _is_scale(dataset: h5py.Dataset) -> bool:
    return dataset.shape is not None and dataset.ndim == 1 and h5py.h5ds.is_scale(dataset.id)


def _clock(dataset: h5py.Dataset, axis: int, keys: Keys, scales: dict[Address, Keys]) -> Clock:
    """Path of the dimension scale of an axis; a scale is its own."""
    if _is_scale(dataset):
        return keys
    if not 0 < h5py.h5ds.get_num_scales(dataset.id, axis) <= MOST_SCALES:
        return None
    return scales.get(address(dataset.dims[axis][0]))


def _is_parameter(dataset: h5py.Dataset) -> bool:
    """Whether a dataset is the data of a parameter, whose group describes it."""
    name = str(dataset.name).rpartition("/")[2]
    return name == DATA and declared_rate(partial(attribute, dataset.parent))[0] > 0.0
