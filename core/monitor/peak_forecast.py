"""Base of predictors that forecast the rest of a manoeuvre, with a state for each flight."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from statistics import NormalDist
from typing import ClassVar, NamedTuple

import numpy as np

from core.monitor.file.portable import Section
from core.types import Array, Flags, Indices

BAND = 0.9
"""Share of future samples within the band of a forecast."""
BAND_DEVIATIONS = NormalDist().inv_cdf(0.5 + BAND / 2)

LOST = (
    "an input had begun before the first assessed sample, or samples of it are missing, so the "
    "rest of the manoeuvre cannot be forecast: hold the controls at rest before the next one"
)


class ForecastScores(NamedTuple):
    """Scores of a forecast for every sample of a flight.

    score: (n,) low means close to a failure; NaN unless `ok`.   state: (n,) codes.
    y_hat: (n, 6) outputs h samples later, NaN for none.   lost: first sample from which no forecast
    is possible; n for none.
    """

    score: Array
    state: Indices
    y_hat: Array
    lost: int


@dataclass(frozen=True, eq=False)
class ForecastAhead:
    """Forecast of the outputs over the rest of a test card.

    made_t: time of the newest sample [s].   t: (n,) times of the forecast samples [s].
    mean, deviation: (n, 6) SI units, N_y in g.   limits: (6,), inf for none.
    """

    made_t: float
    t: Array
    mean: Array
    deviation: Array
    limits: Array

    @property
    def low(self) -> Array:
        """(n, 6) lower edge of the band, for each sample separately."""
        return self.mean - BAND_DEVIATIONS * self.deviation

    @property
    def high(self) -> Array:
        """(n, 6) upper edge of the band."""
        return self.mean + BAND_DEVIATIONS * self.deviation

    @property
    def exceeds(self) -> bool:
        """Whether the mean of a channel exceeds its limit."""
        return bool((np.abs(self.mean) >= self.limits).any())

    def predicted(self, c: int) -> float | None:
        """Time at which the mean of channel c first exceeds its limit [s], if ever."""
        return self._first(np.abs(self.mean[:, c]) >= self.limits[c])

    def possible(self, c: int) -> float | None:
        """Time at which the band of channel c first exceeds its limit [s], if ever."""
        reach = np.abs(self.mean[:, c]) + BAND_DEVIATIONS * self.deviation[:, c]
        return self._first(reach >= self.limits[c])

    def _first(self, exceeds: Flags) -> float | None:
        return float(self.t[exceeds.argmax()]) if exceeds.any() else None


@dataclass(frozen=True, eq=False)
class PeakAhead:
    """Forecast of the coming peak as a share of its limit, for the channel closest to its limit.

    made_t: time of the newest sample [s].   mean, deviation: of the forecast.
    """

    made_t: float
    mean: float
    deviation: float

    @property
    def exceeds(self) -> bool:
        """Whether the peak exceeds its limit."""
        return self.mean >= 1.0

    @property
    def low(self) -> float:
        """Lower edge of the band."""
        return max(self.mean - BAND_DEVIATIONS * self.deviation, 0.0)

    @property
    def high(self) -> float:
        """Upper edge of the band."""
        return self.mean + BAND_DEVIATIONS * self.deviation


@dataclass(frozen=True, eq=False)
class NothingAhead:
    """Why an assessed sample has no forecast of the rest.

    made_t: time of the newest sample [s].   why: NOT_BEGUN or OVER.
    """

    made_t: float
    why: str
    exceeds: ClassVar[bool] = False


NOT_BEGUN = "unknown until the input begins"
OVER = "the test card is complete"
Ahead = ForecastAhead | PeakAhead | NothingAhead


class RunningForecast(ABC):
    """The forecast of one flight, sample by sample.

    y_hat: (6,) outputs h samples after the last sample, if any.
    lost: whether no forecast is possible any more.
    """

    y_hat: Array | None = None
    lost: bool = False

    @abstractmethod
    def update(self, t: float, y: Array, code: int, neighbor_score: float) -> tuple[float, int]:
        """Score of the next sample, NaN for none, and its state.

        y: (6,) float64, contiguous.   code: state before the forecast.
        neighbor_score: of this sample by the monitor's neighbours, NaN for none.
        """

    def ahead(self) -> Ahead | None:
        """Forecast of the rest at the last sample; None if unknown."""
        return None


class PeakForecast(ABC):
    """A fitted forecast of the rest of a manoeuvre, whose peak is scored."""

    section: ClassVar[str]
    """name of its section in a monitor's file"""
    has_outputs: ClassVar[bool] = False
    """whether it also forecasts the outputs"""

    @property
    def no_forecast_reason(self) -> str:
        """Why it never shows a forecast of the rest; empty if it does."""
        return ""

    @abstractmethod
    def start(self, dt: float) -> RunningForecast:
        """Start a flight sampled at dt [s]."""

    @abstractmethod
    def follow(
        self, t: Array, y: Array, state: Indices, dt: float, neighbor_scores: Array
    ) -> ForecastScores:
        """Scores of a whole flight, equal to those of `start(dt).update` sample by sample.

        t: (n,) [s].   y: (n, 6).   state: (n,) codes before the forecast.   dt: [s].
        neighbor_scores: (n,) by the monitor's neighbours, NaN for none.
        """

    @abstractmethod
    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        """Lowest score of each trajectory over its samples first..last.

        y: (n, n_samples, 6), finite over samples 0..last.   first, last: (n,).   +inf for none.
        """

    @abstractmethod
    def to_section(self) -> Section: ...


def lowest_within(scores: Array, last: Indices, first: Indices | None = None) -> Array:
    """(n,) lowest of the scores (n, n_samples) of samples first..last; +inf for none."""
    k = np.arange(scores.shape[1])
    counts = k <= last[:, np.newaxis]
    if first is not None:
        counts &= k >= first[:, np.newaxis]
    return np.where(counts, scores, np.inf).min(axis=1)
