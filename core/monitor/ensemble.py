"""The usual rule: nearest neighbours and a forecast of the peak to come, calibrated as one.

Neighbours fail on aircraft beside the planned ones, peaks where the input is softer than in
training; together they hold in both. Each part has a p-value of its own. The risk is the higher of
both, calibrated as flown on failures that trained and calibrated neither part.
"""

from bisect import bisect_left
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from core.channels import Dictionary
from core.kernels import peak_risk
from core.kernels.assessing import OK, Fitted
from core.monitor.calibration import p_values
from core.monitor.file.portable import Section
from core.monitor.file.values import check_alphas
from core.monitor.peak_forecast import Ahead, ForecastScores, PeakForecast, RunningForecast
from core.monitor.peak_ridge import RidgeForecast
from core.monitor.peak_ridge import from_section as peak_from_section
from core.types import Array, Indices

HALVING_SEED = 32
"""Seed of the random halves of failures, if no fresh ones are given."""
ALPHAS = "neighbor_alphas", "peak_alphas"


def halves(n: int) -> tuple[Indices, Indices]:
    """Numbers of n failures, ascending: those that train, and those that calibrate the rule."""
    order = np.random.default_rng(HALVING_SEED).permutation(n)
    return np.sort(order[: n // 2]), np.sort(order[n // 2 :])


class RunningNeighborsAndPeak(RunningForecast):
    """Both parts on one flight; lost once the forecast of the peak is."""

    def __init__(self, rule: "NeighborsAndPeak", dt: float) -> None:
        self._peak = rule.peak.start(dt)
        self._neighbor_alphas: list[float] = rule.neighbors.alphas.tolist()
        self._peak_alphas: list[float] = rule.peak_alphas.tolist()

    def update(self, t: float, y: Array, code: int, neighbor_score: float) -> tuple[float, int]:
        """Score of the next sample: minus the higher risk of the parts that have one."""
        peak_score, _ = self._peak.update(t, y, code, np.nan)
        self.lost = self._peak.lost
        if code != OK:
            return np.nan, code
        risk = _p_value(self._neighbor_alphas, neighbor_score)
        if peak_score == peak_score:  # not NaN
            risk = max(risk, _p_value(self._peak_alphas, peak_score))
        return -risk, code

    def ahead(self) -> Ahead | None:
        return self._peak.ahead()


def _p_value(alphas: list[float], score: float) -> float:
    """As `p_values`, for one score; faster than numpy."""
    n = len(alphas)
    return (n - bisect_left(alphas, score) + 1) / (n + 1)


@dataclass(frozen=True, eq=False)
class NeighborsAndPeak(PeakForecast):
    """Both parts with their own calibration scores, in the role of a forecast.

    neighbors: arrays of the kernels, with the neighbours' own alphas.   n_delay: of the monitor.
    peak: of the rest of the manoeuvre.   peak_alphas: (n,) sorted, its own.
    """

    section: ClassVar[str] = "ensemble"
    neighbors: Fitted
    n_delay: int
    peak: RidgeForecast
    peak_alphas: Array

    @property
    def no_forecast_reason(self) -> str:
        return self.peak.no_forecast_reason

    def start(self, dt: float) -> RunningNeighborsAndPeak:
        return RunningNeighborsAndPeak(self, dt)

    def follow(
        self, t: Array, y: Array, state: Indices, dt: float, neighbor_scores: Array
    ) -> ForecastScores:
        peak = self.peak.follow(t, y, state, dt, neighbor_scores)
        risk = np.fmax(
            p_values(neighbor_scores, self.neighbors.alphas), p_values(peak.score, self.peak_alphas)
        )
        return peak._replace(score=np.where(state == OK, -risk, np.nan), state=state)

    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        """Minus the highest risk of each trajectory; +inf too if it is lost from its begin."""
        alphas, no_own_point = self.neighbors.alphas, np.full(len(y), -1)
        near = peak_risk.lowest_scores(
            self.neighbors, y, self.n_delay, first, last, no_own_point, alphas
        )
        ahead = self.peak.lowest_scores(y, first, last)
        risk = np.maximum(p_values(near, alphas), p_values(ahead, self.peak_alphas))
        unwarned = (last < first) | self.peak.begun_before(y[:, 0])
        return np.where(unwarned, np.inf, -risk)

    def to_section(self) -> Section:
        part, alphas = self.peak.to_section(), (self.neighbors.alphas, self.peak_alphas)
        arrays = {**part.arrays, **dict(zip(ALPHAS, alphas, strict=True))}
        return Section(self.section, 1, True, part.header, arrays)


def from_section(
    section: Section, fitted: Fitted, n_delay: int, dictionary: Dictionary
) -> NeighborsAndPeak:
    """The rule from its section. ValueError if kernels cannot read it.

    fitted, n_delay, dictionary: of the monitor, which has the neighbours.
    """
    near, ahead = (np.ascontiguousarray(section.arrays[name]) for name in ALPHAS)
    for name, alphas in zip(ALPHAS, (near, ahead), strict=True):
        check_alphas(f"ensemble {name}", alphas, (len(alphas),))
    peak = peak_from_section(section, dictionary)
    return NeighborsAndPeak(fitted._replace(alphas=near), n_delay, peak, ahead)
