"""The simulated safe flights of a monitor, as a display shows them beside a flown one."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from app.assessment.planned_test import PlannedTest, rollouts_test
from app.assessment.trim import CausalTrim
from core.dataset import Dataset
from core.kernels.assessing import Affine
from core.monitor import Monitor
from core.monitor.observation import Observations, OutputsAhead
from core.types import Array, Flags, Indices

LOW, HIGH = 0.05, 0.95
LEAST = 40
"""Flights, so that at least two lie on either side of a band."""
KNOWN = 0.9
"""Share of the flights that must have a value for the band to have one."""
REST_S = 1.0
"""[s] Rest before a rollout, whose own is too short for detection to settle."""
FOLDS = 5
MOST = 1000
"""Flights that a band is computed of: the first ones."""


class Unavailable(ValueError):
    """Why a dataset has none."""


@dataclass(frozen=True, eq=False)
class SafeBand:
    """Quantiles LOW and HIGH of the safe flights at each time from the manoeuvre's start.

    t: (n,) from the detected start [s].   low, high: (n, n_channels).   n_flights: those counted.
    onset: usual time of the detected start in a flight [s].
    """

    t: Array
    low: Array
    high: Array
    n_flights: int
    onset: float


@dataclass(frozen=True, eq=False)
class ForecastInterval:
    """Quantiles LOW and HIGH of the error y - y_hat over samples of safe flights held out.

    low, high: (n_channels,).   n_flights: safe ones.   covered: share of all samples of failing
    flights, which no forecast is fitted on, that the interval holds; the least of the channels.
    """

    low: Array
    high: Array
    n_flights: int
    covered: float


def safe_band(dataset: Dataset) -> SafeBand:
    """The band of a dataset's safe flights, each aligned at its detected start. Unavailable."""
    y, dt = dataset.safe[:MOST], dataset.dt
    _check_number(len(y))
    planned = rollouts_test(y, dt, dataset.dictionary, dataset.recipe)
    if not planned.controls:
        raise Unavailable("no channel is a control, so the manoeuvre's start is unknown")
    begins = _begins(y, planned)
    found = begins >= 0
    _check_number(int(found.sum()), " in which a manoeuvre is detected")
    y, begins = y[found], begins[found]
    lead = int(np.median(begins))
    place = np.arange(-lead, y.shape[1] - int(begins.min()))
    at = begins[:, None] + place
    inside = (at >= 0) & (at < y.shape[1])
    values = np.take_along_axis(y, np.clip(at, 0, y.shape[1] - 1)[..., None], axis=1)
    values[~inside] = np.nan
    enough = np.isfinite(values).all(axis=2).mean(axis=0) >= KNOWN
    low, high = np.nanquantile(values[:, enough], (LOW, HIGH), axis=0)
    return SafeBand(place[enough] * dt, low, high, len(y), lead * dt)


def _check_number(n: int, which: str = "") -> None:
    if n < LEAST:
        raise Unavailable(
            f"it has {n} safe flights{which}; a band of {LOW:.0%} to {HIGH:.0%} needs {LEAST}"
        )


def _begins(y: Array, planned: PlannedTest) -> Indices:
    """(n,) sample at which the manoeuvre of each rollout is detected; -1 where none is."""
    n_lead = max(2, round(planned.trim_segment_s / planned.dt))
    n_rest = n_lead * ceil(REST_S / planned.trim_segment_s)
    begins = np.full(len(y), -1)
    for k, flight in enumerate(y):
        rest = np.concatenate([flight[:n_lead], flight[:n_lead][::-1]])  # without a jump
        before = np.resize(rest, (n_rest, y.shape[2]))
        followed = CausalTrim(planned).follow(np.concatenate([before, flight]))
        if followed and followed[0].begin >= n_rest:
            begins[k] = followed[0].begin - n_rest
    return begins


def forecast_interval(monitor: Monitor, dataset: Dataset) -> ForecastInterval:
    """The interval of the forecast `lead` ahead. Unavailable.

    The safe flights are split: the map is fitted on some, its errors are those on the others.
    """
    predictor = monitor.recipe.predictor
    if not predictor.forecasts:
        raise Unavailable("this method forecasts no channel")
    if monitor.forecast is not None and monitor.forecast.has_outputs:
        raise Unavailable("its forecast to the end of the card has its own interval")
    _check_number(len(dataset.safe))
    fold = np.arange(len(dataset.safe)) % FOLDS
    errors = list[Array]()
    for k in range(FOLDS):
        affine = _fitted(monitor, dataset, fold != k)
        errors.append(_errors(monitor, dataset.safe[fold == k], affine))
    low, high = np.nanquantile(np.concatenate(errors), (LOW, HIGH), axis=0)
    failing = _errors(monitor, dataset.unsafe, _fitted(monitor, dataset, fold >= 0))
    known = np.isfinite(failing)
    held = ((failing >= low) & (failing <= high) & known).sum(axis=0) / known.sum(axis=0)
    return ForecastInterval(low, high, len(dataset.safe), float(held.min()))


def _fitted(monitor: Monitor, dataset: Dataset, chosen: Flags) -> Affine:
    y, times = dataset.safe[chosen], dataset.safe_times[chosen]
    observed = Observations(y, times, monitor.recipe.n_delay, monitor.scale)
    ahead = OutputsAhead(y, times, monitor.h, monitor.scale)
    return monitor.recipe.predictor.fit(observed, ahead)


def _errors(monitor: Monitor, y: Array, affine: Affine) -> Array:
    """(n, n_channels) y - y_hat of all samples that have both, in the channels' units."""
    n, n_samples = y.shape[:2]
    times = np.tile(np.arange(n_samples - monitor.h), (n, 1))
    observed = Observations(y, times, monitor.recipe.n_delay, monitor.scale)[:]
    ahead = OutputsAhead(y, times, monitor.h, monitor.scale)[:]
    return (ahead - (observed @ affine.matrix + affine.offset)) * monitor.scale
