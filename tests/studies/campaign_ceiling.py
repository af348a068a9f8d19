"""Ceiling of the campaign study: what someone achieves who knows every derivative of the aircraft.

The flights, the crew's reaction and the counting are those of the campaign study. Three rules:
`known` knows the aircraft, `identified` knows it as identified from the steps before, and both
refuse a point and abort a flight by the chance of an exceedance; `calibrated` is the clearance and
the monitor of the campaign study. Thresholds are chosen on one half of the aircraft and counted on
the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.clearance.clearance import BATCH, BuildUp, PointPredictor
from core.evaluation.lead_sweep import TESTS, planned_tests
from core.seeds import stream
from core.types import Array, Flags
from tests.studies.campaign_study import (
    GOAL,
    WITHOUT,
    CampaignCounts,
    CampaignStudyRecipe,
    FlownBuildUp,
    PointOutcomes,
    counted,
)
from tests.studies.foresight import Foresight
from tests.studies.study_command import Progress, run_study

RULES = "known", "identified", "calibrated"
AFFORDED = 0.25
"""Share of the safe points that may be lost."""
REFUSED = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, WITHOUT)
"""Chances of an exceedance before the flight from which a point is refused."""
ABORTED = (0.04, 0.07, 0.1, 0.13, 0.16, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, WITHOUT)
"""Chances in flight from which it is aborted."""
WINDOWS_S = 1.0, 1.5, 10.0
"""Times to look ahead in flight; the last one is the rest."""
N_CANDIDATES = 64
"""Aircraft drawn from each posterior."""


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
    n_flown: Annotated[int, Bounds(least=20)] = 600
    """aircraft that fly the build-up"""
    seed: Annotated[int, Bounds(least=0)] = 11
    """seed of every random draw"""

    def __post_init__(self) -> None:
        check_bounds(self)
        for kind, given, known in (("test", self.tests, TESTS), ("rule", self.rules, RULES)):
            if unknown := [name for name in given if name not in known]:
                raise ValueError(f"{kind} {unknown[0]!r} was given: choose {', '.join(known)}")

    @property
    def campaign(self) -> CampaignStudyRecipe:
        return CampaignStudyRecipe(
            tests=self.tests,
            imperfections=self.imperfections,
            reaction_s=self.reaction_s,
            n_flown=self.n_flown,
            seed=self.seed,
        )


class Reached(NamedTuple):
    """One rule on one planned test, with one goal.

    goal: `avoided`, the fewest lost with GOAL avoided; `lost`, the most avoided with AFFORDED lost.
    n_exceeding .. caused: as in CampaignCounts.
    """

    test: str
    rule: str
    goal: str
    n_exceeding: int
    avoided: int
    n_safe: int
    lost: int
    caused: int

    @property
    def counts(self) -> CampaignCounts:
        return CampaignCounts(self.test, np.nan, np.nan, *self[3:])


class Ruled(NamedTuple):
    """The points of a build-up under a rule, at every level of its two thresholds."""

    points: tuple[PointOutcomes, ...]

    def counts(
        self, over: Flags, among: Flags
    ) -> Iterator[tuple[tuple[float, float], CampaignCounts]]:
        for levels in product(self.points[0].cleared, self.points[0].aborted):
            yield levels, counted("", self.points, over, *levels, among)


def ceiling_study(recipe: CeilingRecipe, progress: Progress | None = None) -> list[Reached]:
    """Fly the build-ups under every rule; one entry for each test, rule and goal.

    progress: called with (rules done, total).
    """
    rows: list[Reached] = []
    total = len(recipe.tests) * len(recipe.rules)
    for of_test, (name, test) in enumerate(
        planned_tests(recipe.tests, recipe.imperfections).items()
    ):
        build_up = FlownBuildUp(test, recipe.campaign, list(TESTS).index(name))
        for number, rule in enumerate(recipe.rules):
            if progress:
                progress(of_test * len(recipe.rules) + number, total)
            variants = ruled(build_up, rule)
            over = build_up.flown[0].is_unsafe
            rows += [reached(name, rule, goal, variants, over) for goal in ("avoided", "lost")]
    return rows


def ruled(build_up: FlownBuildUp, rule: str) -> list[Ruled]:
    """The variants of a rule: one for each window in flight."""
    numbers = range(1, len(build_up.points))
    if rule == "calibrated":
        return [Ruled(tuple(build_up.outcomes(number) for number in numbers))]
    foreseen = [_foreseen(build_up, number, rule) for number in numbers]
    return [Ruled(points) for points in zip(*foreseen, strict=True)]


def _foreseen(build_up: FlownBuildUp, number: int, rule: str) -> list[PointOutcomes]:
    """One point by chances, for each window."""
    test, flown = build_up.points[number], build_up.flown[number]
    candidates = None if rule == "known" else _identified(build_up, number)
    foresight = Foresight(test, build_up.theta, stream(*build_up.seed, number), candidates)
    before = foresight.before(stream(*build_up.seed, number, 3))
    cleared = {level: (before < level) | (level == WITHOUT) for level in REFUSED}
    windows = [round(window / test.dt) for window in WINDOWS_S]
    outcomes: list[PointOutcomes] = []
    for chances in foresight.chances(windows, flown.fail_index):
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
    predictor, rng = PointPredictor(points, 8), stream(*build_up.seed, number, 4)
    parts: list[Array] = []
    for first in range(0, len(build_up.theta), BATCH):
        records = [step.y[first : first + BATCH] for step in build_up.flown[:number]]
        posterior = predictor.predict(records, rng).posterior
        root = np.linalg.cholesky(posterior.covariance)
        n, m = posterior.mean.shape
        drawn = rng.standard_normal((n, N_CANDIDATES, m)) @ np.swapaxes(root, 1, 2)
        deviates = (posterior.mean[:, np.newaxis] + drawn).reshape(n * N_CANDIDATES, m)
        parts.append(predictor.plant.theta_of(deviates).reshape(n, N_CANDIDATES, -1))
    return np.concatenate(parts)


def reached(name: str, rule: str, goal: str, variants: Sequence[Ruled], over: Flags) -> Reached:
    """Choose thresholds on each half of the aircraft, and count on the other."""
    odd = np.arange(len(over)) % 2 == 1
    total = np.zeros(5, np.int64)
    for half in (odd, ~odd):
        chosen, levels = best(variants, over, half, goal)
        total += counted("", chosen.points, over, *levels, ~half)[3:]
    return Reached(name, rule, goal, *total.tolist())


def best(
    variants: Sequence[Ruled], over: Flags, among: Flags, goal: str
) -> tuple[Ruled, tuple[float, float]]:
    """The variant and thresholds that serve a goal best among these aircraft."""

    def merit(counts: CampaignCounts) -> tuple[float, float]:
        if goal == "avoided":
            return min(counts.avoided_share, GOAL), -counts.lost_share
        return -max(counts.lost_share, AFFORDED), counts.avoided_share

    every = (
        (merit(c), k, levels) for k, v in enumerate(variants) for levels, c in v.counts(over, among)
    )
    _, which, levels = max(every)
    return variants[which], levels


def plain(row: Reached) -> dict[str, Any]:
    (avoided_low, avoided_high), (lost_low, lost_high) = row.counts.intervals.tolist()
    return row._asdict() | {
        "avoided_share": row.counts.avoided_share,
        "avoided_low": avoided_low,
        "avoided_high": avoided_high,
        "lost_share": row.counts.lost_share,
        "lost_low": lost_low,
        "lost_high": lost_high,
    }


def in_words(rows: Sequence[Reached], recipe: CeilingRecipe) -> str:
    """One line for each rule and goal."""
    lines = [
        f"{recipe.n_flown} aircraft, imperfections {recipe.imperfections}, reaction "
        f"{recipe.reaction_s:g} s; goals: {GOAL:g} avoided, or {AFFORDED:g} lost"
    ]
    for row in rows:
        (low, high), (least, most) = row.counts.intervals
        lines.append(
            f"{row.test:8} {row.rule:11} {row.goal:8} avoided {row.counts.avoided_share:.3f} "
            f"({low:.3f} to {high:.3f}), lost {row.counts.lost_share:.3f} "
            f"({least:.3f} to {most:.3f})"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    run_study(CeilingRecipe, ceiling_study, in_words, plain)
