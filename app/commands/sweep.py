"""The command that says how early planned tests can be warned of, by which method, at what cost."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from app.commands.output.figure_file import check_figure, write_figure
from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from app.report.studies.sweep import in_words, rows_of
from core.evaluation.lead_sweep import METHODS, TESTS, SweepRecipe, sweep
from core.monitor.calibration import Guarantee


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    usual = SweepRecipe()
    for name, known in (("tests", TESTS), ("methods", METHODS)):
        parser.add_argument(
            f"--{name}", type=names, metavar="NAMES", help=f"of {'; '.join(known)}; all if absent"
        )
    for option, name, words in (
        ("leads", "leads_s", "warning lead times"),
        ("reactions", "reactions_s", "mean times from an alert to neutral controls"),
    ):
        default = getattr(usual, name)
        parser.add_argument(
            f"--{option}",
            dest=name,
            type=seconds,
            metavar="SECONDS",
            default=default,
            help=f"{words} (default: {','.join(f'{time:g}' for time in default)})",
        )
    parser.add_argument(
        "--imperfections",
        choices=("none", "usual"),
        default=usual.imperfections,
        help=f"of a real flight, in training as in testing (default: {usual.imperfections})",
    )
    parser.add_argument(
        "--ceiling",
        action="store_true",
        help="also what a posterior of all derivatives could tell: takes a minute a test",
    )
    parser.add_argument("--epsilon", type=float, default=usual.epsilon, help="promised miss rate")
    parser.add_argument(
        "--guarantee", choices=get_args(Guarantee), default=usual.guarantee, help="promise on it"
    )
    numbers = {
        "n_unsafe": "unsafe rollouts that each monitor is calibrated on",
        "n_monitors": "monitors of each method and lead",
        "n_test": "fresh test flights of each monitor",
        "seed": "seed of every random draw",
    }
    parser.add_argument(
        "--figure", type=Path, help="figure written, .png or .svg: power against lead"
    )
    add_table_options(parser, usual, numbers)


def seconds(text: str) -> tuple[float, ...]:
    """Times with commas between them [s]."""
    return tuple(float(time) for time in text.split(","))


def run(options: argparse.Namespace) -> int:
    """Train and test every monitor; print the tables."""
    recipe = recipe_of(SweepRecipe, options)
    check_figure(options.figure)
    with progress_bar("monitors") as progress:
        found = sweep(recipe, progress=progress)
    if options.figure is not None:
        from app.report.studies.sweep_figure import power_against_lead  # matplotlib

        write_figure(options.figure, power_against_lead(found, recipe))
    rows = [row for name, test in found.items() for row in rows_of(name, test, recipe)]
    print_table(options, rows, in_words(found, recipe), [asdict(row) for row in rows])
    return 0
