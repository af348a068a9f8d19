"""Clearance of the next point of a build-up, with a guarantee, from the points flown before it.

Steps at smaller amplitudes identify the aircraft. The posterior predicts the next point's peak,
given the remaining uncertainty of the aircraft and the pilot's scatter. Conformal prediction turns
this into a p-value: simulated aircraft that exceed a limit at the next point are flown and
identified in the same way. At most a share epsilon of the points that would exceed is cleared. The
guarantee holds for aircraft of D_theta and flights like the simulated ones; checks of the fit
withdraw the clearance for others.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import ceil, exp, floor, log
from typing import Annotated, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.clearance.joint_model import Law
from core.clearance.posterior import PlantPosterior, RecordedStep, fit, prior_of
from core.monitor.calibration import Guarantee, alert_above, failures_needed, p_values
from core.planned_test.planned_test import DatasetRecipe, Simulator
from core.seeds import Branch, stream
from core.simulation.imperfections import channel_array
from core.types import Array, Flags

Progress = Callable[[int, int], object]

BATCH, DRAWN_AT_ONCE = 100, 1_000
"""Aircraft identified at a time, and aircraft tested at a time for exceedance."""
MOST_AIRCRAFT = 20_000
"""Largest number of aircraft tested."""
RARE = 0.01
"""If fewer aircraft than this share exceed, the prediction alone decides on a point without failed
checks."""
LEAST_SCATTER = 1e-6
WIDEST, HALVINGS = 4.0, 14
"""The amplitude that just reaches a limit is searched within this factor of the next point's, by
this many bisections."""
CHECK_LEVEL = 0.05
"""Share of aircraft of D_theta, flown as simulated, whose clearance the checks withdraw."""
QUANTILES = (0.05, 0.5, 0.95)


class ClearanceError(ValueError):
    """Steps and a next point without a possible calibration."""


@dataclass(frozen=True)
class ClearanceRecipe:
    """How a clearance is calibrated."""

    epsilon: Annotated[float, Bounds(above=0, below=1)] = 0.05
    """wrong clearances: accepted share of the points that would exceed a limit."""
    guarantee: Guarantee = "average"
    """promise on wrong clearances: on `average` over many calibrations, or for this one with `95%`
    confidence."""
    n_exceeding: Annotated[int, Bounds(least=20)] = 200
    """exceeding aircraft: simulated ones that exceed a limit at the next point."""
    n_aircraft: Annotated[int, Bounds(least=100)] = 400
    """aircraft: simulated ones, exceeding or not, that calibrate the checks and the recommended
    amplitude."""
    n_draws: Annotated[int, Bounds(least=8)] = 64
    """draws: simulated flights of the next point in each prediction."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if (needed := failures_needed(self.epsilon, self.guarantee)) > self.n_exceeding:
            raise ValueError(
                f"epsilon={self.epsilon:g} was given with {self.n_exceeding} exceeding aircraft: "
                f"it needs at least {needed}"
            )


