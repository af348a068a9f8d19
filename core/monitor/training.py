"""Training: from labelled trajectories to a calibrated monitor."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from core import __version__
from core.card import Card
from core.channels import LATERAL
from core.dataset import FLOWN, Dataset
from core.kernels.assessing import Fitted, map_samples, weighted_distances
from core.kernels.p_value import SIMPLE, Transduction
from core.kernels.peak_risk import lowest_scores
from core.limits.limits import envelope_of
from core.monitor.ensemble import NeighborsAndPeak, halves, worst_of
from core.monitor.group import Groups, Pooled
from core.monitor.monitor import Monitor, assemble
from core.monitor.observation import (
    Observations,
    OutputsAhead,
    channel_peaks,
    channel_scale,
    lead_steps,
)
from core.monitor.peak_forecast import PeakForecast
from core.monitor.peak_ridge import LearnedFlights, RidgeForecast, fit_windows
from core.monitor.predictor import NOT_TRAINED, Affine, PeakRidge, Predictor, ResponseFilter
from core.monitor.recipe import MonitorRecipe
from core.monitor.response_filter import NO_CARD, fit_card
from core.monitor.score import CardWindow
from core.monitor.validity.flown_input import FreshInputs
from core.monitor.validity.innovation import fit_innovation
from core.monitor.validity.support import calibrate
from core.types import Array, Indices

Flights = tuple[Array, Indices, *tuple[Any, ...]]
"""Outputs y (n, n_samples, n_channels), fail_index (n,), further items ignored."""
FreshFlights = Iterable[Flights]
NO_NEAR = (
    "scope near was given without flights near the planned ones: train(dataset, recipe, "
    "near=near_failures(...)), or choose scope planned"
)


class SafeObservations:
    """Scale and predictors fitted on a dataset's safe rollouts; each predictor is fitted once."""

    def __init__(self, dataset: Dataset, recipe: MonitorRecipe) -> None:
        y, times, self.scale = dataset.safe, dataset.safe_times, np.ones(len(dataset.dictionary))
        if recipe.scaling != "raw":
            self.scale = channel_scale(Observations(y, times, 0, self.scale)[:])
        self._units = np.tile(self.scale, recipe.n_delay + 1)
        self._pairs = (
            Observations(y, times, recipe.n_delay, self.scale),
            OutputsAhead(y, times, lead_steps(recipe.t_early, dataset.dt), self.scale),
        )
        self._fits: dict[Predictor, Affine] = {}

    def fit(self, predictor: Predictor) -> Affine:
        """Return the predictor fitted on scaled observations, for observations in SI units."""
        if predictor not in self._fits:
            self._fits[predictor] = predictor.fit(*self._pairs).in_units(self._units)
        return self._fits[predictor]


def train(
    dataset: Dataset,
    recipe: MonitorRecipe | None = None,
    fresh: FreshFlights | None = None,
    *,
    card: Card | None = None,
    rollouts: Flights | None = None,
    failures: Flights | None = None,
    near: Sequence[Flights] = (),
    safe: SafeObservations | None = None,
) -> Monitor:
    """Fit the predictor on safe observations, then calibrate the score on the failures.

    Calibration data chooses nothing: scale and predictor use safe observations only.
    fresh: batches of fresh flights to calibrate validity on, see `with_validity`; without them the
    monitor cannot tell whether a flight resembles its training.
    card: test card, for predictors that need it, see core.planned_test.collection.card_of.
    rollouts: y (n, n_samples, n_channels) and fail_index (n,), n_samples for a safe flight, of
    flights that are not in the dataset. The predictor peak_ridge learns from them and the dataset's
    safe ones; it needs them if the specification is known only by its label, see
    core.planned_test.collection.training_rollouts.
    failures: y and fail_index of fresh failing flights, on which the predictor ensemble is
    calibrated as a whole, see core.planned_test.collection.combination_failures; safe flights among
    them are ignored. Without them half of the dataset's failures trains it and half calibrates it.
    near: failing flights of each further population in which an ensemble of scope near keeps its
    promise, as many of each as of those that calibrate it, see core.planned_test.near.
    safe: shared safe observations of this dataset, for recipes that differ only in predictor and
    score.
    ValueError if the dataset has no unsafe or no safe rollout, if fresh flights are too few, or if
    the card is missing.
    """
    recipe = recipe or MonitorRecipe()
    monitor = _calibrated(dataset, recipe, safe, card, rollouts, failures, near)
    return monitor if fresh is None else with_validity(monitor, dataset, fresh)


