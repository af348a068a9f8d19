"""What a plot of very many samples covers, in few: nothing that could be seen is lost."""

import numpy as np

from core.types import Array, Flags

BINS = 1200
"""Most columns of a trace: more cannot be seen on paper."""


def envelope(t: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """The lowest and the highest value of each bin in turn. t, values: (n,)."""
    if len(t) <= 2 * bins:
        return t, values
    size = -(-len(t) // bins)
    whole = len(t) // size * size
    blocks = values[:whole].reshape(-1, size)
    at = np.arange(len(blocks)) * size
    low = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1) + at
    high = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1) + at
    chosen = np.sort(np.concatenate([low, high, np.arange(whole, len(t))]), kind="stable")
    return t[chosen], values[chosen]


def runs(flags: Flags) -> list[tuple[int, int]]:
    """First and last sample of each run of true."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(begins.tolist(), ends.tolist(), strict=True))
