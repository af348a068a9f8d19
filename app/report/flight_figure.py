"""The figure of a scored recording: every channel, its forecasts and limits, and the risk."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.report.envelope import Array, envelope, runs
from app.report.study_figures import ALERT, DASHES, FORECAST, LIMIT, MEASURED, STYLE
from core.channels import CHANNELS
from core.monitor.assessment import STATES, State

WITHDRAWN = "#9a9a9a"
INVALID = STATES.index(State.INVALID)


def whole_flight(
    samples: npt.NDArray,
    stretches: Sequence[Mapping[str, Any]],
    limits: Array,
    epsilon: float,
    lead: float,
    title: str,
) -> Figure:
    """Draw samples, their manoeuvres shaded and named. limits: (6,)."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10, 8.6), layout="constrained")
        axes = figure.subplots(len(CHANNELS) + 1, 1, sharex=True)
        for c, strip in enumerate(axes[:-1]):
            _channel(strip, c, samples, limits[c], lead)
        _risk(axes[-1], samples, epsilon)
        reached = np.array([s["crossing"]["t"] for s in stretches if s["crossing"] is not None])
        for strip in axes if len(reached) else ():
            _moments(strip, reached, lw=1.2, ls="-.", label="limit reached")
            _moments(strip, reached - lead, lw=1.0, ls=":", label="last timely alert")
        _name(axes, stretches)
        axes[0].set_title(title, loc="right", fontsize=9)
        axes[-1].set_xlabel("t [s]")
        _explain(figure, axes[:-1])
    return figure


def _channel(strip: Axes, c: int, samples: npt.NDArray, limit: float, lead: float) -> None:
    channel, t = CHANNELS[c], samples["t"]
    measured, forecast = samples["y"][:, c], samples["y_hat"][:, c]
    ahead = f"predicted {lead:g} s ahead"
    _trace(strip, t, measured, color=MEASURED, label="measured, from trim")
    _trace(strip, t + lead, forecast, color=FORECAST, lw=0.9, ls=DASHES[1], label=ahead)
    if np.isfinite(limit):
        strip.axhline(limit, color=LIMIT, lw=1, label="limit")
        strip.axhline(-limit, color=LIMIT, lw=1)
    symbol = f"${channel.symbol}$" if "_" in channel.symbol else channel.symbol
    strip.set_ylabel(f"{symbol} [{channel.unit}]")


def _risk(strip: Axes, samples: npt.NDArray, epsilon: float) -> None:
    """The risk, grey where it was withdrawn, hatched where nothing could be said."""
    t = samples["t"]
    _trace(strip, t, samples["p_value"], color=MEASURED, lw=1.2)
    if np.isfinite(samples["withdrawn"]).any():
        _trace(strip, t, samples["withdrawn"], color=WITHDRAWN, lw=1.0, label="withdrawn")
    alerts = runs(samples["alert"])
    _fill(strip, [(t[begin], t[end]) for begin, end in alerts], color=ALERT, alpha=0.25)
    begins = [begin for begin, _ in alerts]
    strip.plot(t[begins], samples["p_value"][begins], color=ALERT, marker="v", ms=6, ls="none")
    silent = [(t[begin], t[end]) for begin, end in runs(samples["state"] == INVALID)]
    _fill(strip, silent, facecolor="none", edgecolor=WITHDRAWN, hatch="///")
    strip.axhline(epsilon, color=LIMIT, lw=1, ls="--", label=f"ε = {epsilon:g}")
    strip.set(ylim=(0, 1.02), ylabel="risk\n(higher is worse)")
    strip.legend(loc="upper right", fontsize=7)


def _name(axes: Sequence[Axes], stretches: Sequence[Mapping[str, Any]]) -> None:
    """Shade the manoeuvres on every strip and write their names above the first."""
    for strip in axes:
        spans = [(stretch["start"], stretch["end"]) for stretch in stretches]
        _fill(strip, spans, color=FORECAST, alpha=0.08)
    for stretch in stretches:
        axes[0].annotate(
            stretch["name"], (stretch["start"], 1.0), (2, 2), fontsize=7, color=FORECAST,
            xycoords=("data", "axes fraction"), textcoords="offset points",
        )  # fmt: skip


def _trace(strip: Axes, t: Array, values: Array, **style: Any) -> None:
    strip.plot(*envelope(t, values), **{"lw": 1.1, **style})


def _fill(strip: Axes, spans: Sequence[tuple[float, float]], **style: Any) -> None:
    """Fill spans of time over the whole height, as one artist however many."""
    boxes = [(begin, end - begin) for begin, end in spans]
    strip.broken_barh(boxes, (0, 1), transform=strip.get_xaxis_transform(), lw=0, **style)


def _moments(strip: Axes, t: Array, **style: Any) -> None:
    """Mark moments over the whole height."""
    strip.vlines(t, 0, 1, transform=strip.get_xaxis_transform(), color=LIMIT, **style)


def _explain(figure: Figure, axes: Sequence[Axes]) -> None:
    """One legend above all strips, each label once."""
    handles: dict[str, Any] = {}
    for strip in axes:
        handles |= dict(zip(*reversed(strip.get_legend_handles_labels()), strict=True))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside upper center",
        ncols=len(handles),
        frameon=False,
        fontsize=8,
    )
