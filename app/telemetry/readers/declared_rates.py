"""Read the sample rate of a variable from its attributes, if there is no vector of times."""

from collections.abc import Callable
from typing import Any

import numpy as np

RATES = ("frequency", "sample_rate", "sampling_rate", "sampling_frequency")
STARTS = ("supf_offset",)
"""Of flight data recorders: time of the first sample in the superframe [s]."""
USUAL_HZ = (0.1, 5e4)
"""A frequency outside this range is that of a radio."""


def declared_rate(attribute: Callable[[str], Any]) -> tuple[float, float]:
    """Rate [Hz] and time of the first sample [s]; (0, 0) without such attributes."""
    rate = next((value for name in RATES if (value := _number(attribute(name)))), 0.0)
    if not USUAL_HZ[0] <= rate <= USUAL_HZ[1]:
        return 0.0, 0.0
    return rate, next((value for name in STARTS if (value := _number(attribute(name)))), 0.0)


def _number(value: Any) -> float:
    """A finite number, otherwise 0."""
    values = np.asarray(0.0 if value is None else value).reshape(-1)
    if len(values) != 1 or values.dtype.kind not in "iuf" or not np.isfinite(values[0]):
        return 0.0
    return float(values[0])
