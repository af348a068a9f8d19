"""Array types, by their content."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Numbers."""
Indices = npt.NDArray[np.int64]
"""Positions of samples, rollouts or points."""
Flags = npt.NDArray[np.bool_]
"""Yes or no for each item."""

NO_NUMBERS = {"c": "complex numbers", "U": "text", "S": "text"}


def real_numbers(given: npt.ArrayLike, name: str) -> Array:
    """As float64. ValueError for text, complex numbers and objects, which numpy may convert."""
    values = np.asarray(given)
    if values.dtype.kind not in "fiub":
        kind = NO_NUMBERS.get(values.dtype.kind, "objects")
        raise ValueError(f"{name} holds {kind}: give real numbers, NaN where one is missing")
    return np.asarray(values, np.float64)
