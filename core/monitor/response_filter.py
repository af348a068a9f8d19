"""The fitted response filter of a test card: components, noise, and its section of the file."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from statistics import NormalDist
from typing import Any, ClassVar

import numpy as np

from core.card import Card
from core.channels import N_CHANNELS
from core.kernels import response_filter as kernels
from core.kernels.compiled import entry
from core.kernels.lanes import WIDTH
from core.kernels.response_filter import CardResponses, begin, look_ahead, squares, update
from core.limits.limits import Specification, magnitudes_of
from core.monitor.file.portable import Section
from core.monitor.file.values import MOST_SAMPLES, check_array, check_count
from core.monitor.peak_forecast import (
    NOT_BEGUN,
    OVER,
    Ahead,
    ForecastAhead,
    ForecastScores,
    NothingAhead,
    PeakForecast,
    RunningForecast,
    lowest_within,
)
from core.monitor.score import Score
from core.types import Array, Indices

LIMITED_WEIGHT = 2.0
"""Weight of channels with a limit when components are chosen."""
FINEST = 1e-3
"""Smallest deviation of a sample, as a share of its channel's; for a channel that never moves, in
its SI unit (N_y in g)."""
VISIBLE = 8.0
"""A switch is visible once the surface has moved by this many standard deviations of its noise."""
OF_LAG, OF_SIDES = WIDTH - 2, WIDTH - 1
"""Components of a filter that learns the inputs."""
LASTING = 16.0
"""Factor on the variance of a sample by the lag of its channel, because the lag is the same in all
samples of a transient."""
LATEST = 5.0
"""No step is earlier than planned by more than this many deviations of the timing."""
N_CASES = 5
"""Number of possible times of the pilot's next switch."""
MOST_FLIGHTS = 200
"""Safe rollouts for estimating the noise."""
CHI_SQUARE_MEDIAN = NormalDist().inv_cdf(0.75) ** 2
"""Median of a squared standard normal variable."""
NO_CARD = (
    "this predictor needs the test card: train(dataset, recipe, "
    "card=card_of(dataset_recipe)), or choose the predictor peak_ridge if there is none"
)
ARRAYS = ("mean", "components", "residual", "noise", "steps", "apart", "later", "limits")
SHARES = "shares"
"""An array that only files of version 2 have."""
NUMBERS = ("tail", "surface", "seen_after", "least_apart", "h", "window")


def fit_card(
    card: Card,
    safe: Array,
    specification: Specification,
    score: Score,
    h: int,
    learns_inputs: bool = False,
) -> "CardForecast":
    """Fit the responses to a step of the card, and the noise of the samples.

    safe: (n, n_samples, 6) safe rollouts, which show deviations besides sensor noise: gusts, lags
    and gains that the step responses do not contain.
    learns_inputs: whether it also learns how the inputs differ from the planned ones.
    ValueError if the specification has no limits.
    """
    limits = magnitudes_of(specification)
    if limits is None:
        raise ValueError(
            "the predictor response_filter forecasts limited channels; the specification has no "
            "limits: choose the predictor peak_ridge, and give train its rollouts"
        )
    responses = card.step_responses
    mean, deviation = responses.mean(axis=0), responses.std(axis=(0, 1))
    floor = FINEST * np.where(deviation > 0, deviation, 1.0)
    noise = np.hypot(card.noise_std, floor)
    components, residual = _components(responses - mean, noise, np.isfinite(limits))
    steps = card.steps / card.steps[0]
    shares = np.repeat(steps[:, np.newaxis], WIDTH, axis=1)
    if learns_inputs:
        mean, residual = _learn_inputs(card, mean, components, residual)
        shares[:, OF_SIDES] = np.diff(np.abs(np.cumsum(steps)), prepend=0.0)
    apart = np.round(np.diff(card.switch_times, prepend=card.switch_times[0]) / card.dt)
    apart = apart.astype(np.int64)
    last = round(card.switch_times[0] / card.dt) + int(apart.sum())
    seen_after = _seen_after(mean[:, card.surface], noise[card.surface])
    fitted = CardResponses(
        mean=np.ascontiguousarray(mean),
        components=components,
        residual=residual,
        noise=noise**2,
        steps=steps,
        shares=shares,
        apart=apart,
        later=_later(apart, card.timing_jitter_s / card.dt, len(mean)),
        tail=max(round(card.duration_s / card.dt) - last, 0),
        surface=card.surface,
        seen_after=seen_after,
        share=_share(mean[:, card.surface], seen_after),
        least_apart=_least_apart(
            apart, card.timing_jitter_s / card.dt if learns_inputs else np.inf
        ),
        limits=limits,
        h=h,
        window=score.window(h),
    )
    excess = _excess(fitted, safe[:MOST_FLIGHTS])
    return CardForecast(fitted._replace(noise=fitted.noise + excess))


