"""Calibrating a monitor's validity on fresh rollouts of the planned test."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from core.collection import CHUNK_STEPS, DatasetRecipe, Simulator
from core.dataset import Dataset
from core.monitor import Monitor
from core.monitor.support import LEAST, SupportError, calibrate
from core.seeds import Branch, stream
from core.types import Array, Indices

MOST_FLIGHTS = 20_000
"""Fresh flights made in search of the rarer kind, unless the dataset took more."""

Flights = tuple[Array, Indices]


def supported(
    monitor: Monitor,
    dataset: Dataset,
    recipe: DatasetRecipe,
    said: Callable[[str], object],
) -> tuple[Monitor, str]:
    """Return the monitor with its validity calibrated; or without, and why.

    recipe: of the dataset.   said: told what is being done; what it raises cancels.
    """
    most = max(MOST_FLIGHTS, len(dataset.unsafe) + dataset.n_safe_met)
    try:
        support = calibrate(monitor, dataset, fresh_batches(recipe, most, said))
    except SupportError as error:
        return monitor, str(error)
    return replace(monitor, support=support), ""


def fresh_batches(
    recipe: DatasetRecipe, most: int, said: Callable[[str], object]
) -> Iterator[Flights]:
    """Batches of fresh flights, as large as memory likes, `most` in all at most."""
    simulator = Simulator(recipe)
    rng = stream(recipe.seed, Branch.VALIDITY)
    steps = recipe.maneuver.n_samples(recipe.dt) * recipe.substeps
    size, made = max(1, min(LEAST, CHUNK_STEPS // steps)), 0
    while made < most:
        said(f"calibrating validity on fresh flights: {made} so far")
        flights = simulator.rollouts(min(size, most - made), rng)
        made += len(flights.y)
        yield flights.y, flights.fail_index
