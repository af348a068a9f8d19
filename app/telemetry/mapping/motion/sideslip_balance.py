"""Regression of the sideslip equation d(beta)/dt = -r + p sin(alpha) + g/V (N_y + phi)."""

import numpy as np

from app.telemetry.mapping.motion.motion import STEP, Motion
from core.clearance.equation_error import EquationError, Estimate, SmoothedSignal
from core.types import Array

CAUSES = ("r", "Ny", "phi", "p")
BALANCED = 0.5
"""Least share of beta-dot that the causes must explain."""
LARGEST = 1e9
"""Larger numbers are not a motion in any unit."""


def sideslip_balance(moves: Motion) -> dict[str, Estimate]:
    """beta-dot per cause, in level flight; {} if unexplained or if a channel is missing.

    The fit allows for a delay of beta. Without it the delay of a vane would look like side force.
    """
    if not {"beta", "r", "Ny", "phi"} <= moves.values.keys():
        return {}
    rates = moves.rates["beta"]
    causes = [key for key in CAUSES if key in moves.values]
    if any(_peak(x) > LARGEST for x in (rates, *(moves.values[key] for key in causes))):
        return {}
    apart = np.flatnonzero(np.diff(moves.window)) + 1  # separate the windows

    def parted(values: Array) -> Array:
        return np.insert(values, apart, np.nan)

    x = tuple(SmoothedSignal(parted(moves.values[key]), 0.0) for key in causes)
    fit = EquationError.fit(parted(rates), x, STEP)
    if fit is None or fit.share < BALANCED or not fit.delay_is_inside:
        return {}
    return {key: fit.coefficient(k) for k, key in enumerate(causes)}


def _peak(x: Array) -> float:
    return float(np.fmax.reduce(np.abs(x), initial=0.0))
