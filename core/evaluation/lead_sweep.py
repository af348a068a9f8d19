"""Lead-time study: power of each method against lead, and the failures that alerts prevent.

For every planned test, method and lead, several monitors are trained, each on its own dataset, and
fresh flights are flown through each. The study counts failures without a timely alert, safe flights
without an alert, and failures that an alert prevents, given the reaction time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain
from typing import Annotated, Any, Literal

import numpy as np

from core.bounds import Bounds, check_bounds
from core.card import CardError
from core.evaluation.baselines import BASELINES, Baseline, baselines_for
from core.evaluation.ceiling import Ceiling
from core.evaluation.prevention import REACTIONS_S, Stopped, prevention
from core.evaluation.rates import PooledCounts, first_sample
from core.limits.limits import Limits, envelope_of
from core.monitor.calibration import Guarantee, alert_above, check_epsilon, p_values
from core.monitor.monitor import Monitor
from core.monitor.observation import lead_steps
from core.monitor.peak_forecast import lowest_within
from core.monitor.peak_ridge import LearnedFlights, fit_windows
from core.monitor.predictor import PREDICTORS, Ensemble, PeakRidge, Predictor
from core.monitor.recipe import MISS_RATE, MonitorRecipe
from core.monitor.response_filter import fit_card
from core.monitor.score import SCORES, RestOfCard, Score
from core.monitor.training import SafeObservations, train
from core.planned_test.collection import (
    card_of,
    collect,
    combination_failures,
    evaluation_flights,
    replanned,
    stopping_flights,
    training_rollouts,
)
from core.planned_test.near import near_failures, near_rollouts
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest, SensorNoise, needs_limits
from core.seeds import Branch, monitor_seeds, stream
from core.simulation.aircraft import AIRCRAFT
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.simulator import Rollouts
from core.tasks import Tasks, stop_if_cancelled
from core.types import Array, Flags, Indices

METHODS: dict[str, tuple[Predictor, Score]] = {
    "linear + nearest neighbor": (PREDICTORS["linear"], SCORES["nearest_neighbor"]),
    "predicted magnitude": (PREDICTORS["linear"], SCORES["negative_magnitude"]),
    "peaks ahead: window": (PREDICTORS["peak_ridge"], SCORES["card_window"]),
    "peaks ahead: rest": (PREDICTORS["peak_ridge"], SCORES["rest_of_card"]),
    "test card: window": (PREDICTORS["response_filter"], SCORES["card_window"]),
    "test card: rest": (PREDICTORS["response_filter"], SCORES["rest_of_card"]),
    "neighbors + peaks": (Ensemble(scope="near"), SCORES["highest_risk"]),
}
"""Methods, as pairs of predictor and score."""
COMPARED: dict[str, tuple[Predictor, Score] | Baseline] = METHODS | BASELINES
"""Everything that can be compared, the methods first."""
CEILING = "ceiling"
"""Name of the information limit: see core.evaluation.ceiling."""
CEILING_FLIGHTS, CEILING_POOL, FLIGHTS_A_TASK = 1000, 5000, 25
"""Flights of the information limit, half of them failing; flights they are selected from; flights
that a thread processes at a time."""
FALSE_ALARMS = 0.1
"""Share of safe flights with an alert at which prevented failures are compared."""
NOISE = SensorNoise(beta=0.001, p=0.004, r=0.001, Ny=0.004, delta_a=0.003, delta_r=0.0003)


def _doublet(aircraft: str, control_law: str, amplitude_deg: float) -> DatasetRecipe:
    """A rudder doublet of 1 s halves, flown by hand; about a quarter of the aircraft fail."""
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
"""Planned tests for comparing methods, with noise and a pilot's scatter."""


