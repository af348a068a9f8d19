"""Aircraft and hands near the planned ones: flights that train and calibrate for them."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from core.planned_test.amplitude import AmplitudeError, suggest_amplitude
from core.planned_test.collection import TRAINING_ROLLOUTS
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.seeds import Branch, stream
from core.simulation.simulator import Flies, Parameters, Rollouts
from core.types import Array, Indices

Draw = Callable[[int, np.random.Generator], Array]
"""Theta (n, n_parameters) of n aircraft."""
Progress = Callable[[int, int], object]

WIDER, SOFTER_S = 2.0, 0.8
"""Width of D_theta as a multiple of the planned one, and scatter of the softness of hands [s], of
flights that train forecasts."""
FACTORS, LAG_S = (1.5, 2.0), 0.5
"""Factors on the derivatives, and pedal lag [s], on which a rule is calibrated."""
RETUNED_ON = 100
"""Rollouts at each amplitude tried for a softer input; its share scatters by about .04."""
FLIGHTS_EACH, AIRCRAFT_AT_ONCE = 20, 200
"""Flights of each aircraft to find a failing one, and aircraft flown together."""
MOST_EACH = 100
"""Flights per failure wanted, at most; aircraft that fail less are left out."""


def near_aircraft(of: Parameters, factor: float, n: int, rng: np.random.Generator) -> Array:
    """Theta (n, n_parameters): each nominal one multiplied by exp(U(-ln factor, ln factor))."""
    widest = np.log(factor)
    return of.nominal * np.exp(rng.uniform(-widest, widest, (n, len(of.nominal))))


def softer(recipe: DatasetRecipe, lag_s: float) -> DatasetRecipe:
    """The test flown by hands that all have this pedal lag [s], so that a quarter exceeds."""
    hands = replace(recipe.imperfections, softness_s=0.0)
    maneuver = replace(recipe.maneuver, pedal_lag_s=lag_s)
    return retuned(replace(recipe, maneuver=maneuver, imperfections=hands))


def retuned(recipe: DatasetRecipe) -> DatasetRecipe:
    """The test at the amplitude at which a quarter exceeds; unchanged if there is none."""
    try:
        amplitude_deg = suggest_amplitude(recipe, most=RETUNED_ON).amplitude_deg
    except AmplitudeError:
        return recipe
    return replace(recipe, maneuver=recipe.maneuver.with_peak(amplitude_deg))


def fly_each(
    simulator: Flies,
    theta: Array,
    rng: np.random.Generator,
    n_flights: int,
    most: int,
    most_safe: int,
) -> tuple[Rollouts, Indices]:
    """Fly each of these aircraft, theta (n_aircraft, n_parameters), n_flights times.

    most, most_safe: most failing and safe flights of each to return.   An aircraft that diverges
    is left out.   Returns the flights, and (n,) the number of their aircraft.
    """
    shape = len(theta), n_flights
    flights, peaks = simulator.fly(np.repeat(theta, n_flights, axis=0), rng)
    fails = flights.is_unsafe.reshape(shape)
    failing, safe = fails.cumsum(axis=1), (~fails).cumsum(axis=1)
    few = np.where(fails, failing <= most, safe <= most_safe)
    few &= np.isfinite(peaks).reshape(shape).all(axis=1, keepdims=True)
    chosen = np.flatnonzero(few)
    return flights.some(chosen), chosen // n_flights


def near_rollouts(recipe: DatasetRecipe, n: int = TRAINING_ROLLOUTS) -> Rollouts:
    """Roll out n flights of aircraft and hands that scatter farther than planned.

    For training forecasts; they neither calibrate nor test.
    """
    imperfections = recipe.imperfections
    hands = replace(imperfections, softness_s=max(SOFTER_S, imperfections.softness_s))
    simulator = LateralSimulator(replace(recipe, imperfections=hands), WIDER)
    return simulator.rollouts(n, stream(recipe.seed, Branch.NEAR, 0))


def near_failures(
    recipe: DatasetRecipe, n: int, progress: Progress | None = None
) -> list[Rollouts]:
    """Failing flights of several populations of aircraft, n of each, on which to calibrate a rule.

    The planned aircraft, those within each of FACTORS, and the planned ones flown with a pedal lag
    of LAG_S. One flight of each aircraft, so that every aircraft weighs the same. A population of
    which too few aircraft fail is left out.

    progress: called with (populations done, total); an exception cancels.
    """
    populations = list(_populations(recipe))
    failures = []
    for number, (simulator, draw) in enumerate(populations):
        if progress:
            progress(number, len(populations))
        rng = stream(recipe.seed, Branch.NEAR, number + 1)
        if (failing := _one_failure_each(simulator, draw, n, rng)) is not None:
            failures.append(failing)
    return failures


def _populations(recipe: DatasetRecipe) -> Iterator[tuple[LateralSimulator, Draw]]:
    planned, soft = recipe.simulator(), softer(recipe, LAG_S).simulator()
    yield planned, planned.plant.sample
    for factor in FACTORS:
        yield (
            planned,
            lambda n, rng, factor=factor: near_aircraft(planned.parameters, factor, n, rng),
        )
    yield soft, soft.plant.sample


def _one_failure_each(
    simulator: LateralSimulator, draw: Draw, n: int, rng: np.random.Generator
) -> Rollouts | None:
    """A failing flight of each of n aircraft; None if they fail too rarely."""
    parts, missing, made = list[Rollouts](), n, 0
    at_once = min(AIRCRAFT_AT_ONCE, n)
    while missing > 0:
        if made > MOST_EACH * n:
            return None
        flights, _ = fly_each(simulator, draw(at_once, rng), rng, FLIGHTS_EACH, 1, 0)
        made += at_once * FLIGHTS_EACH
        parts.append(flights.some(slice(missing)))
        missing -= len(flights.y)
    return Rollouts(*map(np.concatenate, zip(*parts, strict=True)))
