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
"""Share of the exceedances that a team wants avoided."""


@dataclass(frozen=True)
class CampaignRow:
    """One pair of epsilons on one planned test; 1 for no clearance, and no monitor.

    avoided, lost: shares, each with its 95 % interval.   caused: safe points that exceed since they
    were aborted.
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


def rows_of(found: Sequence[CampaignCounts]) -> list[CampaignRow]:
    """One row a pair of epsilons on a planned test."""
    return [_row(one) for one in found]


def _row(one: CampaignCounts) -> CampaignRow:
    (avoided_low, avoided_high), (lost_low, lost_high) = one.intervals.tolist()
    return CampaignRow(
        test=one.test,
        clearance_epsilon=one.clearance_epsilon,
        monitor_epsilon=one.monitor_epsilon,
        n_exceeding=one.n_exceeding,
        avoided=one.avoided_share,
        avoided_low=avoided_low,
        avoided_high=avoided_high,
        n_safe=one.n_safe,
        lost=one.lost_share,
        lost_low=lost_low,
        lost_high=lost_high,
        caused=one.caused,
    )


def in_words(found: Sequence[CampaignCounts], recipe: CampaignStudyRecipe) -> str:
    """A line a pair of epsilons, and what it takes to avoid nearly all exceedances."""
    steps = ", ".join(f"{step:.0%}" for step in recipe.steps)
    lines = [
        f"build-up of {steps}, {recipe.n_flown} aircraft; {recipe.method}, {recipe.lead_s:g} s "
        f"ahead, reaction {recipe.reaction_s:g} s; points after the first",
        f"{'':8} {'clearance':>9} {'monitor':>8} {'exceed':>7} {'avoided':>23} {'safe':>6} "
        f"{'lost':>23}",
    ]
    for one in found:
        (low, high), (least, most) = one.intervals
        lines.append(
            f"{one.test:8} {_epsilon(one.clearance_epsilon):>9} "
            f"{_epsilon(one.monitor_epsilon):>8} {one.n_exceeding:7d} "
            f"{one.avoided_share:7.3f} ({low:.3f} to {high:.3f}) {one.n_safe:6d} "
            f"{one.lost_share:7.3f} ({least:.3f} to {most:.3f})"
        )
    for name in dict.fromkeys(one.test for one in found):
        best = best_of([one for one in found if one.test == name], GOAL)
        lines.append(
            f"{name}: no pair avoids {GOAL:.0%} of the exceedances"
            if best is None
            else f"{name}: {best.avoided_share:.1%} avoided at {best.lost_share:.1%} of the safe "
            f"points lost, with a clearance at {_epsilon(best.clearance_epsilon)} and a monitor "
            f"at {_epsilon(best.monitor_epsilon)}: the fewest lost where {GOAL:.0%} is avoided"
        )
    return "\n".join(lines)


def _epsilon(epsilon: float) -> str:
    return "none" if epsilon == WITHOUT else f"{epsilon:g}"
