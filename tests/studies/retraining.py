"""The product's way in the ceiling study: a monitor for each aircraft, trained as identified."""

from dataclasses import replace
from math import inf, log

import numpy as np

from core.clearance.clearance import BATCH, BuildUp, ClearanceRecipe, PointPredictor
from core.monitor import MonitorRecipe, train
from core.monitor.predictor import InputFilter
from core.monitor.score import CardWindow
from core.planned_test.collection import CollectionError, card_of, collect
from core.simulation.aircraft import IdentifiedAircraft
from core.types import Array
from tests.studies.campaign_study import WITHOUT, FlownBuildUp, PointOutcomes

EPSILONS = (0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, WITHOUT)
METHOD = InputFilter(), CardWindow(n_after=20)
N_UNSAFE, MOST_ROLLOUTS, MOST_SAFE = 120, 12_000, 1_500
"""Failures that train and calibrate a monitor, out of at most so many rollouts."""


def retrained(
    build_up: FlownBuildUp,
    number: int,
    lead_s: float,
    refused: tuple[float, ...],
    chances: tuple[float, ...],
) -> tuple[PointOutcomes, PointOutcomes]:
    """One point, refused by the share of failing rollouts of the aircraft as identified, and
    aborted by a monitor trained on them: at an epsilon, and from a chance of an exceedance.

    The chance is the score of the monitor, which turns it into the epsilon of each aircraft. Where
    too few rollouts fail to train a monitor the point is flown without one.
    """
    flown = build_up.flown[number]
    n, n_samples = flown.y.shape[:2]
    share, t = np.zeros(n), np.arange(n_samples) * build_up.points[number].dt
    by_epsilon, by_chance = (
        {level: np.full(n, n_samples) for level in levels} for levels in (EPSILONS, chances)
    )
    for i, aircraft in enumerate(identified(build_up, number)):
        planned = replace(
            build_up.points[number],
            aircraft=aircraft,
            n_unsafe=N_UNSAFE,
            seed=build_up.seed[0] + i,
            max_rollouts=MOST_ROLLOUTS,
            max_safe=MOST_SAFE,
        )
        try:
            dataset = collect(planned)
        except CollectionError as error:
            share[i] = float("rollouts were unsafe, but" in str(error))
            continue
        share[i] = dataset.unsafe_rate
        method = MonitorRecipe(lead_s, predictor=METHOD[0], score=METHOD[1])
        monitor = train(dataset, method, card=card_of(planned))
        assessed = monitor.assess(t, flown.y[i], withdraw=False)
        for alerts, risk in ((by_epsilon, assessed.p_value), (by_chance, -assessed.score)):
            for level, first in alerts.items():
                over = risk > (_log_odds(level) if alerts is by_chance else level)
                first[i] = over.argmax() if over.any() else n_samples
    cleared = {level: (share < level) | (level == WITHOUT) for level in refused}
    both = (build_up.aborting(number, cleared, alerts) for alerts in (by_epsilon, by_chance))
    return next(both), next(both)


def _log_odds(chance: float) -> float:
    return log(chance / (1.0 - chance)) if chance < WITHOUT else inf


def identified(build_up: FlownBuildUp, number: int) -> list[IdentifiedAircraft]:
    """Each aircraft as identified from the steps before a point."""
    points = BuildUp(tuple(build_up.points[:number]), build_up.points[number])
    predictor = PointPredictor(points, ClearanceRecipe(n_draws=8))
    base, found = build_up.points[number].aircraft, []
    for first in range(0, len(build_up.theta), BATCH):
        records = [step.y[first : first + BATCH] for step in build_up.flown[:number]]
        posterior = predictor.predict(records).posterior
        for mean, covariance in zip(posterior.mean, posterior.covariance, strict=True):
            theta, slopes = _linear(predictor, mean)
            found.append(IdentifiedAircraft.of(base, theta, slopes @ covariance @ slopes.T))
    return found


def _linear(predictor: PointPredictor, mean: Array) -> tuple[Array, Array]:
    """Parameters at a mean of deviates, and their derivatives (n_parameters, n_deviates)."""
    moved = predictor.plant.theta_of(mean + np.vstack([np.zeros(len(mean)), np.eye(len(mean))]))
    return moved[0], (moved[1:] - moved[0]).T