@dataclass(frozen=True)
class SweepRecipe:
    """The tests, leads and methods to compare, with how many monitors and flights."""

    tests: tuple[str, ...] = tuple(TESTS)
    """planned tests: by name."""
    imperfections: Literal["none", "usual"] = "none"
    """imperfections of a real flight: `none`, or `usual` noise and pilot's scatter."""
    leads_s: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
    """warning lead times: of the monitors [s]."""
    methods: tuple[str, ...] = tuple(METHODS)
    """methods compared: by name."""
    epsilon: Annotated[float, MISS_RATE] = 0.05
    """promised miss rate epsilon."""
    guarantee: Guarantee = "average"
    """promise on the miss rate: on `average`, or for each monitor with `95%` confidence."""
    n_unsafe: Annotated[int, Bounds(least=2)] = 200
    """unsafe rollouts for calibrating each monitor."""
    n_monitors: Annotated[int, Bounds(least=1)] = 3
    """monitors of each method and warning lead time: each from its own dataset."""
    n_test: Annotated[int, Bounds(least=1)] = 1000
    """fresh test flights of each monitor."""
    reactions_s: tuple[float, ...] = REACTIONS_S
    """reaction times: mean from an alert to neutral controls [s]."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw."""
    ceiling: bool = False
    """information limit: power of a posterior of all derivatives, on 1,000 flights; takes a minute
    for each test."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.ceiling and self.imperfections != "none":
            raise ValueError(
                f"ceiling and imperfections={self.imperfections!r} were given: the information "
                "limit needs imperfections none, leave out either"
            )
        for kind, given, known in (
            ("method", self.methods, COMPARED),
            ("planned test", self.tests, TESTS),
        ):
            if unknown := [name for name in given if name not in known]:
                raise ValueError(f"{kind} {unknown[0]!r} was given: choose {', '.join(known)}")
        check_epsilon(self.epsilon, self.n_unsafe, self.guarantee)
        for name, times in (("leads_s", self.leads_s), ("reactions_s", self.reactions_s)):
            if not times or not all(np.isfinite(t) and t > 0 for t in times):
                raise ValueError(f"{name}={times} was given: give at least one time above 0 s")


@dataclass(frozen=True, eq=False)
class Cell(PooledCounts):
    """Counts of one method at one lead on one planned test, one row for each monitor.

    epsilon: promised.   lead: in effect [s].
    n_early: (n_monitors,) failures too early for any timely alert.
    prevented: (n_monitors, n_reactions) failures that an alert prevents.
    power_at_epsilon: (n_monitors,) share of safe flights without an alert, at the threshold that
    misses exactly epsilon of these failing flights.
    prevented_alike: as `prevented`, at the threshold that alerts on FALSE_ALARMS of these safe
    flights; for comparing methods.
    """

    epsilon: float
    lead: float
    n_early: Indices
    prevented: Indices
    power_at_epsilon: Array
    prevented_alike: Indices

    @classmethod
    def pool(cls, cells: list["Cell"]) -> "Cell":
        """Pool cells of one method and lead with different monitors."""
        rows = {field.name for field in fields(cls)} - {"epsilon", "lead"}
        columns = {name: np.concatenate([getattr(cell, name) for cell in cells]) for name in rows}
        return replace(cells[0], **columns)

    @property
    def prevented_share(self) -> Array:
        """(n_reactions,) share of all failing flights that an alert prevents."""
        return self.prevented.sum(axis=0) / max(self.n_unsafe.sum(), 1)

    @property
    def prevented_alike_share(self) -> Array:
        """(n_reactions,) the same at equal false alarms."""
        return self.prevented_alike.sum(axis=0) / max(self.n_unsafe.sum(), 1)


@dataclass(frozen=True)
class PlannedTestSweep:
    """The results on one planned test.

    earliest_s: time from the first input by which 5 % of the failing flights have failed [s]; a
    longer lead starts before the manoeuvre.   unsafe_share: share of fresh flights that fail.
    cells: by method and requested lead [s]; the information limit, if requested, under CEILING.
    """

    earliest_s: float
    unsafe_share: float
    cells: Mapping[tuple[str, float], Cell]


_PartResult = tuple[float, float, dict[tuple[str, float], Cell]]
"""earliest_s, unsafe_share and cells of PlannedTestSweep, for one dataset."""


def sweep(
    recipe: SweepRecipe | None = None,
    tests: Mapping[str, ManeuverTest] | None = None,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> dict[str, PlannedTestSweep]:
    """Train and test every method at every lead on every planned test.

    tests: by name; default: those of the recipe. Methods that need a test card are left out if the
    manoeuvre has none.
    executor: see Tasks.   progress: called with (monitors done, total); an exception cancels.
    """
    recipe = recipe or SweepRecipe()
    tests = planned_tests(recipe.tests, recipe.imperfections) if tests is None else tests
    check_leads(recipe, tests)
    seeds = monitor_seeds(recipe.seed, recipe.n_monitors)
    sized = {name: replace(test, n_unsafe=recipe.n_unsafe) for name, test in tests.items()}
    seeded = [replace(test, seed=seeds[0][0]) for test in sized.values()]
    ceilings = [_CeilingTest(test, recipe) for test in seeded if recipe.ceiling]
    each = len(recipe.methods) * len(recipe.leads_s)
    with Tasks(executor) as tasks:
        parts = {
            name: [tasks.submit(_part, replace(test, seed=seed), recipe) for seed, _ in seeds]
            for name, test in sized.items()
        }
        chunks = [
            [tasks.submit(test.ceiling.scores, *batch) for batch in test.batches()]
            for test in ceilings
        ]
        weights: dict[Future[Any], int] = dict.fromkeys(chain(*chunks), 1)
        weights |= dict.fromkeys(chain(*parts.values()), each)
        done = 0
        for task in as_completed(weights):
            task.result()
            done += weights[task]
            if progress:
                progress(done, sum(weights.values()))
    results = {name: _pooled([part.result() for part in group]) for name, group in parts.items()}
    for name, ceiling, group in zip(results, ceilings, chunks, strict=False):
        cells = {**results[name].cells, **ceiling.cells([chunk.result() for chunk in group])}
        by_lead = sorted(cells.items(), key=lambda item: recipe.leads_s.index(item[0][1]))
        results[name] = replace(results[name], cells=dict(by_lead))
    return results


def planned_tests(names: Sequence[str], imperfections: str) -> dict[str, DatasetRecipe]:
    """The planned tests of these names. imperfections: none or usual."""
    tests = {name: TESTS[name] for name in names}
    if imperfections == "none":
        return tests
    return {name: test.as_flown() for name, test in tests.items()}


def check_leads(recipe: SweepRecipe, tests: Mapping[str, ManeuverTest]) -> None:
    """ValueError for a lead that is as long as a manoeuvre."""
    longest = max(recipe.leads_s)
    for name, test in tests.items():
        needs_limits(test, "a sweep")
        if longest >= test.maneuver.duration_s:
            raise ValueError(
                f"leads_s={recipe.leads_s} was given: the manoeuvre of {name} lasts "
                f"{test.maneuver.duration_s:g} s, choose shorter warning lead times"
            )


def _part(test: ManeuverTest, recipe: SweepRecipe) -> _PartResult:
    return _Part(test, recipe).result()


@dataclass(frozen=True, eq=False)
class _Scores:
    """One monitor's scores of the test flights.

    h: lead [samples].   lowest: (n,) lowest timely score.   alerts: (n,) whether it alerts in time.
    level: highest score that alerts.   first: function from a level to (n,) first alerts on
    failing flights, timely or not; n_samples for none.
    """

    h: int
    lowest: Array
    alerts: Flags
    level: float
    first: Callable[[float], Indices]


class _Part:
    """One dataset, and its monitors of every method and lead on the same fresh flights.

    Shared work is done once: a forecast's scores do not depend on the lead, which only decides
    until when an alert is timely.
    """

    def __init__(self, test: ManeuverTest, recipe: SweepRecipe) -> None:
        self._test, self._recipe = test, recipe
        self._dataset = collect(test)
        self._flights = evaluation_flights(test, recipe.n_test)
        self._above = alert_above(recipe.epsilon, recipe.n_unsafe, recipe.guarantee)
        self._monitors = [name for name in recipe.methods if name in METHODS]

    def result(self) -> _PartResult:
        """Train and test the monitors."""
        flights, recipe, test = self._flights, self._recipe, self._test
        stopped = stopping_flights(test, recipe.n_test)
        counted: dict[tuple[str, float], Cell] = {}
        of_all = self._by_monitors(), self._by_forecasts(), self._by_baselines()
        for key, scores in chain.from_iterable(of_all):
            stop_if_cancelled()
            counted[key] = _counted(scores, flights, test, recipe, stopped)
        ordered = ((name, lead) for lead in recipe.leads_s for name in recipe.methods)
        cells = {key: counted[key] for key in ordered if key in counted}
        return _earliest(flights, test), float(flights.is_unsafe.mean()), cells

    def _by_monitors(self) -> Iterator[tuple[tuple[str, float], _Scores]]:
        """Methods that use neighbours of the latest samples."""
        recipe, failures, linear = self._recipe, None, replanned(self._test)
        names = [
            name
            for name in self._monitors
            if METHODS[name][0].forecast in ("", "ensemble")
            and (linear or METHODS[name][1].channel < 0)  # a lateral channel
        ]
        rollouts, near = None, list[Rollouts]()
        if any(METHODS[name][0].forecast for name in names):
            failures, _ = combination_failures(self._test, recipe.n_unsafe, branch=Branch.ENSEMBLE)
            if linear is None:
                rollouts = training_rollouts(self._test)
            else:
                rollouts, near = near_rollouts(linear), near_failures(linear, recipe.n_unsafe)
        for lead in recipe.leads_s if names else ():
            settings = MonitorRecipe(
                t_early=lead, epsilon=recipe.epsilon, guarantee=recipe.guarantee
            )
            safe = SafeObservations(self._dataset, settings)
            for name in names:
                predictor, score = METHODS[name]
                monitor_recipe = replace(settings, predictor=predictor, score=score)
                monitor = train(
                    self._dataset,
                    monitor_recipe if linear else monitor_recipe.as_planned(),
                    rollouts=rollouts,
                    failures=failures,
                    near=near,
                    safe=safe,
                )
                yield (name, lead), self._monitor_scores(monitor)

    def _monitor_scores(self, monitor: Monitor) -> _Scores:
        last = _last_timely(self._flights, monitor.h)
        lowest = monitor.lowest_scores(self._flights.y, last)
        level = _highest_alerting(monitor.alphas, self._above)
        first = partial(_first_alerts, monitor, self._flights)
        return _Scores(monitor.h, lowest, (last >= 0) & (lowest <= level), level, first)

    def _by_forecasts(self) -> Iterator[tuple[tuple[str, float], _Scores]]:
        """Methods that forecast the rest of the manoeuvre."""
        methods = [(name, *METHODS[name]) for name in self._monitors]
        for predictor in dict.fromkeys(predictor for _, predictor, _ in methods):
            windows = {
                (name, lead): (score.window(h), h)
                for name, used, score in methods
                if used == predictor
                for lead in self._recipe.leads_s
                for h in (lead_steps(lead, self._test.dt),)
            }
            scores = self._scores(predictor, sorted({window for window, _ in windows.values()}))
            for key, (window, h) in windows.items():
                if scores:
                    yield key, self._forecast_scores(*scores[window], h)

    def _scores(self, predictor: Predictor, windows: list[int]) -> dict[int, tuple[Array, Array]]:
        """Scores of the dataset's failures and of the flights, by window; empty without a card.

        Each (n, n_samples), for all samples up to the failure.
        """
        dataset, flights = self._dataset, self._flights
        both = (
            (dataset.unsafe, dataset.fail_index),
            (flights.y, np.minimum(flights.fail_index, flights.y.shape[1] - 1)),
        )
        if predictor.forecast == "card":
            try:
                card = card_of(self._test)
            except CardError:
                return {}
            forecast = fit_card(card, dataset.safe, dataset.specification, RestOfCard(), 0)
            failures, tests = (forecast.scores_within(np.array(windows), *flown) for flown in both)
            return dict(zip(windows, zip(failures, tests, strict=True), strict=True))
        if predictor.forecast == "peaks" and isinstance(predictor, PeakRidge):
            learned = LearnedFlights.of(dataset.safe, None, judged=True)
            limits = envelope_of(dataset.specification)
            forecasts = fit_windows(predictor, learned, limits, windows, dataset.dt)
            return {
                window: (forecast.scores(*both[0]), forecast.scores(*both[1]))
                for window, forecast in zip(windows, forecasts, strict=True)
            }
        return {}

    def _by_baselines(self) -> Iterator[tuple[tuple[str, float], _Scores]]:
        usable = baselines_for(self._dataset.dictionary)
        for name in self._recipe.methods:
            if name in usable:
                scores = usable[name].fit(self._dataset)
                both = scores(self._dataset.unsafe), scores(self._flights.y)
                for lead in self._recipe.leads_s:
                    h = lead_steps(lead, self._test.dt)
                    yield (name, lead), self._forecast_scores(*both, h)

    def _forecast_scores(self, failures: Array, tests: Array, h: int) -> _Scores:
        """failures, tests: scores of all their samples."""
        alphas = np.sort(lowest_within(failures, self._dataset.fail_index - h))
        return _at_level(tests, self._flights, h, _highest_alerting(alphas, self._above))


class _CeilingTest:
    """The information limit on one planned test's flights, in batches."""

    def __init__(self, test: ManeuverTest, recipe: SweepRecipe) -> None:
        self._test, self._recipe, self.ceiling = test, recipe, Ceiling(test)
        pool = evaluation_flights(test, CEILING_POOL)
        half = CEILING_FLIGHTS // 2
        kinds = np.flatnonzero(pool.is_unsafe)[:half], np.flatnonzero(~pool.is_unsafe)[:half]
        self._which = which = np.sort(np.concatenate(kinds))
        self._flights = Rollouts(pool.y[which], pool.fail_index[which], pool.theta[which])
        rng = stream(test.seed, Branch.TEST)
        self._commands = test.simulator().commands(CEILING_POOL, rng)[self._which]
        steps = [lead_steps(lead, test.dt) for lead in recipe.leads_s]
        scores = SCORES["card_window"], SCORES["rest_of_card"]
        self._looks = [
            (lead, h, score)
            for lead, h in zip(recipe.leads_s, steps, strict=True)
            for score in scores
        ]
        self._windows = np.array([score.window(h) for _, h, score in self._looks])
        fails = self._flights.fail_index
        latest = fails.max(where=self._flights.is_unsafe, initial=0)
        self._last = np.minimum(fails, latest)  # no failure is later

    def batches(self) -> Iterator[tuple[Array, Array, Indices, Indices]]:
        """Arguments of Ceiling.scores for a few flights each."""
        for first in range(0, len(self._which), FLIGHTS_A_TASK):
            batch = slice(first, first + FLIGHTS_A_TASK)
            flown = self._flights.y[batch], self._commands[batch], self._last[batch]
            yield *flown, self._windows

    def cells(self, scores: list[Array]) -> dict[tuple[str, float], Cell]:
        """Cells at the threshold that misses exactly epsilon of these failing flights.

        The better one, for safe flights, of the window and the rest of the card.
        """
        flights, test, recipe = self._flights, self._test, self._recipe
        stopped = stopping_flights(test, CEILING_POOL)
        counted: dict[tuple[str, float], Cell] = {}
        for (lead, h, _), look in zip(self._looks, np.concatenate(scores, axis=1), strict=True):
            lowest = lowest_within(look, _last_timely(flights, h))
            level = _level_at(recipe.epsilon, lowest[flights.is_unsafe])
            cell = _counted(
                _at_level(look, flights, h, level),
                flights,
                test,
                recipe,
                lambda which, neutral_from: stopped(self._which[which], neutral_from),
            )
            if (CEILING, lead) not in counted or cell.power > counted[CEILING, lead].power:
                counted[CEILING, lead] = cell
        return counted


