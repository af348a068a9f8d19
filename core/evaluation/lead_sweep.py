"""Lead against power: how early a planned test can be warned of, by which method, and what for.

For every planned test, method and lead several monitors are trained, each on a dataset of its own,
and fresh flights are flown through each. Counted are failures without a timely alert, safe flights
without an alert, and failures that the alert prevents by the time that people take to react.
"""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, fields, replace
from functools import partial
from threading import Event
from typing import Annotated, Literal

import numpy as np

from core.bounds import Bounds, check_bounds
from core.card import Card, CardError
from core.collection import card_of, collect, evaluation_flights, stopped_flights
from core.evaluation.prevention import REACTIONS_S, prevention
from core.evaluation.rates import clustered_interval, first_alerts
from core.kernels.compiled import on_this_thread
from core.monitor.calibration import Guarantee, check_epsilon, p_values
from core.monitor.monitor import Monitor
from core.monitor.predictor import PREDICTORS, Predictor
from core.monitor.recipe import MISS_RATE, MonitorRecipe
from core.monitor.score import SCORES, Score
from core.monitor.training import SafeObservations, train
from core.planned_test import DatasetRecipe, Rollouts, SensorNoise
from core.seeds import Branch, monitor_seeds, stream
from core.simulation.aircraft import AIRCRAFT
from core.simulation.control_law import CONTROL_LAWS
from core.specification import Limits
from core.types import Array, Flags, Indices

METHODS: dict[str, tuple[Predictor, Score]] = {
    "linear + nearest neighbor": (PREDICTORS["linear"], SCORES["nearest_neighbor"]),
    "predicted magnitude": (PREDICTORS["linear"], SCORES["negative_magnitude"]),
    "peaks ahead: window": (PREDICTORS["peak_ridge"], SCORES["card_window"]),
    "peaks ahead: rest": (PREDICTORS["peak_ridge"], SCORES["rest_of_card"]),
    "test card: window": (PREDICTORS["response_filter"], SCORES["card_window"]),
    "test card: rest": (PREDICTORS["response_filter"], SCORES["rest_of_card"]),
}
"""Methods that are compared, as pairs of predictor and score."""
NOISE = SensorNoise(beta=0.001, p=0.004, r=0.001, Ny=0.004, delta_a=0.003, delta_r=0.0003)


def _doublet(aircraft: str, control_law: str, amplitude_deg: float) -> DatasetRecipe:
    """A rudder doublet of 1 s halves, flown by hand, that about a quarter of the aircraft fail."""
    usual = DatasetRecipe()
    return replace(
        usual,
        aircraft=AIRCRAFT[aircraft],
        control_law=CONTROL_LAWS[control_law],
        maneuver=replace(
            usual.maneuver.with_peak(amplitude_deg), timing_jitter_s=0.1, amplitude_jitter=0.05
        ),
        specification=Limits(Ny=0.5),
        noise=NOISE,
    )


TESTS = {
    "F-16": _doublet("f16_sl_h0_v502", "f16_damper", 9.5),
    "F-104A": _doublet("f104a_sl_m0p8", "f104a_damper", 4.01),
    "ATTAS": _doublet("attas_id_16kft", "none", 9.63),
}
"""Planned tests that methods are compared on: with noise and a pilot's scatter."""


@dataclass(frozen=True)
class SweepRecipe:
    """What is compared, and how many monitors and flights it takes."""

    tests: tuple[str, ...] = tuple(TESTS)
    """planned tests: by name."""
    imperfections: Literal["none", "usual"] = "none"
    """imperfections of a real flight, with the noise and the scatter that are usual in flight:
    `none` or `usual`."""
    leads_s: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
    """leads: warning lead times that monitors are trained for [s]."""
    methods: tuple[str, ...] = tuple(METHODS)
    """methods: by name."""
    epsilon: Annotated[float, MISS_RATE] = 0.05
    """promised miss rate epsilon."""
    guarantee: Guarantee = "average"
    """promise on the miss rate: on `average`, or of each monitor with `95%` confidence."""
    n_unsafe: Annotated[int, Bounds(least=2)] = 200
    """unsafe rollouts that each monitor is calibrated on."""
    n_monitors: Annotated[int, Bounds(least=1)] = 3
    """monitors of each method and lead: each from a dataset of its own."""
    n_test: Annotated[int, Bounds(least=1)] = 1000
    """fresh test flights of each monitor."""
    reactions_s: tuple[float, ...] = REACTIONS_S
    """reaction times: mean from an alert to neutral controls [s]."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw."""

    def __post_init__(self) -> None:
        """Refuse what makes no sweep."""
        check_bounds(self)
        for what, given, known in (
            ("method", self.methods, METHODS),
            ("planned test", self.tests, TESTS),
            ("imperfections", (self.imperfections,), ("none", "usual")),
        ):
            if unknown := [name for name in given if name not in known]:
                raise ValueError(f"{what} {unknown[0]!r} was given: choose {', '.join(known)}")
        check_epsilon(self.epsilon, self.n_unsafe, self.guarantee)
        for name, times in (("leads_s", self.leads_s), ("reactions_s", self.reactions_s)):
            if not times or not all(np.isfinite(t) and t > 0 for t in times):
                raise ValueError(f"{name}={times} was given: give one time above 0 s or more")


