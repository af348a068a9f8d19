"""How close rollouts came to their limits: histograms of peak magnitude over limit."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from app.store.repository import Entry
from core.channels import KEYS
from core.dataset import Dataset
from core.limits.limits import magnitudes_of
from core.types import Array

BINS_TO_THE_LIMIT = 20
MOST_BINS = 60


@dataclass(frozen=True)
class PeakHistogram(Entry):
    """Rollouts counted by their peak |channel| / limit; a bin starts at 1, the limit."""

    channel: str
    limit: float
    """in the channel's unit"""
    edges: tuple[float, ...]
    """(n_bins + 1,) the last bin counts all higher peaks"""
    unsafe: tuple[int, ...]
    """(n_bins,) rollouts"""
    safe: tuple[int, ...]
    """(n_bins,) rollouts"""

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        rows = (tuple(plain[name]) for name in ("edges", "unsafe", "safe"))
        return cls(plain["channel"], plain["limit"], *rows)


def peak_histograms(dataset: Dataset) -> tuple[PeakHistogram, ...]:
    """One histogram per limited channel; none unless the specification is one of limits."""
    limits = magnitudes_of(dataset.specification)
    if limits is None:
        return ()
    return tuple(
        _histogram(
            key,
            limit,
            _peaks(dataset.unsafe[..., c], limit),
            _peaks(dataset.safe[..., c], limit),
        )
        for c, (key, limit) in enumerate(zip(KEYS, limits.tolist(), strict=True))
        if np.isfinite(limit)
    )


def _peaks(y: Array, limit: float) -> Array:
    """(n,) highest |y| / limit of each rollout (n, n_samples)."""
    return np.fmax.reduce(np.abs(y), axis=1, initial=0.0) / limit


def _histogram(key: str, limit: float, unsafe: Array, safe: Array) -> PeakHistogram:
    bins = [np.minimum(p * BINS_TO_THE_LIMIT, MOST_BINS - 1).astype(int) for p in (unsafe, safe)]
    n_bins = max(BINS_TO_THE_LIMIT, *(int(b.max(initial=0)) + 1 for b in bins))
    counts = [tuple(np.bincount(b, minlength=n_bins).tolist()) for b in bins]
    edges = np.arange(n_bins + 1) / BINS_TO_THE_LIMIT
    return PeakHistogram(key, limit, tuple(edges.tolist()), *counts)
