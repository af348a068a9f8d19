"""Train a monitor from a dataset and test it on fresh flights."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from math import ceil
from time import monotonic
from typing import Any

import numpy as np

from app.recipes.recipes import simulated_test, test_of
from core.counted import pace
from core.dataset import FLOWN, Dataset
from core.evaluation.certificate import USES
from core.evaluation.method_choice import best_of, most_missed, plain_threshold, try_methods
from core.evaluation.prevention import Prevention, prevention
from core.evaluation.rates import (
    EPSILONS,
    Evaluation,
    clopper_pearson,
    evaluate,
    evaluate_groups,
    first_alerts,
    leads,
)
from core.evaluation.robustness import DIFFERENCES, by_aircraft, robustness
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.calibration import failures_needed, smallest_epsilon
from core.monitor.training import Flights, halves_of, with_validity
from core.monitor.validity.support import SupportError
from core.planned_test.collection import (
    MOST_FRESH,
    DatasetRecipe,
    Rollouts,
    SimulatedTest,
    card_of,
    collect,
    combination_failures,
    evaluation_flights,
    fresh,
    stopping_flights,
    training_rollouts,
)
from core.planned_test.near import near_failures, near_rollouts
from core.planned_test.own import OwnTest
from core.planned_test.planned_test import ManeuverTest
from core.rollouts import LabelledFlights
from core.seeds import Branch, stream
from core.simulation.simulator import Stops
from core.types import Array, Indices

Progress = Callable[[str, int, int], object]
"""Called with (message, done, total); an exception that it raises cancels the work."""

LEAD_BINS = 20
CHOICE_FLIGHTS = 1_000
"""Fresh flights on which methods are tried."""
LARGEST_ADVISED = 0.3
"""Largest epsilon that is named where there are too few failures for the requested one."""
SHARES = (0.5, 0.15, 0.15, 0.2)
PARTS = tuple(USES)
"""Shares of own flights, by use."""


def calibrating(n_unsafe: int) -> int:
    """How many failures of own flights calibrate, of all that the dataset has."""
    return int(n_unsafe * SHARES[0])


def too_few(n_unsafe: int, recipe: MonitorRecipe) -> list[str]:
    """Warning if own flights have too few failures for the recipe's epsilon; else empty."""
    needed, guarantee = failures_needed(recipe.epsilon, recipe.guarantee), recipe.guarantee
    if calibrating(n_unsafe) >= needed:
        return []
    sure = "" if guarantee == "average" else " with 95 % confidence"
    possible = ceil(1e4 * smallest_epsilon(max(calibrating(n_unsafe), 1), guarantee)) / 1e4
    accepted = f", or accept epsilon {possible:g}" if possible <= LARGEST_ADVISED else ""
    enough = ceil(needed / SHARES[0])
    return [
        f"{n_unsafe} failing flights are too few for epsilon {recipe.epsilon:g}{sure}, which needs "
        f"{enough}, as {SHARES[0]:.0%} of them calibrate: give {enough - n_unsafe} more{accepted}"
    ]


CURVES = (
    "misses",
    "false_alerts",
    "withdrawn",
    "safe_withdrawn",
    "miss_rate",
    "withdrawn_rate",
    "miss_interval",
    "power",
    "power_interval",
    "fail_given_alert",
    "fail_given_alert_interval",
)
"""Fields of an Evaluation that depend on epsilon."""
FAILING = "miss_rate", "withdrawn_rate"
"""Shares of failing flights."""


@dataclass(frozen=True, eq=False)
class FlownTest:
    """The results of a monitor on fresh flights.

    at_epsilon: counts at the monitor's own epsilon.   curves: counts over the grid of epsilons.
    leads: (n_unsafe,) time from the first alert to the failure [s], -inf without an alert.
    prevention: the failures that its alerts prevent; None if flights cannot be flown again.
    robustness: counts at its own epsilon on flights that differ from the planned test.
    groups: counts at its own epsilon on failing flights, by grouping and group name.
    """

    epsilon: float
    at_epsilon: Evaluation
    curves: Evaluation
    leads: Array
    prevention: Prevention | None = None
    robustness: dict[str, Evaluation] = field(default_factory=dict)
    groups: dict[str, dict[str, Evaluation]] = field(default_factory=dict)

    def as_plain(self, n_test: int, monitor: Monitor) -> dict[str, Any]:
        """JSON types; None where nothing could be counted."""
        return {
            "n_test": n_test,
            "epsilon": self.epsilon,
            "lead": monitor.lead,
            "n_unsafe": self.curves.n_unsafe,
            "n_safe": self.curves.n_safe,
            "n_early": self.curves.n_early,
            "at_epsilon": {key: values[0] for key, values in _curves(self.at_epsilon).items()},
            "curves": _curves(self.curves),
            "leads": _histogram(self.leads, monitor.lead, monitor.dt),
            **({"prevention": _prevention(self.prevention)} if self.prevention else {}),
            "robustness": {
                name: {"words": DIFFERENCES[name].words, "n_unsafe": counts.n_unsafe}
                | {"n_safe": counts.n_safe}
                | by_aircraft(counts)
                | {key: values[0] for key, values in _curves(counts).items()}
                for name, counts in self.robustness.items()
            },
            "groups": [
                {
                    "rule": rule,
                    "name": name,
                    "n_unsafe": counts.n_unsafe,
                    "misses": int(counts.misses[0]),
                    "withdrawn": int(counts.withdrawn[0]),
                    "miss_interval": counts.miss_interval[0].tolist(),
                }
                for rule, groups in self.groups.items()
                for name, counts in groups.items()
            ],
        }


