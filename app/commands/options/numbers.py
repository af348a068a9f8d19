"""Options that are a number each, with what holds where none is given."""

import argparse
from collections.abc import Callable, Iterable


def add_numbers(
    parser: argparse.ArgumentParser,
    numbers: Iterable[tuple[str, Callable[[str], float], float, str]],
) -> None:
    """Add options: name, int or float, the usual number, and what it is."""
    for option, kind, usual, text in numbers:
        parser.add_argument(
            option, type=kind, default=usual, metavar="NUMBER", help=f"{text}; {usual:g} if absent"
        )
