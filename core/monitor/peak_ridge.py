"""The peak of the rest of a manoeuvre, forecast by ridge regression on the flown part.

It needs no model of the aircraft and no step responses, only flights that calibration does not use.
For each phase, the largest |y| / limit still to come is regressed on the samples since the input
began. For a specification known only by its label, the target is the log odds of a later failure.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, NamedTuple

import numpy as np

from core.channels import LATERAL, Dictionary
from core.kernels import peak_ridge as kernels
from core.kernels.compiled import entry
from core.kernels.live_call import peaks_at, peaks_call
from core.kernels.peak_ridge import PHASE, PeakWeights, begin
from core.limits.limits import Envelope
from core.monitor.file.portable import Section
from core.monitor.file.values import MOST_SAMPLES, check_array, check_count
from core.monitor.peak_forecast import (
    NOT_BEGUN,
    OVER,
    Ahead,
    ForecastScores,
    NothingAhead,
    PeakAhead,
    PeakForecast,
    RunningForecast,
    lowest_within,
)
from core.monitor.predictor import PeakRidge
from core.types import Array, Flags, Indices

PENALTIES = 10.0 ** np.arange(-1, 5)
"""Candidates, on squared standardised weights; leave-one-out residuals choose among them."""
MOST_FLIGHTS, MOST_PHASES, MOST_PAST = 2_000, 150, 20
"""Largest number of flights to fit, of phases with weights, and of past samples per phase."""
LEAST_SHARE = 0.1
"""A phase gets weights only if at least this share of the flights reaches it."""
LEAST_OF_A_KIND = 5
"""Failing and safe flights needed for a regression on labels."""
BEGUN = 0.1
"""The input has begun once the surface exceeds this share of its usual peak."""
VISIBLE = 8.0
"""Or this many standard deviations of the surface at trim, if that is more."""
MOVES = 0.25
"""A surface is part of the manoeuvre if its peak exceeds this share of the largest peak."""
FINEST = 1e-3
"""Smallest deviation of a forecast, in limits."""
NEWTON_STEPS, SMALL_STEP = 10, 0.01
"""Maximum number of Newton steps, and size of the last step in log odds."""
NO_PEAK = (
    "not available: this monitor looks only one window ahead, has no limits, or is an older file"
)
LEAST_WEIGHT = 0.05
"""Smallest weight of a flight in a Newton step, which keeps steps from diverging."""

Fit = Callable[[Array, list[Array]], list[tuple[Array, float, float]]]
"""Regressors (n, m) and targets (n,) -> weights (m,), constant and deviation of each target."""


@dataclass(frozen=True)
class LearnedFlights:
    """Training flights, which calibration does not use.

    y: (n, n_samples, n_channels), may be NaN after the failure.
    fail_index: (n,) first sample that fails, n_samples for a safe flight.
    dictionary: of the channels.
    """

    y: Array
    fail_index: Indices
    dictionary: Dictionary = LATERAL

    @classmethod
    def of(
        cls,
        safe: Array,
        more: tuple[Array, Indices] | None,
        judged: bool,
        dictionary: Dictionary = LATERAL,
    ) -> "LearnedFlights":
        """Safe rollouts and more flights; only the safe ones of these if peaks are `judged`.

        The peak of a failing flight may be cut off, and safe flights alone give fewer false alarms.
        """
        y, fail_index = (safe[:0], np.empty(0, np.int64)) if more is None else more[:2]
        if y.shape[1:] != safe.shape[1:]:
            raise ValueError(
                f"rollouts of shape {y.shape[1:]} were given: rollouts of the dataset have "
                f"{safe.shape[1:]}, roll out the same manoeuvre"
            )
        chosen = np.flatnonzero(fail_index >= y.shape[1]) if judged else np.arange(len(y))
        chosen = chosen[:MOST_FLIGHTS]
        safe = safe[: MOST_FLIGHTS - len(chosen)]
        lasting = np.full(len(safe), safe.shape[1])
        flights = np.concatenate([y[chosen], safe]), np.concatenate([fail_index[chosen], lasting])
        return cls(*flights, dictionary)


def fit_windows(
    predictor: PeakRidge,
    flights: LearnedFlights,
    limits: Envelope | None,
    windows: list[int],
    dt: float,
) -> list["RidgeForecast"]:
    """Fit the weights of each phase, for each window; they share the regressors.

    limits: None if failures are known only by fail_index.
    windows: samples to look ahead, 0 for the rest of the manoeuvre.   dt: [s].
    ValueError if flights do not show when their input begins, or if too few failed.
    """
    y, (_, n_samples, n_channels) = flights.y, flights.y.shape
    begin = Begin(-1, 0.0)
    if predictor.phase == "input":
        begin = _begin_of_input(y, flights.dictionary, limits)
    start, sign = begin.of(y)
    if limits is None:
        fails = flights.fail_index < n_samples
        if min(fails.sum(), (~fails).sum()) < LEAST_OF_A_KIND:
            raise ValueError(
                f"{fails.sum()} of {len(fails)} rollouts failed: for a specification known only by "
                f"its label, the predictor peak_ridge needs {LEAST_OF_A_KIND} or more of either "
                "kind besides the calibration flights: train(dataset, recipe, rollouts=...)"
            )
        fit: Fit = _all_log_odds
        targets = [_fails_later(flights, window).astype(np.float64) for window in windows]
    else:
        margin = limits.margin(y)
        fit, targets = _margins, [_peak_later(margin, window) for window in windows]
    every = -(-n_samples // MOST_PHASES)
    reach = max(1, round(predictor.past_s / dt))
    stride = -(-reach // MOST_PAST)
    n_past = -(-reach // stride)
    weights, offsets, deviations = ([[] for _ in windows] for _ in range(3))
    for phase in range(0, n_samples, every):
        now = start + phase
        use = np.flatnonzero((start >= 0) & (now < np.minimum(flights.fail_index, n_samples - 1)))
        if len(use) < max(2, LEAST_SHARE * len(y)):
            break
        past = phase - stride * np.arange(n_past)
        past = past[past >= 0]
        samples = y[use[:, None], start[use, None] + past] * sign[use, None, None]
        x = samples.reshape(len(use), -1)
        fits = fit(x, [target[use, now[use]] for target in targets])
        for k, (coefficients, constant, deviation) in enumerate(fits):
            phase_weights = np.zeros((n_past, n_channels))
            phase_weights[: len(past)] = -coefficients.reshape(-1, n_channels)
            weights[k].append(phase_weights)
            offsets[k].append(-constant)
            deviations[k].append(deviation)
    if not weights[0]:
        raise ValueError(
            "no phase of the manoeuvre occurs in a tenth of the rollouts: give rollouts that begin "
            "before their input, or choose phase start"
        )
    return [
        RidgeForecast(
            PeakWeights(np.array(phase_weights), np.array(offset), every, stride, *begin),
            np.array(off) if window == 0 and limits is not None else None,
        )
        for window, phase_weights, offset, off in zip(
            windows, weights, offsets, deviations, strict=True
        )
    ]


class Begin(NamedTuple):
    """How the begin of the input shows; see PeakWeights."""

    surface: int
    threshold: float
    rest: float = 0.0
    mirrored: bool = True

    def of(self, y: Array) -> tuple[Indices, Array]:
        """Sample at which each flight's input begins, -1 if not visible; and its sign."""
        n = np.arange(len(y))
        if self.surface < 0:
            return np.zeros(len(y), np.int64), np.ones(len(y))
        moved = y[:, :, self.surface] - self.rest
        begun = np.abs(moved) >= self.threshold
        start = np.where(begun.any(axis=1) & ~begun[:, 0], begun.argmax(axis=1), -1)
        return start, np.where((moved[n, start] > 0) | (not self.mirrored), 1.0, -1.0)


