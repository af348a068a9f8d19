"""Clearance of the next point of a build-up, with a guarantee, from what was flown before it.

Steps are flown at smaller amplitudes and the aircraft is identified from them; the posterior says
what the next point will reach, over what is left unknown of the aircraft and over the pilot's
scatter. Conformal prediction on simulated aircraft that would exceed a limit there, each flown and
identified in the same way, turns that into a p-value: of the points that would exceed, at most a
share epsilon is cleared. The guarantee holds for aircraft of D_theta and flights as simulated; what
a fit can see of others withdraws the clearance.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import ceil, exp, floor, log
from typing import Annotated, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.identification.joint_model import Law
from core.identification.posterior import PlantPosterior, RecordedStep, fit, prior_of
from core.monitor.calibration import Guarantee, alert_above, failures_needed, p_values
from core.planned_test import DatasetRecipe, Simulator
from core.seeds import Branch, stream
from core.simulation.imperfections import channel_array
from core.types import Array, Flags

Progress = Callable[[int, int], object]

BATCH, DRAWN_AT_ONCE = 100, 1_000
"""Aircraft that are identified at a time, and those that are tried whether they exceed."""
MOST_AIRCRAFT = 20_000
"""Aircraft that are tried."""
RARE = 0.01
"""Share of aircraft that exceed, below which a point without failed checks needs no more than a
prediction below the limit."""
LEAST_SCATTER = 1e-6
WIDEST, HALVINGS = 4.0, 14
"""Factor about the next point's amplitude within which that is looked for which just reaches a
limit, and by how many halvings."""
CHECK_LEVEL = 0.05
"""Share of aircraft of D_theta, flown as simulated, of which any check withdraws the clearance."""
QUANTILES = (0.05, 0.5, 0.95)


class ClearanceError(ValueError):
    """Steps and a next point that no clearance can be calibrated for."""


@dataclass(frozen=True)
class ClearanceRecipe:
    """How a clearance is calibrated."""

    epsilon: Annotated[float, Bounds(above=0, below=1)] = 0.05
    """wrong clearances: share accepted of the points that would exceed a limit."""
    guarantee: Guarantee = "average"
    """promise on wrong clearances: on `average` over many calibrations, or of this very one with
    `95%` confidence."""
    n_exceeding: Annotated[int, Bounds(least=20)] = 200
    """exceeding aircraft: simulated ones that would exceed a limit at the next point."""
    n_aircraft: Annotated[int, Bounds(least=100)] = 400
    """aircraft: simulated ones, whether they exceed or not, that calibrate the checks and the
    recommended amplitude."""
    n_draws: Annotated[int, Bounds(least=8)] = 64
    """draws: flights of the next point that each prediction is made of."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw."""

    def __post_init__(self) -> None:
        """Refuse what cannot be promised."""
        check_bounds(self)
        if (needed := failures_needed(self.epsilon, self.guarantee)) > self.n_exceeding:
            raise ValueError(
                f"epsilon={self.epsilon:g} was given with {self.n_exceeding} exceeding aircraft: "
                f"it needs {needed} at least"
            )


@dataclass(frozen=True)
class BuildUp:
    """Points of a build-up: those that were flown, in order, and the next one.

    All are of one aircraft, law, limits and sample interval. ClearanceError otherwise.
    """

    flown: tuple[DatasetRecipe, ...]
    following: DatasetRecipe

    def __post_init__(self) -> None:
        """Refuse points that no one posterior could serve."""
        if not self.flown:
            raise ClearanceError("no flown step was given: a clearance needs one or more")
        for step in self.flown:
            for what in ("aircraft", "control_law", "specification", "dt"):
                if getattr(step, what) != getattr(self.following, what):
                    raise ClearanceError(
                        f"the {what} of a flown step is not that of the next point: all points of "
                        "a build-up are of one aircraft, control law, limits and sample interval"
                    )

    @classmethod
    def fractions(cls, following: DatasetRecipe, fractions: Sequence[float]) -> "BuildUp":
        """Steps of these fractions of the next point's amplitude."""
        steps = tuple(
            replace(
                following,
                maneuver=following.maneuver.with_peak(part * following.maneuver.peak_deg),
            )
            for part in fractions
        )
        return cls(steps, following)


class PeakPrediction(NamedTuple):
    """Of the logarithm of what part of a limit the next point reaches, of n aircraft.

    mean, deviation: (n,).   quantiles: (n, 3) parts, of QUANTILES.   posterior: of deviates.
    checks: (n, k) mean squares that a wrong model, or a wrong noise, makes large.
    """

    mean: Array
    deviation: Array
    quantiles: Array
    posterior: PlantPosterior
    checks: Array

    @property
    def score(self) -> Array:
        """(n,) how far the limit is passed, in deviations: high means danger."""
        return self.mean / self.deviation


class FailedCheck(NamedTuple):
    """A check beyond its calibrated level: which, its value and that level."""

    words: str
    value: float
    level: float


