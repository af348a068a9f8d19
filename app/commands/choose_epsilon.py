"""`forewarn choose-epsilon`: epsilon from a cost, or from limits on misses and false alarms."""

import argparse
from dataclasses import asdict
from pathlib import Path

from app.commands.options.fields import add_fields, given_fields
from app.commands.options.option import add_json, option
from app.commands.output.results import print_result, stage_bar
from app.jobs.kinds import fly_and_choose, in_words
from core.evaluation.epsilon_choice import ChoiceRecipe
from core.monitor import load


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "monitor MONITOR.fwm", "a trained monitor", type=Path)
    add_fields(parser, ChoiceRecipe)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    recipe = ChoiceRecipe(**given_fields(options, ChoiceRecipe))
    with stage_bar("choosing epsilon") as show:
        choice = fly_and_choose(load(options.monitor), recipe, show)
    print_result(options, in_words(choice), asdict(choice))
    return 0
