"""Recordings of flown flights: pitch doublets of `short_period`, one after another."""

import numpy as np

from core.types import Array
from tests.support import short_period
from tests.support.recorded import csv_of
from tests.support.short_period import DT

HEAD = "t_s,alpha_rad,q (rad/s),Nz_g,delta_e_rad"
REST = 60
"""Samples at rest before and after each doublet."""


def doublets(n: int, seed: int) -> Array:
    """(n, 81, 4): flown ones, which no other seed repeats."""
    return short_period.fly(np.random.default_rng(seed), n)[1]


def fails(y: Array) -> bool:
    """Whether a doublet (81, 4) exceeds the usual limits."""
    return bool(short_period.LIMITS.envelope.exceeds(y).any())


def flown(*manoeuvres: Array, start: float = 0.0, rest: int = REST) -> bytes:
    """A recording as CSV: the doublets with rest between them. start: of its clock [s]."""
    parts = []
    for y in manoeuvres:
        still = y[:8].mean(axis=0) + np.resize(y[:8] - y[:8].mean(axis=0), (rest, y.shape[1]))
        parts += [still, y]
    return csv_of(np.vstack([*parts, parts[0]]), DT, head=HEAD, start=start)
