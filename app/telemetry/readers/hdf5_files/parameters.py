"""Parameters of a flight data recorder: a group of `data` and `mask`, with a rate attribute."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from app.telemetry.readers.declared_rates import declared_rate
from app.telemetry.readers.hdf5_files.walk import Path, attribute

DATA, MASK = "data", "mask"


def parameter_masks(readable: Mapping[Path, h5py.Dataset]) -> dict[Path, Path]:
    """Path of a parameter's data -> path of its mask."""
    masks = {}
    for path, dataset in readable.items():
        mask = readable.get((*path[:-1], MASK))
        if is_parameter(dataset) and mask is not None and mask.shape == dataset.shape:
            masks[path] = (*path[:-1], MASK)
    return masks


def is_parameter(dataset: h5py.Dataset) -> bool:
    """Whether a dataset is the data of a parameter, whose group describes it."""
    name = str(dataset.name).rpartition("/")[2]
    return name == DATA and declared_rate(partial(attribute, dataset.parent))[0] > 0.0


def take_unmasked(
    take: Callable[[Any], npt.NDArray[Any]], mask: h5py.Dataset, index: Any
) -> npt.NDArray[Any]:
    """Values at an index, NaN where the mask is set."""
    return np.where(mask[index], np.nan, take(index))
