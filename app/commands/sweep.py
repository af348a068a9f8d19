"""`forewarn sweep`: how early each method can warn of the planned tests, and at what cost."""

import argparse
import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.commands.options.fields import add_fields, given_fields
from app.commands.options.option import add_output, add_scheduler, option
from app.commands.output.results import check_file, print_result, progress_bar
from app.jobs.cluster import executor_at
from app.report.studies.sweep import in_words, rows_of
from core.evaluation.lead_sweep import COMPARED, TESTS, SweepRecipe, sweep
from core.whole_file import write_whole


def add(parser: argparse.ArgumentParser) -> None:
    add_fields(parser, SweepRecipe, known={"tests": TESTS, "methods": COMPARED})
    option(
        parser,
        "--figure FILE",
        "PNG or SVG to write: safe flights without a false alarm",
        type=Path,
    )
    add_output(parser, "FILE", "CSV table to write")
    add_scheduler(parser)


def run(options: argparse.Namespace) -> int:
    recipe = SweepRecipe(**given_fields(options, SweepRecipe))
    for path in filter(None, (options.out, options.figure)):
        check_file(path)
    if options.figure is not None and options.figure.suffix not in (".png", ".svg"):
        raise ValueError(f"{options.figure} was given: a figure's name ends in .png or .svg")
    with executor_at(options.scheduler) as executor, progress_bar("monitors") as progress:
        tests = sweep(recipe, executor=executor, progress=progress)
    if options.figure is not None:
        from app.report.studies.study_figures import (
            power_against_lead,
            render,  # matplotlib, slow to import
        )

        kind = options.figure.suffix[1:]
        images = render(power_against_lead(tests, recipe), "figure", [kind])
        write_whole(options.figure, images[f"figure.{kind}"])
    rows = [row for name, test in tests.items() for row in rows_of(name, test, recipe)]
    if options.out is not None:
        write_whole(options.out, _csv(rows).encode())
    print_result(options, in_words(tests, recipe), rows)
    return 0


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    file = io.StringIO()
    writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue()