@dataclass(frozen=True, eq=False)
class Training:
    """A trained monitor, its dataset and its test.

    test: results on fresh flights, or None.
    not_calibrated: why validity is not calibrated; empty if it is.
    """

    dataset: Dataset
    monitor: Monitor
    test: FlownTest | None = None
    not_calibrated: str = ""


def simulate(
    recipe: SimulatedTest, progress: Progress, executor: Executor | None = None
) -> Dataset:
    begin = monotonic()

    def report(n_unsafe: int, n_made: int) -> None:
        message, seconds = (
            f"simulating: {n_unsafe} unsafe of {n_made} rollouts",
            monotonic() - begin,
        )
        if n_unsafe and seconds:
            left = seconds * (recipe.n_unsafe - n_unsafe) / n_unsafe
            message += f", {pace(n_made / seconds, left)}"
        progress(message, n_unsafe, recipe.n_unsafe)

    return collect(recipe, executor=executor, progress=report)


def test_to_fly(monitor: Monitor) -> ManeuverTest:
    """The monitor's planned test, to fly again. ValueError if it is not known."""
    remedy = "choose a monitor of simulated flights"
    return test_of(monitor.dataset_recipe, "the test of this monitor", remedy)


def train_and_test(
    dataset: Dataset,
    recipe: MonitorRecipe,
    n_test: int,
    progress: Progress,
    executor: Executor | None = None,
    *,
    test: SimulatedTest | None = None,
    choose: bool = False,
) -> Training:
    """Train a monitor, calibrate its validity, and test it on n_test fresh flights.

    executor: flies them, see `collect`.
    test: that of the dataset; default: by its recipe. Without one the dataset is split, see
    `train_on_flights`.
    choose: choose the method by fresh flights; else, and for a linear aircraft with limits, it is
    that of the recipe.
    """
    test = test or simulated_test(dataset.recipe)
    if test is None:
        return train_on_flights(dataset, recipe, choose, progress)
    progress("training", 0, 3)
    methods, n_more = dict[str, Any](), 0
    if isinstance(test, DatasetRecipe) and not test.margins.label:
        monitor = _trained_on_linear(dataset, recipe, test, progress)
    else:
        monitor, methods, n_more = _trained(dataset, recipe, test, progress, executor, choose)
    monitor, not_calibrated = _with_validity(monitor, dataset, test, progress, executor)
    if n_test == 0:
        return Training(dataset, monitor, not_calibrated=not_calibrated)
    progress(f"certifying on {n_test} fresh flights", 2, 3)
    monitor, flown = with_test(monitor, test, n_test, dataset.unsafe_rate, executor)
    if isinstance(test, OwnTest):
        support = monitor.support
        n_valid = 0 if support is None else len(support.safe) + len(support.unsafe)
        n_learned = len(dataset.unsafe) + len(dataset.safe) + n_more
        counts = zip(PARTS, (n_learned, choose * CHOICE_FLIGHTS, n_valid, n_test), strict=True)
        own = {"simulator": test.flown_by.name, "flights": {part: n for part, n in counts if n}}
        methods = methods | own
    monitor = replace(monitor, evaluation=(monitor.evaluation or {}) | methods)
    progress("done", 3, 3)
    return Training(dataset, monitor, flown, not_calibrated)


