"""Validity: whether a monitor has any right to speak of a flight, one verdict a manoeuvre.

A flight drawn like the simulated ones, safe or failing, is called invalid with a probability of at
most the level, over a whole manoeuvre and so at any moment of it: its statistics only ever grow. A
longer flight than those of training has more samples to stray in, and is called so more often.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from core.channels import KEYS, N_CHANNELS
from core.kernels.assessing import STALE
from core.kernels.deviation import (
    AT,
    DISTANCE,
    SAMPLES,
    SIZE,
    WHEN,
    Excursion,
    begin,
    follow,
    take,
)
from core.monitor.assessment import STATES, Assessment, Assessments
from core.monitor.doubts import NOT_CALIBRATED, strayed, too_little
from core.monitor.support import Support, ground_of
from core.types import Array

if TYPE_CHECKING:
    from core.monitor.monitor import Monitor


CODES = {state: code for code, state in enumerate(STATES)}


@dataclass(frozen=True)
class SupportVerdict:
    """Whether a manoeuvre lies within what its monitor was trained on.

    valid: False where it strays farther than all but a share `level` of the fresh flights of either
    kind; None where nothing can be said: not calibrated, or less than half of it was seen. Only
    True gives the right to speak.
    p_value: of both statistics, by Bonferroni's rule.   residual_p, distance_p: of each.
    residual: largest [sigma].   distance: largest [scaled units].
    sample, t, channel: where it strays most: number, time [s] and the channel's key; no channel
    where that is the distance.
    reasons: why `valid` is not True.
    None stands for what is not tested or not there.
    """

    valid: bool | None
    level: float | None = None
    p_value: float | None = None
    residual_p: float | None = None
    distance_p: float | None = None
    residual: float | None = None
    distance: float | None = None
    sample: int | None = None
    t: float | None = None
    channel: str | None = None
    reasons: tuple[str, ...] = ()


def judge(
    monitor: "Monitor",
    t: Array,
    y: Array,
    said: Assessments,
    level: float | None = None,
    end: int | None = None,
) -> SupportVerdict:
    """Judge a whole manoeuvre.

    t: (n,) [s].   y: (n, 6).   said: what monitor.assess(t, y) said.   level: the support's own
    unless given.   end: last sample that counts; the first that violates the limits, if one does,
    as failing flights are calibrated up to there.
    """
    if monitor.support is None:
        return SupportVerdict(None, reasons=(NOT_CALIBRATED,))
    so_far, _ = excursion_of(monitor, monitor.support, t, y, said, end)
    at = int(so_far.peaks[AT, DISTANCE])
    outlier = said.y_hat[at] if at >= 0 else None
    return _verdict(monitor, monitor.support, so_far, level, outlier)


def excursion_of(
    monitor: "Monitor",
    support: Support,
    t: Array,
    y: Array,
    said: Assessments,
    end: int | None = None,
) -> tuple[Excursion, Array]:
    """How far a manoeuvre strays in the end, and (n, 2) residual and distance by each sample.

    Samples in which nothing was assessed add nothing. A sample is compared with the forecast made
    h samples before it only where every sample since was assessed.
    """
    n = len(said) if end is None else end + 1
    codes, near = said.state[:n], said.nearest_safe[:n]
    t, y = np.ascontiguousarray(t, np.float64)[:n], np.ascontiguousarray(y, np.float64)[:n]
    fresh = codes != STALE
    ground = ground_of(monitor, support.sigma)
    so_far, reached = begin(ground), np.empty((n, 2))
    y = y if fresh.all() else y[fresh]
    follow(ground, so_far, t, y, 0, codes, near, np.nan, reached)
    return so_far, reached


def first_stray(
    monitor: "Monitor",
    t: Array,
    y: Array,
    said: Assessments,
    level: float | None = None,
    end: int | None = None,
) -> tuple[int, SupportVerdict] | None:
    """First sample by which `judge` says invalid, and what it says there: what `Running` finds.

    None where it never does, or validity is not calibrated.
    """
    if monitor.support is None:
        return None
    _, reached = excursion_of(monitor, monitor.support, t, y, said, end)
    beyond = (reached > monitor.support.bounds(level)).any(axis=1)
    if not beyond.any():
        return None
    k = int(beyond.argmax())
    return k, judge(monitor, t, y, said, level, k)


class Running:
    """Validity of a flight under way, sample by sample; invalid once is invalid to the end.

    ValueError for a monitor whose validity is not calibrated, or a level it cannot serve.
    """

    def __init__(self, monitor: "Monitor", level: float | None = None) -> None:
        if monitor.support is None:
            raise ValueError(NOT_CALIBRATED)
        self.monitor, self.support = monitor, monitor.support
        self.level = self.support.check_level(level)
        self.is_invalid = False
        self._residual_bound, self._distance_bound = self.support.bounds(level).tolist()
        self._ground = ground_of(monitor, self.support.sigma)
        self._history = np.zeros((monitor.recipe.n_delay + 1, N_CHANNELS))
        self._so_far: Excursion = begin(self._ground)
        self._outlier: Array | None = None

    def update(self, y: Array, said: Assessment) -> bool:
        """Take the next sample. Returns whether the flight has become invalid, now or before.

        y: (6,) float64, contiguous.   said: what the monitor's stream said of it.
        """
        near = said.nearest_safe
        residual, distance = take(
            self._ground,
            self._so_far,
            self._history,
            y,
            said.t,
            CODES[said.state],
            np.nan if near is None else near.distance,
        )
        if self._so_far.peaks[AT, DISTANCE] == self._so_far.counts[SAMPLES] - 1:
            self._outlier = said.y_hat
        self.is_invalid = residual > self._residual_bound or distance > self._distance_bound
        return self.is_invalid

    @property
    def verdict(self) -> SupportVerdict:
        """The verdict so far."""
        return _verdict(self.monitor, self.support, self._so_far, self.level, self._outlier)


def _verdict(
    monitor: "Monitor",
    support: Support,
    so_far: Excursion,
    level: float | None,
    outlier: Array | None,
) -> SupportVerdict:
    level = support.check_level(level)
    bounds, reached = support.bounds(level), so_far.reached
    p = support.p_values(reached[None])
    residual_p, distance_p = (None if np.isnan(value) else float(value) for value in p[0])
    beyond = strayed(monitor, support, so_far, bounds, level, outlier)
    unseen = too_little(monitor, so_far)
    worst = int(so_far.peaks[SIZE, :DISTANCE].argmax())
    with np.errstate(divide="ignore", invalid="ignore"):
        residual_share, distance_share = np.nan_to_num(reached / bounds)
    if distance_share >= residual_share:
        worst = DISTANCE
    there = so_far.peaks[AT, worst] >= 0
    return SupportVerdict(
        valid=False if beyond else None if unseen else True,
        level=level,
        p_value=float(support.combined(p)[0]),
        residual_p=residual_p,
        distance_p=distance_p,
        residual=None if residual_p is None else float(reached[0]),
        distance=float(reached[1]),
        sample=int(so_far.peaks[AT, worst]) if there else None,
        t=float(so_far.peaks[WHEN, worst]) if there else None,
        channel=KEYS[worst] if there and worst != DISTANCE else None,
        reasons=tuple(beyond or unseen),
    )
