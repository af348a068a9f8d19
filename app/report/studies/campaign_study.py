"""The table of a campaign study: exceedances avoided against safe points lost."""

from collections.abc import Sequence
from dataclasses import dataclass

from core.evaluation.campaign_study import (
    WITHOUT,
    CampaignCounts,
    CampaignStudyRecipe,
    best_of,
)

GOAL = 0.99
"""Share of the exceedances to avoid."""


@dataclass(frozen=True)
class CampaignRow:
    """One pair of epsilons on one planned test; 1 means no clearance, or no monitor.

    avoided, lost: shares, each with its 95 % interval.   caused: safe points that exceed a limit
    because they were aborted.
    """

    test: str
    clearance_epsilon: float
    monitor_epsilon: float
    n_exceeding: int
    avoided: float
    avoided_low: float
    avoided_high: float
    n_safe: int
    lost: float
    lost_low: float
    lost_high: float
    caused: int


def rows_of(counts: Sequence[CampaignCounts]) -> list[CampaignRow]:
    """One row for each pair of epsilons on a planned test."""
    return [_row(pair) for pair in counts]


def _row(pair: CampaignCounts) -> CampaignRow:
    (avoided_low, avoided_high), (lost_low, lost_high) = pair.intervals.tolist()
    return CampaignRow(
        test=pair.test,
        clearance_epsilon=pair.clearance_epsilon,
        monitor_epsilon=pair.monitor_epsilon,
        n_exceeding=pair.n_exceeding,
        avoided=pair.avoided_share,
        avoided_low=avoided_low,
        avoided_high=avoided_high,
        n_safe=pair.n_safe,
        lost=pair.lost_share,
        lost_low=lost_low,
        lost_high=lost_high,
        caused=pair.caused,
    )


def in_words(counts: Sequence[CampaignCounts], recipe: CampaignStudyRecipe) -> str:
    """One line for each pair of epsilons, and the best pair that avoids nearly all exceedances."""
    steps = ", ".join(f"{step:.0%}" for step in recipe.steps)
    lines = [
        f"build-up of {steps}, {recipe.n_flown} aircraft; {recipe.method}, {recipe.lead_s:g} s "
        f"ahead, reaction {recipe.reaction_s:g} s; points after the first",
        f"{'':8} {'clearance':>9} {'monitor':>8} {'exceed':>7} {'avoided':>23} {'safe':>6} "
        f"{'lost':>23}",
    ]
    for pair in counts:
        (low, high), (least, most) = pair.intervals
        lines.append(
            f"{pair.test:8} {_epsilon(pair.clearance_epsilon):>9} "
            f"{_epsilon(pair.monitor_epsilon):>8} {pair.n_exceeding:7d} "
            f"{pair.avoided_share:7.3f} ({low:.3f} to {high:.3f}) {pair.n_safe:6d} "
            f"{pair.lost_share:7.3f} ({least:.3f} to {most:.3f})"
        )
    for name in dict.fromkeys(pair.test for pair in counts):
        best = best_of([pair for pair in counts if pair.test == name], GOAL)
        lines.append(
            f"{name}: no pair avoids {GOAL:.0%} of the exceedances"
            if best is None
            else f"{name}: {best.avoided_share:.1%} avoided at {best.lost_share:.1%} of the safe "
            f"points lost, with a clearance at {_epsilon(best.clearance_epsilon)} and a monitor "
            f"at {_epsilon(best.monitor_epsilon)}: the fewest lost with {GOAL:.0%} avoided"
        )
    return "\n".join(lines)


def _epsilon(epsilon: float) -> str:
    return "none" if epsilon == WITHOUT else f"{epsilon:g}"
