"""Campaign study: exceedances avoided against safe points lost.

Aircraft of D_theta fly a fixed build-up. Each point after the first is flown if it is cleared from
the steps before it; a flight with an alert is aborted after the crew's reaction. A refused or
aborted point ends the build-up, and so does an exceedance. Every pair of epsilons, of the clearance
and of the monitor, is applied to the same flights.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from app.report.studies.study_figures import COLOURS, DASHES, STYLE
from core.bounds import Bounds, check_bounds
from core.clearance.clearance import (
    BATCH,
    BuildUp,
    Clearance,
    ClearanceRecipe,
    PointPredictor,
    calibrate,
)
from core.evaluation.lead_sweep import METHODS, TESTS, planned_tests
from core.evaluation.prevention import neutral_from, unit_reactions
from core.evaluation.rates import clopper_pearson, first_alerts
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.calibration import Guarantee, alert_above, failures_needed
from core.planned_test.collection import CollectionError, card_of, collect
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.seeds import Branch, stream
from core.types import Array, Flags, Indices
from tests.studies.study_command import Progress, run_study

WITHOUT = 1.0
"""Epsilon that means no clearance, or no monitor."""
OTHERS = 10_000
"""Added to the study's seed for the monitors, so that their flights are other ones."""


@dataclass(frozen=True)
class CampaignStudyRecipe:
    """The build-ups, aircraft, clearances and monitors of a study."""

    tests: tuple[str, ...] = tuple(TESTS)
    """planned tests: by name."""
    imperfections: Literal["none", "usual"] = "none"
    """imperfections of a real flight: `none`, or `usual` noise and pilot's scatter."""
    steps: tuple[float, ...] = (0.6, 0.8, 1.0)
    """points: growing shares of the planned amplitude; the first needs no clearance."""
    clearance_epsilons: tuple[float, ...] = (0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, WITHOUT)
    """accepted shares of wrong clearances; 1 for no clearance."""
    monitor_epsilons: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, WITHOUT)
    """accepted miss rates; 1 for no monitor."""
    guarantee: Guarantee = "average"
    """promise of both."""
    method: str = "test card: window"
    """method of the monitor: by name."""
    lead_s: Annotated[float, Bounds(above=0)] = 0.5
    """warning lead time [s]."""
    reaction_s: Annotated[float, Bounds(above=0)] = 0.25
    """reaction: mean time from an alert to neutral controls [s]."""
    n_flown: Annotated[int, Bounds(least=10)] = 1000
    """aircraft that fly the build-up."""
    n_unsafe: Annotated[int, Bounds(least=2)] = 500
    """failures for calibrating each point's monitor."""
    n_exceeding: Annotated[int, Bounds(least=20)] = 400
    """exceeding aircraft for calibrating each clearance."""
    n_aircraft: Annotated[int, Bounds(least=100)] = 400
    """aircraft for calibrating its checks."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw."""

    def __post_init__(self) -> None:
        check_bounds(self)
        for kind, given, known in (
            ("planned test", self.tests, TESTS),
            ("method", (self.method,), METHODS),
            ("imperfections", (self.imperfections,), ("none", "usual")),
        ):
            if unknown := [name for name in given if name not in known]:
                raise ValueError(f"{kind} {unknown[0]!r} was given: choose {', '.join(known)}")
        if len(self.steps) < 2 or sorted({*self.steps}) != [*self.steps] or self.steps[0] <= 0:
            raise ValueError(
                f"steps={self.steps} was given: give two or more positive, growing shares"
            )
        for given, n, kind in (
            (self.clearance_epsilons, self.n_exceeding, "exceeding aircraft"),
            (self.monitor_epsilons, self.n_unsafe, "failures"),
        ):
            smallest = min(given, default=0.0)
            if not 0.0 < smallest <= max(given) <= WITHOUT:
                raise ValueError(f"epsilons of {given} were given: give numbers above 0, at most 1")
            if smallest < WITHOUT and (needed := failures_needed(smallest, self.guarantee)) > n:
                raise ValueError(
                    f"epsilon={smallest:g} was given with {n} {kind}: it needs at least {needed}"
                )


