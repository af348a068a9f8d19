"""The figure of a campaign study: exceedances avoided against safe points lost."""

from collections.abc import Sequence

from matplotlib import rc_context
from matplotlib.figure import Figure

from app.report.studies.study_figures import COLOURS, DASHES, STYLE
from core.evaluation.campaign_study import WITHOUT, CampaignCounts, CampaignStudyRecipe


def avoided_against_lost(counts: Sequence[CampaignCounts], recipe: CampaignStudyRecipe) -> Figure:
    """One panel per planned test, one line per monitor, one mark per clearance; 95 % intervals."""
    tests = list(dict.fromkeys(pair.test for pair in counts))
    with rc_context(STYLE):
        figure = Figure(figsize=(4.0 * len(tests) + 1.0, 4.4), layout="constrained")
        panels = figure.subplots(1, len(tests), sharey=True, squeeze=False)[0]
        for axes, name in zip(panels, tests, strict=True):
            for number, epsilon in enumerate(recipe.monitor_epsilons):
                line = [c for c in counts if c.test == name and c.monitor_epsilon == epsilon]
                line.sort(key=lambda pair: pair.lost_share)
                axes.errorbar(
                    [pair.lost_share for pair in line],
                    [pair.avoided_share for pair in line],
                    yerr=_sides([pair.avoided_share for pair in line], line, 0),
                    xerr=_sides([pair.lost_share for pair in line], line, 1),
                    label="no monitor" if epsilon == WITHOUT else f"monitor at {epsilon:g}",
                    color=COLOURS[number % len(COLOURS)],
                    ls=DASHES[number % len(DASHES)],
                    marker="o",
                    lw=1.4,
                    ms=3,
                    elinewidth=0.6,
                )
            axes.set(title=name, xlabel="share of safe points lost", ylim=(-0.02, 1.02))
        panels[0].set_ylabel("share of exceedances avoided")
        lines, labels = panels[0].get_legend_handles_labels()
        figure.legend(lines, labels, loc="outside lower center", ncols=5, frameon=False)
        figure.suptitle(
            "clearances at "
            f"{', '.join(f'{e:g}' for e in recipe.clearance_epsilons if e < WITHOUT)}, and none; "
            f"{recipe.lead_s:g} s ahead, reaction {recipe.reaction_s:g} s"
        )
    return figure


def _sides(
    shares: list[float], counts: list[CampaignCounts], which: int
) -> tuple[list[float], list[float]]:
    """Distance of the interval's ends below and above each share."""
    intervals = [pair.intervals[which] for pair in counts]
    pairs = list(zip(shares, intervals, strict=True))
    return [share - low for share, (low, _) in pairs], [high - share for share, (_, high) in pairs]
