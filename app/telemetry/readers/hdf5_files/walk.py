"""Walking an HDF5 file of unknown origin: never into other files, in circles or without end."""

import math
from collections.abc import Iterator
from typing import Any

import h5py

from app.telemetry.readers.library_errors import too_deep
from app.telemetry.recording import TelemetryError

MOST_DEPTH = 32
MOST_OBJECTS = 50_000
MOST_CHUNK = 1 << 28
"""Of one chunk, which HDF5 unfolds whole [bytes]."""
MOST_TEXT = 1 << 12
LARGE, MOST_HOLES = 1 << 24, 100
"""Of a dataset above this size [bytes], one part in so many must have been written."""
UNIT_NAMES = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")

Path = tuple[str, ...]
Address = tuple[int, int]


def datasets(
    file: h5py.File, ignored: list[str], skip: frozenset[str] = frozenset()
) -> Iterator[tuple[Path, h5py.Dataset]]:
    """Every dataset of a file, each group once, in the order of their names.

    Links to other files are not followed and soft links need not be. skip: names of groups at the
    root that are left out. TelemetryError where groups lie too deep or objects are too many.
    """
    n_objects, seen = 0, {address(file)}
    stack: list[tuple[Path, h5py.Group]] = [((), file)]
    while stack:
        path, group = stack.pop()
        if len(path) > MOST_DEPTH:
            raise TelemetryError(too_deep("HDF5"))
        inner = []
        for name in group:
            if isinstance(name, bytes):
                shown = name.decode("utf-8", "replace")
                ignored.append(f"{'/'.join((*path, shown))}: a name that is not in UTF-8")
                continue
            here = (*path, str(name))
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                ignored.append(f"{'/'.join(here)}: a link to another file, which is not followed")
            if not isinstance(link, h5py.HardLink) or (not path and name in skip):
                continue
            n_objects += 1
            if n_objects > MOST_OBJECTS:
                raise TelemetryError(
                    f"the HDF5 file holds more than {MOST_OBJECTS} objects: export the signals of "
                    "this test in a flat table"
                )
            member = group[name]
            if isinstance(member, h5py.Dataset):
                yield here, member
            elif isinstance(member, h5py.Group) and (at := address(member)) not in seen:
                seen.add(at)
                inner.append((here, member))
        stack += reversed(inner)


def unreadable(dataset: h5py.Dataset) -> str:
    """Why a dataset's numbers are not read, "" where they can be."""
    if reason := not_stored(dataset):
        return reason
    try:
        dtype = dataset.dtype
    except TypeError:
        return "of a type that cannot be read"
    if reason := not_numeric(dtype):
        return reason
    if _hardly_written(dataset):
        return "hardly ever written"
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(k) for k in range(properties.get_nfilters())]
    if missing := [f for f in filters if not h5py.h5z.filter_avail(f[0])]:
        name = missing[0][3].decode("utf-8", "replace") or missing[0][0]
        return f"compressed by {name}, which is not installed"
    chunk = math.prod(dataset.chunks or (0,)) * dtype.itemsize
    if chunk > MOST_CHUNK:
        return f"stored in pieces of {chunk / 2**20:.0f} MiB, which is more than may be read"
    return ""


def not_stored(dataset: h5py.Dataset) -> str:
    """Why a dataset has no values in its file, "" where it has."""
    if dataset.is_virtual or dataset.id.get_create_plist().get_external_count():
        return "its numbers lie in other files"
    if dataset.shape is None or math.prod(dataset.shape) == 0:
        return "no value"
    return ""


def _hardly_written(dataset: h5py.Dataset) -> bool:
    """Whether a dataset has next to nothing in the file but its declaration."""
    declared = math.prod(dataset.shape) * dataset.dtype.itemsize
    if dataset.chunks and declared > LARGE:
        written = dataset.id.get_num_chunks() * math.prod(dataset.chunks)
        return written * dataset.dtype.itemsize * MOST_HOLES < declared
    return not dataset.id.get_storage_size()


def not_numeric(dtype: Any) -> str:
    """Why values of a type are no numbers, "" where they are; of a table if one field is."""
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
    """A small attribute as h5py gives it, None where there is none that can be read."""
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
    """What an attribute says, "" where it is no single text."""
    if hasattr(value, "reshape") and getattr(value, "size", 0) == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return str(value).strip(" \0")[:MOST_TEXT] if isinstance(value, str) else ""


def first_text(holder: Any, names: tuple[str, ...]) -> str:
    """The first of the named attributes that says something."""
    return next((value for name in names if (value := text(attribute(holder, name)))), "")


def address(holder: Any) -> Address:
    """Where in its file an object lies, by which it is known under all its names."""
    return h5py.h5g.get_objinfo(holder.id).objno
