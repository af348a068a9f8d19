"""Walk an HDF5 file safely: never into other files, in circles or without end."""

import math
from collections.abc import Iterator
from typing import Any

import h5py

from app.telemetry.readers.library_errors import too_deep
from app.telemetry.recording import TelemetryError

MOST_DEPTH = 32
MOST_OBJECTS = 50_000
MOST_CHUNK = 1 << 28
"""Largest chunk, which HDF5 expands whole [bytes]."""
MOST_TEXT = 1 << 12
LARGE, MOST_HOLES = 1 << 24, 100
"""In a dataset above LARGE [bytes], at least one in MOST_HOLES chunks must be written."""
UNIT_NAMES = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")

Path = tuple[str, ...]
Address = tuple[int, int]


def datasets(
    file: h5py.File, ignored: list[str], skip: frozenset[str] = frozenset()
) -> Iterator[tuple[Path, h5py.Dataset]]:
    """Every dataset of a file, each group once, in the order of names.

    Links to other files and soft links are not followed. skip: groups at the root to omit.
    TelemetryError if groups are nested too deeply or there are too many objects.
    """
    n_objects, visited = 0, {address(file)}
    stack: list[tuple[Path, h5py.Group]] = [((), file)]
    while stack:
        path, group = stack.pop()
        if len(path) > MOST_DEPTH:
            raise TelemetryError(too_deep("HDF5"))
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
            n_objects += 1
            if n_objects > MOST_OBJECTS:
                raise TelemetryError(
                    f"the HDF5 file has more than {MOST_OBJECTS} objects: export the signals of "
                    "this test in a flat table"
                )
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
    if reason := not_numeric(dtype):
        return reason
    if _hardly_written(dataset):
        return "almost nothing written"
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(k) for k in range(properties.get_nfilters())]
    if missing := [f for f in filters if not h5py.h5z.filter_avail(f[0])]:
        name = missing[0][3].decode("utf-8", "replace") or missing[0][0]
        return f"compressed by {name}, which is not installed"
    chunk = math.prod(dataset.chunks or (0,)) * dtype.itemsize
    if chunk > MOST_CHUNK:
        return f"stored in pieces of {chunk / 2**20:.0f} MiB, too large to read"
    return ""


def not_stored(dataset: h5py.Dataset) -> str:
    """Why a dataset has no values in its file, "" if it has."""
    if dataset.is_virtual or dataset.id.get_create_plist().get_external_count():
        return "its numbers are in other files"
    if dataset.shape is None or math.prod(dataset.shape) == 0:
        return "no value"
    return ""


def _hardly_written(dataset: h5py.Dataset) -> bool:
    """Whether a dataset has almost no data in the file."""
    declared = math.prod(dataset.shape) * dataset.dtype.itemsize
    if dataset.chunks and declared > LARGE:
        written = dataset.id.get_num_chunks() * math.prod(dataset.chunks)
        return written * dataset.dtype.itemsize * MOST_HOLES < declared
    return not dataset.id.get_storage_size()


def not_numeric(dtype: Any) -> str:
    """Why values of a type are not numbers, "" if they are, or one field of a table is."""
    if dtype.names:
        if set(dtype.names) in ({"real", "imag"}, {"r", "i"}):
            return "complex"
        reasons = [not_numeric(dtype[name].base) for name in dtype.names]
        return "" if "" in reasons else reasons[0]
    if h5py.check_ref_dtype(dtype):
        return "references"
    if h5py.check_vlen_dtype(dtype) and not h5py.check_string_dtype(dtype):
        return "rows of different lengths"
    if dtype.subdtype:
        return not_numeric(dtype.base)
    return {"b": "", "i": "", "u": "", "f": "", "c": "complex", "S": "text", "O": "text"}.get(
        dtype.kind, "no numbers"
    )


def attribute(holder: Any, name: str) -> Any:
    """A small attribute as h5py returns it, None if missing or unreadable."""
    if not h5py.h5a.exists(holder.id, name.encode()):
        return None
    identifier = h5py.h5a.open(holder.id, name.encode())
    if identifier.get_storage_size() > MOST_TEXT:
        return None
    try:
        return holder.attrs[name]
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
    """The first of the named attributes that has text."""
    return next((value for name in names if (value := text(attribute(holder, name)))), "")


def address(holder: Any) -> Address:
    """Address of an object in its file, equal under all its names."""
    return h5py.h5g.get_objinfo(holder.id).objno
