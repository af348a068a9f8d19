"""What predictors that forecast the rest of a manoeuvre have in common: a state for each flight."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from statistics import NormalDist
from typing import ClassVar, NamedTuple

import numpy as np

from core.monitor.file.portable import Section
from core.types import Array, Flags, Indices

BAND = 0.9
"""Share of the samples to come that the band of a forecast holds."""
BAND_DEVIATIONS = NormalDist().inv_cdf(0.5 + BAND / 2)

LOST = (
    "too many samples were missing while an input of the test card was due: what is left of the "
    "card cannot be forecast; wait for the next manoeuvre"
)


class Followed(NamedTuple):
    """What a forecast says of every sample of a flight.

    score: (n,) low means close to a failure; NaN unless `ok`.   state: (n,) codes.
    y_hat: (n, 6) outputs h samples later, NaN for none.   lost: first sample from which on nothing
    is forecast any more; n where there is none.
    """

    score: Array
    state: Indices
    y_hat: Array
    lost: int


@dataclass(frozen=True, eq=False)
class ForecastAhead:
    """What is to be measured of the rest of a test card.

    made_t: of the newest sample [s].   t: (n,) of those to come [s].
    mean, deviation: (n, 6) of each, SI units, N_y in g.   limits: (6,), inf for none.
    """

    made_t: float
    t: Array
    mean: Array
    deviation: Array
    limits: Array

    @property
    def low(self) -> Array:
        """(n, 6) that BAND of the samples lie between, each by itself."""
        return self.mean - BAND_DEVIATIONS * self.deviation

    @property
    def high(self) -> Array:
        """(n, 6) see `low`."""
        return self.mean + BAND_DEVIATIONS * self.deviation

    def predicted(self, c: int) -> float | None:
        """When the mean of channel c first exceeds its limit [s]; None where it never does."""
        return self._first(np.abs(self.mean[:, c]) >= self.limits[c])

    def possible(self, c: int) -> float | None:
        """When the band of channel c first does [s]."""
        reach = np.abs(self.mean[:, c]) + BAND_DEVIATIONS * self.deviation[:, c]
        return self._first(reach >= self.limits[c])

    def _first(self, exceeds: Flags) -> float | None:
        return float(self.t[exceeds.argmax()]) if exceeds.any() else None


@dataclass(frozen=True, eq=False)
class PeakAhead:
    """The peak that is still to come, as a share of its limit: of the channel nearest to its own.

    made_t: of the newest sample [s].   mean, deviation: of the forecast.
    """

    made_t: float
    mean: float
    deviation: float

    @property
    def low(self) -> float:
        """Of a BAND of the peaks."""
        return max(self.mean - BAND_DEVIATIONS * self.deviation, 0.0)

    @property
    def high(self) -> float:
        """See `low`."""
        return self.mean + BAND_DEVIATIONS * self.deviation


@dataclass(frozen=True, eq=False)
class NothingAhead:
    """Why nothing is forecast of the rest by a sample that was assessed.

    made_t: of the newest sample [s].   why: NOT_BEGUN or OVER.
    """

    made_t: float
    why: str


NOT_BEGUN = "not known before the input begins"
OVER = "nothing is left of the test card"
Ahead = ForecastAhead | PeakAhead | NothingAhead


class RunningForecast(ABC):
    """The forecast of one flight, sample by sample.

    y_hat: (6,) outputs h samples after the last sample; None for none.
    lost: whether nothing can be forecast any more.
    """

    y_hat: Array | None = None
    lost: bool = False

    @abstractmethod
    def update(self, t: float, y: Array, code: int) -> tuple[float, int]:
        """Take the next sample; returns its score, NaN for none, and its state.

        y: (6,) float64, contiguous.   code: its state so far.
        """

    def ahead(self) -> Ahead | None:
        """What is forecast of the rest by the last sample; None where that is not known."""
        return None


class PeakForecast(ABC):
    """A fitted forecast of what is left of a manoeuvre, whose peak is scored."""

    section: ClassVar[str]
    """Name of its section in a monitor's file."""
    has_outputs: ClassVar[bool] = False
    """Whether it forecasts the outputs too."""

    @property
    def no_rest(self) -> str:
        """Why it tells nothing of the rest of the card, of no flight; empty where it does."""
        return ""

    @abstractmethod
    def begin(self, dt: float) -> RunningForecast:
        """Begin a flight sampled at dt [s]."""

    @abstractmethod
    def follow(self, t: Array, y: Array, state: Indices, dt: float) -> Followed:
        """Return what `begin(dt).update` says sample by sample.

        t: (n,) [s].   y: (n, 6).   state: (n,) codes so far.   dt: [s].
        """

    @abstractmethod
    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        """Lowest score of each trajectory over its samples first..last.

        y: (n, n_samples, 6), finite over samples 0..last.   first, last: (n,).   +inf for none.
        """

    @abstractmethod
    def to_section(self) -> Section:
        """Return the section of a monitor's file."""