@dataclass(frozen=True, eq=False)
class Cell:
    """Counts of one method at one lead on one planned test, a row a monitor.

    misses, n_unsafe, false_alerts, n_safe: (n_monitors,).   prevented: (n_monitors, n_reactions).
    n_early: (n_monitors,) failures that came before any timely alert could.
    power_at_epsilon: (n_monitors,) share of safe flights without an alert where just the share
    epsilon of these very failing flights is missed.
    lead: in effect [s].   epsilon: promised.
    """

    epsilon: float
    lead: float
    misses: Indices
    n_unsafe: Indices
    n_early: Indices
    false_alerts: Indices
    n_safe: Indices
    prevented: Indices
    power_at_epsilon: Array

    @classmethod
    def pool(cls, cells: list["Cell"]) -> "Cell":
        """Pool cells of one method and lead, each of monitors of its own."""
        rows = (field.name for field in fields(cls)[2:])
        columns = {name: np.concatenate([getattr(cell, name) for cell in cells]) for name in rows}
        return cls(cells[0].epsilon, cells[0].lead, **columns)

    @property
    def miss_rate(self) -> float:
        """Share of all failing flights without a timely alert."""
        return float(self.misses.sum() / max(self.n_unsafe.sum(), 1))

    @property
    def miss_interval(self) -> Array:
        """(2,) 95 % interval that allows for the scatter between monitors."""
        return clustered_interval(self.misses, self.n_unsafe)

    @property
    def power(self) -> float:
        """Share of all safe flights without an alert."""
        return float(1 - self.false_alerts.sum() / max(self.n_safe.sum(), 1))

    @property
    def power_interval(self) -> Array:
        """(2,) 95 % interval that allows for the scatter between monitors."""
        return clustered_interval(self.n_safe - self.false_alerts, self.n_safe)

    @property
    def prevented_share(self) -> Array:
        """(n_reactions,) share of all failing flights that an alert prevents."""
        return self.prevented.sum(axis=0) / max(self.n_unsafe.sum(), 1)


@dataclass(frozen=True)
class PlannedTestSweep:
    """What was found on one planned test.

    earliest_s: time from the first input by which 5 % of the failing flights have failed [s]: a
    longer lead leaves the manoeuvre.   unsafe_share: of fresh flights that fail.
    cells: by method and wanted lead [s].
    """

    earliest_s: float
    unsafe_share: float
    cells: Mapping[tuple[str, float], Cell]


_Part = tuple[float, float, dict[tuple[str, float], Cell]]
"""Of one monitor: earliest_s, unsafe_share and cells of PlannedTestSweep."""


def sweep(
    recipe: SweepRecipe | None = None,
    tests: Mapping[str, DatasetRecipe] | None = None,
    *,
    progress: Callable[[int, int], object] | None = None,
) -> dict[str, PlannedTestSweep]:
    """Train and test every method at every lead on every planned test.

    tests: by name, those of the recipe unless given. Methods that need a test card are left out
    where the manoeuvre has none.
    progress: called with (monitors done, monitors in all); what it raises cancels.
    """
    recipe = recipe or SweepRecipe()
    if tests is None:
        tests = {name: TESTS[name] for name in recipe.tests}
        if recipe.imperfections == "usual":
            tests = {name: test.as_flown() for name, test in tests.items()}
    seeds = monitor_seeds(recipe.seed, recipe.n_monitors)
    each = len(recipe.methods) * len(recipe.leads_s)
    total, done, cancelled = len(tests) * recipe.n_monitors * each, 0, Event()
    pool = ThreadPoolExecutor(os.cpu_count() or 1)
    try:
        parts = {
            pool.submit(
                partial(
                    _part_alone,
                    replace(test, seed=seed, n_unsafe=recipe.n_unsafe),
                    recipe,
                    cancelled,
                )
            ): name
            for seed, _ in seeds
            for name, test in tests.items()
        }
        for part in as_completed(parts):
            part.result()
            done += each
            if progress:
                progress(done, total)
    finally:
        cancelled.set()
        pool.shutdown(cancel_futures=True)
    found = {name: [part.result() for part in parts if parts[part] == name] for name in tests}
    return {name: _pooled(own) for name, own in found.items()}


