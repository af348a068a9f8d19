"""What commands share that print a table of counts: their options, and the table as CSV."""

import argparse
import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from app.commands.options.destinations import check_file
from app.commands.output.results import add_json, print_result
from core.whole_file import write_whole


def names(text: str) -> tuple[str, ...]:
    """Names with commas between them."""
    return tuple(name.strip() for name in text.split(","))


def add_table_options(
    parser: argparse.ArgumentParser, usual: Any, words: Mapping[str, str]
) -> None:
    """Add whole numbers of a recipe by their names, the CSV file, and JSON.

    usual: the recipe of the defaults.   words: what each number is.
    """
    for option, meaning in words.items():
        default = getattr(usual, option)
        parser.add_argument(
            f"--{option.replace('_', '-')}",
            type=int,
            default=default,
            help=f"{meaning} (default: {default})",
        )
    parser.add_argument("-o", "--out", type=Path, help="CSV table written")
    add_json(parser)


def recipe_of(kind: type[Any], options: argparse.Namespace) -> Any:
    """The recipe that the options give; ValueError where it refuses them, or the CSV's place."""
    if options.out is not None:
        check_file(options.out)
    given = {field.name: getattr(options, field.name) for field in fields(kind)}
    return kind(**{name: value for name, value in given.items() if value is not None})


def print_table(
    options: argparse.Namespace, rows: Sequence[Any], text: str, answer: Sequence[Any]
) -> None:
    """Write the rows, dataclasses of one kind, where that is asked for; print text or JSON."""
    if options.out is not None:
        write_whole(options.out, as_csv(rows).encode())
    print_result(options, text, list(answer))


def as_csv(rows: Sequence[Any]) -> str:
    """Dataclasses of one kind as a table, a column a field."""
    file = io.StringIO()
    columns = [field.name for field in fields(rows[0])] if rows else []
    writer = csv.DictWriter(file, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return file.getvalue()
