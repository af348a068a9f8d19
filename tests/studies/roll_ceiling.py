"""Ceiling of the roll tests: what a warner reaches that learns from a hundred times more flights.

Beside the monitors' methods there are two warners without a promise: `peaks` is the peak to come by
the monitor's own regression on all learning flights, and `boosted` is the chance of a failure to
come, by boosted trees on that peak and the outputs of the last second. `boosted, exact` sees true
outputs, without noise and other instrument errors. All are judged at the threshold that misses
exactly epsilon of the failing flights that chose nothing.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier

from core.bounds import Bounds, check_bounds
from core.computed import complete
from core.evaluation.lead_sweep import SweepRecipe, sweep
from core.limits.limits import Limits, envelope_of
from core.monitor.observation import lead_steps
from core.monitor.peak_forecast import lowest_within
from core.monitor.peak_ridge import Begin, LearnedFlights, RidgeForecast, fit_windows
from core.monitor.predictor import PREDICTORS, PeakRidge
from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest
from core.seeds import Branch, stream
from core.simulation.maneuver import MANEUVERS
from core.simulation.simulator import Rollouts
from core.types import Array, Flags, Indices
from tests.studies.study_command import Progress, run_study

METHODS = "peaks ahead: rest", "peaks ahead: window", "neighbors + peaks"
AGO = 1, 2, 4, 8, 14, 20
"""Earlier samples that the trees see."""
ROWS, TREES = 300_000, 200
"""Samples of flights that teach the trees, and their number."""
N_RESAMPLED = 200


def _rolls(limit: float, maneuver: str) -> ManeuverTest:
    """A linear F-16 whose roll rate a quarter of the flights exceeds."""
    planned = replace(DatasetRecipe(), maneuver=MANEUVERS[maneuver], specification=Limits(p=limit))
    return planned.as_trained()


TESTS: dict[str, ManeuverTest] = {
    "aileron doublet, p": _rolls(0.52, "aileron_doublet"),
    "bank to bank, p": _rolls(0.56, "bank_to_bank"),
    "bank to bank, bending": NonlinearTest(maneuver=MANEUVERS["bank_to_bank"])
    .with_usual()
    .as_trained(),
}


@dataclass(frozen=True)
class RollCeilingRecipe:
    """The tests, and how many flights teach and judge."""

    tests: tuple[str, ...] = tuple(TESTS)
    """tests, by name"""
    epsilon: float = 0.1
    """share of failing flights missed"""
    lead_s: float = 0.25
    """warning lead time [s]"""
    n_flights: Annotated[int, Bounds(least=200)] = 40_000
    """flights, half of which teach and half judge"""
    n_monitors: Annotated[int, Bounds(least=1)] = 3
    """monitors of each method, of 300 failures each"""
    seed: Annotated[int, Bounds(least=0)] = 11
    """seed of every random draw"""

    def __post_init__(self) -> None:
        check_bounds(self)
        if unknown := [name for name in self.tests if name not in TESTS]:
            raise ValueError(f"test {unknown[0]!r} was given: choose {', '.join(TESTS)}")


class Reached(NamedTuple):
    """Share of the safe flights without an alert, where epsilon of the failing ones are missed.

    error: its standard error, over flights; of methods, over monitors and flights.
    """

    test: str
    warner: str
    n_unsafe: int
    n_safe: int
    power: float
    error: float


def roll_ceiling(recipe: RollCeilingRecipe, progress: Progress | None = None) -> Iterator[Reached]:
    tests = {name: TESTS[name] for name in recipe.tests}
    methods = sweep(
        SweepRecipe(
            leads_s=(recipe.lead_s,),
            methods=METHODS,
            epsilon=recipe.epsilon,
            n_unsafe=300,
            n_monitors=recipe.n_monitors,
            seed=recipe.seed,
        ),
        tests,
    )
    for number, (name, test) in enumerate(tests.items()):
        if progress:
            progress(number, len(tests))
        for (method, _), cell in methods[name].cells.items():
            each, n = cell.power_at_epsilon, len(cell.power_at_epsilon)
            error = float(each.std(ddof=1) / n**0.5) if n > 1 else float("nan")
            counted = int(cell.n_unsafe.sum()), int(cell.n_safe.sum())
            yield Reached(name, method, *counted, float(each.mean()), error)
        for warner, scores, flights in warned(test, recipe):
            yield reached(name, warner, scores, flights, test, recipe)


def warned(test: ManeuverTest, recipe: RollCeilingRecipe) -> Iterator[tuple[str, Array, Rollouts]]:
    """Scores (n, n_samples) of the judging flights, low for danger, by each warner."""
    flights, true = flown(test, recipe)
    teach = np.arange(len(flights.y)) < len(flights.y) // 2
    judged = flights.some(~teach)
    for kind, y in (("", flights.y), (", exact", true)):
        seen = flights._replace(y=y)
        peaks = _peaks(test, seen.some(teach))
        score = peaks.scores(np.nan_to_num(y), np.minimum(flights.fail_index, y.shape[1] - 1))
        if not kind:
            yield "peaks", score[~teach], judged
        yield f"boosted{kind}", _boosted(seen, score, peaks, teach), judged


def flown(test: ManeuverTest, recipe: RollCeilingRecipe) -> tuple[Rollouts, Array]:
    """Flights as recorded, and their true outputs."""
    simulator, parts, true = test.simulator(), list[Rollouts](), dict[int, Array]()
    for first in range(0, recipe.n_flights, 2048):
        n = min(2048, recipe.n_flights - first)

        def look(block: slice, y: Array, trim: Array) -> None:
            true[first + block.start] = complete(simulator.dictionary, y.copy(), test.dt)  # noqa: B023

        parts.append(simulator.recorded(n, stream(recipe.seed, Branch.TEST, first), look))
    flights = Rollouts(*map(np.concatenate, zip(*parts, strict=True)))
    return flights, np.concatenate([true[first] for first in sorted(true)])


def _peaks(test: ManeuverTest, learned: Rollouts) -> RidgeForecast:
    """The monitor's regression of the peak to come, on all safe flights."""
    safe, predictor = learned.some(~learned.is_unsafe), PREDICTORS["peak_ridge"]
    assert isinstance(predictor, PeakRidge)
    dictionary = test.simulator().dictionary
    flights = LearnedFlights(safe.y, safe.fail_index, dictionary)
    (forecast,) = fit_windows(predictor, flights, envelope_of(test.judged_by), [0], test.dt)
    return forecast