class CampaignCounts(NamedTuple):
    """Counts over the points after the first, for one pair of epsilons on one planned test.

    n_exceeding, avoided: points that would exceed a limit; those refused or aborted in time.
    n_safe, lost: points that would not; those refused or aborted unnecessarily.
    caused: safe points that exceed a limit because they were aborted.
    """

    test: str
    clearance_epsilon: float
    monitor_epsilon: float
    n_exceeding: int
    avoided: int
    n_safe: int
    lost: int
    caused: int

    @property
    def avoided_share(self) -> float:
        """Share of the points that would exceed; NaN without any."""
        return self.avoided / self.n_exceeding if self.n_exceeding else np.nan

    @property
    def lost_share(self) -> float:
        """Share of the points that would not exceed; NaN without any."""
        return self.lost / self.n_safe if self.n_safe else np.nan

    @property
    def intervals(self) -> Array:
        """(2, 2) Clopper-Pearson 95 % intervals of both shares, as if points were independent."""
        counts = np.array([self.avoided, self.lost]), np.array([self.n_exceeding, self.n_safe])
        return clopper_pearson(*counts)


@dataclass(frozen=True, eq=False)
class PointOutcomes:
    """One point for every aircraft.

    would: (n,) exceeds if not stopped.   cleared: (n,) by epsilon of the clearance.   aborted,
    exceeds: (n,) by epsilon of the monitor; `exceeds` counts aborted flights that still exceed.
    """

    would: Flags
    cleared: dict[float, Flags]
    aborted: dict[float, Flags]
    exceeds: dict[float, Flags]


def campaign_study(
    recipe: CampaignStudyRecipe, progress: Progress | None = None
) -> list[CampaignCounts]:
    """Fly the build-ups; one entry for each planned test and pair of epsilons.

    progress: called with (points done, total).
    """
    each = len(recipe.steps) - 1
    counts: list[CampaignCounts] = []
    tests = planned_tests(recipe.tests, recipe.imperfections)
    for of_test, (name, test) in enumerate(tests.items()):
        build_up = FlownBuildUp(test, recipe, of_test)
        points: list[PointOutcomes] = []
        for number in range(1, len(recipe.steps)):
            if progress:
                done = of_test * each + number - 1
                progress(done, len(tests) * each)
            points.append(build_up.outcomes(number))
        first = build_up.flown[0].is_unsafe
        counts += [
            counted(name, points, first, clearance, monitor)
            for monitor in recipe.monitor_epsilons
            for clearance in recipe.clearance_epsilons
        ]
    return counts