def with_validity(monitor: Monitor, dataset: Dataset, fresh: FreshFlights) -> Monitor:
    """Return the monitor with calibrated validity and the statistics of flown inputs.

    dataset: its training dataset.
    fresh: batches of y (n, n_samples, n_channels) and fail_index (n,), n_samples for a safe flight,
    that neither trained nor tested it; reads only as many as needed.   SupportError.
    """
    reference = monitor.reference(fit_innovation(dataset))
    inputs = FreshInputs(dataset.dt, dataset.dictionary)
    support = calibrate(reference, dataset.safe.shape[1], _noted(fresh, inputs))
    return replace(monitor, support=support, inputs=inputs.support)


def _noted(fresh: FreshFlights, inputs: FreshInputs) -> FreshFlights:
    """The same batches, while their inputs are gathered."""
    for y, fail_index, *rest in fresh:
        inputs.add(y, fail_index)
        yield y, fail_index, *rest


def _calibrated(
    dataset: Dataset,
    recipe: MonitorRecipe,
    safe: SafeObservations | None,
    card: Card | None,
    rollouts: Flights | None,
    failures: Flights | None,
    near: Sequence[Flights],
) -> Monitor:
    _check(dataset, recipe)
    if recipe.is_near and not near:
        raise ValueError(NO_NEAR)
    h, n_delay = lead_steps(recipe.t_early, dataset.dt), recipe.n_delay
    numbers, unsafe, fail_index = np.arange(len(dataset.unsafe)), dataset.unsafe, dataset.fail_index
    calibrating = unsafe, fail_index
    if recipe.predictor.forecast == "ensemble":
        numbers, calibrating = _apart(dataset, failures)
        unsafe, fail_index = unsafe[numbers], fail_index[numbers]
        if rollouts is None and envelope_of(dataset.specification) is None:
            rollouts = unsafe, fail_index  # labels are learned from failures too
    forecasts = _fit_forecasts(dataset, recipe, h, card, rollouts)
    forecast = forecasts[0] if forecasts else None
    safe = safe or SafeObservations(dataset, recipe)
    affine = safe.fit(recipe.predictor)

    first, last = _counted(fail_index, h, recipe)
    timely = np.flatnonzero(last >= 0)
    at = np.column_stack([timely, last[timely]])
    n_safe, n_obs = dataset.safe_times.shape
    safe_where = np.column_stack([np.repeat(np.arange(n_safe), n_obs), dataset.safe_times.ravel()])
    unsafe_points = map_samples(affine, unsafe, at, n_delay)
    safe_points = map_samples(affine, dataset.safe, safe_where, n_delay)

    no_others = safe_points, np.empty(0)
    fitted = assemble(recipe, affine, unsafe_points, *no_others)
    flights = _several(dataset, numbers)
    without_flights = [
        (rows, assemble(recipe, affine, unsafe_points[~np.isin(timely, rows)], *no_others))
        for rows in flights
    ]
    own_point = np.full(len(last), -1)
    own_point[timely] = np.arange(len(timely))
    of_forecasts = [each.lowest_scores(unsafe, first, last) for each in forecasts]
    if forecast is None or recipe.predictor.forecast == "ensemble":
        alphas = lowest_scores(fitted, unsafe, n_delay, first, last, own_point, np.empty(0))
        for rows, apart in without_flights:
            about = n_delay, first[rows], last[rows], np.full(len(rows), -1), np.empty(0)
            alphas[rows] = lowest_scores(apart, unsafe[rows], *about)
    else:
        alphas = of_forecasts[0]
    if recipe.predictor.forecast == "ensemble":
        neighbors = fitted._replace(alphas=np.sort(alphas))
        forecast = rule = _rule(neighbors, n_delay, forecasts, of_forecasts)
        alphas = rule.lowest_scores(calibrating[0], *_counted(calibrating[1], h, recipe))
        if recipe.is_near:
            others = [_scores_near(rule, each, len(alphas), h, recipe) for each in near]
            alphas = worst_of([alphas, *others])
    groups = None
    if not isinstance(recipe.groups, Pooled):
        assigned = recipe.groups.fit(*calibrating, dataset.specification)
        groups = Groups.calibrate(assigned, alphas, recipe.epsilon, recipe.guarantee)
    exact = SIMPLE
    if recipe.is_exact:
        running = recipe.calibration == "trajectory"
        about = affine, unsafe, n_delay, timely, first, last, alphas, running
        exact = _transduction(fitted, without_flights, *about)
    return Monitor(
        recipe=recipe,
        dt=dataset.dt,
        h=h,
        scale=safe.scale,
        training_max_abs=np.fmax(channel_peaks(dataset.safe), channel_peaks(dataset.unsafe)),
        unsafe_points=unsafe_points,
        unsafe_where=np.column_stack([numbers[timely], last[timely]]),
        safe_points=safe_points,
        safe_where=safe_where,
        theta_names=dataset.theta_names,
        theta_unsafe=dataset.theta_unsafe,
        theta_safe=dataset.theta_safe,
        n_early=int(np.isposinf(alphas).sum()),
        fitted=fitted._replace(alphas=np.sort(alphas)),
        exact=exact,
        forecast=forecast,
        groups=groups,
        dataset_recipe=dataset.recipe,
        dataset_digest=dataset.digest(),
        seed=dataset.seed,
        version=__version__,
        specification=dataset.specification,
        dictionary=dataset.dictionary,
    )