def _trained_on_linear(
    dataset: Dataset, recipe: MonitorRecipe, test: DatasetRecipe, progress: Progress
) -> Monitor:
    card = card_of(test) if recipe.predictor.forecast == "card" else None
    failures = rollouts = None
    near: list[Rollouts] = []
    if recipe.predictor.forecast == "ensemble":
        failures = _fresh_failures(replace(test, groups=recipe.groups), progress)
    if recipe.is_near:
        rollouts, near = near_rollouts(test), _near_failures(test, progress)
    monitor = train(dataset, recipe, card=card, rollouts=rollouts, failures=failures, near=near)
    monitor.check_epsilon()
    return monitor


def _trained(
    dataset: Dataset,
    recipe: MonitorRecipe,
    test: SimulatedTest,
    progress: Progress,
    executor: Executor | None,
    choose: bool,
) -> tuple[Monitor, dict[str, Any], int]:
    """A monitor, the methods tried, and the number of training flights besides the dataset."""
    recipe = recipe.as_planned()
    learning = failures = None
    if choose or recipe.predictor.forecast:
        learning = training_rollouts(test, executor=executor)
    if choose or recipe.predictor.forecast == "ensemble":
        grouped = test if isinstance(test, OwnTest) else replace(test, groups=recipe.groups)
        failures = _fresh_failures(grouped, progress, executor)
    choosing = None
    if choose:
        progress(f"trying the methods on {CHOICE_FLIGHTS} fresh flights", 0, 3)
        tried = evaluation_flights(test, CHOICE_FLIGHTS, Branch.CHOICE, executor)
        choosing = replace(dataset.flights(), **tried._asdict())
    monitor, methods = _learned(dataset, recipe, choosing, learning, failures)
    return monitor, methods, sum(len(each.y) for each in (learning, failures) if each is not None)


def _learned(
    dataset: Dataset,
    recipe: MonitorRecipe,
    choosing: LabelledFlights | None,
    learning: Flights | None,
    failures: Flights | None = None,
) -> tuple[Monitor, dict[str, Any]]:
    """A monitor of the recipe's method, or of the best one on `choosing`, and those tried.

    learning, failures: see `try_methods`.
    """
    if choosing is None:
        monitor = train(dataset, recipe, rollouts=learning, failures=failures)
        monitor.check_epsilon()
        return monitor, {}
    methods = try_methods(dataset, choosing, recipe, learning, failures)
    if not methods:
        raise ValueError(
            f"no method can be trained on {len(dataset.unsafe)} failing and "
            f"{len(dataset.safe)} safe flights: give more, or raise epsilon"
        )
    tried = [counts for _, counts in methods.values()]
    chosen = best_of(tried, recipe.epsilon).name
    if (plain := plain_threshold(dataset, choosing, recipe)) is not None:
        tried.append(plain)
    rows = [
        asdict(counts)
        | {
            "chosen": counts.name == chosen,
            "miss_interval": clopper_pearson(counts.missed, counts.n_unsafe).tolist(),
            "most_missed": most_missed(recipe.epsilon, counts.n_unsafe),
        }
        for counts in tried
    ]
    return methods[chosen][0], {"methods": rows}


def _fresh_failures(
    recipe: SimulatedTest, progress: Progress, executor: Executor | None = None
) -> Rollouts:
    """Fresh failures, as many as the dataset has, to calibrate a rule of several parts."""

    def report(n_unsafe: int, n_made: int) -> None:
        progress(f"training: {n_unsafe} fresh failures of {n_made} flights", 0, 3)

    return combination_failures(recipe, recipe.n_unsafe, report, Branch.ENSEMBLE, executor)[0]


def _near_failures(recipe: DatasetRecipe, progress: Progress) -> list[Rollouts]:
    """Failing flights of each population near the planned one, as many as in the dataset."""

    def report(n_done: int, total: int) -> None:
        progress(f"training: {n_done} of {total} kinds of near aircraft and hands", 0, 3)

    return near_failures(recipe, recipe.n_unsafe, report)


def with_test(
    monitor: Monitor,
    recipe: SimulatedTest,
    n: int,
    unsafe_rate: float,
    executor: Executor | None = None,
) -> tuple[Monitor, FlownTest]:
    """The monitor with its test on n fresh flights. unsafe_rate: of its planned test."""
    test = fly_test(monitor, recipe, n, executor)
    return _with_evaluation(monitor, test, n, unsafe_rate), test


def _with_evaluation(monitor: Monitor, test: FlownTest, n: int, unsafe_rate: float) -> Monitor:
    evaluation = test.as_plain(n, monitor) | {
        "unsafe_rate": unsafe_rate,
        "seed": monitor.seed,
        "dataset_digest": monitor.dataset_digest,
        "version": monitor.version,
    }
    return replace(monitor, evaluation=evaluation)


