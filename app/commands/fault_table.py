"""The command that puts each sensor of simulated flights at fault, and says by what it is found."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict

from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from app.scoring.fault_table import (
    FAULTS,
    KINDS,
    SENSORS,
    FaultCounts,
    FaultTableRecipe,
    fault_table,
)
from core.simulation.published import MODELS

MEANS = ("mapping", "validity", "flown_input", "compatibility", "found")
NONE = "-"


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    usual = FaultTableRecipe()
    parser.add_argument(
        "--aircraft",
        choices=tuple(MODELS),
        default=usual.aircraft,
        metavar="NAME",
        help=f"its usual test is trained for and flown: one of {', '.join(MODELS)} "
        f"(default: {usual.aircraft})",
    )
    for name, known in (("sensors", SENSORS), ("faults", FAULTS)):
        parser.add_argument(
            f"--{name}", type=names, metavar="NAMES", help=f"of {', '.join(known)}; all if absent"
        )
    numbers = {
        "n_flights": "flights of each kind, safe and failing, of each fault",
        "n_unsafe": "unsafe rollouts that the monitor is trained on",
        "seed": "seed of every random draw",
    }
    add_table_options(parser, usual, numbers)


def run(options: argparse.Namespace) -> int:
    """Train the monitor, fly the faults, print how often each was found."""
    recipe = recipe_of(FaultTableRecipe, options)
    with progress_bar("faults") as progress:
        rows = list(fault_table(recipe, progress))
    print_table(options, rows, in_words(rows), [asdict(row) for row in rows])
    return 0


def in_words(rows: Sequence[FaultCounts]) -> str:
    """One line a fault: how many of the safe and of the failing flights each means found."""
    n = rows[0].n if rows else 0
    head = f"{'sensor':8} {'fault':14}" + "".join(
        f" {name.replace('_', ' '):>14}" for name in MEANS
    )
    lines = [f"found in so many of {n} safe + {n} failing flights, by:", head]
    for safe, failing in zip(rows[:: len(KINDS)], rows[1 :: len(KINDS)], strict=True):
        counts = (f"{getattr(safe, name)} + {getattr(failing, name)}" for name in MEANS)
        cells = "".join(f" {NONE if count == '0 + 0' else count:>14}" for count in counts)
        lines.append(f"{safe.sensor:8} {safe.fault:14}{cells}")
    return "\n".join(lines)