def _begin_of_input(y: Array, dictionary: Dictionary, limits: Envelope | None) -> Begin:
    """The control that the input moves first, and from where it counts as moved.

    Flights are mirrored if both sides are alike: all channels are deviations from trim, and limits
    are magnitudes.
    """
    controls = dictionary.of_role("control")
    if not controls:
        raise ValueError(
            f"the dictionary {dictionary.name} has no control, so the begin of the input is not "
            "visible: choose phase start"
        )
    mirrored = not dictionary.absolute
    mirrored &= limits is None or bool((limits.low == -limits.high).all())
    rest = np.array([0.0 if mirrored else float(np.median(y[:, 0, c])) for c in controls])
    deflection = np.abs(y[:, :, list(controls)] - rest)
    peak = np.median(np.nanmax(deflection, axis=1), axis=0)
    if not peak.any():
        raise ValueError(
            "no surface moves in the rollouts, so the begin of the input is not visible: choose "
            "phase start"
        )
    threshold = np.maximum(BEGUN * peak, VISIBLE * deflection[:, 0].std(axis=0))
    begins = [
        Begin(*each, mirrored)
        for each in zip(controls, threshold.tolist(), rest.tolist(), strict=True)
    ]
    first = [begin.of(y)[0] for begin in begins]
    mean = [starts[starts >= 0].mean() if (starts >= 0).any() else np.inf for starts in first]
    return begins[int(np.where(peak >= MOVES * peak.max(), mean, np.inf).argmin())]