def _components(off: Array, noise: Array, limited: Array) -> tuple[Array, Array]:
    """Principal components of responses in units of the noise, and the residual variance.

    off: (n, n_lags, 6) deviation from the mean.   limited: (6,) channels with more weight.
    Returns (n_lags, 6, 8), missing components zero; and (n_lags, 6).
    """
    n, n_lags, _ = off.shape
    units = np.where(limited, 1 / LIMITED_WEIGHT, 1.0) * noise
    vectors = np.linalg.svd((off / units).reshape(n, -1), full_matrices=False)[0][:, :WIDTH]
    components = np.zeros((WIDTH, n_lags, N_CHANNELS))
    scores = np.sqrt(n) * vectors
    components[: scores.shape[1]] = np.tensordot(scores.T / n, off, 1)
    residual = off - np.tensordot(scores, components[: scores.shape[1]], 1)
    return np.ascontiguousarray(components.transpose(1, 2, 0)), residual.var(axis=0)


def _learn_inputs(
    card: Card, mean: Array, components: Array, residual: Array
) -> tuple[Array, Array]:
    """Mean response and residual variance with lags; the last two components become those of the
    lag of the surface and of unequal sides."""
    lag = card.lag_s / card.dt
    slope, scatter = np.diff(mean, axis=0, prepend=0.0), lag / np.sqrt(12.0)
    mean = mean - 0.5 * lag * slope
    components[..., OF_LAG:] = 0.0
    components[:, card.surface, OF_LAG] = -scatter * slope[:, card.surface]
    components[..., OF_SIDES] = card.asymmetry * mean
    factor = np.where(np.arange(N_CHANNELS) == card.surface, 1.0, LASTING)
    return mean, residual + factor * np.square(scatter * slope)