@dataclass(frozen=True)
class BuildUp:
    """The flown points of a build-up, in order, and the next one.

    All share one aircraft, control law, limits and sample interval; ClearanceError otherwise.
    """

    flown: tuple[DatasetRecipe, ...]
    following: DatasetRecipe

    def __post_init__(self) -> None:
        if not self.flown:
            raise ClearanceError("no flown step was given: a clearance needs at least one")
        for step in self.flown:
            for part in ("aircraft", "control_law", "specification", "dt"):
                if getattr(step, part) != getattr(self.following, part):
                    raise ClearanceError(
                        f"the {part} of a flown step differs from that of the next point: all "
                        "points of a build-up share one aircraft, control law, limits and sample "
                        "interval"
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
    """Predicted peak of the next point for n aircraft.

    mean, deviation: (n,) of the logarithm of the part of a limit.   quantiles: (n, 3) parts, at
    QUANTILES.   posterior: of deviates.   checks: (n, k) mean squares that a wrong model or wrong
    noise makes large.
    """

    mean: Array
    deviation: Array
    quantiles: Array
    posterior: PlantPosterior
    checks: Array

    @property
    def score(self) -> Array:
        """(n,) distance beyond the limit, in deviations: high means danger."""
        return self.mean / self.deviation


class FailedCheck(NamedTuple):
    """A check beyond its calibrated level."""

    words: str
    value: float
    level: float


class PointVerdict(NamedTuple):
    """The verdict on the next point.

    cleared: whether it may be flown under the guarantee.   withdrawn: failed checks, which void the
    guarantee; such a point is never cleared.   p_value: high means risk; None where so few aircraft
    exceed that the prediction alone decides.   reached: predicted part of a limit, at QUANTILES.
    amplitude_deg: largest recommended amplitude, under its own guarantee; None without one.
    posterior: of this aircraft's deviates.
    """

    cleared: bool
    withdrawn: tuple[FailedCheck, ...]
    p_value: float | None
    reached: tuple[float, float, float]
    amplitude_deg: float | None
    posterior: PlantPosterior


class PointPredictor:
    """Identifies aircraft from the flown steps and predicts the peak of the next point."""

    def __init__(self, points: BuildUp, n_draws: int) -> None:
        self._n_draws = n_draws
        self.steps = [Simulator(step) for step in points.flown]
        self.following = Simulator(points.following)
        law = points.following.control_law
        self._law = Law(self.following.controller, law.actuator)
        self.plant = self.following.plant

    @property
    def checks(self) -> tuple[str, ...]:
        words: list[str] = []
        for number in range(1, len(self.steps) + 1):
            of = f"step {number}" if len(self.steps) > 1 else "the flown step"
            words.append(f"residuals of {of} exceed the noise")
            words.append(
                f"{of} disagrees with the steps before it: the aircraft may be nonlinear"
                if number > 1
                else f"{of} is far from the expected aircraft"
            )
        return tuple(words)

    def predict(self, records: Sequence[Array], rng: np.random.Generator) -> PeakPrediction:
        """Identify n aircraft and predict.   records: (n, n_samples, 6) of each step."""
        n = len(records[0])
        posterior, checks = prior_of(self.plant, n), []
        for simulator, y in zip(self.steps, records, strict=True):
            noise = channel_array(simulator.recipe.noise)
            step = RecordedStep(y, simulator.recipe.dt, noise)
            fitted = fit(self.plant, self._law, [step], posterior)
            posterior = fitted.posterior
            checks += [fitted.chi_square[:, 0], fitted.distance]
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
        """(n,) factor on the next point's amplitude at which these flights just reach a limit.

        Between 1 / WIDEST and WIDEST.   rng: not advanced.
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

    n_tried: simulated aircraft tested for exceedance.   exceeding_share: share of them that exceed
    a limit.   scores, exceeds: (n,) of the identified aircraft, and whether they exceed.
    drawn: (n,) whether they were identified regardless of exceedance.   spare: (n,) logarithm of
    the amplitude that just reaches a limit over the predicted one.   checks: (n, k) as in
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
        """(k,) level of each check, beyond which the clearance is withdrawn."""
        checks = self.checks[self.drawn]
        n, k = checks.shape
        rank = min(n, ceil((n + 1) * (1.0 - CHECK_LEVEL / k) - 1e-9))
        return np.sort(checks, axis=0)[rank - 1]

    @property
    def amplitude_spare(self) -> float | None:
        """Logarithm of the recommended amplitude over the one predicted to reach a limit.

        At the recommended amplitude at most a share epsilon of flights exceeds a limit.
        """
        spare = np.sort(self.spare[self.drawn])
        rank = floor(self.recipe.epsilon * (len(spare) + 1) + 1e-9)
        return float(spare[rank - 1]) if rank else None

    @property
    def n_exceeding(self) -> int:
        """Number of identified aircraft that exceed a limit."""
        return int(np.count_nonzero(self.exceeds))

    @property
    def is_rare(self) -> bool:
        """Whether fewer aircraft exceed a limit than the recipe asks for."""
        return self.n_exceeding < self.recipe.n_exceeding

    def p_values(self, scores: Array) -> Array:
        """(n,) p-value of each score among aircraft that exceed: high means risk."""
        return p_values(-scores, np.sort(-self.scores[self.exceeds]))

    @property
    def clear_below(self) -> float:
        """Largest p-value of a cleared point."""
        recipe = self.recipe
        return alert_above(recipe.epsilon, self.n_exceeding, recipe.guarantee)

    def decide(self, records: Sequence[Array]) -> PointVerdict:
        """Decide on the next point.   records: (n_samples, 6) of each flown step, from trim.

        ClearanceError for records that do not fit the flown steps.
        """
        predictor = PointPredictor(self.points, self.recipe.n_draws)
        if len(records) != len(self.points.flown):
            raise ClearanceError(
                f"{len(records)} records were given: the build-up has {len(self.points.flown)} "
                "flown steps, give one for each"
            )
        for number, (y, step) in enumerate(zip(records, predictor.steps, strict=True), start=1):
            if y.ndim != 2 or y.shape[1] != 6 or not np.isfinite(y).all():
                raise ClearanceError(
                    f"the record of step {number} has shape {y.shape}: it needs (n_samples, 6) "
                    "without gaps, all six channels"
                )
            expected = step.recipe.maneuver.n_samples(step.recipe.dt)
            if not 0.8 * expected <= len(y) <= 1.25 * expected:
                raise ClearanceError(
                    f"the record of step {number} has {len(y)} samples: the manoeuvre takes "
                    f"{expected} of {step.recipe.dt:g} s, give exactly the manoeuvre"
                )
        rng = stream(self.recipe.seed, Branch.CLEARANCE, 1)
        prediction = predictor.predict([y[np.newaxis] for y in records], rng)
        withdrawn = tuple(
            FailedCheck(words, value, level)
            for words, value, level in zip(
                predictor.checks, prediction.checks[0].tolist(), self.levels.tolist(), strict=True
            )
            if not value <= level
        )
        low, middle, high = prediction.quantiles[0].tolist()
        p_value = None if self.is_rare else float(self.p_values(prediction.score)[0])
        is_safe = high < 1.0 if p_value is None else p_value <= self.clear_below
        spare = self.amplitude_spare
        factor = None if spare is None else exp(spare - float(prediction.mean[0]))
        return PointVerdict(
            cleared=is_safe and not withdrawn,
            withdrawn=withdrawn,
            p_value=p_value,
            reached=(low, middle, high),
            amplitude_deg=None
            if factor is None or withdrawn
            else factor * self.points.following.maneuver.peak_deg,
            posterior=prediction.posterior,
        )


def calibrate(
    points: BuildUp, recipe: ClearanceRecipe, progress: Progress | None = None
) -> Clearance:
    """Find simulated aircraft that exceed a limit at the next point; identify them and others.

    progress: called with (aircraft identified, aircraft to identify); an exception cancels.
    ClearanceError if too few exceed, but more than RARE.
    """
    predictor = PointPredictor(points, recipe.n_draws)
    rng = stream(recipe.seed, Branch.CLEARANCE, 0)
    n_wanted = recipe.n_aircraft + recipe.n_exceeding
    samples: list[tuple[Array, Flags, Flags]] = []
    n_tried = n_exceeding = n_met = 0
    while n_tried < MOST_AIRCRAFT and n_exceeding < recipe.n_exceeding:
        if progress:
            progress(0, n_wanted)
        theta = predictor.plant.sample(DRAWN_AT_ONCE, rng)
        exceeds = predictor.following.fly(theta, rng)[0].is_unsafe
        drawn = n_tried + np.arange(DRAWN_AT_ONCE) < recipe.n_aircraft
        last = np.searchsorted(np.cumsum(exceeds), recipe.n_exceeding - n_exceeding) + 1
        kept = drawn | (exceeds & (np.arange(DRAWN_AT_ONCE) < last))
        samples.append((theta[kept], exceeds[kept], drawn[kept]))
        n_exceeding += int(np.count_nonzero(exceeds[kept]))
        n_met += int(np.count_nonzero(exceeds))
        n_tried += DRAWN_AT_ONCE
    if n_exceeding < recipe.n_exceeding and n_exceeding > RARE * n_tried:
        raise ClearanceError(
            f"{n_exceeding} of {n_tried} simulated aircraft would exceed a limit at the next "
            f"point: {recipe.n_exceeding} are out of reach, lower n_exceeding"
        )
    theta, exceeds, drawn = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    parts: list[tuple[Array, Array, Array]] = []
    for first in range(0, len(theta), BATCH):
        batch = theta[first : first + BATCH]
        reach = np.log(predictor.amplitudes(batch, rng))
        prediction = predictor.predict([step.fly(batch, rng)[0].y for step in predictor.steps], rng)
        parts.append((prediction.score, reach + prediction.mean, prediction.checks))
        if progress:
            progress(min(first + BATCH, len(theta)), len(theta))
    scores, spare, checks = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Clearance(
        points, recipe, n_tried, n_met / n_tried, scores, exceeds, drawn, spare, checks
    )