def _peak_later(margin: Array, window: int) -> Array:
    """(n, n_samples) largest margin after each sample, within a window; 0 after the last one."""
    later = np.zeros_like(margin)
    if window == 0:
        later[:, :-1] = np.fmax.accumulate(margin[:, :0:-1], axis=1)[:, ::-1]
        return later
    for ahead in range(1, min(window, margin.shape[1] - 1) + 1):
        later[:, :-ahead] = np.fmax(later[:, :-ahead], margin[:, ahead:])
    return later


def _fails_later(flights: LearnedFlights, window: int) -> Flags:
    """(n, n_samples) whether a flight fails after each sample, within a window."""
    n_samples = flights.y.shape[1]
    ahead = flights.fail_index[:, None] - np.arange(n_samples)
    return (flights.fail_index < n_samples)[:, None] & (ahead <= (window or n_samples))


def _margins(x: Array, peaks: list[Array]) -> list[tuple[Array, float, float]]:
    """Weights and constant of (peak forecast - 1) / deviation, and the deviation of its error."""
    regressors, fits = Regressors(x, np.ones(len(x))), []
    for peak in peaks:
        weights, constant, residuals = regressors.ridge(peak)
        deviation = max(float(np.sqrt(np.mean(residuals**2))), FINEST)
        fits.append((weights / deviation, (constant - 1.0) / deviation, deviation))
    return fits


def _all_log_odds(x: Array, fails: list[Array]) -> list[tuple[Array, float, float]]:
    return [(*log_odds(x, labels), np.nan) for labels in fails]


def log_odds(x: Array, fails: Array) -> tuple[Array, float]:
    """Weights and constant of the log odds of failing, by penalised logistic regression.

    fails: (n,) 1 or 0.
    Newton's method, each step a weighted ridge regression. If almost no flight or almost every
    flight fails, the odds are constant.
    """
    from scipy.special import expit  # slow to import, and only needed here

    n_failed = int(fails.sum())
    odds = float(np.log((n_failed + 0.5) / (len(x) - n_failed + 0.5)))
    weights, constant = np.zeros(x.shape[1]), odds
    if min(n_failed, len(x) - n_failed) < LEAST_OF_A_KIND:
        return weights, constant
    for _ in range(NEWTON_STEPS):
        logit = x @ weights + constant
        share = expit(logit)
        precision = np.maximum(share * (1 - share), LEAST_WEIGHT)
        target = logit + (fails - share) / precision
        weights, constant, _ = Regressors(x, precision).ridge(target)
        if np.abs(x @ weights + constant - logit).max() < SMALL_STEP:
            break
    return weights, constant


