"""The command that flies every published aircraft through the monitor of every other."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from core.evaluation.validity_matrix import MatrixRecipe, Pair, pairs
from core.monitor.recipe import MonitorRecipe
from core.simulation.published import MODELS

FEW = 100
"""Exceeding flights below which a bound says little."""


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    known = ", ".join(MODELS)
    for name, words in (("monitors", "monitors are trained for"), ("aircraft", "are flown")):
        parser.add_argument(
            f"--{name}", type=names, metavar="NAMES", help=f"aircraft that {words}: {known}"
        )
    numbers = {
        "n_unsafe": "unsafe rollouts that each monitor is trained on",
        "n_failing": "exceeding flights of each pair, as far as there are any",
        "most_flights": "flights of each pair at most",
        "seed": "seed of every random draw",
    }
    add_table_options(parser, MatrixRecipe(), numbers)


def run(options: argparse.Namespace) -> int:
    """Train the monitors, fly the pairs, print the matrix."""
    recipe = recipe_of(MatrixRecipe, options)
    with progress_bar("monitors") as progress:
        flown = list(pairs(recipe, progress))
    print_table(options, flown, in_words(flown), [plain(pair) for pair in flown])
    return 0


def plain(pair: Pair) -> dict[str, Any]:
    """Return a pair with its shares, as JSON's types."""
    shares = {
        "share_invalid": pair.share_invalid,
        "share_unwarned": pair.share_unwarned,
        "most_unwarned": pair.most_unwarned,
    }
    return asdict(pair) | shares


def in_words(flown: Sequence[Pair]) -> str:
    """One line a pair, and what is worst."""
    head = (
        f"{'monitor':15} {'aircraft':15} {'doublet':>8} {'flights':>7} {'exceed':>6} "
        f"{'invalid':>7} {'missed':>6}   valid and missed"
    )
    lines = [head, *map(_line, flown)]
    own = [pair for pair in flown if pair.is_own]
    others = [pair for pair in flown if not pair.is_own and pair.n_failing >= FEW]
    if own:
        worst = max(own, key=lambda pair: pair.share_invalid)
        lines.append(f"own aircraft called invalid: at most {worst.share_invalid:.1%}")
    if others:
        worst = max(others, key=lambda pair: pair.most_unwarned)
        epsilon = MonitorRecipe().epsilon
        above = sum(pair.most_unwarned > epsilon for pair in others)
        lines.append(
            f"others, of the flights that exceed, valid and missed: {worst.share_unwarned:.1%}, "
            f"surely below {worst.most_unwarned:.1%}, where it is most ({worst.monitor} on "
            f"{worst.aircraft}); above epsilon {epsilon:g} in {above} of {len(others)} pairs"
        )
    return "\n".join(lines)


def _line(pair: Pair) -> str:
    unwarned = "none exceeds"
    if pair.share_unwarned is not None:
        unwarned = f"{pair.share_unwarned:.1%}, surely below {pair.most_unwarned:.1%}"
    n_missed = f"{pair.missed / pair.n_failing:.0%}" if pair.n_failing else "-"
    return (
        f"{pair.monitor:15} {pair.aircraft:15} {pair.amplitude_deg:7.3g}° "
        f"{pair.n_safe + pair.n_failing:7} {pair.n_failing:6} {pair.share_invalid:7.1%} "
        f"{n_missed:>6}   {unwarned}"
    )
