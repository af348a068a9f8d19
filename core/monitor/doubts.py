"""Why a monitor has no right to speak of a flight, in words."""

from typing import TYPE_CHECKING

import numpy as np

from core.channels import CHANNELS
from core.kernels.deviation import COMPARED, DISTANCE, PLACED, SIZE, WHEN, Excursion
from core.monitor.support import Support
from core.types import Array

if TYPE_CHECKING:
    from core.monitor.monitor import Monitor

NOT_CALIBRATED = (
    "validity is not calibrated: this monitor cannot tell whether a flight is like those it was "
    "trained on, train it again"
)
MOST_NAMED = 3
"""Channels that are named, the worst ones."""


def strayed(
    monitor: "Monitor",
    support: Support,
    so_far: Excursion,
    bounds: Array,
    level: float,
    outlier: Array | None,
) -> list[str]:
    """Where and how far beyond the bounds; nothing for a flight within them.

    outlier: (6,) forecast made of the farthest observation; None or NaN where there is none.
    """
    share = f"{100 * (1 - level / len(support.statistics)):.4g} % of fresh flights stay within"
    residual, distance = so_far.peaks[SIZE, :DISTANCE], so_far.peaks[SIZE, DISTANCE]
    when, found = so_far.peaks[WHEN], []
    for c in np.argsort(-residual, kind="stable")[:MOST_NAMED]:
        if residual[c] > bounds[0]:
            channel, amount = CHANNELS[c], residual[c] * support.sigma[c]
            found.append(
                f"{channel.key} moved by {amount:.3g} {channel.unit} at {when[c]:.2f} s; it never "
                "moved in training"
                if monitor.reach[c] == 0
                else f"{channel.key} was off its forecast by {residual[c]:.1f} sigma "
                f"({amount:.3g} {channel.unit}) at {when[c]:.2f} s; {share} {bounds[0]:.1f}"
            )
    if distance > bounds[1]:
        found.append(
            f"it was {distance:.3g} from every safe observation of training at "
            f"{when[DISTANCE]:.2f} s, in scaled units{_mostly(monitor, outlier)}; {share} "
            f"{bounds[1]:.3g}"
        )
    n_due = so_far.n_due(monitor.dt)
    if found and n_due > support.n_samples:
        found.append(
            f"it lasts {n_due * monitor.dt:.2f} s, the flights of training "
            f"{support.n_samples * monitor.dt:.2f} s: a longer one strays farther, split it up"
        )
    return found


def _mostly(monitor: "Monitor", outlier: Array | None) -> str:
    """In which channel a forecast is farthest from that of the nearest safe observation."""
    if outlier is None or not np.isfinite(outlier).all():
        return ""
    apart = np.abs(monitor.safe_points - outlier / monitor.scale)
    with np.errstate(over="ignore"):
        nearest = apart[np.square(apart).sum(axis=1).argmin()]
    return f", mostly by its forecast of {CHANNELS[int(nearest.argmax())].key}"


def too_little(monitor: "Monitor", so_far: Excursion) -> list[str]:
    """Why nothing can be said of a flight: less than half was seen of what one without gaps has."""
    n_due = so_far.n_due(monitor.dt)
    placed, compared = int(so_far.counts[PLACED]), int(so_far.counts[COMPARED])
    if placed == 0 or 2 * placed < n_due:
        return [f"only {placed} of {n_due} samples could be assessed: too few to judge validity"]
    n_pairs = n_due - monitor.h
    if not monitor.recipe.predictor.forecasts:
        return []
    if n_pairs <= 0:
        return [
            f"{n_due} samples are too few to judge validity: a forecast is compared with what came "
            f"from sample {monitor.h + 1} on"
        ]
    if 2 * compared < n_pairs:
        return [
            f"only {compared} of {n_pairs} forecasts could be compared with what came: too few to "
            "judge validity"
        ]
    return []
