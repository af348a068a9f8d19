"""`forewarn choose-epsilon`: epsilon from a cost, or from limits on misses and false alarms."""

import argparse
from dataclasses import asdict, fields
from pathlib import Path

from app.commands.options.numbers import add_numbers
from app.commands.output.results import add_json, print_result
from app.jobs.choosing import fly_and_choose, in_words
from core.evaluation.epsilon_choice import N_FLIGHTS, ChoiceRecipe
from core.monitor import load


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("monitor", type=Path, metavar="MONITOR.fwm", help="a trained monitor")
    for option, text in (
        ("--most-missed", "largest share of failing flights missed, such as 0.1"),
        ("--most-false-alarms", "largest share of safe flights with an alert, such as 0.2"),
        ("--cost-of-miss", "how many false alarms a miss costs; replaces both limits"),
    ):
        parser.add_argument(option, type=float, metavar="NUMBER", help=text)
    n_test = ("--n-test", int, N_FLIGHTS, "fresh flights, half to choose and half to certify")
    add_numbers(parser, (n_test,))
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    given = {field.name: getattr(options, field.name) for field in fields(ChoiceRecipe)}
    choice = fly_and_choose(load(options.monitor), ChoiceRecipe(**given), lambda *_: None)
    print_result(options, in_words(choice), asdict(choice))
    return 0
