"""Sentences about the resampling of channels."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from app.telemetry.resampling.low_pass import HALF_WIDTH, PASS, STOP
from app.telemetry.resampling.segments import Grid
from core.types import Array


@dataclass(frozen=True, eq=False)
class Treatment:
    """How a channel was resampled.

    step: its own [s], 0 if it was on the grid.   even: whether its clock is even.
    slow: slower than the monitor needs.   gaps: lengths of open gaps [s], longer than `limit`.
    bridged: samples lost in shorter holes.
    """

    key: str
    step: float = 0.0
    even: bool = True
    slow: bool = False
    gaps: Array = field(default_factory=lambda: np.empty(0))
    limit: float = 0.0
    bridged: int = 0

    def look_ahead(self, dt: float) -> float:
        """How far into the future a row may look [s]; 0 on the grid. dt: of the grid [s]."""
        if not self.step:
            return 0.0
        filtered = HALF_WIDTH * max(self.step, dt) if self.is_filtered(dt) else 0.0
        return filtered + (0.0 if self.even else 2.0 * self.step)

    def is_filtered(self, dt: float) -> bool:
        """Whether it passed the low-pass filter, not only local cubics."""
        return self.even or self.is_reduced(dt)

    def is_reduced(self, dt: float) -> bool:
        """Whether the grid has fewer samples."""
        return dt > self.step * (1.0 + 1e-3)


def notes_on(grid: Grid, treatments: Iterable[Treatment]) -> list[str]:
    """One sentence for all channels treated alike; none for a channel already on the grid."""
    channels: dict[str, list[str]] = {}
    for treatment in treatments:
        for sentence in (_rate(treatment, grid), _gaps(treatment), _bridged(treatment)):
            if sentence:
                channels.setdefault(sentence, []).append(treatment.key)
    return [sentence.format(", ".join(keys)) for sentence, keys in channels.items()]


def _rate(treatment: Treatment, grid: Grid) -> str:
    step, dt = treatment.step, grid.dt
    if not step:
        return ""
    change = f"{{}}: resampled from {1.0 / step:.4g} Hz to {1.0 / dt:.4g} Hz"
    if treatment.slow:
        return f"{change}; recorded more slowly than the grid, for display only."
    uneven = "" if treatment.even else ", from an uneven clock by local cubics"
    ahead = treatment.look_ahead(dt)
    if not treatment.is_filtered(dt):
        return f"{change}{uneven}; uses samples up to {ahead:.4g} s in the future."
    slower = max(step, dt)
    removed = f" and removes {STOP / slower:.3g} Hz and above" if treatment.is_reduced(dt) else ""
    return (
        f"{change}{uneven}, by a zero-phase low-pass filter that passes up to "
        f"{PASS / slower:.3g} Hz{removed}; uses samples up to {ahead:.3g} s in "
        f"the future; a step appears {slower:.3g} s early with 9 % of its height."
    )


def _gaps(treatment: Treatment) -> str:
    if not len(treatment.gaps):
        return ""
    return (
        f"{{}}: {len(treatment.gaps)} gaps longer than {treatment.limit:.4g} s left open, the "
        f"longest {treatment.gaps.max():.4g} s."
        if len(treatment.gaps) > 1
        else f"{{}}: 1 gap of {treatment.gaps[0]:.4g} s left open."
    )


def _bridged(treatment: Treatment) -> str:
    n = treatment.bridged
    if not n:
        return ""
    samples = "1 lost sample" if n == 1 else f"{n} lost samples"
    return f"{{}}: {samples} in holes of up to {treatment.limit:.4g} s bridged by local cubics."
