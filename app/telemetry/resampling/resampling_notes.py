"""What was done to bring channels onto a grid, in sentences."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from app.telemetry.resampling.low_pass import HALF_WIDTH, PASS, STOP
from app.telemetry.resampling.segments import Grid
from core.types import Array


@dataclass(frozen=True, eq=False)
class Treatment:
    """How a channel came onto the grid.

    step: its own [s], 0 where it was on the grid.   even: its clock.   slow: slower than wanted.
    gaps: lengths of those left open [s], longer than `limit`.   bridged: samples lost elsewhere.
    """

    key: str
    step: float = 0.0
    even: bool = True
    slow: bool = False
    gaps: Array = field(default_factory=lambda: np.empty(0))
    limit: float = 0.0
    bridged: int = 0


def notes_on(grid: Grid, treatments: Iterable[Treatment]) -> list[str]:
    """One sentence for all channels that fared alike; none for a channel on the grid as it was."""
    alike: dict[str, list[str]] = {}
    for treatment in treatments:
        for sentence in (_rate(treatment, grid), _gaps(treatment), _bridged(treatment)):
            if sentence:
                alike.setdefault(sentence, []).append(treatment.key)
    return [sentence.format(", ".join(keys)) for sentence, keys in alike.items()]


def _rate(treatment: Treatment, grid: Grid) -> str:
    step, dt = treatment.step, grid.dt
    if not step:
        return ""
    change = f"{{}}: from {1.0 / step:.4g} Hz to {1.0 / dt:.4g} Hz"
    if treatment.slow:
        return f"{change}, recorded more slowly than the grid, so good for display only."
    down = dt > step * (1.0 + 1e-3)
    uneven = "" if treatment.even else ", from an uneven clock by local cubics"
    if not (down or treatment.even):
        return f"{change}{uneven}, which look up to {2.0 * step:.4g} s ahead."
    slower = max(step, dt)
    removed = f" and removes from {STOP / slower:.3g} Hz on" if down else ""
    return (
        f"{change}{uneven}, by a filter without delay that keeps up to {PASS / slower:.3g} Hz"
        f"{removed}; it looks up to {HALF_WIDTH * slower:.3g} s ahead, and a step shows "
        f"{slower:.3g} s ahead of itself by 9 %."
    )


def _gaps(treatment: Treatment) -> str:
    if not len(treatment.gaps):
        return ""
    return (
        f"{{}}: gaps of more than {treatment.limit:.4g} s, left open: {len(treatment.gaps)}, the "
        f"longest {treatment.gaps.max():.4g} s."
    )


def _bridged(treatment: Treatment) -> str:
    if not treatment.bridged:
        return ""
    return (
        f"{{}}: samples lost in holes of up to {treatment.limit:.4g} s, bridged by cubics: "
        f"{treatment.bridged}."
    )