class Regressors:
    """Regressors, standardised and decomposed once for all targets.

    x: (n, m).   precision: (n,) of the targets.
    """

    def __init__(self, x: Array, precision: Array) -> None:
        self._share = precision / precision.sum()
        self._mean = self._share @ x
        deviation = np.sqrt(self._share @ (x - self._mean) ** 2)
        self._moves = deviation > 1e-9 * np.abs(x).max(axis=0)
        self._deviation = deviation[self._moves]
        self._root = np.sqrt(precision)
        z = (x - self._mean)[:, self._moves] / self._deviation * self._root[:, None]
        values, self._vectors = np.linalg.eigh(z.T @ z)
        self._u = z @ self._vectors
        squares = self._u**2
        self._shrunk = [1 / (np.maximum(values, 0) + penalty) for penalty in PENALTIES]
        self._left = [np.maximum(1 - self._share - squares @ s, 1e-9) for s in self._shrunk]

    def ridge(self, target: Array) -> tuple[Array, float, Array]:
        """Weights, constant and leave-one-out residuals of a ridge regression.

        The penalty on standardised weights is the one of PENALTIES with the smallest sum of squared
        residuals.   target: (n,).
        """
        center = float(self._share @ target)
        off = self._root * (target - center)
        along = self._u.T @ off
        best: tuple[float, Array, Array] | None = None
        for shrunk, left in zip(self._shrunk, self._left, strict=True):
            residual = (off - self._u @ (along * shrunk)) / left
            if best is None or residual @ residual < best[0]:
                best = float(residual @ residual), along * shrunk, residual / self._root
        assert best is not None
        weights = np.zeros(len(self._mean))
        weights[self._moves] = self._vectors @ best[1] / self._deviation
        return weights, center - float(self._mean @ weights), best[2]


