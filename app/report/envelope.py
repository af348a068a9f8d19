"""Reduce very many samples to a plot of the same appearance."""

import numpy as np

from core.types import Array, Flags

BINS = 1200
"""Columns of a trace; paper shows no more."""


def envelope(t: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """The lowest and the highest value of each bin, in order of time. t, values: (n,)."""
    if len(t) <= 2 * bins:
        return t, values
    size = -(-len(t) // bins)
    whole = len(t) // size * size
    blocks = values[:whole].reshape(-1, size)
    at = np.arange(len(blocks)) * size
    low = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1) + at
    high = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1) + at
    kept = np.sort(np.concatenate([low, high, np.arange(whole, len(t))]), kind="stable")
    return t[kept], values[kept]


def runs(flags: Flags) -> list[tuple[int, int]]:
    """First and last sample of each run of true."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(begins.tolist(), ends.tolist(), strict=True))
