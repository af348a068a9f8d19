"""The program's way in the ceiling study: its clearance, and a monitor of each aircraft."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from math import inf, log

import numpy as np

from core.clearance.clearance import Clearance, ClearanceError
from core.clearance.identification import FlownSegment, identify_test
from core.clearance.with_monitor import CLEARED, monitor_of, with_monitor
from core.planned_test.collection import CollectionError
from core.simulation.aircraft import IdentifiedAircraft
from core.types import Flags
from tests.studies.campaign_study import WITHOUT, FlownBuildUp, PointOutcomes

CLEARED_UP_TO = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, WITHOUT)
"""Largest p-values of a cleared point."""
EPSILONS = (0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, WITHOUT)
PROMISES = (0.02, 0.05, 0.1, 0.2, 0.3)
"""Epsilons of a clearance with its monitor."""


def retrained(
    build_up: FlownBuildUp, number: int, chances: tuple[float, ...]
) -> tuple[PointOutcomes, PointOutcomes, PointOutcomes]:
    """One point, cleared by its p-value, with a monitor of the aircraft as identified.

    The flight is aborted at an epsilon, from a chance of an exceedance, or at the epsilon that the
    promise of a clearance with its monitor gives. The chance is the score of the monitor, which
    turns it into the epsilon of each aircraft. Where too few rollouts fail to train a monitor the
    point is flown without one.
    """
    flown = build_up.flown[number]
    n, n_samples = flown.y.shape[:2]
    t = np.arange(n_samples) * build_up.points[number].dt
    rule, p, unflagged = build_up.clearance(number, min(PROMISES))
    promised = _promised(rule)
    by_epsilon, by_chance, by_promise = (
        {level: np.full(n, n_samples) for level in levels}
        for levels in (EPSILONS, chances, PROMISES)
    )
    for i, aircraft in enumerate(identified(build_up, number)):
        planned = replace(build_up.points[number], aircraft=aircraft, seed=build_up.seed[0] + i)
        try:
            monitor = monitor_of(planned)
        except CollectionError:
            continue
        assessed = monitor.assess(t, flown.y[i], withdraw=False)
        for level, first in by_epsilon.items():
            first[i] = _first(assessed.p_value > level)
        for level, first in by_chance.items():
            first[i] = _first(-assessed.score > _log_odds(level))
        for promise, first in by_promise.items():
            first[i] = _first(assessed.p_value > promised[promise])
    cleared = {level: (p <= level) & unflagged | (level == WITHOUT) for level in CLEARED_UP_TO}
    together = {
        promise: (p <= CLEARED) & unflagged & (epsilon > 0.0)
        for promise, epsilon in promised.items()
    }
    return (
        build_up.aborting(number, cleared, by_epsilon),
        build_up.aborting(number, cleared, by_chance),
        build_up.aborting(number, together, by_promise),
    )


def _first(over: Flags) -> int:
    return int(over.argmax()) if over.any() else len(over)


def _log_odds(chance: float) -> float:
    return log(chance / (1.0 - chance)) if chance < WITHOUT else inf


def _promised(rule: Clearance) -> dict[float, float]:
    """Epsilon of the monitor for each promise; 0 where no monitor keeps it."""
    together, epsilons = with_monitor(rule), dict.fromkeys(PROMISES, 0.0)
    for promise in PROMISES:
        with suppress(ClearanceError):
            recipe = replace(rule.recipe, epsilon=promise)
            epsilons[promise] = replace(together, recipe=recipe).epsilon
    return epsilons


def identified(build_up: FlownBuildUp, number: int) -> Iterator[IdentifiedAircraft]:
    """Each aircraft as a campaign identifies it from the steps before a point."""
    test = build_up.points[number]
    for i in range(len(build_up.theta)):
        segments = [FlownSegment(step.y[i], test.dt) for step in build_up.flown[:number]]
        yield identify_test(test, segments).identified