class PointVerdict(NamedTuple):
    """What a clearance says of the next point.

    cleared: whether it may be flown under the promise.   withdrawn: checks that speak against
    that promise; a point is never cleared with one.   p_value: high means risk; None where hardly
    any aircraft exceeds, and the prediction alone decides.   reached: part of
    a limit, by QUANTILES.   amplitude_deg: largest amplitude recommended, under a promise of its
    own; None where none was found.   posterior: of this aircraft's deviates.
    """

    cleared: bool
    withdrawn: tuple[FailedCheck, ...]
    p_value: float | None
    reached: tuple[float, float, float]
    amplitude_deg: float | None
    posterior: PlantPosterior


class PointPredictor:
    """Steps and next point made ready: identifies, and predicts what the next point reaches."""

    def __init__(self, points: BuildUp, n_draws: int) -> None:
        self._n_draws = n_draws
        self.steps = [Simulator(step) for step in points.flown]
        self.following = Simulator(points.following)
        law = points.following.control_law
        self._law = Law(self.following.controller, law.actuator)
        self.plant = self.following.plant

    @property
    def checks(self) -> tuple[str, ...]:
        """What each check asks, in words."""
        words: list[str] = []
        for number in range(1, len(self.steps) + 1):
            of = f"step {number}" if len(self.steps) > 1 else "the flown step"
            words.append(f"residuals of {of} are larger than noise explains")
            words.append(
                f"{of} does not agree with the steps before it: the aircraft may be nonlinear"
                if number > 1
                else f"{of} is far from what is expected of this aircraft"
            )
        return tuple(words)

    def predict(self, records: Sequence[Array], rng: np.random.Generator) -> PeakPrediction:
        """Identify n aircraft and predict.   records: (n, n_samples, 6) of each step."""
        n = len(records[0])
        posterior, checks = prior_of(self.plant, n), []
        for simulator, y in zip(self.steps, records, strict=True):
            noise = channel_array(simulator.recipe.noise)
            found = fit(
                self.plant, self._law, [RecordedStep(y, simulator.recipe.dt, noise)], posterior
            )
            posterior = found.posterior
            checks += [found.chi_square[:, 0], found.distance]
        root = np.linalg.cholesky(posterior.covariance)
        drawn = rng.standard_normal((n, self._n_draws, root.shape[1]))
        deviates = posterior.mean[:, np.newaxis] + drawn @ np.swapaxes(root, 1, 2)
        theta = self.plant.theta_of(deviates.reshape(n * self._n_draws, -1))
        _, peaks = self.following.fly(theta, rng)
        parts = np.log(np.minimum(peaks, 1e6)).reshape(n, self._n_draws)
        return PeakPrediction(
            parts.mean(axis=1),
            np.maximum(parts.std(axis=1, ddof=1), LEAST_SCATTER),
            np.exp(np.quantile(parts, QUANTILES, axis=1, method="weibull").T),
            posterior,
            np.stack(checks, axis=1),
        )

    def amplitudes(self, theta: Array, rng: np.random.Generator) -> Array:
        """(n,) factor on the next point's amplitude with which these very flights reach a limit.

        Between 1 / WIDEST and WIDEST.   rng: left as it was.
        """
        low, high = np.full(len(theta), -log(WIDEST)), np.full(len(theta), log(WIDEST))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            _, peaks = self.following.fly(theta, deepcopy(rng), np.exp(middle))
            low, high = np.where(peaks < 1.0, middle, low), np.where(peaks < 1.0, high, middle)
        return np.exp(low)


