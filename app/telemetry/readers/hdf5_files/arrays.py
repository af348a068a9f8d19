"""Collect the unread arrays and tables of an HDF5 file."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from app.telemetry.readers.declared_rates import declared_rate
from app.telemetry.readers.hdf5_files.tables import table
from app.telemetry.readers.hdf5_files.walk import (
    UNIT_NAMES,
    Address,
    Path,
    address,
    attribute,
    first_text,
    text,
    unreadable,
)
from app.telemetry.readers.matrices import Matrix, matrix, to_tables
from app.telemetry.readers.signal_tables import (
    DESCRIPTION_NAMES,
    Clock,
    Column,
    SignalTable,
    is_time_name,
)

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

    matrices: dict[Path, Matrix] = field(default_factory=dict)
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
    members: Iterable[tuple[Path, h5py.Dataset]],
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
    readable: dict[Path, h5py.Dataset] = {}
    scales: dict[Address, Path] = {}
    for path, dataset in members:
        if _is_scale(dataset):
            scales[address(dataset)] = path
            if NO_VARIABLE in text(attribute(dataset, "NAME")):
                continue
        if reason := unreadable(dataset):
            ignored.append(f"{separator.join(path)}: {reason}")
        else:
            readable[path] = dataset
    result = Arrays()
    masks = _parameter_masks(readable)
    for path, dataset in readable.items():
        if path in masks.values():
            continue
        name = separator.join(path)
        if dataset.dtype.names:
            array = table(path, name, dataset, ignored)
        else:
            column, unpack = describe(name, dataset)
            take = partial(_take, dataset, unpack) if unpack else dataset.__getitem__
            if path in masks:
                take = partial(_take_unmasked, take, readable[masks[path]])
            array = matrix(
                path[:-1],
                column,
                dataset.shape,
                take,
                chunks=dataset.chunks,
                clocks=tuple(_clock(dataset, k, path, scales) for k in range(dataset.ndim)),
                reverse=reverse,
            )
        if isinstance(array, str):
            ignored.append(array)
        elif isinstance(array, Matrix):
            result.matrices[path] = array
        else:
            result.tables.append(array)
    return result


def _take(dataset: h5py.Dataset, unpack: Unpack, index: Any) -> npt.NDArray[Any]:
    return unpack(dataset[index])


def _is_scale(dataset: h5py.Dataset) -> bool:
    """Whether a dataset holds the values of a dimension."""
    return dataset.shape is not None and dataset.ndim == 1 and h5py.h5ds.is_scale(dataset.id)


def _clock(dataset: h5py.Dataset, axis: int, path: Path, scales: dict[Address, Path]) -> Clock:
    """Path of the dimension scale of an axis; a scale is its own."""
    if _is_scale(dataset):
        return path
    if not 0 < h5py.h5ds.get_num_scales(dataset.id, axis) <= MOST_SCALES:
        return None
    return scales.get(address(dataset.dims[axis][0]))


def _parameter_masks(readable: Mapping[Path, h5py.Dataset]) -> dict[Path, Path]:
    """Path of a parameter's data -> path of its mask."""
    masks = {}
    for path, dataset in readable.items():
        mask = readable.get((*path[:-1], MASK))
        if _is_parameter(dataset) and mask is not None and mask.shape == dataset.shape:
            masks[path] = (*path[:-1], MASK)
    return masks


def _is_parameter(dataset: h5py.Dataset) -> bool:
    """Whether a dataset is the data of a parameter, whose group describes it."""
    name = str(dataset.name).rpartition("/")[2]
    return name == DATA and declared_rate(partial(attribute, dataset.parent))[0] > 0.0


def _take_unmasked(
    take: Callable[[Any], npt.NDArray[Any]], mask: h5py.Dataset, index: Any
) -> npt.NDArray[Any]:
    """Values at an index, NaN where the mask is set."""
    return np.where(mask[index], np.nan, take(index))
