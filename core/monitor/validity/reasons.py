"""Texts for why a flight is outside a monitor's training, or cannot be judged."""

import numpy as np

from core.kernels.deviation import (
    COMPARED,
    DISTANCE,
    INNOVATION,
    PLACED,
    SIZE,
    WHEN,
    Deviation,
)
from core.monitor.validity.support import ValidityBasis
from core.types import Array

MOST_NAMED = 3
"""Number of worst channels to name."""


def outside_training(
    basis: ValidityBasis, deviation: Deviation, bounds: Array, outlier: Array | None
) -> list[str]:
    """Where and how far a flight exceeds the bounds; empty for a flight within them.

    bounds: (2,) of the forecast error and of the distance.
    outlier: (n_channels,) forecast from the farthest observation; None or NaN for none.
    """
    support, dt = basis.support, basis.reference.dt
    share = (
        f"{100 * (1 - support.level / len(support.statistics)):.4g} % of fresh flights stay within"
    )
    residual, distance = deviation.peaks[SIZE, :DISTANCE], deviation.peaks[SIZE, DISTANCE]
    when, reasons = deviation.peaks[WHEN], []
    for c in np.argsort(-residual, kind="stable")[:MOST_NAMED].tolist():
        if residual[c] > bounds[0]:
            reasons.append(
                _off_forecast(basis, c, float(residual[c]), float(when[c]), bounds[0], share)
            )
    if deviation.peaks[SIZE, INNOVATION] > bounds[0]:
        reasons.append(f"{_off_forecasts(basis, deviation)}; {share} {bounds[0]:.2f}")
    if distance > bounds[1]:
        reasons.append(
            f"the nearest safe training sample was {distance:.3g} (scaled units) away at "
            f"{when[DISTANCE]:.2f} s{_mostly(basis, outlier)}; {share} "
            f"{bounds[1]:.3g}"
        )
    n_due = deviation.n_due(dt)
    if reasons and n_due > support.n_samples:
        reasons.append(
            f"the manoeuvre lasts {n_due * dt:.2f} s, training flights only "
            f"{support.n_samples * dt:.2f} s: split it, because longer ones deviate more"
        )
    return reasons


def _off_forecasts(basis: ValidityBasis, deviation: Deviation) -> str:
    innovation, dt = basis.reference.innovation, basis.reference.dt
    size, when = deviation.peaks[SIZE, INNOVATION], deviation.peaks[WHEN, INNOVATION]
    c = int((deviation.responses / innovation.sigma).argmax())
    channel = basis.dictionary.channels[basis.responses[c]]
    amount = float(deviation.responses[c])
    is_pilots = channel.role == "control"
    what = "the pilot's part in the surfaces" if is_pilots else "the response to the surfaces"
    return (
        f"{what} was {size:.2f} sigma off its forecast over the "
        f"{innovation.window * dt:g} s to {when:.2f} s, mostly {channel.key} "
        f"({channel.read(amount)})"
    )


def _off_forecast(
    basis: ValidityBasis, c: int, residual: float, when: float, bound: float, share: str
) -> str:
    channel, amount = basis.dictionary.channels[c], residual * basis.support.sigma[c]
    if basis.training_max_abs[c] == 0:
        return (
            f"{channel.key} moved by {channel.read(amount)} at {when:.2f} s, but never in training"
        )
    return (
        f"{channel.key} was {residual:.1f} sigma ({channel.read(amount)}) off its forecast "
        f"at {when:.2f} s; {share} {bound:.1f}"
    )


def _mostly(basis: ValidityBasis, outlier: Array | None) -> str:
    """Channel in which a forecast differs most from the nearest safe observation's."""
    if outlier is None or not np.isfinite(outlier).all():
        return ""
    apart = basis.safe_points - outlier / basis.reference.scale
    with np.errstate(over="ignore"):
        nearest = apart[np.einsum("ij,ij->i", apart, apart).argmin()]
    return f", mostly in forecast {basis.dictionary.keys[int(np.abs(nearest).argmax())]}"


def too_little(basis: ValidityBasis, deviation: Deviation) -> list[str]:
    """Why a flight cannot be judged: less than half of its samples could be used."""
    reference = basis.reference
    n_due = deviation.n_due(reference.dt)
    placed, compared = int(deviation.counts[PLACED]), int(deviation.counts[COMPARED])
    if placed == 0 or 2 * placed < n_due:
        return [f"only {placed} of {n_due} samples could be assessed: too few to judge validity"]
    if not reference.has_forecasts:
        return []
    n_before = reference.h if reference.has_residuals else reference.innovation.history
    n_pairs = n_due - n_before
    if n_pairs <= 0:
        return [
            f"{n_due} samples are too few to judge validity: forecasts are checked "
            f"from sample {n_before + 1}"
        ]
    if 2 * compared < n_pairs:
        return [
            f"only {compared} of {n_pairs} forecasts could be checked: too few to judge validity"
        ]
    return []