def _at_level(scores: Array, flights: Rollouts, h: int, level: float) -> _Scores:
    """scores: (n, n_samples) of the flights up to their failure.   level: highest that alerts."""
    last = _last_timely(flights, h)
    lowest = lowest_within(scores, last)
    first = partial(_first_at_or_below, scores, flights)
    return _Scores(h, lowest, (last >= 0) & (lowest <= level), level, first)


def _first_at_or_below(scores: Array, flights: Rollouts, level: float) -> Indices:
    """First score (n, n_samples) at or below a level, in each failing flight up to its failure."""
    until = np.arange(scores.shape[1]) <= flights.fail_index[:, np.newaxis]
    alerts = until & (scores <= level) & flights.is_unsafe[:, np.newaxis]
    return np.where(alerts.any(axis=1), alerts.argmax(axis=1), scores.shape[1])


def _first_alerts(monitor: Monitor, flights: Rollouts, level: float) -> Indices:
    """Like _first_at_or_below, but computes only some of a monitor's scores."""
    first = np.full(len(flights.y), flights.y.shape[1])
    unsafe = np.flatnonzero(flights.is_unsafe)
    first[unsafe] = first_sample(
        lambda y, k: monitor.lowest_scores(y, k) <= level,
        flights.y[unsafe],
        flights.fail_index[unsafe],
    )
    return first