def _boosted(flights: Rollouts, score: Array, peaks: RidgeForecast, teach: Flags) -> Array:
    """(n_judged, n_samples) minus the log odds of a failure to come, +inf without a score."""
    begin = Begin(*(getattr(peaks.peaks, name) for name in Begin._fields))
    start, sign = begin.of(flights.y)
    which, now = np.nonzero(np.isfinite(score))
    learn = np.flatnonzero(teach[which])
    learn = np.random.default_rng(0).permutation(learn)[:ROWS]

    def features(rows: Indices) -> Array:
        i, k = which[rows], now[rows]
        before = [np.maximum(k - ago, 0) for ago in (0, *AGO)]
        outputs = [flights.y[i, then] * sign[i, np.newaxis] for then in before]
        scores = [np.where(np.isfinite(s), s, np.nan) for s in (score[i, t] for t in before)]
        columns = np.column_stack([k - start[i], k, *scores, *outputs])
        return np.asarray(columns, np.float64)

    trees = HistGradientBoostingClassifier(
        max_iter=TREES, learning_rate=0.08, min_samples_leaf=100, l2_regularization=5.0
    )
    trees.fit(features(learn), flights.is_unsafe[which[learn]])
    danger = np.full(score.shape, np.inf)
    for rows in np.array_split(np.flatnonzero(~teach[which]), 20):
        danger[which[rows], now[rows]] = [-odds for odds in trees.decision_function(features(rows))]
    return danger[~teach]


def reached(
    name: str,
    warner: str,
    scores: Array,
    flights: Rollouts,
    test: ManeuverTest,
    recipe: RollCeilingRecipe,
) -> Reached:
    """The power at the threshold that misses exactly epsilon; its error by resampled flights."""
    last = np.full(len(scores), scores.shape[1] - 1)
    timely = flights.fail_index - lead_steps(recipe.lead_s, test.dt)
    lowest = lowest_within(scores, np.where(flights.is_unsafe, timely, last))
    unsafe, safe = lowest[flights.is_unsafe], lowest[~flights.is_unsafe]
    rng = stream(recipe.seed, Branch.TEST)
    again = [
        power(rng.choice(unsafe, len(unsafe)), rng.choice(safe, len(safe)), recipe.epsilon)
        for _ in range(N_RESAMPLED)
    ]
    exactly = power(unsafe, safe, recipe.epsilon)
    return Reached(name, warner, len(unsafe), len(safe), exactly, float(np.std(again)))


def power(unsafe: Array, safe: Array, epsilon: float) -> float:
    """Share of safe flights above the score that misses at most epsilon of the unsafe ones."""
    missed = int(epsilon * len(unsafe) + 1e-9)
    return float((safe > np.sort(unsafe)[len(unsafe) - missed - 1]).mean())


def in_words(rows: Sequence[Reached], recipe: RollCeilingRecipe) -> str:
    """One line for each warner."""
    return "\n".join(
        f"{row.test:22} {row.warner:18} {row.power:.3f} +- {row.error:.3f} "
        f"({row.n_unsafe} failing, {row.n_safe} safe)"
        for row in rows
    )


if __name__ == "__main__":
    run_study(RollCeilingRecipe, roll_ceiling, in_words, Reached._asdict)
