"""The command that says what a clearance is worth where the model is wrong."""

import argparse
from collections.abc import Sequence

from app.commands.options.numbers import add_numbers
from app.commands.output.progress import progress_bar
from app.commands.output.results import add_json, print_result
from app.commands.output.tables import names
from core.evaluation.clearance_errors import ErrorRow, ErrorTableRecipe, error_table
from core.evaluation.lead_sweep import TESTS

USUAL = ErrorTableRecipe()


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "--tests", type=names, default=USUAL.tests, metavar="NAMES", help=f"of {', '.join(TESTS)}"
    )
    parser.add_argument(
        "--steps",
        type=float,
        nargs="+",
        default=USUAL.steps,
        metavar="SHARE",
        help="flown steps, shares of the planned amplitude (default: 0.6)",
    )
    numbers = (
        ("--epsilon", float, USUAL.epsilon, "accepted share of wrong clearances"),
        ("--n-exceeding", int, USUAL.n_exceeding, "exceeding aircraft that calibrate each"),
        ("--n-aircraft", int, USUAL.n_aircraft, "aircraft that each error is tried on"),
        ("--seed", int, USUAL.seed, "seed of every random draw"),
    )
    add_numbers(parser, numbers)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Calibrate a clearance for each test; fly and identify aircraft with each error."""
    recipe = ErrorTableRecipe(
        tests=tuple(options.tests),
        steps=tuple(options.steps),
        epsilon=options.epsilon,
        n_exceeding=options.n_exceeding,
        n_aircraft=options.n_aircraft,
        seed=options.seed,
    )
    with progress_bar("errors") as progress:
        rows = list(error_table(recipe, progress))
    print_result(options, in_words(rows), [row._asdict() for row in rows])
    return 0


def in_words(rows: Sequence[ErrorRow]) -> str:
    """One line an error of a test."""
    lines = [
        "wrongly: of exceeding aircraft those that the prediction clears; unflagged: those of them "
        "that no check withdraws",
        f"{'':8} {'error':44} {'exceed':>6} {'wrongly':>8} {'unflagged':>9} {'safe cleared':>12} "
        f"{'flagged':>8}",
    ]
    for row in rows:
        n = row.n_exceed + row.n_safe
        shares = [
            f"{part / whole:.3f}" if whole else "-"
            for part, whole in (
                (row.wrongly, row.n_exceed),
                (row.wrongly_unflagged, row.n_exceed),
                (row.safe_cleared, row.n_safe),
                (row.flagged, n),
            )
        ]
        lines.append(
            f"{row.test:8} {row.error:44} {row.n_exceed / n:6.2f} {shares[0]:>8} {shares[1]:>9} "
            f"{shares[2]:>12} {shares[3]:>8}"
        )
    return "\n".join(lines)
