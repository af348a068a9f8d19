"""The best method for a test: tried on flights that chose nothing, with a plain threshold."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from core.dataset import Dataset
from core.evaluation import THRESHOLD
from core.evaluation.baselines import CurrentShare, evaluate_baseline
from core.evaluation.rates import Evaluation, evaluate
from core.limits.limits import envelope_of
from core.monitor.monitor import Monitor
from core.monitor.recipe import METHODS, MonitorRecipe, planned
from core.monitor.training import Flights, train
from core.rollouts import LabelledFlights

OF_THE_CARD = "test_card"
"""The method that needs a test card, which own rollouts lack."""


@dataclass(frozen=True)
class MethodCounts:
    """Flights on which a method was tried. name: key of METHODS, or THRESHOLD.

    missed: failing flights without an alert in time.   quiet: safe flights, valid and without one.
    """

    name: str
    missed: int
    n_unsafe: int
    quiet: int
    n_safe: int

    @classmethod
    def of(cls, name: str, counts: Evaluation) -> Self:
        """Counts at the first epsilon."""
        missed, quiet = int(counts.misses[0]), int(counts.quiet[0])
        return cls(name, missed, counts.n_unsafe, quiet, counts.n_safe)

    @property
    def miss_rate(self) -> float:
        return self.missed / max(self.n_unsafe, 1)

    @property
    def power(self) -> float:
        return self.quiet / max(self.n_safe, 1)


def try_methods(
    dataset: Dataset,
    flights: LabelledFlights,
    recipe: MonitorRecipe,
    learning: Flights | None,
    failures: Flights | None = None,
) -> dict[str, tuple[Monitor, MethodCounts]]:
    """Each method that works without a test card, trained on a dataset and tried on flights.

    recipe: of lead, epsilon and promise; its method does not matter.
    learning: flights from which forecasts learn where only the label tells failures.
    failures: that calibrate an ensemble, see `train`.
    """
    tried = {}
    for name, (predictor, score) in METHODS.items():
        if name == OF_THE_CARD:
            continue
        of_method = replace(recipe, predictor=planned(predictor), score=score)
        try:
            monitor = train(dataset, of_method, rollouts=learning, failures=failures)
            monitor.check_epsilon()
        except ValueError:
            continue  # such as a peak that too few failures teach
        counts = evaluate(monitor, flights.y, flights.fail_index, np.array([recipe.epsilon]))
        tried[name] = monitor, MethodCounts.of(name, counts)
    return tried


def most_missed(epsilon: float, n_unsafe: int) -> int:
    """Misses up to which a method keeps epsilon: two standard errors more than its share."""
    error = np.sqrt(epsilon * (1 - epsilon) / max(n_unsafe, 1))
    return int(np.floor((epsilon + 2 * error) * n_unsafe))


def kept_in_words(epsilon: float, n_unsafe: int) -> str:
    """Which methods keep epsilon in a trial on this many failing flights."""
    return (
        f"a method keeps epsilon {epsilon:g} here if it misses at most "
        f"{most_missed(epsilon, n_unsafe)} of {n_unsafe}: so few flights cannot tell more from "
        "chance (two standard errors); the promise comes from the calibration, not from this count"
    )


def best_of(counts: list[MethodCounts], epsilon: float) -> MethodCounts:
    """The method with most quiet flights among those that do not miss surely more than epsilon.

    The first one wins a tie within one standard error, because the order of METHODS is that of
    robustness to flights unlike the planned ones.
    """

    within = [c for c in counts if c.missed <= most_missed(epsilon, c.n_unsafe)] or counts
    most = max(count.power for count in within)
    error = np.sqrt(most * (1 - most) / max(within[0].n_safe, 1))
    return next(count for count in within if count.power >= most - error)


def plain_threshold(
    dataset: Dataset, flights: LabelledFlights, recipe: MonitorRecipe
) -> MethodCounts | None:
    """A threshold on the current margin, calibrated like the monitors; None for labels alone."""
    if envelope_of(dataset.specification) is None:
        return None
    at = np.array([recipe.epsilon])
    counts = evaluate_baseline(CurrentShare(), dataset, flights, recipe, at)
    return MethodCounts.of(THRESHOLD, counts)
