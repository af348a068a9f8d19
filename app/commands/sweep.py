"""`forewarn sweep`: how early each method can warn of the planned tests, and at what cost."""

import argparse
import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import get_args

from app.commands.options.destinations import check_file
from app.commands.options.numbers import add_numbers
from app.commands.output.progress import progress_bar
from app.commands.output.results import add_json, print_result
from app.report.studies.sweep import Row, in_words, rows_of
from core.evaluation.lead_sweep import METHODS, TESTS, SweepRecipe, sweep
from core.monitor.calibration import Guarantee
from core.whole_file import write_whole


def add(parser: argparse.ArgumentParser) -> None:
    usual = SweepRecipe()
    for name, known in (("tests", TESTS), ("methods", METHODS)):
        parser.add_argument(
            f"--{name}", type=_names, metavar="NAMES", help=f"{'; '.join(known)}; all if absent"
        )
    for option, name, text in (
        ("--leads", "leads_s", "warning lead times"),
        ("--reactions", "reactions_s", "mean times from an alert to neutral controls"),
    ):
        default = getattr(usual, name)
        listed = ",".join(f"{time:g}" for time in default)
        parser.add_argument(
            option,
            dest=name,
            type=_seconds,
            metavar="SECONDS",
            default=default,
            help=f"{text}; {listed} if absent",
        )
    parser.add_argument(
        "--imperfections",
        choices=("none", "usual"),
        default=usual.imperfections,
        help="imperfections of a real flight, in training and in testing; "
        f"{usual.imperfections} if absent",
    )
    parser.add_argument(
        "--ceiling",
        action="store_true",
        help="also compute how well any method could do that knows the posterior of all "
        "derivatives; takes a minute a test",
    )
    parser.add_argument(
        "--guarantee",
        choices=get_args(Guarantee),
        default=usual.guarantee,
        help="promise on the miss rate",
    )
    numbers = (
        ("--epsilon", float, usual.epsilon, "accepted miss rate"),
        ("--n-unsafe", int, usual.n_unsafe, "unsafe rollouts that calibrate each monitor"),
        ("--n-monitors", int, usual.n_monitors, "monitors for each method and lead time"),
        ("--n-test", int, usual.n_test, "fresh test flights for each monitor"),
        ("--seed", int, usual.seed, "seed of every random draw"),
    )
    add_numbers(parser, numbers)
    parser.add_argument(
        "--figure",
        type=Path,
        metavar="FILE",
        help="figure to write, .png or .svg: safe flights without a false alarm by lead time",
    )
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="CSV table to write")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    given = {field.name: getattr(options, field.name) for field in fields(SweepRecipe)}
    recipe = SweepRecipe(**{name: value for name, value in given.items() if value is not None})
    for path in filter(None, (options.out, options.figure)):
        check_file(path)
    if options.figure is not None and options.figure.suffix not in (".png", ".svg"):
        raise ValueError(f"{options.figure} was given: a figure's name ends in .png or .svg")
    with progress_bar("monitors") as progress:
        tests = sweep(recipe, progress=progress)
    if options.figure is not None:
        from app.report.studies.study_figures import render  # matplotlib, slow to import
        from app.report.studies.sweep_figure import power_against_lead

        kind = options.figure.suffix[1:]
        images = render(power_against_lead(tests, recipe), "figure", [kind])
        write_whole(options.figure, images[f"figure.{kind}"])
    rows = [row for name, test in tests.items() for row in rows_of(name, test, recipe)]
    if options.out is not None:
        write_whole(options.out, _csv(rows).encode())
    print_result(options, in_words(tests, recipe), [asdict(row) for row in rows])
    return 0


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


def _seconds(text: str) -> tuple[float, ...]:
    return tuple(float(time) for time in text.split(","))


def _csv(rows: Sequence[Row]) -> str:
    file = io.StringIO()
    columns = [field.name for field in fields(Row)]
    writer = csv.DictWriter(file, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return file.getvalue()
