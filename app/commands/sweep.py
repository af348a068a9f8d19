"""The command that says how early planned tests can be warned of, by which method, at what cost."""

import argparse
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from app.commands.options.destinations import check_file
from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from app.report.sweep import in_words, rows_of
from core.evaluation.lead_sweep import METHODS, TESTS, PlannedTestSweep, SweepRecipe, sweep
from core.monitor.calibration import Guarantee
from core.whole_file import write_whole


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
    if options.figure is not None:
        _check_figure(options.figure)
    with progress_bar("monitors") as progress:
        found = sweep(recipe, progress=progress)
    if options.figure is not None:
        write_whole(options.figure, _figure(options.figure, found, recipe))
    rows = [row for name, test in found.items() for row in rows_of(name, test, recipe)]
    print_table(options, rows, in_words(found, recipe), [asdict(row) for row in rows])
    return 0


def _check_figure(path: Path) -> None:
    check_file(path)
    if path.suffix not in (".png", ".svg"):
        raise ValueError(f"{path} was given: a figure's name ends in .png or .svg")


def _figure(path: Path, found: Mapping[str, PlannedTestSweep], recipe: SweepRecipe) -> bytes:
    from app.report.study_figures import render  # matplotlib: a quarter of a second
    from app.report.sweep_figure import power_against_lead

    kind = path.suffix[1:]
    return render(power_against_lead(found, recipe), "sweep", [kind])[f"sweep.{kind}"]
