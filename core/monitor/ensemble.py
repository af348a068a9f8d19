"""The usual rule: nearest neighbours and a forecast of the peak to come, calibrated as one.

Neighbours fail on aircraft unlike the planned ones, peaks where the input is softer than in
training; together they hold in both. Each part has its own p-value. The risk is the highest of
them, calibrated as flown on failures that trained and calibrated no part.

For aircraft and hands near the planned ones there is a third part, the peak of the next samples
(`window`), and the rule is calibrated on several populations, see `worst_of`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from core.channels import Dictionary
from core.kernels import peak_risk
from core.kernels.assessing import OK, Fitted
from core.monitor.calibration import p_values
from core.monitor.file.portable import Section
from core.monitor.file.values import check_alphas
from core.monitor.peak_forecast import Ahead, ForecastScores, PeakForecast, RunningForecast
from core.monitor.peak_ridge import RidgeForecast, RunningPeaks
from core.monitor.peak_ridge import from_section as peak_from_section
from core.types import Array, Indices

HALVING_SEED = 32
"""Seed of the random halves of failures, if no fresh ones are given."""
ALPHAS = "neighbor_alphas", "peak_alphas"
WINDOW = "window_"
"""Prefix of the arrays of the peak of the next samples, which only newer files have."""


def halves(n: int) -> tuple[Indices, Indices]:
    """Numbers of n failures, ascending: those that train, and those that calibrate the rule."""
    order = np.random.default_rng(HALVING_SEED).permutation(n)
    return np.sort(order[: n // 2]), np.sort(order[n // 2 :])


def worst_of(populations: Sequence[Array]) -> Array:
    """Calibration scores (n,), sorted, that keep the promise in each population.

    populations: calibration scores of each, of equal length n.   The k-th score is the largest k-th
    one, so that the p-value of any score is the largest over the populations.
    """
    return np.max([np.sort(alphas) for alphas in populations], axis=0)


class RunningNeighborsAndPeak(RunningForecast):
    """All parts on one flight; lost once the forecast of the peak is."""

    def __init__(self, rule: "NeighborsAndPeak", dt: float) -> None:
        self._peaks = RunningPeaks(rule.peaks, rule.neighbors.alphas, dt)

    def update(self, t: float, y: Array, code: int, neighbor_score: float) -> tuple[float, int]:
        """Score of the next sample: minus the highest risk of the parts that have one."""
        self._peaks.update(t, y, code, neighbor_score)
        self.lost = self._peaks.lost
        return -self._peaks.risk, code

    def ahead(self) -> Ahead | None:
        return self._peaks.ahead()


@dataclass(frozen=True, eq=False)
class NeighborsAndPeak(PeakForecast):
    """All parts with their own calibration scores, in the role of a forecast.

    neighbors: arrays of the kernels, with the neighbours' own alphas.   n_delay: of the monitor.
    peak: of the rest of the manoeuvre.   peak_alphas: (n,) sorted, its own.
    window: peak of the next samples, if it is a part.   window_alphas: (n,) sorted, its own.
    """

    section: ClassVar[str] = "ensemble"
    neighbors: Fitted
    n_delay: int
    peak: RidgeForecast
    peak_alphas: Array
    window: RidgeForecast | None = None
    window_alphas: Array = field(default_factory=lambda: np.empty(0))

    @property
    def peaks(self) -> list[tuple[RidgeForecast, Array]]:
        """The parts that forecast a peak, with their alphas; that of the rest is the first."""
        rest = self.peak, self.peak_alphas
        return [rest] if self.window is None else [rest, (self.window, self.window_alphas)]

    @property
    def no_forecast_reason(self) -> str:
        return self.peak.no_forecast_reason

    def start(self, dt: float) -> RunningNeighborsAndPeak:
        return RunningNeighborsAndPeak(self, dt)

    def follow(
        self, t: Array, y: Array, state: Indices, dt: float, neighbor_scores: Array
    ) -> ForecastScores:
        risk, scores = p_values(neighbor_scores, self.neighbors.alphas), []
        for peak, alphas in self.peaks:
            scores.append(peak.follow(t, y, state, dt, neighbor_scores))
            risk = np.fmax(risk, p_values(scores[-1].score, alphas))
        return scores[0]._replace(score=np.where(state == OK, -risk, np.nan), state=state)

    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        """Minus the highest risk of each trajectory; +inf too if it is lost from its begin."""
        alphas, no_own_point = self.neighbors.alphas, np.full(len(y), -1)
        near = peak_risk.lowest_scores(
            self.neighbors, y, self.n_delay, first, last, no_own_point, alphas
        )
        risk = p_values(near, alphas)
        for peak, alphas in self.peaks:
            risk = np.maximum(risk, p_values(peak.lowest_scores(y, first, last), alphas))
        unwarned = (last < first) | self.peak.begun_before(y[:, 0])
        return np.where(unwarned, np.inf, -risk)

    def to_section(self) -> Section:
        """Section of a monitor's file; version 2 has a window."""
        part, alphas = self.peak.to_section(), (self.neighbors.alphas, self.peak_alphas)
        arrays = {**part.arrays, **dict(zip(ALPHAS, alphas, strict=True))}
        if self.window is None:
            return Section(self.section, 1, True, part.header, arrays)
        window = {**self.window.to_section().arrays, "alphas": self.window_alphas}
        arrays |= {f"{WINDOW}{name}": array for name, array in window.items()}
        return Section(self.section, 2, True, part.header, arrays)


def from_section(
    section: Section, fitted: Fitted, n_delay: int, dictionary: Dictionary
) -> NeighborsAndPeak:
    """The rule from its section. ValueError if kernels cannot read it.

    fitted, n_delay, dictionary: of the monitor, which has the neighbours.
    """
    near, ahead = (_alphas_of(section, name) for name in ALPHAS)
    peak = peak_from_section(section, dictionary)
    rule = NeighborsAndPeak(fitted._replace(alphas=near), n_delay, peak, ahead)
    if section.version == 1:
        return rule
    arrays = {name: section.arrays[f"{WINDOW}{name}"] for name in ("weights", "offset")}
    window = peak_from_section(section._replace(arrays=arrays), dictionary)
    return replace(rule, window=window, window_alphas=_alphas_of(section, f"{WINDOW}alphas"))


def _alphas_of(section: Section, name: str) -> Array:
    """Calibration scores of a part. ValueError unless sorted."""
    alphas = np.ascontiguousarray(section.arrays[name])
    check_alphas(f"ensemble {name}", alphas, (len(alphas),))
    return alphas