class FlownBuildUp:
    """The aircraft of one planned test, and their flights at every point."""

    def __init__(self, test: DatasetRecipe, recipe: CampaignStudyRecipe, of_test: int) -> None:
        self._recipe = recipe
        peak = test.maneuver.peak_deg
        self.points = [
            replace(test, maneuver=test.maneuver.with_peak(part * peak)) for part in recipe.steps
        ]
        self.seed = (recipe.seed, Branch.CLEARANCE, 3, of_test)
        simulators = [LateralSimulator(point) for point in self.points]
        self.theta = simulators[0].plant.sample(recipe.n_flown, stream(*self.seed))
        rngs = [stream(*self.seed, number) for number in range(len(self.points))]
        self._stopped = [
            simulator.stopping(recipe.n_flown, deepcopy(rng), self.theta)
            for simulator, rng in zip(simulators, rngs, strict=True)
        ]
        self.flown = [
            simulator.fly(self.theta, rng)[0]
            for simulator, rng in zip(simulators, rngs, strict=True)
        ]

    def outcomes(self, number: int) -> PointOutcomes:
        """One point after the first, at every epsilon."""
        flown = self.flown[number]
        monitor = self._monitor(number)
        alerts: dict[float, Indices] = {}
        for epsilon in self._recipe.monitor_epsilons:
            alerts[epsilon] = np.full(len(flown.y), flown.y.shape[1])
            if monitor is not None and epsilon < WITHOUT:
                alerts[epsilon] = first_alerts(monitor, flown.y, flown.fail_index, epsilon)
        return self.aborting(number, self._cleared(number), alerts)

    def aborting(
        self, number: int, cleared: dict[float, Flags], alerts: dict[float, Indices]
    ) -> PointOutcomes:
        """One point after the first, flown if cleared and aborted after an alert.

        cleared: (n,) by level of the clearance.   alerts: (n,) first samples by level of the
        monitor, n_samples for none.
        """
        flown = self.flown[number]
        aborted: dict[float, Flags] = {}
        exceeds: dict[float, Flags] = {}
        for level, first in alerts.items():
            aborted[level] = first < np.minimum(flown.fail_index, flown.y.shape[1])
            exceeds[level] = self._exceeds(number, first, aborted[level])
        return PointOutcomes(flown.is_unsafe, cleared, aborted, exceeds)

    def _exceeds(self, number: int, alerts: Indices, aborted: Flags) -> Flags:
        """(n,) whether a flight exceeds although it is aborted after its alert and a reaction."""
        flown, recipe = self.flown[number], self._recipe
        unit = unit_reactions(len(alerts), stream(*self.seed, number, 1))
        which, exceeds = np.flatnonzero(aborted), flown.is_unsafe.copy()
        if len(which):
            reactions = recipe.reaction_s * unit[which]
            neutral = neutral_from(alerts[which], reactions, self.points[number].dt)
            exceeds[which] = self._stopped[number](which, neutral) < flown.y.shape[1]
        return exceeds

    def _monitor(self, number: int) -> Monitor | None:
        """The monitor of a point; None if too few of its flights exceed a limit."""
        recipe = self._recipe
        predictor, score = METHODS[recipe.method]
        settings = MonitorRecipe(
            t_early=recipe.lead_s,
            predictor=predictor,
            score=score,
            epsilon=min(recipe.monitor_epsilons),
            guarantee=recipe.guarantee,
        ).as_planned()
        if settings.epsilon == WITHOUT:
            return None
        planned = replace(
            self.points[number], n_unsafe=recipe.n_unsafe, seed=recipe.seed + OTHERS + number
        )
        try:
            card = card_of(planned) if predictor.forecast == "card" else None
            return train(collect(planned), settings, card=card)
        except CollectionError:
            return None

    def clearance(self, number: int, epsilon: float) -> tuple[Clearance, Array, Flags]:
        """Clearance of a point, the p-value of each aircraft, and whether no check fails."""
        recipe = self._recipe
        rule = calibrate(
            BuildUp(tuple(self.points[:number]), self.points[number]),
            ClearanceRecipe(
                epsilon=epsilon,
                guarantee=recipe.guarantee,
                n_exceeding=recipe.n_exceeding,
                n_aircraft=recipe.n_aircraft,
                seed=recipe.seed,
            ),
        )
        predictor = PointPredictor(rule.points, rule.recipe)
        p_values, unflagged = [], []
        for first in range(0, recipe.n_flown, BATCH):
            batch = slice(first, first + BATCH)
            prediction = predictor.predict([step.y[batch] for step in self.flown[:number]])
            below = prediction.quantiles[:, 2] < 1.0
            p_values.append(
                np.where(below, 0.0, 1.0) if rule.is_rare else rule.p_values(prediction.score)
            )
            unflagged.append((prediction.checks <= rule.levels).all(axis=1))
        return rule, np.concatenate(p_values), np.concatenate(unflagged)

    def _cleared(self, number: int) -> dict[float, Flags]:
        """Whether each aircraft's point is cleared from the steps before it, by epsilon."""
        recipe = self._recipe
        everyone: Flags = np.ones(recipe.n_flown, bool)
        epsilons = [epsilon for epsilon in recipe.clearance_epsilons if epsilon < WITHOUT]
        if not epsilons:
            return {WITHOUT: everyone}
        rule, p, unflagged = self.clearance(number, min(epsilons))
        cleared = {
            epsilon: (p <= alert_above(epsilon, max(rule.n_exceeding, 1), recipe.guarantee))
            & unflagged
            for epsilon in epsilons
        }
        return {**cleared, WITHOUT: everyone}


def counted(
    name: str, points: Sequence[PointOutcomes], over: Flags, clearance: float, monitor: float
) -> CampaignCounts:
    """Count over the build-up.   over: (n,) aircraft that exceeded at the first point."""
    total = counted_each(points, over, clearance, monitor).sum(axis=0)
    return CampaignCounts(name, clearance, monitor, *total.tolist())


def counted_each(
    points: Sequence[PointOutcomes], over: Flags, clearance: float, monitor: float
) -> Indices:
    """Counts n_exceeding .. caused (n, 5) of each aircraft over the build-up."""
    counts = np.zeros((len(over), 5), np.int64)
    on_hold: Flags = np.zeros(len(over), bool)
    over = over.copy()
    for point in points:
        flown = ~over & ~on_hold & point.cleared[clearance]
        aborted = flown & point.aborted[monitor]
        exceeds = flown & point.exceeds[monitor]
        exceeding, safe = ~over & point.would, ~over & ~point.would
        stopped = ~over & (~flown | aborted)
        kinds = exceeding, exceeding & ~exceeds, safe, safe & stopped, exceeds & ~point.would
        counts += np.stack(kinds, axis=1)
        on_hold |= stopped
        over |= exceeds
    return counts


def best_of(counts: Sequence[CampaignCounts], avoided: float) -> CampaignCounts | None:
    """Among pairs that avoid at least this share, the one that loses the fewest safe points."""
    enough = [pair for pair in counts if pair.avoided_share >= avoided]
    return min(enough, key=lambda pair: pair.lost_share) if enough else None


GOAL = 0.99
"""Share of the exceedances to avoid."""


