"""The clearance of a point and its monitor as one rule, calibrated as it is flown.

The clearance may be lax, because an alert still aborts the flight. Simulated points that exceed a
limit are cleared from the steps before them; where one is cleared, a monitor is trained on the
aircraft as identified and watches the flight. The monitors share one epsilon: the largest at which
at most a share of these points, the epsilon of the clearance, is flown without a timely alert.
"""

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import floor

import numpy as np

from core.clearance.clearance import (
    BATCH,
    Clearance,
    ClearanceError,
    ClearanceRecipe,
    PointPredictor,
    Progress,
)
from core.clearance.identification import FlownSegment, identify_test
from core.limits.limits import magnitudes_of
from core.monitor.calibration import alert_above, failures_needed
from core.monitor.monitor import Monitor
from core.monitor.observation import lead_steps
from core.monitor.predictor import InputFilter
from core.monitor.recipe import MonitorRecipe
from core.monitor.score import CardWindow
from core.monitor.training import train
from core.planned_test.collection import CollectionError, card_of, collect
from core.planned_test.planned_test import DatasetRecipe
from core.seeds import Branch, stream
from core.simulation.maneuver import Steps
from core.tasks import Tasks
from core.types import Array, Indices

CLEARED = 0.5
"""Largest p-value of a point that is cleared with its monitor."""
MONITOR = MonitorRecipe(t_early=0.5, predictor=InputFilter(), score=CardWindow(n_after=20))
"""Recipe of the monitors."""
N_POINTS = 120
"""Least number of simulated points that exceed a limit; about half of them need a monitor."""
N_UNSAFE, MOST_ROLLOUTS, MOST_SAFE = 100, 5_000, 1_000
"""Failures that calibrate each of their monitors, out of at most so many rollouts."""
STEP = 1.0 / (N_UNSAFE + 1)
"""Step between p-values of these monitors."""


@dataclass(frozen=True, eq=False)
class WithMonitor:
    """A calibrated rule: clear up to CLEARED, and abort the flight at an alert of its monitor.

    risks: (n,) of simulated points that exceed a limit: 1 if not cleared, 0 without a monitor, else
    the highest p-value of the monitor while an alert is timely.
    """

    recipe: ClearanceRecipe
    risks: Array

    @property
    def epsilon(self) -> float:
        """Epsilon of the point's monitor. ClearanceError if none keeps the promise."""
        recipe, n = self.recipe, len(self.risks)
        rank = floor(alert_above(recipe.epsilon, n, recipe.guarantee) * (n + 1) + 1e-9)
        epsilon = float(np.sort(self.risks)[rank - 1]) - 0.5 * STEP
        if epsilon < STEP:
            raise ClearanceError(
                f"no monitor keeps epsilon={recipe.epsilon:g} at this point: "
                f"{np.count_nonzero(self.risks < 1.5 * STEP)} of {n} simulated points that exceed "
                "a limit are cleared and give no alert in time; accept a larger epsilon, or fly a "
                "smaller step"
            )
        return epsilon


def with_monitor(
    clearance: Clearance, progress: Progress | None = None, executor: Executor | None = None
) -> WithMonitor:
    """Calibrate a clearance and the monitor of its next point as one rule.

    executor: see Tasks.   progress: called with (points done, points); an exception cancels.
    ClearanceError if too few aircraft exceed, and for other tests than steps with limits.
    """
    points, recipe = clearance.points, clearance.recipe
    following = points.following
    if not isinstance(following, DatasetRecipe):
        raise ClearanceError(
            "a clearance with its monitor identifies the aircraft, which needs a linear one: "
            "compute the clearance alone, and train a monitor of the next point"
        )
    if clearance.is_rare:
        raise ClearanceError(
            f"{clearance.n_exceeding} of {clearance.n_tried} simulated aircraft exceed a limit at "
            "the next point: too few to calibrate with a monitor, compute the clearance alone"
        )
    if not isinstance(following.maneuver, Steps) or magnitudes_of(following.specification) is None:
        raise ClearanceError(
            "a clearance with a monitor needs a manoeuvre of steps, and limits that are equal to "
            "both sides: compute the clearance alone"
        )
    predictor, rng = PointPredictor(points, recipe), stream(recipe.seed, Branch.CLEARANCE, 4)
    n = max(N_POINTS, failures_needed(recipe.epsilon, recipe.guarantee))
    theta, y, last = _exceeding(predictor, n, rng)
    records = [step.fly(theta, rng)[0].y for step in predictor.steps]
    prediction = predictor.predict(records)
    cleared = clearance.p_values(prediction.score) <= CLEARED
    cleared &= (prediction.checks <= clearance.levels).all(axis=1)

    risks, which = np.ones(n), np.flatnonzero(cleared)
    flown = [
        (
            following,
            int(i),
            [FlownSegment(record[i], following.dt) for record in records],
            y[[i]],
            last[[i]],
        )
        for i in which
    ]
    with Tasks(executor) as tasks:
        results = zip(which, tasks.results(_risk, flown), strict=True)
        for done, (i, highest) in enumerate(results, start=1):
            risks[i] = highest
            if progress:
                progress(done, len(which))
    return WithMonitor(recipe, risks)


def _risk(
    following: DatasetRecipe, seed: int, steps: list[FlownSegment], y: Array, last: Indices
) -> float:
    """Highest p-value while an alert is timely, of one flight by the monitor trained for it.

    0 where no monitor can be trained.   steps: flown before, which identify the aircraft.
    y: (1, n_samples, 6).   last: (1,) last sample of a timely alert.
    """
    aircraft = identify_test(following, steps).identified
    try:
        monitor = monitor_of(replace(following, aircraft=aircraft, seed=seed))
    except CollectionError:
        return 0.0
    return float(monitor.highest_p_values(y, last)[0])


def _exceeding(
    predictor: PointPredictor, n: int, rng: np.random.Generator
) -> tuple[Array, Array, Indices]:
    """n aircraft, their flights of the next point, which exceed, and the last samples to alert."""
    parts: list[tuple[Array, Array, Indices]] = []
    while sum(len(theta) for theta, _, _ in parts) < n:
        theta = predictor.plant.sample(BATCH, rng)
        flights, _ = predictor.following.fly(theta, rng)
        which = flights.is_unsafe
        parts.append((theta[which], flights.y[which], flights.fail_index[which]))
    theta, y, fail_index = (np.concatenate(part)[:n] for part in zip(*parts, strict=True))
    h = lead_steps(MONITOR.t_early, predictor.following.test.dt)
    return theta, y, fail_index - h


def monitor_of(test: DatasetRecipe) -> Monitor:
    """A monitor with few failures.   CollectionError if nearly none or nearly all flights fail."""
    few = replace(test, n_unsafe=N_UNSAFE, max_rollouts=MOST_ROLLOUTS, max_safe=MOST_SAFE)
    return train(collect(few), MONITOR, card=card_of(few))