def _with_validity(
    monitor: Monitor,
    dataset: Dataset,
    recipe: SimulatedTest,
    progress: Progress,
    executor: Executor | None = None,
) -> tuple[Monitor, str]:
    """The monitor with calibrated validity and "", or without and the reason."""
    most = max(MOST_FRESH, len(dataset.unsafe) + dataset.n_safe_met)
    flights = _counted(fresh(recipe, most, executor), progress)
    try:
        return with_validity(monitor, dataset, flights), ""
    except SupportError as error:
        return monitor, str(error)


def _counted(batches: Iterator[Rollouts], progress: Progress) -> Iterator[Rollouts]:
    """The same batches, with progress after each."""
    n_flown = 0
    progress(f"calibrating validity on fresh flights: {n_flown} so far", 1, 3)
    for flights in batches:
        yield flights
        n_flown += len(flights.y)
        progress(f"calibrating validity on fresh flights: {n_flown} so far", 1, 3)


def fly_test(
    monitor: Monitor, recipe: SimulatedTest, n: int, executor: Executor | None = None
) -> FlownTest:
    """Test a monitor on n fresh flights of a planned test and n of each difference from it.

    As far as the test's simulator can fly them, and stop them.
    """
    flights = evaluation_flights(recipe, n, executor=executor)
    test, alerts = _tested(monitor, flights.y, flights.fail_index)
    prevented = None
    of_aircraft = isinstance(recipe, ManeuverTest) and recipe.margins.label  # not of its flight
    if isinstance(recipe.simulator(), Stops) and not of_aircraft:
        prevented = prevention(
            alerts,
            flights.fail_index,
            flights.y.shape[1],
            monitor.dt,
            stopping_flights(recipe, n),
            stream(recipe.seed, Branch.REACTION),
        )
    return replace(test, prevention=prevented, robustness=robustness(monitor, recipe, n))


def _tested(monitor: Monitor, y: Array, fail_index: Indices) -> tuple[FlownTest, Indices]:
    """The counts on fresh flights, and the first alert of each."""
    epsilon = monitor.check_epsilon()
    grid = EPSILONS[monitor.smallest_epsilon - 1e-9 <= EPSILONS]
    both = evaluate(monitor, y, fail_index, np.append(grid, epsilon))
    alerts = first_alerts(monitor, y, fail_index)
    test = FlownTest(
        epsilon=epsilon,
        at_epsilon=_part(both, slice(-1, None)),
        curves=_part(both, slice(0, -1)),
        leads=leads(alerts, fail_index, y.shape[1], monitor.dt),
        groups=evaluate_groups(monitor, y, fail_index),
    )
    return test, alerts


def train_on_flights(
    whole: Dataset, recipe: MonitorRecipe, choose: bool, progress: Progress, seed: int = 0
) -> Training:
    """Train a monitor on flights that cannot be simulated here, split by flight into SHARES.

    choose: choose the method by the second part; else that of the recipe is used.
    ValueError also for a lead shorter than half a sample interval.
    """
    recipe = recipe.as_planned()
    if recipe.t_early < 0.5 * whole.dt:
        raise ValueError(
            f"t_early={recipe.t_early:g} s was given: the flights have one sample every "
            f"{whole.dt:g} s: give their times or dt in seconds, or a warning lead time of at "
            f"least {0.5 * whole.dt:g} s"
        )
    flights = whole.flights()
    learning, choosing, checking, testing = flights.split(SHARES, seed)
    dataset = Dataset.from_flights(learning, seed=seed)
    recipe_of = whole.recipe
    if flights.flown:
        recipe_of = recipe_of | {FLOWN: dataset.recipe.get(FLOWN, [])}
        dataset = dataset.without_theta()  # flown flights have none
    dataset = replace(dataset, recipe=recipe_of)
    progress("training", 0, 3)
    more = checking.y, checking.fail_index
    if choose:
        progress(f"trying the methods on {len(choosing.y)} held-out flights", 0, 3)
    monitor, methods = _learned(dataset, recipe, choosing if choose else None, more)
    progress(f"calibrating validity on {len(checking.y)} held-out flights", 1, 3)
    not_calibrated = ""
    try:
        monitor = with_validity(monitor, dataset, [(checking.y, checking.fail_index)])
    except SupportError as error:
        not_calibrated = str(error)
    progress(f"certifying on {len(testing.y)} held-out flights", 2, 3)
    test, _ = _tested(monitor, testing.y, testing.fail_index)
    if origins := _by_origin(monitor, testing):
        test = replace(test, groups=test.groups | {"origin": origins})
    monitor = replace(monitor, dataset_digest=whole.digest())
    monitor = _with_evaluation(monitor, test, len(testing.y), float(flights.fails.mean()))
    parts = dict(zip(PARTS, (learning, choosing, checking, testing), strict=True))
    own: dict[str, Any] = {"flights": {name: len(part.y) for name, part in parts.items()}}
    if flights.flown:
        own |= {"flown": _used(parts), "calibrated_on": _calibrated_on(dataset, monitor)}
    monitor = replace(monitor, evaluation=(monitor.evaluation or {}) | own | methods)
    progress("done", 3, 3)
    return Training(dataset, monitor, test, not_calibrated)


