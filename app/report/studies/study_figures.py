"""Figures of a study and of a lead-time study, as PNG and SVG bytes."""

import io
import logging
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from app.report.figures import flown_figure
from core.evaluation.lead_sweep import CEILING, COMPARED, PlannedTestSweep, SweepRecipe
from core.monitor import Monitor
from core.types import Array, Indices

if TYPE_CHECKING:
    from core.evaluation.study import StudyResult


# Another font takes the place of one that is missing, such as after another Matplotlib's cache.
logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)

# Okabe and Ito's colours keep apart for colour-blind eyes; dashes repeat the difference.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (6, 2)),
    (0, (4, 1, 1, 1)),
    (0, (1, 1)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (8, 1)),
    (0, (12, 2)),
)
MEASURED, LIMIT = "#222222", "#B22222"
STYLE: Any = {
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "forewarn",
    "svg.fonttype": "none",
}


ABOUT: dict[str, dict[str, Any]] = {
    "png": {"Software": "forewarn"},
    "svg": {"Date": None, "Creator": "forewarn"},
}
"""Metadata of each kind of file, equal in every run."""


def render(figure: Figure, stem: str, kinds: Iterable[str] = tuple(ABOUT)) -> dict[str, bytes]:
    """stem.png and stem.svg of a figure: same bytes for the same data."""
    files = {}
    with rc_context(STYLE):
        figure.draw_without_rendering()
        figure.set_layout_engine(None)  # once for all kinds: layout is slow
        for kind in kinds:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=kind, dpi=150, metadata=ABOUT[kind])
            files[f"{stem}.{kind}"] = buffer.getvalue()
    return files


def study_curves(result: "StudyResult") -> Figure:
    """Miss rate and power of every method over epsilon, with 95 % intervals."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10, 4.6), layout="constrained")
        miss, power = figure.subplots(1, 2)
        for axes, quantity, label in (
            (miss, "miss_rate", "miss rate: failing flights without a timely alert"),
            (power, "power", "safe flights without a false alarm"),
        ):
            for number, (name, method) in enumerate(result.methods.items()):
                look, epsilons = _numbered_look(number), method.epsilons
                share = getattr(method, quantity)
                low, high = getattr(method, f"{quantity.removesuffix('_rate')}_interval").T
                axes.plot(epsilons, share, label=name, lw=1.8, ms=4, markevery=6, **look)
                axes.fill_between(epsilons, low, high, color=look["color"], alpha=0.15, lw=0)
            axes.set(xlim=(0, 1), ylim=(-0.02, 1.02), xlabel="ε, accepted miss rate", ylabel=label)
        miss.plot([0, 1], [0, 1], color=LIMIT, lw=1, ls="--", label="guarantee: miss rate ≤ ε")
        miss.legend(loc="upper left", frameon=False)
        recipe = result.recipe
        figure.suptitle(
            f"{recipe.n_monitors} monitors of {recipe.dataset.n_unsafe} unsafe rollouts, "
            f"{recipe.n_test} test flights each; {recipe.monitor.calibration} calibration, "
            f"warning lead time {result.monitor.lead:g} s; bands: 95 % intervals"
        )
    return figure


def example_flights(result: "StudyResult") -> dict[str, bytes]:
    """A safe and an unsafe test flight as SVG files, by name; without those that there are not."""
    monitor, flights = result.monitor, result.flights
    examples = dict(
        zip(("unsafe", "safe"), _example_pair(monitor, flights.y, flights.fail_index), strict=True)
    )
    return {
        f"{kind}_flight.svg": flown_figure(
            monitor, flights.y[k], int(flights.fail_index[k]), f"{kind} flight (test flight {k})"
        )
        for kind, k in examples.items()
        if k is not None
    }


def _example_pair(monitor: Monitor, y: Array, fail_index: Indices) -> tuple[int | None, int | None]:
    """An unsafe flight failing at the median time, and the safe flight closest to a failure."""
    unsafe = np.flatnonzero(fail_index < y.shape[1])
    safe = np.flatnonzero(fail_index == y.shape[1])
    middle = closest = None
    if len(unsafe):
        middle = int(unsafe[fail_index[unsafe].argsort()[len(unsafe) // 2]])
    if len(safe):
        last = np.full(len(safe), y.shape[1] - 1)
        closest = int(safe[monitor.lowest_scores(y[safe], last).argmin()])
    return middle, closest


MARKERS = "osv^D*P"


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


def _look(method: str) -> dict[str, Any]:
    if method == CEILING:
        return {"color": MEASURED, "ls": "--", "marker": "x"}
    return _numbered_look(list(COMPARED).index(method))


def _numbered_look(number: int) -> dict[str, Any]:
    """The look of a line; colours recur with other dashes and markers."""
    again, k = divmod(number, len(COLOURS))
    marker = MARKERS[(k + 3 * again) % len(MARKERS)]
    return {"color": COLOURS[k], "ls": DASHES[(k + again) % len(DASHES)], "marker": marker}
