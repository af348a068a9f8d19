"""Robustness: a monitor on flights that differ from its planned test."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from core.evaluation.rates import Evaluation, evaluate
from core.monitor.monitor import Monitor
from core.planned_test.planned_test import (
    USUAL_TIMING_JITTER_S,
    DatasetRecipe,
    SensorNoise,
    Simulator,
)
from core.seeds import Branch, stream
from core.simulation.imperfections import USUAL_IMPERFECTIONS
from core.simulation.maneuver import Altered
from core.simulation.turbulence import Turbulence

WORSE_AIR: dict[Turbulence, Turbulence] = {
    "none": "smooth",
    "smooth": "light",
    "light": "moderate",
    "moderate": "severe",
}
"""The next class of turbulence; given gusts are doubled instead."""
DOUBLED = "gust_sigma_deg", "gain", "bias", "lag_s", "trim_deg", "unsteadiness_deg", "asymmetry"
"""Imperfections to double."""


def _as_planned(recipe: DatasetRecipe) -> DatasetRecipe:
    return recipe


def _opposite(recipe: DatasetRecipe) -> DatasetRecipe:
    return replace(recipe, maneuver=recipe.maneuver.with_peak(-recipe.maneuver.peak_deg))


def _noisier(recipe: DatasetRecipe) -> DatasetRecipe:
    return replace(
        recipe, noise=SensorNoise(**{key: 2 * std for key, std in asdict(recipe.noise).items()})
    )


def _mistimed(recipe: DatasetRecipe) -> DatasetRecipe:
    jitter = recipe.maneuver.timing_jitter_s + USUAL_TIMING_JITTER_S
    return replace(recipe, maneuver=replace(recipe.maneuver, timing_jitter_s=jitter))


def _slower(recipe: DatasetRecipe) -> DatasetRecipe:
    return replace(recipe, maneuver=Altered.of(recipe.maneuver, slower=1.5))


def _stopped(recipe: DatasetRecipe) -> DatasetRecipe:
    return replace(recipe, maneuver=Altered.of(recipe.maneuver, flown_share=0.5))


def _less_perfect(recipe: DatasetRecipe) -> DatasetRecipe:
    planned = recipe.imperfections
    if planned.are_none:
        return replace(recipe, imperfections=USUAL_IMPERFECTIONS)
    doubled = {name: 2 * getattr(planned, name) for name in DOUBLED}
    gusty = WORSE_AIR.get(planned.turbulence, planned.turbulence)
    return replace(recipe, imperfections=replace(planned, turbulence=gusty, **doubled))


@dataclass(frozen=True)
class Difference:
    """A way in which flights differ from the planned test.

    words: the difference.   number: of its random stream; it never changes.
    recipe: changes the planned test.   spread: factor on the width of D_theta.
    """

    words: str
    number: int
    recipe: Callable[[DatasetRecipe], DatasetRecipe] = _as_planned
    spread: float = 1.0


DIFFERENCES = {
    "opposite_input": Difference("input in the opposite direction", 0, _opposite),
    "wider_theta": Difference("derivatives scatter 1.5 times as far", 1, spread=1.5),
    "doubled_noise": Difference("sensor noise twice as large", 2, _noisier),
    "timing": Difference("timing scatters by 0.1 s more", 3, _mistimed),
    "slower_input": Difference("every segment 1.5 times as long", 4, _slower),
    "stopped_input": Difference("input stopped midway", 5, _stopped),
    "imperfections": Difference("gusts, lags and gains worse than trained", 6, _less_perfect),
}


def robustness(
    monitor: Monitor, recipe: DatasetRecipe, n: int, epsilon: float | None = None
) -> dict[str, Evaluation]:
    """Fly n flights of each difference through the monitor, and count at one epsilon.

    recipe: the monitor's planned test.   epsilon: default: the monitor's own.
    """
    at, evaluations = np.array([monitor.check_epsilon(epsilon)]), {}
    for name, difference in DIFFERENCES.items():
        simulator = Simulator(difference.recipe(recipe), difference.spread)
        rng = stream(recipe.seed, Branch.ROBUSTNESS, difference.number)
        flights = simulator.rollouts(n, rng)
        evaluations[name] = evaluate(monitor, flights.y, flights.fail_index, at)
    return evaluations
