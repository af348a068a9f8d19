"""What a training found, as lines to print."""

import numpy as np

from app.commands.progress import progress_bar
from app.jobs.training import FlownTest, Training, simulate
from app.jobs.training import train_and_test as train_from
from core.collection import DatasetRecipe
from core.dataset import Dataset
from core.evaluation import clopper_pearson
from core.monitor import Monitor, MonitorRecipe


def train_and_test(
    dataset_recipe: DatasetRecipe, recipe: MonitorRecipe, n_test: int
) -> tuple[Monitor, str]:
    """Simulate, train, fly n_test fresh flights through the monitor; return it and a report."""
    with progress_bar("unsafe rollouts") as progress:
        dataset = simulate(dataset_recipe, lambda _, done, total: progress(done, total))
    training = train_from(dataset, recipe, n_test, lambda *_: None)
    return training.monitor, report(training)


def report(training: Training) -> str:
    """Return the lines that a person reads after a training."""
    monitor, test = training.monitor, training.test
    lines = [
        _dataset_line(training.dataset),
        f"calibrated on {monitor.n_unsafe} failures, {monitor.n_early} of them earlier than the "
        f"lead of {monitor.lead:g} s; smallest epsilon {monitor.smallest_epsilon:.3g}",
        _validity_line(training),
    ]
    return "\n".join(lines + (_test_lines(test, monitor.lead) if test else []))


def _dataset_line(dataset: Dataset) -> str:
    recipe = dataset.recipe
    plan = ", ".join(recipe[part]["kind"] for part in ("aircraft", "control_law", "maneuver"))
    return (
        f"simulated {len(dataset.unsafe)} unsafe and {dataset.n_safe_met} safe rollouts "
        f"(unsafe rate {100 * dataset.unsafe_rate:.2g} %) of {plan}"
    )


def _validity_line(training: Training) -> str:
    support = training.monitor.support
    if support is None:
        return training.unsupported
    return (
        f"validity calibrated on {len(support.safe)} safe and {len(support.unsafe)} failing fresh "
        f"flights: at most {100 * support.level:.2g} % of either are called invalid"
    )


def _test_lines(test: FlownTest, lead: float) -> list[str]:
    found = test.at_epsilon
    caught = found.n_unsafe - found.misses[0]
    silent = found.n_safe - found.false_alerts[0]
    return [
        f"fresh flights: {found.n_unsafe} failed, {found.n_safe} did not; at epsilon "
        f"{test.epsilon:g}:",
        _share("missed", found.misses[0], found.n_unsafe, "of failing flights"),
        _share("no alert", silent, found.n_safe, "of safe flights"),
        _share("P(fail | alert)", caught, caught + found.false_alerts[0], "of alerts"),
        _lead_line(test.leads, lead),
    ]


def _share(what: str, count: int, total: int, of: str) -> str:
    if total == 0:
        return f"  {what:16} none to count"
    low, high = clopper_pearson(count, total)
    return f"  {what:16} {count / total:6.1%} [{low:.1%}, {high:.1%}] {of}"


def _lead_line(lead: np.ndarray, wished: float) -> str:
    warned = lead[np.isfinite(lead)]
    if not len(warned):
        return "  lead             no failing flight had an alert"
    low, middle, high = np.quantile(warned, [0.05, 0.5, 0.95])
    return (
        f"  lead             median {middle:.2f} s, 5-95 % {low:.2f} to {high:.2f} s; "
        f"{np.mean(lead >= wished - 1e-9):.0%} at least {wished:g} s"
    )
