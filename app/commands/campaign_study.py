"""The command that says what campaigns avoid, and how many safe points that costs."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from app.commands.options.destinations import check_file
from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from app.report.campaign_study import in_words, rows_of
from core.evaluation.campaign_study import CampaignCounts, CampaignStudyRecipe, campaign_study
from core.evaluation.lead_sweep import METHODS, TESTS
from core.monitor.calibration import Guarantee
from core.whole_file import write_whole


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
    if options.figure is not None:
        check_file(options.figure)
        if options.figure.suffix not in (".png", ".svg"):
            raise ValueError(f"{options.figure} was given: a figure's name ends in .png or .svg")
    with progress_bar("points") as progress:
        found = campaign_study(recipe, lambda words, done, total: progress(done, total))
    if options.figure is not None:
        write_whole(options.figure, _figure(options.figure, found, recipe))
    rows = rows_of(found)
    print_table(options, rows, in_words(found, recipe), [asdict(row) for row in rows])
    return 0


def _figure(path: Path, found: list[CampaignCounts], recipe: CampaignStudyRecipe) -> bytes:
    from app.report.campaign_figure import avoided_against_lost  # matplotlib
    from app.report.study_figures import render

    kind = path.suffix[1:]
    return render(avoided_against_lost(found, recipe), "campaign", [kind])[f"campaign.{kind}"]
