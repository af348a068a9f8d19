"""The command that puts each sensor of simulated flights at fault, and says by what it is found."""

import argparse
import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from app.commands.destinations import check_file
from app.commands.progress import progress_bar
from app.commands.results import add_json, print_result
from app.scoring.fault_table import (
    FAULTS,
    KINDS,
    SENSORS,
    FaultTableRecipe,
    FoundFaults,
    fault_table,
)
from core.simulation.published import MODELS
from core.whole_file import write_whole

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
            f"--{name}", type=_names, metavar="NAMES", help=f"of {', '.join(known)}; all if absent"
        )
    for option, words in (
        ("n_flights", "flights of each kind, safe and failing, of each fault"),
        ("n_unsafe", "unsafe rollouts that the monitor is trained on"),
        ("seed", "seed of every random draw"),
    ):
        default = getattr(usual, option)
        parser.add_argument(
            f"--{option.replace('_', '-')}",
            type=int,
            default=default,
            help=f"{words} (default: {default})",
        )
    parser.add_argument("-o", "--out", type=Path, help="CSV table written")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Train the monitor, fly the faults, print how often each was found."""
    names = {key: getattr(options, key) for key in ("sensors", "faults")}
    recipe = FaultTableRecipe(
        aircraft=options.aircraft,
        n_flights=options.n_flights,
        n_unsafe=options.n_unsafe,
        seed=options.seed,
        **{key: given for key, given in names.items() if given is not None},
    )
    if options.out is not None:
        check_file(options.out)
    with progress_bar("faults") as progress:
        rows = list(fault_table(recipe, progress))
    if options.out is not None:
        write_whole(options.out, table(rows).encode())
    print_result(options, in_words(rows), [asdict(row) for row in rows])
    return 0


def table(rows: Sequence[FoundFaults]) -> str:
    """The counts as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(
        text, [field.name for field in fields(FoundFaults)], lineterminator="\n"
    )
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return text.getvalue()


def in_words(rows: Sequence[FoundFaults]) -> str:
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


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))