def _last_timely(flights: Rollouts, h: int) -> Indices:
    """(n,) last sample at which an alert counts: timely before a failure, else the last one."""
    return np.where(flights.is_unsafe, flights.fail_index - h, flights.y.shape[1] - 1)


def _highest_alerting(alphas: Array, above: float) -> float:
    """Highest score with a p-value above this, +inf if every score has one."""
    if p_values(np.inf, alphas) > above:
        return np.inf
    return float(alphas[p_values(alphas, alphas) > above].max(initial=-np.inf))


def _earliest(flights: Rollouts, test: ManeuverTest) -> float:
    fails = flights.fail_index[flights.is_unsafe]
    earliest = float(np.quantile(fails, 0.05) * test.dt) if len(fails) else np.nan
    return earliest - test.maneuver.lead_in_s


def _counted(
    scores: _Scores,
    flights: Rollouts,
    test: ManeuverTest,
    recipe: SweepRecipe,
    stopped: Stopped,
) -> Cell:
    """Count misses, false alerts and prevented failures."""
    fails, is_unsafe, n_samples = flights.fail_index, flights.is_unsafe, flights.y.shape[1]
    equal_level = _level_of_false_alarms(scores.lowest[~is_unsafe])
    prevented, prevented_alike = (
        prevention(
            scores.first(level),
            fails,
            n_samples,
            test.dt,
            stopped,
            stream(test.seed, Branch.REACTION),
            recipe.reactions_s,
        ).prevented
        for level in (scores.level, equal_level)
    )
    return Cell(
        epsilon=recipe.epsilon,
        lead=scores.h * test.dt,
        misses=np.array([np.count_nonzero(~scores.alerts[is_unsafe])]),
        n_unsafe=np.array([np.count_nonzero(is_unsafe)]),
        n_early=np.array([np.count_nonzero(fails[is_unsafe] < scores.h)]),
        false_alerts=np.array([np.count_nonzero(scores.alerts[~is_unsafe])]),
        n_safe=np.array([np.count_nonzero(~is_unsafe)]),
        prevented=prevented[np.newaxis],
        power_at_epsilon=np.array([_power_at(recipe.epsilon, scores.lowest, is_unsafe)]),
        prevented_alike=prevented_alike[np.newaxis],
    )


