"""The command that chooses a monitor's epsilon by costs, or so that two targets are kept."""

import argparse
from dataclasses import asdict
from pathlib import Path

from app.commands.output.results import add_json, print_result
from app.recipes import from_plain
from core.collection import DatasetRecipe, evaluation_flights
from core.evaluation.epsilon_choice import Choice, choose_by_costs, choose_by_targets
from core.evaluation.rates import clopper_pearson
from core.monitor import load

N_FLIGHTS = 10_000


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("monitor", type=Path, metavar="MONITOR.fwm", help="a trained monitor")
    parser.add_argument("--most-missed", type=float, help="share of failing flights, at most")
    parser.add_argument(
        "--most-false-alarms", type=float, help="share of safe flights with an alert, at most"
    )
    parser.add_argument(
        "--cost-of-miss", type=float, help="in false alarms, instead of both targets"
    )
    parser.add_argument(
        "--n-test",
        type=int,
        default=N_FLIGHTS,
        help=f"fresh flights, half to choose and half to certify (default: {N_FLIGHTS})",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Fly fresh flights through the monitor; print the epsilon and what it costs."""
    targets = options.most_missed, options.most_false_alarms
    if (options.cost_of_miss is None) == (None in targets):
        raise ValueError("give --most-missed with --most-false-alarms, or --cost-of-miss alone")
    if options.n_test < 1:
        raise ValueError(f"--n-test {options.n_test}: it must be 1 or more")
    monitor = load(options.monitor)
    if not monitor.dataset_recipe:
        raise ValueError(
            f"{options.monitor} does not say which planned test it was trained for, so no fresh "
            "flights can be flown: train it again"
        )
    recipe = from_plain(DatasetRecipe(), monitor.dataset_recipe, "dataset")
    flights = evaluation_flights(recipe, options.n_test)
    if options.cost_of_miss is None:
        found = choose_by_targets(monitor, flights, *targets)
    else:
        found = choose_by_costs(monitor, flights, options.cost_of_miss)
    print_result(options, in_words(found), asdict(found))
    return 0


def in_words(found: Choice) -> str:
    """The epsilon, and both shares with their intervals."""
    missed = clopper_pearson(found.misses, found.n_unsafe)
    false = clopper_pearson(found.false_alerts, found.n_safe)
    return "\n".join(
        [
            f"epsilon {found.epsilon:.4g}: alerts above a risk of {found.alert_above:.4g}",
            "on fresh flights that had no part in choosing it:",
            f"  missed        {found.misses / found.n_unsafe:6.2%} [{missed[0]:.2%}, "
            f"{missed[1]:.2%}] of {found.n_unsafe} failing flights",
            f"  false alarms  {found.false_alerts / found.n_safe:6.2%} [{false[0]:.2%}, "
            f"{false[1]:.2%}] of {found.n_safe} safe flights",
            f"with 95 % confidence at most {found.most_missed:.2%} missed and at most "
            f"{found.most_false:.2%} false alarms",
        ]
    )