def plain(counts: CampaignCounts) -> dict[str, Any]:
    (avoided_low, avoided_high), (lost_low, lost_high) = counts.intervals.tolist()
    return counts._asdict() | {
        "avoided_share": counts.avoided_share,
        "avoided_low": avoided_low,
        "avoided_high": avoided_high,
        "lost_share": counts.lost_share,
        "lost_low": lost_low,
        "lost_high": lost_high,
    }


def in_words(counts: Sequence[CampaignCounts], recipe: CampaignStudyRecipe) -> str:
    """One line for each pair of epsilons, and the best pair that avoids nearly all exceedances."""
    steps = ", ".join(f"{step:.0%}" for step in recipe.steps)
    lines = [
        f"build-up of {steps}, {recipe.n_flown} aircraft; {recipe.method}, {recipe.lead_s:g} s "
        f"ahead, reaction {recipe.reaction_s:g} s; points after the first",
        f"{'':8} {'clearance':>9} {'monitor':>8} {'exceed':>7} {'avoided':>23} {'safe':>6} "
        f"{'lost':>23}",
    ]
    for pair in counts:
        (low, high), (least, most) = pair.intervals
        lines.append(
            f"{pair.test:8} {_epsilon(pair.clearance_epsilon):>9} "
            f"{_epsilon(pair.monitor_epsilon):>8} {pair.n_exceeding:7d} "
            f"{pair.avoided_share:7.3f} ({low:.3f} to {high:.3f}) {pair.n_safe:6d} "
            f"{pair.lost_share:7.3f} ({least:.3f} to {most:.3f})"
        )
    for name in dict.fromkeys(pair.test for pair in counts):
        best = best_of([pair for pair in counts if pair.test == name], GOAL)
        lines.append(
            f"{name}: no pair avoids {GOAL:.0%} of the exceedances"
            if best is None
            else f"{name}: {best.avoided_share:.1%} avoided at {best.lost_share:.1%} of the safe "
            f"points lost, with a clearance at {_epsilon(best.clearance_epsilon)} and a monitor "
            f"at {_epsilon(best.monitor_epsilon)}: the fewest lost with {GOAL:.0%} avoided"
        )
    return "\n".join(lines)


def _epsilon(epsilon: float) -> str:
    return "none" if epsilon == WITHOUT else f"{epsilon:g}"


def avoided_against_lost(counts: Sequence[CampaignCounts], recipe: CampaignStudyRecipe) -> Figure:
    """One panel per planned test, one line per monitor, one mark per clearance; 95 % intervals."""
    tests = list(dict.fromkeys(pair.test for pair in counts))
    with rc_context(STYLE):
        figure = Figure(figsize=(4.0 * len(tests) + 1.0, 4.4), layout="constrained")
        panels = figure.subplots(1, len(tests), sharey=True, squeeze=False)[0]
        for axes, name in zip(panels, tests, strict=True):
            for number, epsilon in enumerate(recipe.monitor_epsilons):
                line = [c for c in counts if c.test == name and c.monitor_epsilon == epsilon]
                line.sort(key=lambda pair: pair.lost_share)
                axes.errorbar(
                    [pair.lost_share for pair in line],
                    [pair.avoided_share for pair in line],
                    yerr=_sides([pair.avoided_share for pair in line], line, 0),
                    xerr=_sides([pair.lost_share for pair in line], line, 1),
                    label="no monitor" if epsilon == WITHOUT else f"monitor at {epsilon:g}",
                    color=COLOURS[number % len(COLOURS)],
                    ls=DASHES[number % len(DASHES)],
                    marker="o",
                    lw=1.4,
                    ms=3,
                    elinewidth=0.6,
                )
            axes.set(title=name, xlabel="share of safe points lost", ylim=(-0.02, 1.02))
        panels[0].set_ylabel("share of exceedances avoided")
        lines, labels = panels[0].get_legend_handles_labels()
        figure.legend(lines, labels, loc="outside lower center", ncols=5, frameon=False)
        figure.suptitle(
            "clearances at "
            f"{', '.join(f'{e:g}' for e in recipe.clearance_epsilons if e < WITHOUT)}, and none; "
            f"{recipe.lead_s:g} s ahead, reaction {recipe.reaction_s:g} s"
        )
    return figure


def _sides(
    shares: list[float], counts: list[CampaignCounts], which: int
) -> tuple[list[float], list[float]]:
    """Distance of the interval's ends below and above each share."""
    intervals = [pair.intervals[which] for pair in counts]
    pairs = list(zip(shares, intervals, strict=True))
    return [share - low for share, (low, _) in pairs], [high - share for share, (_, high) in pairs]


if __name__ == "__main__":
    run_study(CampaignStudyRecipe, campaign_study, in_words, plain, avoided_against_lost)
