"""The figure of a lead-time study: power of each method against lead, with the ceiling."""

from collections.abc import Mapping

from matplotlib import rc_context
from matplotlib.figure import Figure

from app.report.studies.study_figures import COLOURS, DASHES, LIMIT, MEASURED, STYLE
from core.evaluation.lead_sweep import CEILING, METHODS, PlannedTestSweep, SweepRecipe

MARKERS = "osv^D*"


def power_against_lead(results: Mapping[str, PlannedTestSweep], recipe: SweepRecipe) -> Figure:
    """One panel per planned test, with the time by which 1 in 20 failing flights has failed."""
    with rc_context(STYLE):
        figure = Figure(figsize=(4.0 * len(results) + 1.0, 4.4), layout="constrained")
        panels = figure.subplots(1, len(results), sharey=True, squeeze=False)[0]
        for axes, (name, test) in zip(panels, results.items(), strict=True):
            for method in dict.fromkeys(method for method, _ in test.cells):
                cells = [cell for (key, _), cell in test.cells.items() if key == method]
                cells.sort(key=lambda cell: cell.lead)
                leads = [cell.lead for cell in cells]
                power = [float(cell.power_at_epsilon.mean()) for cell in cells]
                axes.plot(leads, power, label=method, lw=1.6, ms=4, **_look(method))
            axes.axvline(test.earliest_s, color=LIMIT, lw=1, ls=":", label="1 in 20 has failed")
            axes.set(title=name, xlabel="warning lead time [s]", ylim=(-0.02, 1.02))
        panels[0].set_ylabel("safe flights without a false alarm")
        lines, labels = panels[0].get_legend_handles_labels()
        figure.legend(lines, labels, loc="outside lower center", ncols=4, frameon=False)
        figure.suptitle(
            f"with exactly {recipe.epsilon:g} of the failing flights missed; {recipe.n_monitors} "
            f"monitors of {recipe.n_unsafe} failures, {recipe.n_test} fresh flights each"
        )
    return figure


def _look(method: str) -> dict[str, object]:
    if method == CEILING:
        return {"color": MEASURED, "ls": "--", "marker": "x"}
    number = list(METHODS).index(method) if method in METHODS else 0
    colour, dashes = COLOURS[number % len(COLOURS)], DASHES[number % len(DASHES)]
    return {"color": colour, "ls": dashes, "marker": MARKERS[number % len(MARKERS)]}
