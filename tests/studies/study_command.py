"""A study's command line: an option for each field of its recipe, the table printed and as CSV."""

import argparse
import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from app.commands.output.results import progress_bar

Progress = Callable[[int, int], object]


def run_study(
    recipe_class: type[Any],
    study: Callable[[Any, Progress], Iterable[Any]],
    in_words: Callable[[Sequence[Any], Any], str],
    plain: Callable[[Any], dict[str, Any]],
    draw: Callable[[Sequence[Any], Any], Figure] | None = None,
    arguments: Sequence[str] | None = None,
) -> None:
    """Read the recipe from the arguments, run the study, print its rows and write them as CSV.

    draw: a figure of the rows, written beside the CSV file as SVG.
    """
    parser = argparse.ArgumentParser(description=recipe_class.__doc__)
    for field in fields(recipe_class):
        read = _reader(field.default)
        parser.add_argument(f"--{field.name.replace('_', '-')}", type=read, default=field.default)
    parser.add_argument("-o", "--out", type=Path, help="CSV file to write")
    options = vars(parser.parse_args(arguments))
    out = options.pop("out")
    recipe = recipe_class(**options)
    with progress_bar(recipe_class.__name__) as progress:
        rows = list(study(recipe, progress))
    if out is not None:
        table = [plain(row) for row in rows]
        with out.open("w", newline="") as file:
            writer = csv.DictWriter(file, [*table[0]], lineterminator="\n")
            writer.writeheader()
            writer.writerows(table)
        if draw is not None:
            draw(rows, recipe).savefig(out.with_suffix(".svg"))
    print(in_words(rows, recipe))


def _reader(default: Any) -> Callable[[str], Any]:
    """How an option is read: like its default, a tuple with commas between its items."""
    if not isinstance(default, tuple):
        return type(default)
    item = type(default[0])
    return lambda text: tuple(item(part.strip()) for part in text.split(","))
