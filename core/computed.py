"""Channels that are computed from others: in whole flights, and sample by sample."""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from core.channels import Channel, Dictionary
from core.formulas import LastingWindow, smallest_of_times, spelled
from core.types import Array

Side = Literal["above", "below"]
AT_ONCE = 8192
"""Samples whose columns a processor's cache holds."""


def lasting(known: Channel, seconds: float, side: Side = "above") -> Channel:
    """The value above or below which a channel was for this time [s]: to limit lasting values."""
    name = spelled(known.key)
    held = f"lasting({name}, {seconds:g})" if side == "above" else f"-lasting(-{name}, {seconds:g})"
    return replace(
        known,
        key=f"{known.key}_{side}_{seconds:g}s",
        symbol=f"{known.symbol} ({seconds:g} s)",
        label=f"lasting {known.label}",
        role="output",
        formula=held,
    )


def complete(dictionary: Dictionary, y: Array, dt: float) -> Array:
    """Flights with their computed channels; y itself if there are none.

    y: (..., n_samples, n_channels), or n_measured: measured channels alone.   dt: [s].
    """
    if not dictionary.formulas:
        return y
    places = [dictionary.index(key) for key in dictionary.measured]
    whole = np.empty((*y.shape[:-1], len(dictionary)))
    whole[..., places] = y[..., places] if y.shape[-1] == len(dictionary) else y
    flights = whole.reshape(-1, *whole.shape[-2:])
    smallest = smallest_of_times(np.arange(flights.shape[1], dtype=np.float64) * dt)
    at_once = max(1, AT_ONCE // max(1, flights.shape[1]))
    for first in range(0, len(flights), at_once):
        some = flights[first : first + at_once]
        columns = np.ascontiguousarray(np.moveaxis(some, -1, 0))
        for c, formula in dictionary.formulas:
            columns[c] = some[..., c] = formula.values(columns, smallest)
    return whole


def fill(dictionary: Dictionary, t: Array, y: Array) -> None:
    """Compute the channels of a stream's samples in place, as `Computed` does one by one.

    t: (n,) [s] in order of arrival.   y: (n, n_channels or more).
    """
    if not dictionary.formulas:
        return
    if (np.diff(t) < 0.0).any():
        computed = Computed(dictionary)
        for at, sample in zip(t.tolist(), y[:, : len(dictionary)], strict=True):
            computed.fill(at, sample)
        return
    columns, smallest = np.ascontiguousarray(y[:, : len(dictionary)].T), smallest_of_times(t)
    for c, formula in dictionary.formulas:
        columns[c] = y[:, c] = formula.values(columns, smallest)


class Computed:
    """Fills the computed channels of a stream, one sample after another."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._formulas = dictionary.formulas
        self._windows: dict[tuple[int, int], LastingWindow] = {}

    def fill(self, t: float, y: Array) -> None:
        """Compute in place.   t: [s] of the sample.   y: (n_channels,)."""
        if not self._formulas:
            return
        # numpy computes powers of one value in another way than those of several
        columns = np.repeat(y[:, np.newaxis], 2, axis=1)
        for c, formula in self._formulas:
            columns[c] = formula.values(columns, partial(self._smallest, c, t))
            y[c] = columns[c, 0]

    def _smallest(self, c: int, t: float, place: int, x: Array, seconds: float) -> Array:
        window = self._windows.setdefault((c, place), LastingWindow())
        return np.full_like(x, window.smallest(t, float(x[0]), seconds))
