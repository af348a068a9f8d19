"""Failures that alerts prevent: flights repeated with neutral controls after a reaction."""

from dataclasses import dataclass

import numpy as np

from core.simulation.simulator import Stopped
from core.types import Array, Indices

REACTIONS_S = (0.25, 0.5, 1.0, 1.5, 2.5)
"""Mean times from an alert to neutral controls [s]: from an automatic switch to a radio call."""
VARIATION = 0.3
"""Standard deviation of a reaction time, as a share of its mean; Gamma distributed."""


@dataclass(frozen=True, eq=False)
class Prevention:
    """Counts over fresh flights at one epsilon, for each mean reaction time.

    reactions_s: (n_reactions,) [s].   n_unsafe, n_safe: flights that fail, and that do not, without
    a reaction.   stopped: safe flights stopped unnecessarily by an alert.
    prevented: (n_reactions,) failing flights that their alert stops in time.
    caused: (n_reactions,) safe flights that fail because they were stopped.
    """

    reactions_s: Array
    n_unsafe: int
    n_safe: int
    stopped: int
    prevented: Indices
    caused: Indices


def unit_reactions(n: int, rng: np.random.Generator) -> Array:
    """(n,) reaction times with mean 1."""
    return rng.gamma(VARIATION**-2, VARIATION**2, n)


def neutral_from(alerts: Indices, reactions: Array, dt: float) -> Indices:
    """(m,) first neutral command of flights that are aborted (m,) reactions [s] after an alert."""
    return np.ceil(alerts + reactions / dt - 1e-9).astype(np.int64)


def prevention(
    alerts: Indices,
    fail_index: Indices,
    n_samples: int,
    dt: float,
    stopped: Stopped,
    rng: np.random.Generator,
    reactions_s: tuple[float, ...] = REACTIONS_S,
) -> Prevention:
    """Repeat the flights with an alert, and count the prevented failures.

    alerts, fail_index: (n,) first alert and first exceedance, n_samples for none.   dt: [s].
    rng: for the reaction times.
    """
    is_unsafe = fail_index < n_samples
    which = np.flatnonzero(alerts < n_samples)
    unit = unit_reactions(len(which), rng)
    prevented, caused = [], []
    for mean in reactions_s:
        fails = stopped(which, neutral_from(alerts[which], mean * unit, dt)) < n_samples
        prevented.append(np.count_nonzero(is_unsafe[which] & ~fails))
        caused.append(np.count_nonzero(~is_unsafe[which] & fails))
    return Prevention(
        reactions_s=np.array(reactions_s),
        n_unsafe=int(is_unsafe.sum()),
        n_safe=int((~is_unsafe).sum()),
        stopped=int(np.count_nonzero(~is_unsafe[which])),
        prevented=np.array(prevented),
        caused=np.array(caused),
    )
