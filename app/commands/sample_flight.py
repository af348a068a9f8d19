"""The command that writes a simulated flight as a recorder would: something to score at once."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.commands.options.option import add_output, option
from app.commands.output.results import check_file, print_result
from core.channels import KEYS
from core.planned_test.amplitude import HIGHEST_DEG
from core.planned_test.collection import DatasetRecipe, evaluation_flights
from core.simulation.aircraft import AIRCRAFT
from core.simulation.published import MODELS
from core.types import Array
from core.whole_file import write_whole

COLUMNS = ("t_s", "beta_deg", "p_degps", "r_degps", "ay_g", "da_deg", "dr_deg")
TEXTS = (".csv", ".txt")
TRIM_S, TAIL_S = 5.0, 2.0
"""[s] Recorded in trim before the planned test, and after its end."""
FLIGHTS = 100
"""Simulated; the first with the outcome asked for is written."""


def add(parser: argparse.ArgumentParser) -> None:
    option(
        parser,
        "--aircraft NAME",
        f"whose usual rudder doublet is flown, %(default)s if absent: {', '.join(MODELS)}",
        choices=tuple(MODELS),
        default=next(iter(MODELS)),
    )
    option(
        parser,
        "--amplitude DEG",
        "of the doublet, negative for the other side first; the usual one if absent",
        type=float,
    )
    option(parser, "--seed NUMBER", "of the aircraft", type=int, default=0)
    option(
        parser,
        "--outcome",
        "whether the flight exceeds its limit; random: whatever the seed gives",
        choices=("unsafe", "safe", "random"),
        default="unsafe",
    )
    add_output(parser, "FILE", "CSV file to write", Path("flight.csv"))


def run(options: argparse.Namespace) -> int:
    """Write a flight of the aircraft's usual test; the same seed writes the same flight."""
    out = check_file(options.out)
    if out.suffix.lower() not in TEXTS:
        raise ValueError(f"--out {out}: a CSV file is written: end its name in {TEXTS[0]}")
    recipe = replace(DatasetRecipe.usual(AIRCRAFT[options.aircraft]), seed=options.seed)
    if options.amplitude is not None:
        if not abs(options.amplitude) <= HIGHEST_DEG:
            raise ValueError(
                f"--amplitude {options.amplitude:g}: give -{HIGHEST_DEG:g} to {HIGHEST_DEG:g} deg"
            )
        recipe = replace(recipe, maneuver=recipe.maneuver.with_peak(options.amplitude))
    recorded_s = recipe.maneuver.duration_s + TAIL_S
    flown = replace(recipe, maneuver=replace(recipe.maneuver, duration_s=recorded_s))
    flights = evaluation_flights(flown, FLIGHTS)
    wanted = {"unsafe": flights.is_unsafe, "safe": ~flights.is_unsafe}
    matching = np.flatnonzero(wanted.get(options.outcome, np.ones(FLIGHTS)))
    if len(matching) == 0:
        is_higher = options.outcome == "unsafe"
        lacks, change = ("exceeds", "further from 0") if is_higher else ("keeps", "nearer to 0")
        raise ValueError(
            f"none of {FLIGHTS} flights at {recipe.maneuver.peak_deg:g} deg {lacks} its limit: "
            f"give an --amplitude {change}"
        )
    number = int(matching[0])
    write_whole(out, table(flights.y[number], recipe.dt).encode())
    is_unsafe = bool(flights.is_unsafe[number])
    exceeds_at = TRIM_S + float(flights.fail_index[number]) * recipe.dt if is_unsafe else None
    words = f"exceeds its limit at {exceeds_at:g} s" if is_unsafe else "keeps its limit"
    text = f"written: {out}, a rudder doublet of {options.aircraft} that {words}"
    print_result(options, text, {"file": str(out), "exceeds_at": exceeds_at})
    return 0


def table(y: Array, dt: float) -> str:
    """A flight (n, 6) as CSV in degrees, deg/s and g, after TRIM_S in trim."""
    y = np.vstack([np.zeros((round(TRIM_S / dt), len(KEYS))), y])
    scale = np.array([1.0 if key == "Ny" else np.degrees(1.0) for key in KEYS])
    rows = np.column_stack([np.arange(len(y)) * dt, y * scale])
    lines = (",".join(f"{number:.9g}" for number in row) for row in rows)
    return "\n".join([",".join(COLUMNS), *lines, ""])
