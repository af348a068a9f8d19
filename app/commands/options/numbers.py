"""Numeric options with defaults."""

import argparse
from collections.abc import Callable, Iterable


def add_numbers(
    parser: argparse.ArgumentParser,
    numbers: Iterable[tuple[str, Callable[[str], float], float, str]],
) -> None:
    """numbers: option, int or float, default, help."""
    for option, kind, usual, text in numbers:
        parser.add_argument(
            option, type=kind, default=usual, metavar="NUMBER", help=f"{text}; {usual:g} if absent"
        )
