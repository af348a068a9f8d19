"""Array types, by their content."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Numbers."""
Indices = npt.NDArray[np.int64]
"""Positions of samples, rollouts or points."""
Flags = npt.NDArray[np.bool_]
"""Yes or no for each item."""