def halves_of(dataset: Dataset) -> tuple[Indices, Indices]:
    """Numbers of the dataset's failures that train, and that calibrate an ensemble.

    Failures of one flown flight are in one half.
    """
    if FLOWN not in dataset.recipe:
        return halves(len(dataset.unsafe))
    flight = _flight_of_failures(dataset)
    training = np.isin(flight, halves(flight.max() + 1)[0])
    return np.flatnonzero(training), np.flatnonzero(~training)


def _flight_of_failures(dataset: Dataset) -> Indices:
    """(n_unsafe,) number of the flight of each failure, from 0."""
    setting = dataset.flights().settings()[: len(dataset.unsafe)]
    return np.unique(setting, return_inverse=True)[1].reshape(-1)


def _several(dataset: Dataset, numbers: Indices) -> list[Indices]:
    """Rows of the failures of each flown flight that has several among those numbered.

    Calibration leaves them out together: the failures of one flight are alike.
    """
    if FLOWN not in dataset.recipe:
        return []
    flight = _flight_of_failures(dataset)[numbers]
    several = np.flatnonzero(np.bincount(flight) > 1)
    return [np.flatnonzero(flight == each) for each in several]


def _apart(dataset: Dataset, failures: Flights | None) -> tuple[Indices, tuple[Array, Indices]]:
    """Numbers of the dataset's failures that train; y and fail_index of those that calibrate."""
    if failures is None:
        training, calibrating = halves_of(dataset)
        if not len(training):
            raise ValueError("the dataset has 1 failure: the predictor ensemble needs 2 or more")
        return training, (dataset.unsafe[calibrating], dataset.fail_index[calibrating])
    y, fail_index = failures[:2]
    if y.shape[1:] != dataset.safe.shape[1:]:
        raise ValueError(
            f"failures of shape {y.shape[1:]} were given: rollouts of the dataset have "
            f"{dataset.safe.shape[1:]}, roll out the same manoeuvre"
        )
    fails = fail_index < y.shape[1]
    if not fails.any():
        raise ValueError("no flight of failures fails: give failing flights of the same manoeuvre")
    return np.arange(len(dataset.unsafe)), (y[fails], fail_index[fails])


def _counted(fail_index: Indices, h: int, recipe: MonitorRecipe) -> tuple[Indices, Indices]:
    """First and last sample of each failure that calibration counts."""
    last = fail_index - h
    return np.maximum(last, 0) if recipe.calibration == "pointwise" else np.zeros_like(last), last


def _fit_forecasts(
    dataset: Dataset,
    recipe: MonitorRecipe,
    h: int,
    card: Card | None,
    rollouts: Flights | None,
) -> Sequence[PeakForecast]:
    """Forecast of the rest of the manoeuvre, of an ensemble those of its peaks; none without."""
    predictor, specification = recipe.predictor, dataset.specification
    if isinstance(predictor, PeakRidge):
        limits = envelope_of(specification)
        learned = dataset.safe, rollouts, limits is not None, dataset.dictionary
        flights, windows = LearnedFlights.of(*learned), [recipe.score.window(h)]
        if recipe.is_near:
            windows.append(CardWindow().window(h))
        return fit_windows(predictor, flights, limits, windows, dataset.dt)
    if not isinstance(predictor, ResponseFilter):
        return ()
    if card is None:
        raise ValueError(NO_CARD)
    settings = recipe.score, h, predictor.learns_inputs
    return (fit_card(card, dataset.safe, specification, *settings),)