def _level_of_false_alarms(safe: Array) -> float:
    """Highest level at which at most FALSE_ALARMS of safe flights alert. safe: lowest scores."""
    if not len(safe):
        return -np.inf
    return float(np.nextafter(np.sort(safe)[int(FALSE_ALARMS * len(safe) + 1e-9)], -np.inf))


def _power_at(epsilon: float, lowest: Array, is_unsafe: Flags) -> float:
    """Power of the threshold that misses exactly epsilon of these failing flights."""
    failing, safe = lowest[is_unsafe], lowest[~is_unsafe]
    if not (len(failing) and len(safe)):
        return np.nan
    return float(np.mean(safe > _level_at(epsilon, failing)))


def _level_at(epsilon: float, failing: Array) -> float:
    """Threshold at or below which to alert, from the lowest scores (n,) of failing flights."""
    if not len(failing):
        return -np.inf
    return float(np.sort(failing)[len(failing) - 1 - int(epsilon * len(failing) + 1e-9)])


def _pooled(parts: list[_PartResult]) -> PlannedTestSweep:
    """Pool the parts of one planned test."""
    earliest, unsafe_share, counted = zip(*parts, strict=True)
    cells = {key: Cell.pool([part[key] for part in counted]) for key in counted[0]}
    return PlannedTestSweep(float(np.nanmean(earliest)), float(np.mean(unsafe_share)), cells)
