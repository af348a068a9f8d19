"""Training a monitor from a dataset, and what fresh flights say of it, as data."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from app.recipes import RecipeError, from_plain
from core.collection import (
    MOST_FRESH,
    DatasetRecipe,
    Rollouts,
    card_of,
    collect,
    evaluation_flights,
    fresh,
    stopping_flights,
)
from core.dataset import Dataset
from core.evaluation.prevention import Prevention, prevention
from core.evaluation.rates import (
    EPSILONS,
    Evaluation,
    clopper_pearson,
    evaluate,
    evaluate_groups,
    first_alerts,
    leads,
)
from core.evaluation.robustness import DIFFERENCES, robustness
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.training import with_validity
from core.monitor.validity.support import SupportError
from core.seeds import Branch, stream
from core.types import Array

Progress = Callable[[str, int, int], object]
"""Called with (what is being done, done, in all); what it raises cancels."""

LEAD_BINS = 20
NO_RECIPE = "validity is not calibrated: the dataset has no recipe to fly fresh flights of"


@dataclass(frozen=True, eq=False)
class FlownTest:
    """What fresh flights said of a monitor.

    at_epsilon: counts at the monitor's own epsilon.   curves: counts over the grid of epsilons.
    leads: (n_unsafe,) [s] from the first alert to the failure, -inf where there was none.
    prevention: which failures its alerts prevent.
    robustness: counts at its own epsilon over flights that differ from the planned test.
    groups: counts at its own epsilon over failing flights, by grouping and by a group's name.
    """

    epsilon: float
    at_epsilon: Evaluation
    curves: Evaluation
    leads: Array
    prevention: Prevention
    robustness: dict[str, Evaluation] = field(default_factory=dict)
    groups: dict[str, dict[str, Evaluation]] = field(default_factory=dict)

    def as_plain(self, n_test: int, lead: float, dt: float) -> dict[str, Any]:
        """Return JSON's types, None for what could not be counted.

        lead: the promised one [s].   dt: sample interval [s].
        """
        return {
            "n_test": n_test,
            "epsilon": self.epsilon,
            "lead": lead,
            "n_unsafe": self.curves.n_unsafe,
            "n_safe": self.curves.n_safe,
            "n_early": self.curves.n_early,
            "at_epsilon": {key: values[0] for key, values in _curves(self.at_epsilon).items()},
            "curves": _curves(self.curves),
            "leads": _histogram(self.leads, lead, dt),
            "prevention": _prevention(self.prevention),
            "robustness": {
                name: {"words": DIFFERENCES[name].words, "n_unsafe": counts.n_unsafe}
                | {"n_safe": counts.n_safe}
                | {key: values[0] for key, values in _curves(counts).items()}
                for name, counts in self.robustness.items()
            },
            "groups": [
                {
                    "rule": rule,
                    "name": name,
                    "n_unsafe": counts.n_unsafe,
                    "misses": int(counts.misses[0]),
                    "withdrawn": int(counts.withdrawn[0]),
                    "miss_interval": counts.miss_interval[0].tolist(),
                }
                for rule, groups in self.groups.items()
                for name, counts in groups.items()
            ],
        }


@dataclass(frozen=True, eq=False)
class Training:
    """A trained monitor, evaluated if it was flown, and what it learned from.

    test: what fresh flights said; None: not flown.
    not_calibrated: why its validity is not calibrated; empty where it is.
    """

    dataset: Dataset
    monitor: Monitor
    test: FlownTest | None = None
    not_calibrated: str = ""


def simulate(recipe: DatasetRecipe, progress: Progress) -> Dataset:
    """Collect a dataset that knows its recipe as plain data."""

    def found(n_unsafe: int, n_made: int) -> None:
        words = f"simulating: {n_unsafe} unsafe of {n_made} rollouts"
        progress(words, n_unsafe, recipe.n_unsafe)

    return collect(recipe, progress=found)


def recipe_of(dataset: Dataset) -> DatasetRecipe | None:
    """The recipe a dataset was simulated from; None where it was not simulated here."""
    return simulated_test(dataset.recipe)


def simulated_test(plain: dict[str, Any]) -> DatasetRecipe | None:
    """The recipe that a dataset or a monitor keeps as plain data; None for what is none."""
    if not plain:
        return None
    try:
        return from_plain(DatasetRecipe(), plain)
    except RecipeError:
        return None


def train_and_test(
    dataset: Dataset, recipe: MonitorRecipe, n_test: int, progress: Progress
) -> Training:
    """Train a monitor, calibrate its validity, fly n_test fresh flights of the dataset's recipe.

    Neither of both without a recipe; no flight is flown where n_test is 0.
    """
    progress("training", 0, 3)
    simulated = recipe_of(dataset)
    card = card_of(simulated) if simulated and recipe.predictor.forecast == "card" else None
    monitor = train(dataset, recipe, card=card)
    monitor.check_epsilon()
    if simulated is None:
        return Training(dataset, monitor, not_calibrated=NO_RECIPE)
    monitor, not_calibrated = _with_validity(monitor, dataset, simulated, progress)
    if n_test == 0:
        return Training(dataset, monitor, not_calibrated=not_calibrated)
    progress(f"flying {n_test} fresh flights", 2, 3)
    test = fly_test(monitor, simulated, n_test)
    progress("done", 3, 3)
    evaluation = test.as_plain(n_test, monitor.lead, monitor.dt) | {
        "unsafe_rate": dataset.unsafe_rate,
        "seed": dataset.seed,
        "dataset_digest": dataset.digest(),
        "version": monitor.version,
    }
    return Training(dataset, replace(monitor, evaluation=evaluation), test, not_calibrated)


def _with_validity(
    monitor: Monitor, dataset: Dataset, recipe: DatasetRecipe, progress: Progress
) -> tuple[Monitor, str]:
    """Return the monitor with its validity calibrated; or without, and why."""
    most = max(MOST_FRESH, len(dataset.unsafe) + dataset.n_safe_met)
    try:
        return with_validity(monitor, dataset, _told(fresh(recipe, most), progress)), ""
    except SupportError as error:
        return monitor, str(error)


def _told(batches: Iterator[Rollouts], progress: Progress) -> Iterator[Rollouts]:
    made = 0
    progress(f"calibrating validity on fresh flights: {made} so far", 1, 3)
    for flights in batches:
        yield flights
        made += len(flights.y)
        progress(f"calibrating validity on fresh flights: {made} so far", 1, 3)


def fly_test(monitor: Monitor, recipe: DatasetRecipe, n: int) -> FlownTest:
    """Fly n fresh flights of a planned test, and as many of each difference from it.

    Counts are of the monitor's own epsilon and of the grid it can serve.
    """
    epsilon, flights = monitor.check_epsilon(), evaluation_flights(recipe, n)
    grid = EPSILONS[monitor.smallest_epsilon - 1e-9 <= EPSILONS]
    both = evaluate(monitor, flights.y, flights.fail_index, np.append(grid, epsilon))
    alerts, fails = first_alerts(monitor, flights.y, flights.fail_index), flights.fail_index
    return FlownTest(
        epsilon=epsilon,
        at_epsilon=_part(both, slice(-1, None)),
        curves=_part(both, slice(0, -1)),
        leads=leads(alerts, fails, flights.y.shape[1], monitor.dt),
        prevention=prevention(
            alerts,
            fails,
            flights.y.shape[1],
            monitor.dt,
            stopping_flights(recipe, n),
            stream(recipe.seed, Branch.REACTION),
        ),
        robustness=robustness(monitor, recipe, n),
        groups=evaluate_groups(monitor, flights.y, flights.fail_index),
    )


def _prevention(found: Prevention) -> dict[str, Any]:
    return {
        "reactions_s": found.reactions_s.tolist(),
        "n_unsafe": found.n_unsafe,
        "n_safe": found.n_safe,
        "stopped": found.stopped,
        "prevented": found.prevented.tolist(),
        "prevented_interval": clopper_pearson(found.prevented, found.n_unsafe).tolist(),
        "caused": found.caused.tolist(),
    }


def _part(whole: Evaluation, at: slice) -> Evaluation:
    return Evaluation(
        epsilons=whole.epsilons[at],
        n_unsafe=whole.n_unsafe,
        n_safe=whole.n_safe,
        n_early=whole.n_early,
        misses=whole.misses[at],
        false_alerts=whole.false_alerts[at],
        withdrawn=whole.withdrawn[at],
        safe_withdrawn=whole.safe_withdrawn[at],
    )


def _curves(found: Evaluation) -> dict[str, list[Any]]:
    no_unsafe, no_safe = found.n_unsafe == 0, found.n_safe == 0
    unknown = [None] * len(found.epsilons)
    return {
        "epsilon": found.epsilons.tolist(),
        "misses": found.misses.tolist(),
        "false_alerts": found.false_alerts.tolist(),
        "withdrawn": found.withdrawn.tolist(),
        "safe_withdrawn": found.safe_withdrawn.tolist(),
        "miss_rate": unknown if no_unsafe else found.miss_rate.tolist(),
        "miss_interval": found.miss_interval.tolist(),
        "power": unknown if no_safe else found.power.tolist(),
        "power_interval": found.power_interval.tolist(),
        "fail_given_alert": [_or_none(share) for share in found.fail_given_alert.tolist()],
        "fail_given_alert_interval": found.fail_given_alert_interval.tolist(),
    }


def _histogram(lead: Array, promised: float, dt: float) -> dict[str, Any]:
    warned = lead[np.isfinite(lead)]
    quantiles = np.quantile(warned, [0.05, 0.5, 0.95]).tolist() if len(warned) else [None] * 3
    # Whole samples a bin, and an edge just below the promised lead: no bin mixes late and timely.
    samples, h = np.rint(warned / dt).astype(int), round(promised / dt)
    width = max(1, -(-int(samples.max(initial=h)) // LEAD_BINS))
    edges = np.arange(
        h % width - width * (h % width > 0), samples.max(initial=h) + width + 1, width
    )
    counts, edges = np.histogram(samples, edges - 0.5)
    return {
        "edges": (edges * dt).tolist(),
        "counts": counts.tolist(),
        "n_without": int(len(lead) - len(warned)),
        "n_timely": int((lead >= promised - 1e-9).sum()),
        "p05": quantiles[0],
        "median": quantiles[1],
        "p95": quantiles[2],
    }


def _or_none(number: float) -> float | None:
    return None if np.isnan(number) else number