def _rule(
    neighbors: Fitted, n_delay: int, peaks: Sequence[PeakForecast], alphas: Sequence[Array]
) -> NeighborsAndPeak:
    """The parts of an ensemble as one rule. alphas: of each peak, in any order."""
    rest, *window = (peak for peak in peaks if isinstance(peak, RidgeForecast))
    of_rest, *of_window = (np.sort(each) for each in alphas)
    rule = NeighborsAndPeak(neighbors, n_delay, rest, of_rest)
    return replace(rule, window=window[0], window_alphas=of_window[0]) if window else rule


def _scores_near(
    rule: NeighborsAndPeak, flights: Flights, n: int, h: int, recipe: MonitorRecipe
) -> Array:
    """Calibration scores (n,) of the failing flights of a population near the planned one."""
    y, fail_index = flights[:2]
    if len(y) != n or (fail_index >= y.shape[1]).any():
        raise ValueError(
            f"near has a population of {np.count_nonzero(fail_index < y.shape[1])} failing flights "
            f"among {len(y)}: give {n} failing ones, as many as calibrate the rule"
        )
    return rule.lowest_scores(y, *_counted(fail_index, h, recipe))


def _transduction(
    fitted: Fitted,
    without_flights: Sequence[tuple[Indices, Fitted]],
    affine: Affine,
    y: Array,
    n_delay: int,
    timely: Indices,
    first: Indices,
    last: Indices,
    alphas: Array,
    running: bool,
) -> Transduction:
    """Keep the calibration's distances, because an added test point can lower them."""
    lengths = (last - first + 1)[timely]
    start = np.concatenate([[0], lengths.cumsum()])
    point = np.repeat(np.arange(len(timely)), lengths)
    sample = first[timely][point] + np.arange(len(point)) - start[point]
    points = map_samples(affine, y, np.column_stack([timely[point], sample]), n_delay)
    unsafe, safe = weighted_distances(fitted, points, point)
    for rows, apart in without_flights:
        of = np.isin(timely[point], rows)
        unsafe[of], _ = weighted_distances(apart, points[of], np.full(of.sum(), -1))
    always = len(y) - len(timely)
    return Transduction(points, unsafe, safe, start, alphas[timely], always, running).indexed()


def _lateral_part(recipe: MonitorRecipe) -> str:
    """Part of a recipe that only works with the lateral channels; empty for none."""
    if isinstance(recipe.predictor, ResponseFilter):
        name = "input_filter" if recipe.predictor.learns_inputs else "response_filter"
        return f"the predictor {name}"
    if recipe.score.channel >= 0:
        return "the score negative_magnitude"
    return "" if isinstance(recipe.groups, Pooled) else "groups of failing flights"


def check_lead(t_early: float, horizon: float) -> None:
    """Raise ValueError for a lead [s] that is not shorter than the manoeuvre [s]."""
    if t_early >= horizon:
        raise ValueError(
            f"t_early={t_early} s was given: the manoeuvre lasts {horizon:g} s, choose a "
            "shorter warning lead time"
        )


def _check(dataset: Dataset, recipe: MonitorRecipe) -> None:
    if recipe.predictor.forecast == "members":
        raise ValueError(NOT_TRAINED)
    if dataset.dictionary != LATERAL and (part := _lateral_part(recipe)):
        raise ValueError(
            f"{part} was given for the channels {', '.join(dataset.dictionary.keys)}: it "
            f"knows only {', '.join(LATERAL.keys)}, choose another"
        )
    if not len(dataset.unsafe) or not len(dataset.safe):
        raise ValueError(
            f"the dataset has {len(dataset.unsafe)} unsafe and {len(dataset.safe)} safe rollouts: "
            "a monitor needs both, change the amplitude or the limit"
        )
    if dataset.theta_unsafe.shape[1] != len(dataset.theta_names):
        raise ValueError(
            f"theta has {dataset.theta_unsafe.shape[1]} parameters and theta_names has "
            f"{len(dataset.theta_names)}: name each parameter"
        )
    check_lead(recipe.t_early, (dataset.safe.shape[1] - 1) * dataset.dt)
