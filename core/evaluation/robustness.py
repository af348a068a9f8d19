"""Robustness: a monitor on flights that differ from its planned test."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from core.evaluation.rates import Evaluation, evaluate
from core.monitor.monitor import Monitor
from core.planned_test.collection import SimulatedTest, replanned
from core.planned_test.near import FLIGHTS_EACH, fly_each, near_aircraft, retuned, softer
from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.planned_test import (
    USUAL_TIMING_JITTER_S,
    DatasetRecipe,
    LateralSimulator,
    SensorNoise,
)
from core.seeds import Branch, stream
from core.simulation.aircraft import AIRCRAFT, IdentifiedAircraft, PublishedAircraft
from core.simulation.imperfections import USUAL_IMPERFECTIONS
from core.simulation.maneuver import Altered
from core.simulation.nonlinear import TrimError
from core.simulation.pilot import Crossover
from core.simulation.published import MODELS
from core.simulation.python_simulator import OwnCodeError
from core.simulation.simulator import Flies, Rollouts
from core.simulation.turbulence import Turbulence
from core.types import Indices

Piloted = DatasetRecipe | NonlinearTest
"""Tests with a pilot."""
WORSE_AIR: dict[Turbulence, Turbulence] = {
    "none": "smooth",
    "smooth": "light",
    "light": "moderate",
    "moderate": "severe",
}
"""The next class of turbulence; given gusts are doubled instead."""
DOUBLED = "gust_sigma_deg", "gain", "bias", "lag_s", "trim_deg", "unsteadiness_deg", "asymmetry"
"""Imperfections to double."""

N_NEAR = 150
"""Aircraft near the planned one; those that never fail are not counted."""
MOST_FAILURES, MOST_SAFE = 5, 1
"""Failing and safe flights of such an aircraft that are counted, at most."""
LEAST_FAILURES = 4
"""Failures from which an aircraft may be the worst."""


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


def _another_pilot(test: Piloted, gain: float = 1.0, delay_s: float = 0.0) -> Piloted:
    """The test with another pilot in the loop, who keeps bank where none was in it.

    ValueError where none can be.
    """
    pilot = test.pilot if isinstance(test.pilot, Crossover) else Crossover()
    crossover = gain * pilot.crossover_rad_s
    changed = replace(pilot, crossover_rad_s=crossover, delay_s=pilot.delay_s + delay_s)
    return replace(test, pilot=changed)


@dataclass(frozen=True)
class Difference:
    """A way in which flights differ from the planned test.

    words: the difference.   number: of its random stream; it never changes.
    recipe: changes the planned test.   pilot: the same, also of nonlinear aircraft.
    spread: factor on the width of D_theta.
    share: of the flights asked for.
    factor: of `near_aircraft` on the derivatives of aircraft flown several times; None: D_theta.
    others: whether published aircraft of other types fly the test.
    """

    words: str
    number: int
    recipe: Callable[[DatasetRecipe], DatasetRecipe] = _as_planned
    pilot: Callable[[Piloted], Piloted] | None = None
    spread: float = 1.0
    share: float = 1.0
    factor: float | None = None
    others: bool = False


DIFFERENCES = {
    "opposite_input": Difference("input in the opposite direction", 0, _opposite),
    "wider_theta": Difference("derivatives scatter 1.5 times as far", 1, spread=1.5),
    "doubled_noise": Difference("sensor noise twice as large", 2, _noisier),
    "timing": Difference("timing scatters by 0.1 s more", 3, _mistimed),
    "slower_input": Difference("every segment 1.5 times as long", 4, _slower),
    "stopped_input": Difference("input stopped midway", 5, _stopped),
    "imperfections": Difference("gusts, lags and gains worse than trained", 6, _less_perfect),
    "lag_0.2": Difference(
        "softer input: pedal lag 0.2 s", 7, partial(softer, lag_s=0.2), share=0.3
    ),
    "lag_0.3": Difference(
        "softer input: pedal lag 0.3 s", 8, partial(softer, lag_s=0.3), share=0.3
    ),
    "lag_0.5": Difference(
        "softer input: pedal lag 0.5 s", 9, partial(softer, lag_s=0.5), share=0.3
    ),
    "near_1.25": Difference("parameters within a factor of 1.25", 10, factor=1.25),
    "near_1.5": Difference("parameters within a factor of 1.5", 11, factor=1.5),
    "other_type": Difference("another type of aircraft", 12, others=True),
    "pilot_high_gain": Difference(
        "another pilot in the loop: gain 1.5 times", 13, pilot=partial(_another_pilot, gain=1.5)
    ),
    "pilot_low_gain": Difference(
        "another pilot in the loop: gain 0.67 times", 14, pilot=partial(_another_pilot, gain=2 / 3)
    ),
    "pilot_delay": Difference(
        "another pilot in the loop: delay 0.1 s longer",
        15,
        pilot=partial(_another_pilot, delay_s=0.1),
    ),
}


def robustness(monitor: Monitor, test: SimulatedTest, n: int) -> dict[str, Evaluation]:
    """Fly n flights of each difference through the monitor, and count at its epsilon.

    Softer inputs get fewer flights; aircraft near the planned one have their own number. Flights
    that the simulator cannot fly are left out, and other types if none can fly the test.

    test: the monitor's planned test.
    """
    at, evaluations = np.array([monitor.check_epsilon()]), {}
    for name, difference in DIFFERENCES.items():
        rng = stream(test.seed, Branch.ROBUSTNESS, difference.number)
        if flown := _flown(test, difference, n, rng):
            (outputs, fail_index, _), aircraft = flown
            evaluations[name] = evaluate(monitor, outputs, fail_index, at, aircraft)
    return evaluations


def _flown(
    test: SimulatedTest, difference: Difference, n: int, rng: np.random.Generator
) -> tuple[Rollouts, Indices | None] | None:
    """Flights of a difference, and the number of their aircraft if those flew several times.

    None if the simulator cannot fly them.
    """
    if difference.factor is not None:
        simulator = test.simulator()
        if not isinstance(simulator, Flies):
            return None
        theta = near_aircraft(simulator.parameters, difference.factor, N_NEAR, rng)
        try:
            return fly_each(simulator, theta, rng, FLIGHTS_EACH, MOST_FAILURES, MOST_SAFE)
        except (OwnCodeError, TrimError):
            return None  # such as aircraft that cannot be trimmed
    if difference.pilot is not None:
        if not isinstance(test, Piloted):
            return None
        try:
            return difference.pilot(test).simulator().rollouts(n, rng), None
        except ValueError:
            return None  # such as a manoeuvre that moves the pilot's own surface
    if (recipe := replanned(test)) is None:
        return None
    if difference.others:
        return _other_types(recipe, n, rng)
    changed = LateralSimulator(difference.recipe(recipe), difference.spread)
    return changed.rollouts(round(difference.share * n), rng), None


def _other_types(
    recipe: DatasetRecipe, n: int, rng: np.random.Generator
) -> tuple[Rollouts, Indices] | None:
    """About n flights of the published aircraft of other types, equally many of each.

    Each at the amplitude at which a quarter exceeds.   None if none of them can fly the test.
    """
    own = recipe.aircraft
    if isinstance(own, IdentifiedAircraft):
        own = own.base
    if isinstance(own, PublishedAircraft):
        others = [replace(own, name=name) for name in MODELS if name != own.name]
    else:
        others = [aircraft for name, aircraft in AIRCRAFT.items() if name in MODELS]
    flights = list[Rollouts]()
    for aircraft in others:
        try:
            simulator = LateralSimulator(retuned(replace(recipe, aircraft=aircraft)))
        except ValueError:
            continue  # such as one that this control law makes unstable
        flights.append(simulator.rollouts(round(n / len(others)), rng))
    if not flights:
        return None
    y, fail_index, theta = (np.concatenate(part) for part in zip(*flights, strict=True))
    type_of = np.repeat(np.arange(len(flights)), [len(each.y) for each in flights])
    return Rollouts(y, fail_index, theta), type_of


def by_aircraft(counts: Evaluation) -> dict[str, Any]:
    """Aircraft that failed, and [misses, failures] of the worst with enough failures, if any.

    At the first epsilon; empty where aircraft are not counted one by one.
    """
    if counts.failures_of is None or counts.misses_of is None:
        return {}
    enough = np.flatnonzero(counts.failures_of >= LEAST_FAILURES)
    shares = counts.misses_of[enough, 0] / counts.failures_of[enough]
    worst = enough[shares.argmax()] if len(enough) else None
    return {
        "n_aircraft": len(counts.failures_of),
        "worst": None
        if worst is None
        else [int(counts.misses_of[worst, 0]), int(counts.failures_of[worst])],
    }
