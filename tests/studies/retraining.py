"""The product's way in the ceiling study: a monitor for each aircraft, trained as identified."""

from dataclasses import replace

import numpy as np

from core.clearance.clearance import BATCH, BuildUp, ClearanceRecipe, PointPredictor
from core.evaluation.lead_sweep import METHODS
from core.evaluation.rates import first_alerts
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import CollectionError, collect
from core.simulation.aircraft import IdentifiedAircraft
from core.types import Array, Indices
from tests.studies.campaign_study import WITHOUT, FlownBuildUp, PointOutcomes

EPSILONS = (0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, WITHOUT)
METHOD = "neighbors + peaks"
N_UNSAFE, MOST_ROLLOUTS, MOST_SAFE = 120, 12_000, 1_500
"""Failures that train and calibrate a monitor, out of at most so many rollouts."""


def retrained(
    build_up: FlownBuildUp, number: int, lead_s: float, refused: tuple[float, ...]
) -> PointOutcomes:
    """One point, refused by the share of failing rollouts of the aircraft as identified, and
    aborted by a monitor trained on them.

    Where too few rollouts fail to train a monitor the point is flown without one.
    """
    flown = build_up.flown[number]
    n, n_samples = flown.y.shape[:2]
    share = np.zeros(n)
    alerts: dict[float, Indices] = {epsilon: np.full(n, n_samples) for epsilon in EPSILONS}
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
        predictor, score = METHODS[METHOD]
        method = MonitorRecipe(t_early=lead_s, predictor=predictor, score=score).as_planned()
        monitor = train(dataset, method)
        for epsilon in EPSILONS[:-1]:
            one = slice(i, i + 1)
            first = first_alerts(monitor, flown.y[one], flown.fail_index[one], epsilon)
            alerts[epsilon][i] = first[0]
    cleared = {level: (share < level) | (level == WITHOUT) for level in refused}
    return build_up.aborting(number, cleared, alerts)


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
