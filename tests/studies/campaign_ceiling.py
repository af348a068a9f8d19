"""Ceiling of the campaign study: what someone achieves who knows every derivative of the aircraft.

The flights, the crew's reaction and the counting are those of the campaign study. Two rules refuse
a point and abort a flight by the chance of an exceedance: for the `known` aircraft, and for the
aircraft as `identified` from the steps before. `calibrated` is the clearance and the monitor of the
campaign study. The ceiling is the best of all three, since who knows the aircraft may also decide
as if not. The thresholds of each rule are the best ones for the counted flights; intervals choose
them again for resampled aircraft.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.clearance.clearance import BATCH, BuildUp, ClearanceRecipe, PointPredictor
from core.evaluation.lead_sweep import TESTS, planned_tests
from core.seeds import stream
from core.types import Array, Flags, Indices
from tests.studies.campaign_study import (
    GOAL,
    WITHOUT,
    CampaignStudyRecipe,
    FlownBuildUp,
    PointOutcomes,
    counted_each,
)
from tests.studies.foresight import Foresight
from tests.studies.retraining import retrained
from tests.studies.study_command import Progress, run_study

RULES = "known", "identified", "calibrated"
RETRAINED = "retrained"
"""Clearance and monitor of a campaign, a monitor for each aircraft as identified."""
BY = "retrained, epsilon", "retrained, chance", "retrained, promise"
"""The monitor aborts at an epsilon, from a chance of an exceedance, or at the epsilon that keeps
the promise of the clearance with its monitor: the same for all aircraft."""
CEILING = "ceiling"
AFFORDED = 0.25
"""Share of the safe points that may be lost."""
REFUSED = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, WITHOUT)
"""Chances of an exceedance before the flight from which a point is refused."""
ABORTED = (0.04, 0.07, 0.1, 0.13, 0.16, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, WITHOUT)
"""Chances in flight from which it is aborted."""
WINDOWS_S = 1.0, 1.5, 10.0
"""Times to look ahead in flight; the last one is the rest."""
N_CANDIDATES, N_RESAMPLED = 64, 1000
"""Aircraft drawn from each posterior; resamplings for an interval."""
GOALS = "avoided", "lost"
SIDES = {"avoided": "lost", "lost": "avoided"}
"""The share that a goal is judged by."""


@dataclass(frozen=True)
class CeilingRecipe:
    """The build-ups, aircraft and rules of a study."""

    tests: tuple[str, ...] = tuple(TESTS)
    """planned tests, by name"""
    rules: tuple[str, ...] = RULES
    """rules, by name"""
    imperfections: Literal["none", "usual"] = "usual"
    """imperfections of a real flight: none, or usual noise and pilot's scatter"""
    reaction_s: float = 0.25
    """mean time from an alert to neutral controls [s]"""
    n_flown: Annotated[int, Bounds(least=20)] = 400
    """aircraft that fly the build-up"""
    seed: Annotated[int, Bounds(least=0)] = 11
    """seed of every random draw"""

    def __post_init__(self) -> None:
        check_bounds(self)
        for kind, given, known in (
            ("test", self.tests, TESTS),
            ("rule", self.rules, (*RULES, RETRAINED)),
        ):
            if unknown := [name for name in given if name not in known]:
                raise ValueError(f"{kind} {unknown[0]!r} was given: choose {', '.join(known)}")

    @property
    def campaign(self) -> CampaignStudyRecipe:
        return CampaignStudyRecipe(
            tests=self.tests,
            imperfections=self.imperfections,
            reaction_s=self.reaction_s,
            n_flown=self.n_flown,
            n_unsafe=200,
            n_exceeding=200,
            n_aircraft=200,
            seed=self.seed,
        )


class Reached(NamedTuple):
    """One rule on one planned test, with one goal.

    goal: `avoided`, the fewest lost with GOAL avoided; `lost`, the most avoided with AFFORDED lost.
    n_exceeding .. caused: as in CampaignCounts.   share: of the safe points lost, or of the
    exceedances avoided.   low, high: its 95 % interval over aircraft.
    """

    test: str
    rule: str
    goal: str
    n_exceeding: int
    avoided: int
    n_safe: int
    lost: int
    caused: int
    share: float
    low: float
    high: float


def ceiling_study(recipe: CeilingRecipe, progress: Progress | None = None) -> list[Reached]:
    """Fly the build-ups under every rule; one entry for each test, rule and goal, ceiling first.

    progress: called with (rules done, total).
    """
    rows: list[Reached] = []
    total = len(recipe.tests) * len(recipe.rules)
    for of_test, (name, test) in enumerate(
        planned_tests(recipe.tests, recipe.imperfections).items()
    ):
        build_up = FlownBuildUp(test, recipe.campaign, list(TESTS).index(name))
        counts: dict[str, Indices] = {}
        for number, rule in enumerate(recipe.rules):
            if progress:
                progress(of_test * len(recipe.rules) + number, total)
            variants, first = ruled(build_up, rule), build_up.flown[0].is_unsafe
            if rule == RETRAINED:
                of_pairs = counts_of, counts_of, counts_of_promises
                counts |= {
                    by: count([each], first)
                    for by, count, each in zip(BY, of_pairs, variants, strict=True)
                }
            else:
                counts[rule] = counts_of(variants, first)
        counts = {CEILING: np.concatenate([*counts.values()]), **counts}
        rows += [
            reached(name, rule, goal, counts[rule], stream(*build_up.seed, 5))
            for rule, goal in product(counts, GOALS)
        ]
    return rows