def _least_apart(apart: Indices, deviation: float) -> int:
    """Minimum samples between switches.   deviation: of the pilot's timing; inf if not used."""
    if len(apart) < 2:
        return 1
    planned = int(apart[1:].min())
    return int(max(1, planned // 4, planned - LATEST * deviation))


def _seen_after(response: Array, noise: float) -> int:
    """Samples until a switch is visible in its surface.   response: (n_lags,) of the surface."""
    is_visible = np.abs(response) > VISIBLE * noise
    return int(is_visible.argmax()) if is_visible.any() else len(response) - 1


def _share(response: Array, seen_after: int) -> float:
    """Mean of the surface's relative response at that sample and one sample earlier."""
    return float(0.5 * (1 + response[seen_after - 1] / response[seen_after]))


def _later(apart: Indices, deviation: float, n_lags: int) -> Indices:
    """(n_switches, n_lags, N_CASES) samples from a switch to the next, given the samples passed.

    apart: (n_switches,) as planned.   deviation: of the pilot's timing [samples].
    """
    later = np.maximum(apart[:, None, None], np.arange(n_lags)[None, :, None])
    later = np.repeat(later, N_CASES, axis=2)
    if deviation <= 0:
        return later
    pilot, cases = NormalDist(), (np.arange(N_CASES) + 0.5) / N_CASES
    for j, planned in enumerate(apart.tolist()):
        for passed in range(n_lags):
            before = pilot.cdf((passed - 0.5 - planned) / deviation)
            if before > 1 - 1e-7:
                later[j, passed] = passed + np.arange(N_CASES)
                continue
            shares = np.clip(before + (1 - before) * cases, 1e-9, 1 - 1e-9)
            due = planned + deviation * np.array([pilot.inv_cdf(share) for share in shares])
            later[j, passed] = np.maximum(passed, np.round(due))
    return later


def _excess(fitted: CardResponses, safe: Array) -> Array:
    """(6,) excess variance of the forecast errors over the expected one; by medians."""
    off = np.empty((safe.shape[0] * safe.shape[1], N_CHANNELS))
    expected = np.empty_like(off)
    n = squares(fitted, np.ascontiguousarray(safe), off, expected)
    if n == 0:
        raise ValueError(
            "no safe rollout shows the first step of the test card in its surface: give rollouts "
            "of the card's manoeuvre"
        )
    variance = np.median(off[:n], axis=0) / CHI_SQUARE_MEDIAN
    return np.maximum(variance - np.median(expected[:n], axis=0), 0.0)


class RunningCard(RunningForecast):
    """Forecast of one flight's card; lost if a switch may have been missed."""

    def __init__(self, card: CardResponses, dt: float) -> None:
        self._estimate, self._ahead = begin(len(card.steps)), np.empty(N_CHANNELS)
        self._state = card, self._estimate, np.zeros(2), float(dt)
        nothing = 0.0, self._ahead, 0, self._ahead
        self._update: Callable[..., float] = entry(update, *self._state, *nothing)
        self._rest = np.zeros((2, len(card.mean) + card.tail, N_CHANNELS))
        about = card, self._estimate, *self._rest
        self._look_ahead: Callable[..., int] = entry(look_ahead, *about)

    def update(self, t: float, y: Array, code: int, neighbor_score: float) -> tuple[float, int]:
        s = self._update(*self._state, t, y, code, self._ahead)
        self.lost = bool(self._estimate.counts[kernels.LOST])
        self.y_hat = self._ahead.copy() if isfinite(self._ahead[0]) else None
        return s, code

    def ahead(self) -> Ahead | None:
        card, estimate, clock, dt = self._state
        mean, variance = self._rest
        n = self._look_ahead(card, estimate, mean, variance)
        if self.lost:
            return None
        made_t = float(clock[0])
        if n == 0:
            has_begun = estimate.counts[kernels.SWITCHED] > 0
            return NothingAhead(made_t, OVER if has_begun else NOT_BEGUN)
        t = made_t + dt * np.arange(1, n + 1, dtype=np.float64)
        return ForecastAhead(made_t, t, mean[:n].copy(), np.sqrt(variance[:n]), card.limits)


@dataclass(frozen=True, eq=False)
class CardForecast(PeakForecast):
    """The response filter of a card.   card: arrays for the kernels."""

    section: ClassVar[str] = "card"
    has_outputs: ClassVar[bool] = True
    card: CardResponses

    def start(self, dt: float) -> RunningCard:
        return RunningCard(self.card, dt)

    def follow(
        self, t: Array, y: Array, state: Indices, dt: float, neighbor_scores: Array
    ) -> ForecastScores:
        score, y_hat = np.full(len(t), np.nan), np.full((len(t), N_CHANNELS), np.nan)
        lost = kernels.follow(self.card, t, y, state, dt, score, y_hat)
        return ForecastScores(score, state, y_hat, lost)

    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        window = np.array([self.card.window])
        return lowest_within(self.scores_within(window, y, last)[0], last, first)

    def scores_within(self, windows: Indices, y: Array, last: Indices) -> Array:
        """Score of each sample for other windows of the card, without fitting again.

        windows: (n_windows,) samples, ascending; 0, for the rest of the card, is the first of them.
        y: (n, n_samples, 6), finite over samples 0..last.   last: (n,).
        Returns (n_windows, n, n_samples); +inf after `last`.
        """
        return kernels.scores_within(self.card, windows, y, last)

    def to_section(self) -> Section:
        header: dict[str, Any] = {name: getattr(self.card, name) for name in NUMBERS}
        arrays = {name: getattr(self.card, name) for name in ARRAYS}
        unequal = bool((self.card.shares != self.card.steps[:, np.newaxis]).any())
        if unequal:
            arrays[SHARES] = self.card.shares
        return Section(self.section, 1 + unequal, True, header | {"share": self.card.share}, arrays)


def from_section(section: Section, h: int, score: Score) -> CardForecast:
    """Forecast from its section. ValueError if kernels cannot read it.

    h, score: of the monitor.
    """
    header = {name: section.header[name] for name in (*NUMBERS, "share")}
    names = ARRAYS if section.version == 1 else (*ARRAYS, SHARES)
    arrays = {name: np.ascontiguousarray(section.arrays[name]) for name in names}
    n_lags, m = len(arrays["mean"]), len(arrays["steps"])
    by_lag, whole = (n_lags, N_CHANNELS), {"kind": np.int64, "least": 0, "most": MOST_SAMPLES}
    ranges: dict[str, tuple[tuple[int, ...], dict[str, Any]]] = {
        "mean": (by_lag, {}),
        "components": ((*by_lag, WIDTH), {}),
        "residual": (by_lag, {"least": 0}),
        "noise": ((N_CHANNELS,), {"above": 0}),
        "steps": ((m,), {}),
        SHARES: ((m, WIDTH), {}),
        "apart": ((m,), whole),
        "later": ((m, n_lags, arrays["later"].shape[-1]), whole),
        "limits": ((N_CHANNELS,), {"above": 0, "finite": False}),
    }
    arrays.setdefault(SHARES, np.repeat(arrays["steps"][:, np.newaxis], WIDTH, axis=1))
    for name, (shape, values) in ranges.items():
        check_array(f"card {name}", arrays[name], shape, **values)
    for name in NUMBERS:
        check_count(f"card {name}", header[name])
    if not arrays["mean"].size or not arrays["later"].size or arrays["steps"][0] != 1:
        raise ValueError("card mean, later or steps is impossible")
    if header["h"] != h or header["window"] != score.window(h) or header["tail"] > n_lags:
        raise ValueError("card h, window or tail does not match the monitor")
    if not (header["surface"] < N_CHANNELS and 1 <= header["seen_after"] < n_lags):
        raise ValueError("card surface or seen_after is out of range")
    if type(header["share"]) is not float or not 0 < header["share"] <= 1:
        raise ValueError(f"card share is {header['share']!r}")
    if not arrays["mean"][header["seen_after"], header["surface"]]:
        raise ValueError("card mean has no response to the first step")
    return CardForecast(CardResponses(**arrays, **header))
