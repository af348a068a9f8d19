"""Checks of single values of a monitor's file, because kernels trust its content."""

from typing import Any

import numpy as np
import numpy.typing as npt

MOST_SAMPLES = 100_000
"""Largest number of samples of a lead, a history or a card."""


def is_count(value: object, most: float = 2**53) -> bool:
    return type(value) is int and 0 <= value <= most


def is_number(value: object) -> bool:
    return type(value) in (int, float)


def check_count(name: str, value: object, least: int = 0, most: float = MOST_SAMPLES) -> None:
    """Refuse a number of samples that is not whole or out of range."""
    if not (type(value) is int and least <= value <= most):
        raise ValueError(f"{name} is {value!r} instead of {least} to {most} samples")


def check_array(
    name: str,
    array: npt.NDArray[Any],
    shape: tuple[int, ...],
    kind: type = np.float64,
    *,
    least: float = -np.inf,
    above: float | None = None,
    most: float = np.inf,
    finite: bool = True,
    ascending: bool = False,
) -> None:
    """Refuse another type or shape, and values that are NaN, infinite, out of range or unsorted.

    finite: False to allow infinite values.   ascending: along the first axis.
    """
    if array.dtype != kind or array.shape != shape:
        raise ValueError(
            f"{name} is {array.dtype} {array.shape} instead of {kind.__name__} {shape}"
        )
    if not array.size:
        return
    if np.isnan(array).any() or (finite and not np.isfinite(array).all()):
        raise ValueError(f"{name} holds NaN or a value that is not finite")
    low, high = array.min(), array.max()
    if not least <= low <= high <= most or (above is not None and low <= above):
        raise ValueError(f"{name} holds numbers outside its range: {low:g} to {high:g}")
    if ascending and (array[1:] < array[:-1]).any():
        raise ValueError(f"{name} is not sorted")


def check_alphas(name: str, alphas: npt.NDArray[Any], shape: tuple[int, ...]) -> None:
    """Refuse calibration scores that are missing, NaN, -inf or not sorted along the last axis."""
    check_array(name, alphas, shape, above=-np.inf, finite=False)
    if not alphas.size or (alphas[..., 1:] < alphas[..., :-1]).any():
        raise ValueError(f"{name} is empty or not sorted")
