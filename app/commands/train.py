"""The command that simulates, trains and tests a monitor, and what it prints of it."""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.commands.options.destinations import check_file
from app.commands.options.recipe import add_number, add_recipe_options, plain_recipe, print_recipe
from app.commands.output.progress import progress_bar
from app.commands.output.results import add_json, print_result
from app.jobs.requests import N_TEST
from app.jobs.training import FlownTest, Training, simulate, train_and_test
from app.recipes import dataset_for, from_plain
from app.scoring.wording import PROMISED
from core.collection import DatasetRecipe
from core.dataset import Dataset
from core.evaluation.certificate import warnings_of
from core.evaluation.prevention import Prevention
from core.evaluation.rates import Evaluation, clopper_pearson
from core.evaluation.robustness import DIFFERENCES
from core.monitor import Monitor, MonitorRecipe
from core.monitor.calibration import check_epsilon
from core.monitor.training import check_lead


@dataclass(frozen=True)
class TrainingRecipe:
    """What `train` does: simulate a dataset, train a monitor, fly fresh rollouts through it."""

    dataset: DatasetRecipe = DatasetRecipe()  # noqa: RUF009
    monitor: MonitorRecipe = MonitorRecipe()  # noqa: RUF009
    n_test: int = N_TEST

    def __post_init__(self) -> None:
        """Refuse less than no test flight."""
        if self.n_test < 0:
            raise ValueError(f"n_test={self.n_test} was given: it must be 0 or more")


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    add_recipe_options(parser, method=True, imperfections="usual")
    add_number(parser, "--n-test", "fresh test flights")
    parser.add_argument("-o", "--out", type=Path, default=Path("monitor.fwm"), help="file written")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Simulate, train, fly fresh flights through the monitor; write its file."""
    recipe = from_plain(TrainingRecipe(), plain_recipe(options))
    recipe = replace(recipe, dataset=dataset_for(recipe.monitor, recipe.dataset))
    if options.print_recipe:
        return print_recipe(recipe)
    check_lead(recipe.monitor.t_early, recipe.dataset.maneuver.duration_s)
    check_epsilon(recipe.monitor.epsilon, recipe.dataset.n_unsafe, recipe.monitor.guarantee)
    check_file(options.out)
    with progress_bar("unsafe rollouts") as progress:
        dataset = simulate(recipe.dataset, lambda _, done, total: progress(done, total))
    training = train_and_test(dataset, recipe.monitor, recipe.n_test, lambda *_: None)
    training.monitor.save(options.out)
    text = f"{report(training)}\nwritten: {options.out}"
    print_result(options, text, summary(training) | {"file": str(options.out)})
    return 0


def summary(training: Training) -> dict[str, Any]:
    """Return what `report` says as plain data; times [s]."""
    monitor, dataset = training.monitor, training.dataset
    return {
        "dataset": {
            "n_unsafe": len(dataset.unsafe),
            "n_safe_met": dataset.n_safe_met,
            "unsafe_rate": dataset.unsafe_rate,
            "recipe": dataset.recipe,
        },
        "n_early": monitor.n_early,
        "lead": monitor.lead,
        "epsilon": monitor.recipe.epsilon,
        "guarantee": monitor.recipe.guarantee,
        "alert_above": monitor.alert_above(),
        "smallest_epsilon": monitor.smallest_epsilon,
        "validity": "calibrated" if monitor.support else training.not_calibrated,
        "evaluation": monitor.evaluation,
        "warnings": list(warnings_of(monitor.evaluation, monitor.recipe.epsilon)),
    }


def report(training: Training) -> str:
    """Return the lines that a person reads after a training."""
    monitor, test = training.monitor, training.test
    lines = [
        _dataset_line(training.dataset),
        f"calibrated on {len(monitor.alphas)} failures{_of_groups(monitor)}, {monitor.n_early} of "
        f"them earlier than the warning lead time of {monitor.lead:g} s; smallest epsilon "
        f"{monitor.smallest_epsilon:.3g}",
        _validity_line(training),
        f"alerts above a risk of {monitor.alert_above():.3g}, for a miss rate of at most "
        f"{monitor.recipe.epsilon:g} {PROMISED[monitor.recipe.guarantee]}",
    ]
    lines += test_lines(test, monitor.lead) if test else []
    warnings = warnings_of(monitor.evaluation, monitor.recipe.epsilon)
    return "\n".join([*lines, *(f"WARNING: {warning}" for warning in warnings)])


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
        return training.not_calibrated
    return (
        f"validity calibrated on {len(support.safe)} safe and {len(support.unsafe)} failing fresh "
        f"flights: at most {100 * support.level:.2g} % of either are called invalid"
    )


def _of_groups(monitor: Monitor) -> str:
    """How many of them each group has; empty where all are pooled."""
    groups = monitor.groups
    return "" if groups is None else f" ({groups.n_unsafe} in each of {len(groups.alphas)} groups)"


def test_lines(test: FlownTest, lead: float) -> list[str]:
    """Return the lines that a person reads of test flights.   lead: the promised one [s]."""
    counts = test.at_epsilon
    caught = int(counts.caught[0])
    return [
        f"fresh flights: {counts.n_unsafe} failed, {counts.n_safe} did not; at epsilon "
        f"{test.epsilon:g}:",
        _share("missed", counts.misses[0], counts.n_unsafe, "of failing flights"),
        *_withdrawn_line(int(counts.withdrawn[0]), counts.n_unsafe),
        _share("quiet", counts.quiet[0], counts.n_safe, "of safe flights, valid and no alert"),
        _share("false alarm", counts.false_alerts[0], counts.n_safe, "of safe flights"),
        *_safe_withdrawn_line(int(counts.safe_withdrawn[0]), counts.n_safe),
        _share("P(fail | alert)", caught, caught + counts.false_alerts[0], "of alerts"),
        _lead_line(test.leads, lead),
        *_prevention_lines(test.prevention),
        *(
            _robustness_line(DIFFERENCES[name].words, counts)
            for name, counts in test.robustness.items()
        ),
        *(
            _share("missed", counts.misses[0], counts.n_unsafe, f"of {name}")
            for groups in test.groups.values()
            for name, counts in groups.items()
        ),
    ]


def _prevention_lines(found: Prevention) -> list[str]:
    if not found.n_unsafe:
        return []
    shares = ", ".join(
        f"{prevented / found.n_unsafe:.0%} ({reaction_s:g} s)"
        for reaction_s, prevented in zip(found.reactions_s, found.prevented, strict=True)
    )
    return [
        f"  prevented          {shares} of failing flights, by mean reaction to an alert",
        _share("stopped", found.stopped, found.n_safe, "of safe flights, to no purpose"),
    ]


def _robustness_line(words: str, counts: Evaluation) -> str:
    failing, safe = "none failed", "none was safe"
    if n := counts.n_unsafe:
        missed, invalid = (int(of[0]) / n for of in (counts.misses, counts.withdrawn))
        failing = f"missed {missed:.1%}, invalid before an alert {invalid:.1%} of {n} failing"
    if n := counts.n_safe:
        vain, invalid = (int(of[0]) / n for of in (counts.false_alerts, counts.safe_withdrawn))
        safe = f"false alarm on {vain:.1%}, invalid without an alert {invalid:.1%} of {n} safe"
    return f"  {words}: {failing}; {safe}"


def _withdrawn_line(withdrawn: int, n_unsafe: int) -> list[str]:
    if not withdrawn:
        return []
    where = "of failing flights, before an alert: neither missed nor caught"
    return [_share("withdrawn", withdrawn, n_unsafe, where)]


def _safe_withdrawn_line(withdrawn: int, n_safe: int) -> list[str]:
    if not withdrawn:
        return []
    return [_share("invalid", withdrawn, n_safe, "of safe flights, no alert: not quiet")]


def _share(what: str, count: int, total: int, of: str) -> str:
    if total == 0:
        return f"  {what:18} none to count"
    low, high = clopper_pearson(count, total)
    return f"  {what:18} {count / total:6.1%} [{low:.1%}, {high:.1%}] {of}"


def _lead_line(lead: np.ndarray, required: float) -> str:
    warned = lead[np.isfinite(lead)]
    if not len(warned):
        return "  warning lead time  no failing flight had an alert"
    low, middle, high = np.quantile(warned, [0.05, 0.5, 0.95])
    return (
        f"  warning lead time  median {middle:.2f} s, 5-95 % {low:.2f} to {high:.2f} s; "
        f"{np.mean(lead >= required - 1e-9):.0%} at least {required:g} s"
    )
