"""The command that says what campaigns avoid, and how many safe points that costs."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from app.commands.output.figure_file import check_figure, write_figure
from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from app.report.studies.campaign_study import in_words, rows_of
from core.evaluation.campaign_study import CampaignStudyRecipe, campaign_study
from core.evaluation.lead_sweep import METHODS, TESTS
from core.monitor.calibration import Guarantee


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    usual = CampaignStudyRecipe()
    parser.add_argument("--tests", type=names, metavar="NAMES", help=f"of {'; '.join(TESTS)}")
    parser.add_argument("--method", help=f"of the monitor: {'; '.join(METHODS)}")
    for option, name, words in (
        ("steps", "steps", "points, shares of the planned amplitude"),
        ("clearance-epsilons", "clearance_epsilons", "shares of wrong clearances, 1: none is made"),
        ("monitor-epsilons", "monitor_epsilons", "miss rates, 1: no monitor"),
    ):
        default = getattr(usual, name)
        parser.add_argument(
            f"--{option}",
            type=shares,
            metavar="SHARES",
            default=default,
            help=f"{words} (default: {','.join(f'{share:g}' for share in default)})",
        )
    parser.add_argument(
        "--imperfections",
        choices=("none", "usual"),
        default=usual.imperfections,
        help=f"of a real flight (default: {usual.imperfections})",
    )
    parser.add_argument(
        "--guarantee", choices=get_args(Guarantee), default=usual.guarantee, help="promise of both"
    )
    for option, name, words in (
        ("lead", "lead_s", "warning lead time [s]"),
        ("reaction", "reaction_s", "mean time from an alert to neutral controls [s]"),
    ):
        parser.add_argument(
            f"--{option}", dest=name, type=float, default=getattr(usual, name), help=words
        )
    numbers = {
        "n_flown": "aircraft that fly the build-up",
        "n_unsafe": "failures that each monitor is calibrated on",
        "n_exceeding": "exceeding aircraft that calibrate each clearance",
        "n_aircraft": "aircraft that calibrate its checks",
        "seed": "seed of every random draw",
    }
    parser.add_argument("--figure", type=Path, help="figure written, .png or .svg")
    add_table_options(parser, usual, numbers)


def shares(text: str) -> tuple[float, ...]:
    """Numbers with commas between them."""
    return tuple(float(share) for share in text.split(","))


def run(options: argparse.Namespace) -> int:
    """Fly every build-up; print the table."""
    recipe: CampaignStudyRecipe = recipe_of(CampaignStudyRecipe, options)
    check_figure(options.figure)
    with progress_bar("points") as progress:
        found = campaign_study(recipe, lambda words, done, total: progress(done, total))
    if options.figure is not None:
        from app.report.studies.campaign_figure import avoided_against_lost  # matplotlib

        write_figure(options.figure, avoided_against_lost(found, recipe))
    rows = rows_of(found)
    print_table(options, rows, in_words(found, recipe), [asdict(row) for row in rows])
    return 0