@dataclass(frozen=True, eq=False)
class Clearance:
    """A calibrated rule for the next point of a build-up.

    n_tried: simulated aircraft among which those that exceed were found.   exceeding_share: share
    of all these that exceed a limit.
    scores, exceeds: (n,) of the identified ones, and whether they exceed a limit there.   drawn:
    (n,) whether they were identified whatever they do.   spare: (n,) logarithm of the amplitude
    that just reaches a limit over the one that was predicted to.   checks: (n, k) as of
    PeakPrediction.
    """

    points: BuildUp
    recipe: ClearanceRecipe
    n_tried: int
    exceeding_share: float
    scores: Array
    exceeds: Flags
    drawn: Flags
    spare: Array
    checks: Array

    @property
    def levels(self) -> Array:
        """(k,) what each check may reach; beyond it the clearance is withdrawn."""
        checks = self.checks[self.drawn]
        n, k = checks.shape
        rank = min(n, ceil((n + 1) * (1.0 - CHECK_LEVEL / k) - 1e-9))
        return np.sort(checks, axis=0)[rank - 1]

    @property
    def amplitude_spare(self) -> float | None:
        """Logarithm that a recommended amplitude keeps of the predicted one that reaches a limit.

        So that a flight at that amplitude exceeds in at most a share epsilon.
        """
        spare = np.sort(self.spare[self.drawn])
        rank = floor(self.recipe.epsilon * (len(spare) + 1) + 1e-9)
        return float(spare[rank - 1]) if rank else None

    @property
    def n_exceeding(self) -> int:
        """Of the aircraft that were tried."""
        return int(np.count_nonzero(self.exceeds))

    @property
    def is_rare(self) -> bool:
        """Whether hardly any aircraft exceeds."""
        return self.n_exceeding < self.recipe.n_exceeding

    def p_values(self, scores: Array) -> Array:
        """(n,) of scores, as if the point would exceed a limit: high means risk."""
        return p_values(-scores, np.sort(-self.scores[self.exceeds]))

    @property
    def clear_below(self) -> float:
        """What a p-value of a cleared point is at most."""
        recipe = self.recipe
        return alert_above(recipe.epsilon, self.n_exceeding, recipe.guarantee)

    def decide(self, records: Sequence[Array]) -> PointVerdict:
        """Say whether the next point is cleared.   records: (n_samples, 6) of each flown step, from
        trim.

        ClearanceError for records that are not of the flown steps' kind.
        """
        predictor = PointPredictor(self.points, self.recipe.n_draws)
        if len(records) != len(self.points.flown):
            raise ClearanceError(
                f"{len(records)} records were given: the build-up has {len(self.points.flown)} "
                "flown steps, give one of each"
            )
        for number, (y, step) in enumerate(zip(records, predictor.steps, strict=True), start=1):
            if y.ndim != 2 or y.shape[1] != 6 or not np.isfinite(y).all():
                raise ClearanceError(
                    f"the record of step {number} has shape {y.shape}: it needs (n_samples, 6) "
                    "without gaps, of all six channels"
                )
            expected = step.recipe.maneuver.n_samples(step.recipe.dt)
            if not 0.8 * expected <= len(y) <= 1.25 * expected:
                raise ClearanceError(
                    f"the record of step {number} has {len(y)} samples: the manoeuvre takes "
                    f"{expected} of {step.recipe.dt:g} s, give just these"
                )
        rng = stream(self.recipe.seed, Branch.CLEARANCE, 1)
        found = predictor.predict([y[np.newaxis] for y in records], rng)
        withdrawn = tuple(
            FailedCheck(words, value, level)
            for words, value, level in zip(
                predictor.checks, found.checks[0].tolist(), self.levels.tolist(), strict=True
            )
            if not value <= level
        )
        low, middle, high = found.quantiles[0].tolist()
        p_value = None if self.is_rare else float(self.p_values(found.score)[0])
        is_safe = high < 1.0 if p_value is None else p_value <= self.clear_below
        spare = self.amplitude_spare
        factor = None if spare is None else exp(spare - float(found.mean[0]))
        return PointVerdict(
            cleared=is_safe and not withdrawn,
            withdrawn=withdrawn,
            p_value=p_value,
            reached=(low, middle, high),
            amplitude_deg=None
            if factor is None or withdrawn
            else factor * self.points.following.maneuver.peak_deg,
            posterior=found.posterior,
        )


def calibrate(
    points: BuildUp, recipe: ClearanceRecipe, progress: Progress | None = None
) -> Clearance:
    """Find simulated aircraft that exceed at the next point; fly and identify them, and others.

    progress: called with (aircraft identified, aircraft to identify); what it raises cancels.
    ClearanceError where too few exceed, though they are not rare.
    """
    predictor = PointPredictor(points, recipe.n_draws)
    rng = stream(recipe.seed, Branch.CLEARANCE, 0)
    n_wanted = recipe.n_aircraft + recipe.n_exceeding
    chosen: list[tuple[Array, Flags, Flags]] = []
    n_tried = n_exceeding = n_met = 0
    while n_tried < MOST_AIRCRAFT and n_exceeding < recipe.n_exceeding:
        if progress:
            progress(0, n_wanted)
        theta = predictor.plant.sample(DRAWN_AT_ONCE, rng)
        exceeds = predictor.following.fly(theta, rng)[0].is_unsafe
        drawn = n_tried + np.arange(DRAWN_AT_ONCE) < recipe.n_aircraft
        last = np.searchsorted(np.cumsum(exceeds), recipe.n_exceeding - n_exceeding) + 1
        kept = drawn | (exceeds & (np.arange(DRAWN_AT_ONCE) < last))
        chosen.append((theta[kept], exceeds[kept], drawn[kept]))
        n_exceeding += int(np.count_nonzero(exceeds[kept]))
        n_met += int(np.count_nonzero(exceeds))
        n_tried += DRAWN_AT_ONCE
    if n_exceeding < recipe.n_exceeding and n_exceeding > RARE * n_tried:
        raise ClearanceError(
            f"{n_exceeding} of {n_tried} simulated aircraft would exceed a limit at the next "
            f"point: {recipe.n_exceeding} of them are out of reach, ask for fewer"
        )
    theta, exceeds, drawn = (np.concatenate(parts) for parts in zip(*chosen, strict=True))
    parts: list[tuple[Array, Array, Array]] = []
    for first in range(0, len(theta), BATCH):
        some = theta[first : first + BATCH]
        reach = np.log(predictor.amplitudes(some, rng))
        found = predictor.predict([step.fly(some, rng)[0].y for step in predictor.steps], rng)
        parts.append((found.score, reach + found.mean, found.checks))
        if progress:
            progress(min(first + BATCH, len(theta)), len(theta))
    scores, spare, checks = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Clearance(
        points, recipe, n_tried, n_met / n_tried, scores, exceeds, drawn, spare, checks
    )
