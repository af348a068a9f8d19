"""Figures of the report: the whole recording, and each manoeuvre, as SVG."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.figures import ALERT, DASHES, FORECAST, LIMIT, MEASURED, STYLE
from core.channels import CHANNELS
from core.monitor.assessment import STATES, State

Array = npt.NDArray[np.float64]
BINS = 1200
"""Most columns of a trace: more cannot be seen on paper."""
WITHDRAWN = "#9a9a9a"
INVALID = STATES.index(State.INVALID)


def overview(
    samples: npt.NDArray, stretches: Sequence[Mapping[str, Any]], limits: Array, epsilon: float
) -> bytes:
    """Limited channels and risk of the whole recording, its manoeuvres numbered."""
    limited = np.flatnonzero(np.isfinite(limits)).tolist() or [3]
    with rc_context(STYLE):
        figure = Figure(figsize=(10, 1.5 * (len(limited) + 1)), layout="constrained")
        axes = np.atleast_1d(figure.subplots(len(limited) + 1, 1, sharex=True))
        for strip, c in zip(axes, limited, strict=False):
            _trace(strip, samples["t"], samples["y"][:, c], color=MEASURED)
            _channel(strip, c, limits[c])
        _risk(axes[-1], samples, epsilon)
        _name(axes.tolist(), stretches)
        axes[-1].set_xlabel("t [s]")
        return _svg(figure)


def manoeuvre(
    samples: npt.NDArray, stretch: Mapping[str, Any], limits: Array, epsilon: float, lead: float
) -> bytes:
    """Every channel of one manoeuvre with forecasts and limits, and the risk below."""
    part = samples[stretch["first"] : stretch["last"] + 1]
    with rc_context(STYLE):
        return _svg(_all_channels(part, [stretch], limits, epsilon, lead))


def whole_flight(
    samples: npt.NDArray,
    stretches: Sequence[Mapping[str, Any]],
    limits: Array,
    epsilon: float,
    lead: float,
    title: str,
) -> Figure:
    """Every channel of a whole recording, its manoeuvres shaded and named."""
    with rc_context(STYLE):
        figure = _all_channels(samples, stretches, limits, epsilon, lead)
        _name(figure.axes, stretches)
        figure.axes[0].set_title(title, loc="right", fontsize=9)
    return figure


def _all_channels(
    samples: npt.NDArray,
    stretches: Sequence[Mapping[str, Any]],
    limits: Array,
    epsilon: float,
    lead: float,
) -> Figure:
    figure = Figure(figsize=(10, 8.6), layout="constrained")
    axes = figure.subplots(len(CHANNELS) + 1, 1, sharex=True)
    for c, strip in enumerate(axes[:-1]):
        _trace(strip, samples["t"], samples["y"][:, c], color=MEASURED, label="measured, from trim")
        label = f"predicted {lead:g} s ahead"
        ahead, y_hat = samples["t"] + lead, samples["y_hat"][:, c]
        _trace(strip, ahead, y_hat, color=FORECAST, lw=0.9, ls=DASHES[1], label=label)
        _channel(strip, c, limits[c])
    _risk(axes[-1], samples, epsilon)
    for crossing in filter(None, (stretch["crossing"] for stretch in stretches)):
        for strip in axes:
            strip.axvline(crossing["t"], color=LIMIT, lw=1.2, ls="-.", label="limit reached")
            strip.axvline(
                crossing["t"] - lead, color=LIMIT, lw=1.0, ls=":", label="last timely alert"
            )
    axes[-1].set_xlabel("t [s]")
    handles: dict[str, Any] = {}
    for strip in axes[:-1]:
        handles |= dict(zip(*reversed(strip.get_legend_handles_labels()), strict=True))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside upper center",
        ncols=len(handles),
        frameon=False,
        fontsize=8,
    )
    return figure


def _name(axes: Sequence[Axes], stretches: Sequence[Mapping[str, Any]]) -> None:
    """Shade the manoeuvres on every strip and write their names above the first."""
    for strip in axes:
        for stretch in stretches:
            strip.axvspan(stretch["start"], stretch["end"], color=FORECAST, alpha=0.08, lw=0)
    for stretch in stretches:
        axes[0].annotate(
            stretch["name"], (stretch["start"], 1.0), (2, 2), fontsize=7, color=FORECAST,
            xycoords=("data", "axes fraction"), textcoords="offset points",
        )  # fmt: skip


def envelope(t: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """The lowest and the highest value of each bin in turn: what a plot of all samples covers."""
    if len(t) <= 2 * bins:
        return t, values
    size = -(-len(t) // bins)
    whole = len(t) // size * size
    blocks = values[:whole].reshape(-1, size)
    at = np.arange(len(blocks)) * size
    low = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1) + at
    high = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1) + at
    chosen = np.sort(np.concatenate([low, high, np.arange(whole, len(t))]), kind="stable")
    return t[chosen], values[chosen]


def _trace(strip: Axes, t: Array, values: Array, **style: Any) -> None:
    strip.plot(*envelope(t, values), **{"lw": 1.1, **style})


def _channel(strip: Axes, c: int, limit: float) -> None:
    channel = CHANNELS[c]
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
    for begin, end in _runs(samples["alert"]):
        strip.axvspan(t[begin], t[end], color=ALERT, alpha=0.25, lw=0)
        strip.plot(t[begin], samples["p_value"][begin], color=ALERT, marker="v", ms=6, ls="none")
    for begin, end in _runs(samples["state"] == INVALID):
        strip.axvspan(t[begin], t[end], facecolor="none", edgecolor=WITHDRAWN, hatch="///", lw=0)
    strip.axhline(epsilon, color=LIMIT, lw=1, ls="--", label=f"ε = {epsilon:g}")
    strip.set(ylim=(0, 1.02), ylabel="risk\n(higher is worse)")
    strip.legend(loc="upper right", fontsize=7)


def _runs(flags: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last sample of each run of true."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def _svg(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": "forewarn"})
    return file.getvalue()