def _part_alone(test: DatasetRecipe, recipe: SweepRecipe, cancelled: Event) -> _Part:
    with on_this_thread():
        return _part(test, recipe, cancelled)


def _part(test: DatasetRecipe, recipe: SweepRecipe, cancelled: Event) -> _Part:
    """One dataset, and its monitors of every method and lead on the same fresh flights."""
    dataset, card = collect(test), _card(test)
    flights = evaluation_flights(test, recipe.n_test)
    counted: dict[tuple[str, float], Cell] = {}
    for lead in recipe.leads_s:
        settings = MonitorRecipe(t_early=lead, epsilon=recipe.epsilon, guarantee=recipe.guarantee)
        safe = SafeObservations(dataset, settings)
        for name in recipe.methods:
            predictor, score = METHODS[name]
            if predictor.forecast == "card" and card is None:
                continue
            if cancelled.is_set():
                raise InterruptedError("the sweep was cancelled")
            chosen = replace(settings, predictor=predictor, score=score)
            monitor = train(dataset, chosen, card=card, safe=safe)
            counted[name, lead] = _counted(monitor, flights, test, recipe.reactions_s)
    fails = flights.fail_index[flights.is_unsafe]
    earliest = float(np.quantile(fails, 0.05) * test.dt) if len(fails) else np.nan
    return earliest - test.maneuver.lead_in_s, float(flights.is_unsafe.mean()), counted


def _card(test: DatasetRecipe) -> Card | None:
    try:
        return card_of(test)
    except CardError:
        return None


def _counted(
    monitor: Monitor, flights: Rollouts, test: DatasetRecipe, reactions_s: tuple[float, ...]
) -> Cell:
    """Fly the flights through one monitor."""
    y, fails, n_samples = flights.y, flights.fail_index, flights.y.shape[1]
    is_unsafe = flights.is_unsafe
    last = np.where(is_unsafe, fails - monitor.h, n_samples - 1)
    lowest = monitor.lowest_scores(y, last)
    alerts = (last >= 0) & (p_values(lowest, monitor.alphas) > monitor.alert_above())
    unsafe, first = np.flatnonzero(is_unsafe), np.full(len(y), n_samples)
    first[unsafe] = first_alerts(monitor, y[unsafe], fails[unsafe])
    reactions = prevention(
        first,
        fails,
        n_samples,
        monitor.dt,
        partial(stopped_flights, test, len(y)),
        stream(test.seed, Branch.REACTION),
        reactions_s,
    )
    return Cell(
        epsilon=monitor.recipe.epsilon,
        lead=monitor.lead,
        misses=np.array([np.count_nonzero(~alerts[is_unsafe])]),
        n_unsafe=np.array([len(unsafe)]),
        n_early=np.array([np.count_nonzero(last[is_unsafe] < 0)]),
        false_alerts=np.array([np.count_nonzero(alerts[~is_unsafe])]),
        n_safe=np.array([np.count_nonzero(~is_unsafe)]),
        prevented=reactions.prevented[np.newaxis],
        power_at_epsilon=np.array([_power_at(monitor.recipe.epsilon, lowest, is_unsafe)]),
    )


def _power_at(epsilon: float, lowest: Array, is_unsafe: Flags) -> float:
    """Power of the threshold that misses just the share epsilon of these failing flights."""
    scores, safe = np.sort(lowest[is_unsafe]), lowest[~is_unsafe]
    if not (len(scores) and len(safe)):
        return np.nan
    threshold = scores[len(scores) - 1 - int(epsilon * len(scores) + 1e-9)]
    return float(np.mean(safe > threshold))


def _pooled(parts: list[_Part]) -> PlannedTestSweep:
    """One planned test's parts, a monitor each, as one."""
    earliest, unsafe_share, counted = zip(*parts, strict=True)
    cells = {key: Cell.pool([part[key] for part in counted]) for key in counted[0]}
    return PlannedTestSweep(float(np.nanmean(earliest)), float(np.mean(unsafe_share)), cells)
