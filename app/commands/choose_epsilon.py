"""The command that chooses a monitor's epsilon by costs, or so that two targets are kept."""

import argparse
from dataclasses import asdict, fields
from pathlib import Path

from app.commands.output.results import add_json, print_result
from app.jobs.choosing import fly_and_choose, in_words
from core.evaluation.epsilon_choice import N_FLIGHTS, ChoiceRecipe
from core.monitor import load


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("monitor", type=Path, metavar="MONITOR.fwm", help="a trained monitor")
    parser.add_argument(
        "--most-missed", type=float, help="share of failing flights, at most: 0.1 for 10 %%"
    )
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
    asked = {field.name: getattr(options, field.name) for field in fields(ChoiceRecipe)}
    recipe = ChoiceRecipe(**asked)
    found = fly_and_choose(load(options.monitor), recipe, lambda *_: None)
    print_result(options, in_words(found), asdict(found))
    return 0