def ruled(build_up: FlownBuildUp, rule: str) -> list[tuple[PointOutcomes, ...]]:
    """The points under each variant of a rule: one for each window in flight, or as in BY."""
    numbers = range(1, len(build_up.points))
    if rule == "calibrated":
        return [tuple(build_up.outcomes(number) for number in numbers)]
    if rule == RETRAINED:
        pairs = [retrained(build_up, number, ABORTED) for number in numbers]
        return list(zip(*pairs, strict=True))
    foreseen = [_foreseen(build_up, number, rule) for number in numbers]
    return list(zip(*foreseen, strict=True))


def _foreseen(build_up: FlownBuildUp, number: int, rule: str) -> list[PointOutcomes]:
    """One point by chances, for each window."""
    test, flown = build_up.points[number], build_up.flown[number]
    candidates = None if rule == "known" else _identified(build_up, number)
    foresight = Foresight(test, build_up.theta, stream(*build_up.seed, number), candidates)
    before = foresight.before(stream(*build_up.seed, number, 3))
    cleared = {level: (before < level) | (level == WITHOUT) for level in REFUSED}
    windows = [round(window / test.dt) for window in WINDOWS_S]
    outcomes: list[PointOutcomes] = []
    until = np.where(before > 0.0, flown.fail_index, 0)
    for chances in foresight.chances(windows, until):
        alerts = {
            level: _first(chances >= (2.0 if level == WITHOUT else level)) for level in ABORTED
        }
        outcomes.append(build_up.aborting(number, cleared, alerts))
    return outcomes


def _first(flags: Flags) -> Any:
    """(n,) first sample that is set, n_samples without one."""
    return np.where(flags.any(axis=1), flags.argmax(axis=1), flags.shape[1])


def _identified(build_up: FlownBuildUp, number: int) -> Array:
    """Aircraft (n, N_CANDIDATES, n_parameters) drawn from the posteriors after the steps before."""
    points = BuildUp(tuple(build_up.points[:number]), build_up.points[number])
    predictor = PointPredictor(points, ClearanceRecipe(n_draws=8))
    rng = stream(*build_up.seed, number, 4)
    parts: list[Array] = []
    for first in range(0, len(build_up.theta), BATCH):
        records = [step.y[first : first + BATCH] for step in build_up.flown[:number]]
        posterior = predictor.predict(records).posterior
        assert posterior is not None
        root = np.linalg.cholesky(posterior.covariance)
        n, m = posterior.mean.shape
        drawn = rng.standard_normal((n, N_CANDIDATES, m)) @ np.swapaxes(root, 1, 2)
        deviates = (posterior.mean[:, np.newaxis] + drawn).reshape(n * N_CANDIDATES, m)
        parts.append(predictor.plant.theta_of(deviates).reshape(n, N_CANDIDATES, -1))
    return np.concatenate(parts)


def counts_of(variants: Sequence[Sequence[PointOutcomes]], over: Flags) -> Indices:
    """Counts (n_choices, n, 5) of each aircraft, for each variant and pair of thresholds."""
    return np.stack(
        [
            counted_each(points, over, refused, aborted)
            for points in variants
            for refused, aborted in product(points[0].cleared, points[0].aborted)
        ]
    )


def counts_of_promises(variants: Sequence[Sequence[PointOutcomes]], over: Flags) -> Indices:
    """Counts (n_choices, n, 5) of each aircraft, with one promise for clearance and monitor."""
    return np.stack(
        [
            counted_each(points, over, promise, promise)
            for points in variants
            for promise in points[0].cleared
        ]
    )


def reached(name: str, rule: str, goal: str, counts: Indices, rng: np.random.Generator) -> Reached:
    """The best choice for a goal.   counts: (n_choices, n, 5)."""
    n = counts.shape[1]
    total = counts.sum(axis=1)[np.newaxis]
    (chosen,), (share,) = best(total, goal)
    again = rng.multinomial(n, np.full(n, 1.0 / n), N_RESAMPLED).astype(np.float64)
    _, shares = best(np.tensordot(again, counts, axes=(1, 1)), goal)
    low, high = np.quantile(shares, (0.025, 0.975)).tolist()
    n_exceeding, avoided, n_safe, lost, caused = total[0, chosen].tolist()
    counted = n_exceeding, avoided, n_safe, lost, caused
    return Reached(name, rule, goal, *counted, float(share), low, high)


def best(total: Array | Indices, goal: str) -> tuple[Indices, Array]:
    """The best choice for a goal and its share, for each row of counts (m, n_choices, 5)."""
    n_exceeding, avoided, n_safe, lost, _ = np.moveaxis(total, 2, 0)
    avoided, lost = avoided / np.maximum(n_exceeding, 1), lost / np.maximum(n_safe, 1)
    enough, merit, share = (
        (np.minimum(avoided, GOAL), -lost, lost)
        if goal == "avoided"
        else (-np.maximum(lost, AFFORDED), avoided, avoided)
    )
    is_enough = enough >= enough.max(axis=1, keepdims=True)
    chosen = np.where(is_enough, merit, -np.inf).argmax(axis=1)
    return chosen, share[np.arange(len(share)), chosen]


def in_words(rows: Sequence[Reached], recipe: CeilingRecipe) -> str:
    """One line for each rule and goal."""
    lines = [
        f"{recipe.n_flown} aircraft, imperfections {recipe.imperfections}, reaction "
        f"{recipe.reaction_s:g} s; goals: {GOAL:g} avoided, or {AFFORDED:g} lost"
    ]
    for row in rows:
        lines.append(
            f"{row.test:8} {row.rule:18} avoided {row.avoided / max(row.n_exceeding, 1):.3f}, "
            f"lost {row.lost / max(row.n_safe, 1):.3f}; {SIDES[row.goal]} {row.share:.3f} "
            f"({row.low:.3f} to {row.high:.3f})"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    run_study(CeilingRecipe, ceiling_study, in_words, Reached._asdict)