class RunningPeaks(RunningForecast):
    """Forecasts of one flight; lost if the begin of the input was missed.

    risk: highest p-value of the neighbours and of the parts at the last sample; NaN for none, 1
    without calibration scores.
    """

    def __init__(
        self, parts: Sequence[tuple["RidgeForecast", Array]], near_alphas: Array, dt: float
    ) -> None:
        """parts: with their sorted calibration scores; the first one is shown.

        near_alphas: (n,) sorted, of the neighbours.
        """
        self.risk = self._score = np.nan
        shown, _ = parts[0]
        self._deviation, self._every = shown.deviation, shown.peaks.every
        self._parts = [(part.peaks, begin(part.peaks), alphas) for part, alphas in parts]
        self._near_alphas, self._history = near_alphas, self._parts[0][1]
        self._call = peaks_call(self._parts, near_alphas, dt)
        arguments = *self._call, 0.0, self._history.samples[0], 0, 0.0
        self._update: Callable[..., tuple[float, int, bool, float]] = entry(peaks_at, *arguments)

    def update(self, t: float, y: Array, code: int, neighbor_score: float) -> tuple[float, int]:
        self._score, code, self.lost, self.risk = self._update(
            *self._call, t, y, code, neighbor_score
        )
        return self._score, code

    def ahead(self) -> Ahead | None:
        """Peak over the rest of the manoeuvre, once its input has begun.

        Over after the last scored phase.
        """
        if self._deviation is None:
            return None
        made_t, phase = self._history.clock.item(), self._history.counts.item(PHASE)
        every = self._every
        if phase < 0:
            return NothingAhead(made_t, NOT_BEGUN)
        if phase > (len(self._deviation) - 1) * every:
            return NothingAhead(made_t, OVER)
        if not isfinite(self._score):
            return None
        deviation = self._deviation.item(phase // every)
        return PeakAhead(made_t, 1.0 - self._score * deviation, deviation)


@dataclass(frozen=True, eq=False)
class RidgeForecast(PeakForecast):
    """Weights of each phase.   peaks: arrays for the kernels.

    deviation: (n_scored,) of forecast peaks, in limits; None if the score looks only one window
    ahead, if limits are unknown, and in older files.
    """

    section: ClassVar[str] = "peaks"
    peaks: PeakWeights
    deviation: Array | None = None

    @property
    def no_forecast_reason(self) -> str:
        return "" if self.deviation is not None else NO_PEAK

    def start(self, dt: float) -> RunningPeaks:
        nothing = np.empty(0)
        return RunningPeaks([(self, nothing)], nothing, dt)

    def begun_before(self, y: Array) -> Flags:
        """(n,) whether flights have begun their input by their first sample, y (n, n_channels).

        Their forecast is lost.
        """
        surface, threshold, rest = self.peaks.surface, self.peaks.threshold, self.peaks.rest
        return (surface >= 0) & (np.abs(y[:, surface] - rest) >= threshold)

    def follow(
        self, t: Array, y: Array, state: Indices, dt: float, neighbor_scores: Array
    ) -> ForecastScores:
        score, state = np.full(len(t), np.nan), state.copy()
        lost = kernels.follow(self.peaks, t, y, state, dt, score)
        return ForecastScores(score, state, np.full(y.shape, np.nan), lost)

    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        return lowest_within(self.scores(y, last), last, first)

    def scores(self, y: Array, last: Indices) -> Array:
        """Scores (n, n_samples) of samples 0..last of each flight; +inf for the rest.

        y: (n, n_samples, n_channels), finite over samples 0..last.   last: (n,).
        """
        return kernels.scores(self.peaks, y, last)

    def to_section(self) -> Section:
        header = self.peaks._asdict()
        arrays = {name: header.pop(name) for name in ("weights", "offset")}
        if self.peaks.mirrored:
            del header["rest"], header["mirrored"]
        if self.deviation is not None:
            arrays["deviation"] = self.deviation
        return Section(self.section, 1, True, header, arrays)


def from_section(section: Section, dictionary: Dictionary = LATERAL) -> RidgeForecast:
    """Forecast from its section. ValueError if kernels cannot read it."""
    counts = {name: section.header[name] for name in ("every", "stride", "surface")}
    threshold, rest = section.header["threshold"], section.header.get("rest", 0.0)
    mirrored = section.header.get("mirrored", True)
    weights, offset = (np.ascontiguousarray(section.arrays[key]) for key in ("weights", "offset"))
    if type(threshold) is not float or not 0 <= threshold < np.inf:
        raise ValueError(f"peaks threshold is {threshold!r}")
    if type(rest) is not float or not isfinite(rest) or type(mirrored) is not bool:
        raise ValueError(f"peaks rest is {rest!r}, mirrored {mirrored!r}")
    controls = dictionary.of_role("control")
    if type(counts["surface"]) is not int or counts["surface"] not in (-1, *controls):
        raise ValueError(f"peaks surface is {counts['surface']!r}")
    n, n_past = max(len(offset), 1), weights.shape[1]
    check_array("peaks weights", weights, (n, max(n_past, 1), len(dictionary)))
    check_array("peaks offset", offset, (n,))
    for name in ("every", "stride"):
        check_count(f"peaks {name}", counts[name], 1)
    if n_past * counts["stride"] + counts["every"] > MOST_SAMPLES:
        raise ValueError("peaks weights need a longer history than any flight has")
    deviation = section.arrays.get("deviation")
    if deviation is not None:
        check_array("peaks deviation", deviation, offset.shape, above=0)
    begin = Begin(counts.pop("surface"), threshold, rest, mirrored)
    peaks = PeakWeights(weights, offset, **counts, **begin._asdict())
    return RidgeForecast(peaks, deviation)