def _by_origin(monitor: Monitor, flights: LabelledFlights) -> dict[str, Evaluation]:
    """Counts on failing simulated and flown flights; none unless there are both."""
    kinds = {"simulated": flights.fails & ~flights.is_flown}
    kinds["flown"] = flights.fails & flights.is_flown
    if not all(those.any() for those in kinds.values()):
        return {}
    at = np.array([monitor.check_epsilon()])
    return {
        name: evaluate(monitor, flights.y[those], flights.fail_index[those], at)
        for name, those in kinds.items()
    }


def _used(parts: dict[str, LabelledFlights]) -> list[dict[str, Any]]:
    """The flown flights with the use of each and its numbers of manoeuvres."""
    used: dict[str, dict[str, Any]] = {}
    for part, flights in parts.items():
        for each, fails in zip(flights.flown, flights.fails.tolist(), strict=True):
            if each is None:
                continue
            counts = {"part": part, "manoeuvres": 0, "failures": 0}
            flight = {"flight": each.flight, "recording": each.recording, "digest": each.digest}
            flight |= {"sizes": list(each.sizes)}
            row = used.setdefault(each.digest, flight | counts)
            row["manoeuvres"] += 1
            row["failures"] += fails
    return list(used.values())


def _calibrated_on(dataset: Dataset, monitor: Monitor) -> dict[str, int]:
    """Failures that calibrate, by origin, and the number of flights of the flown ones."""
    numbers = np.arange(len(dataset.unsafe))
    if monitor.recipe.predictor.forecast == "ensemble":
        numbers = halves_of(dataset)[1]
    flights = dataset.flights()
    of, setting = flights.flown, flights.settings()
    flown = [setting[k] for k in numbers.tolist() if of and of[k]]
    return {"simulated": len(numbers) - len(flown), "flown": len(flown), "flights": len(set(flown))}


def _prevention(result: Prevention) -> dict[str, Any]:
    return {
        "reactions_s": result.reactions_s.tolist(),
        "n_unsafe": result.n_unsafe,
        "n_safe": result.n_safe,
        "stopped": result.stopped,
        "prevented": result.prevented.tolist(),
        "prevented_interval": clopper_pearson(result.prevented, result.n_unsafe).tolist(),
        "caused": result.caused.tolist(),
    }


def _part(whole: Evaluation, at: slice) -> Evaluation:
    arrays = {key: value[at] for key, value in vars(whole).items() if isinstance(value, np.ndarray)}
    return replace(whole, **arrays)


def _curves(counts: Evaluation) -> dict[str, list[Any]]:
    """Counts and shares by name over epsilon; None where nothing could be counted."""
    n_met = {"power": counts.n_safe} | dict.fromkeys(FAILING, counts.n_unsafe)
    curves = {"epsilon": counts.epsilons.tolist()}
    for name in CURVES:
        values = getattr(counts, name)
        shown = values.astype(object)
        shown[np.isnan(values) | (n_met.get(name) == 0)] = None
        curves[name] = shown.tolist()
    return curves


def _histogram(lead: Array, required: float, dt: float) -> dict[str, Any]:
    warned = lead[np.isfinite(lead)]
    quantiles = np.quantile(warned, [0.05, 0.5, 0.95]).tolist() if len(warned) else [None] * 3
    # Bins of whole samples, with an edge just below the required lead: none mixes late and timely.
    samples, h = np.rint(warned / dt).astype(int), round(required / dt)
    width = max(1, -(-int(samples.max(initial=h)) // LEAD_BINS))
    edges = np.arange(
        h % width - width * (h % width > 0), samples.max(initial=h) + width + 1, width
    )
    counts, edges = np.histogram(samples, edges - 0.5)
    return {
        "edges": (edges * dt).tolist(),
        "counts": counts.tolist(),
        "n_without": int(len(lead) - len(warned)),
        "n_timely": int((lead >= required - 1e-9).sum()),
        "p05": quantiles[0],
        "median": quantiles[1],
        "p95": quantiles[2],
    }
