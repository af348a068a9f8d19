"""Clearance of the next point of a build-up, with a guarantee, from the points flown before it.

Steps at smaller amplitudes identify the aircraft. The posterior predicts the next point's peak,
given the remaining uncertainty of the aircraft and the pilot's scatter. Conformal prediction turns
this into a p-value: simulated aircraft are flown and identified in the same way, and each counts
with the share of its flights of the next point that exceed a limit. At most a share epsilon of the
points that would exceed is cleared. The guarantee holds for aircraft of D_theta and flights like
the simulated ones; checks of the fit withdraw the clearance for others.

The p-value is that of weighted conformal prediction (Tibshirani, Foygel Barber, Candes and Ramdas
2019, "Conformal Prediction Under Covariate Shift"): D_theta weighted by the share that exceeds is
the distribution of the aircraft that exceed. All predictions use the same random draws, so these
draws barely change the order of the scores.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from copy import deepcopy
from dataclasses import dataclass
from math import ceil, exp, floor, log
from typing import Annotated, Any, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.clearance.by_rollouts import PeakRegression
from core.clearance.joint_model import Law
from core.clearance.posterior import PlantPosterior, RecordedStep, fit, prior_of
from core.monitor.calibration import Guarantee, alert_above, failures_needed
from core.planned_test.planned_test import DatasetRecipe, Replans
from core.seeds import Branch, stream
from core.simulation.imperfections import channel_array
from core.tasks import Tasks
from core.types import Array

Progress = Callable[[int, int], object]

BATCH = 100
"""Aircraft tested and identified at a time."""
FLIGHTS = 8
"""Flights of the next point by each aircraft tested for exceedance."""
N_LEARNED = 1_000
"""Simulated aircraft that train a prediction by flights alone; they calibrate nothing."""
SHARED = "aircraft", "condition", "control_law", "pitch_law", "specification", "dt"
"""Parts of a test that are the same at all points of a build-up."""
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
    """exceeding aircraft: least number of simulated ones that exceed a limit at the next point; an
    aircraft counts with the share of its flights that exceed."""
    n_aircraft: Annotated[int, Bounds(least=100)] = 1_000
    """aircraft: least number of simulated ones, exceeding or not; more of them make the p-value
    more precise."""
    n_draws: Annotated[int, Bounds(least=8)] = 128
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
    """The flown points of a build-up, in order, and the next one, each a ManeuverTest.

    All share SHARED; ClearanceError otherwise.
    """

    flown: tuple[Any, ...]
    following: Any

    def __post_init__(self) -> None:
        if not self.flown:
            raise ClearanceError("no flown step was given: a clearance needs at least one")
        if self.following.simulator().crew is not None:
            raise ClearanceError(
                "a clearance is computed for planned inputs alone, and a pilot in the loop flies "
                "the next point: choose the pilot open_loop"
            )
        for step in self.flown:
            for part in SHARED:
                if getattr(step, part, None) != getattr(self.following, part, None):
                    raise ClearanceError(
                        f"the {part} of a flown step differs from that of the next point: all "
                        "points of a build-up share one aircraft, flight condition, control law, "
                        "limits and sample interval"
                    )


class PeakPrediction(NamedTuple):
    """Predicted peak of the next point for n aircraft.

    mean, deviation: (n,) of the logarithm of the part of a limit.   quantiles: (n, 3) parts, at
    QUANTILES.   checks: (n, k) mean squares that a wrong model or wrong noise makes large.
    posterior: of deviates; None where the aircraft is not identified.
    """

    mean: Array
    deviation: Array
    quantiles: Array
    checks: Array
    posterior: PlantPosterior | None = None

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
    exceed that the prediction alone decides.   p_error: its standard error over other random draws.
    reached: predicted part of a limit, at QUANTILES.
    amplitude_deg: largest recommended amplitude, under its own guarantee; None without one.
    """

    cleared: bool
    withdrawn: tuple[FailedCheck, ...]
    p_value: float | None
    p_error: float | None
    reached: tuple[float, float, float]
    amplitude_deg: float | None


class PeakPredictor(ABC):
    """Predicts the peak of the next point from the flown steps."""

    def __init__(self, points: BuildUp, recipe: ClearanceRecipe) -> None:
        self._recipe = recipe
        self.steps = [step.simulator() for step in points.flown]
        self.following = points.following.simulator()

    @property
    @abstractmethod
    def checks(self) -> tuple[str, ...]:
        """Meaning of each check of a prediction, if it fails."""

    @abstractmethod
    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Theta (n, n_parameters) of aircraft that can be flown."""

    @abstractmethod
    def predict(self, records: Sequence[Array]) -> PeakPrediction:
        """records: (n, n_samples, n_channels) of each step by n aircraft."""

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

    def identified(self, theta: Array, first: int) -> tuple[Array, Array, Array]:
        """Fly these aircraft, identify and predict them.   first: number of the first one.

        Returns score (n,), spare amplitude (n,) and checks (n, k), see Clearance.
        """
        rng = stream(self._recipe.seed, Branch.CLEARANCE, 0, first)
        reach = np.log(self.amplitudes(theta, rng))
        prediction = self.predict([step.fly(theta, rng)[0].y for step in self.steps])
        return prediction.score, reach + prediction.mean, prediction.checks

    def words(self, number: int) -> str:
        """A flown step, by its number from 1."""
        return f"step {number}" if len(self.steps) > 1 else "the flown step"


class RolloutPredictor(PeakPredictor):
    """Predicts by a regression over flights of simulated aircraft, for any simulator."""

    def __init__(self, points: BuildUp, recipe: ClearanceRecipe) -> None:
        super().__init__(points, recipe)
        rng = stream(recipe.seed, Branch.CLEARANCE, 5)
        flights, limits = self.following, self.following.limits
        theta = self.sample(N_LEARNED, rng)
        records = [step.fly(theta, rng)[0].y for step in self.steps]
        _, peaks = flights.fly(theta, rng)
        self._regression = PeakRegression.fit(records, np.log(np.minimum(peaks, 1e6)), limits)

    @property
    def checks(self) -> tuple[str, ...]:
        return tuple(
            f"{self.words(number)} is unlike those of simulated aircraft"
            f"{', or disagrees with the steps before it' if number > 1 else ''}"
            for number in range(1, len(self.steps) + 1)
        )

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        return self.following.rollouts(n, rng).theta

    def predict(self, records: Sequence[Array]) -> PeakPrediction:
        mean, checks = self._regression.predict(records)
        off = self._regression.residuals
        deviation = np.full(len(mean), max(float(off.std()), LEAST_SCATTER))
        quantiles = np.exp(mean[:, np.newaxis] + np.quantile(off, QUANTILES, method="weibull"))
        return PeakPrediction(mean, deviation, quantiles, checks)


class PointPredictor(PeakPredictor):
    """Identifies linear aircraft from the flown steps and predicts the peak of the next point.

    All aircraft are predicted with the same draws of deviates, pilots and gusts.
    """

    def __init__(self, points: BuildUp, recipe: ClearanceRecipe) -> None:
        super().__init__(points, recipe)
        test = points.following
        assert isinstance(test, DatasetRecipe)
        simulator = test.simulator()
        self.plant, self._law = (
            simulator.plant,
            Law(simulator.controller, test.control_law.actuator),
        )
        self._deviates = self._stream().standard_normal((recipe.n_draws, self.plant.root.shape[1]))

    @property
    def checks(self) -> tuple[str, ...]:
        words: list[str] = []
        for number in range(1, len(self.steps) + 1):
            of = self.words(number)
            words.append(f"residuals of {of} exceed the noise")
            words.append(
                f"{of} disagrees with the steps before it: the aircraft may be nonlinear"
                if number > 1
                else f"{of} is far from the expected aircraft"
            )
        return tuple(words)

    def _stream(self) -> np.random.Generator:
        return stream(self._recipe.seed, Branch.CLEARANCE, 1)

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        return self.plant.sample(n, rng)

    def predict(self, records: Sequence[Array]) -> PeakPrediction:
        """Identify n aircraft and predict.   records: (n, n_samples, 6) of each step."""
        n = len(records[0])
        posterior, checks = prior_of(self.plant, n), []
        for simulator, y in zip(self.steps, records, strict=True):
            step = RecordedStep(y, simulator.dt, channel_array(simulator.test.noise))
            fitted = fit(self.plant, self._law, [step], posterior)
            posterior = fitted.posterior
            checks += [fitted.chi_square[:, 0], fitted.distance]
        roots = np.linalg.cholesky(posterior.covariance)
        peaks = [
            self.following.fly(self.plant.theta_of(mean + self._deviates @ root.T), self._stream())
            for mean, root in zip(posterior.mean, roots, strict=True)
        ]
        parts = np.log(np.minimum([peak for _, peak in peaks], 1e6))
        return PeakPrediction(
            parts.mean(axis=1),
            np.maximum(parts.std(axis=1, ddof=1), LEAST_SCATTER),
            np.exp(np.quantile(parts, QUANTILES, axis=1, method="weibull").T),
            np.stack(checks, axis=1),
            posterior,
        )


def predictor_of(points: BuildUp, recipe: ClearanceRecipe) -> PeakPredictor:
    """The predictor that identifies the aircraft where it can, else one of simulated flights."""
    can_identify = isinstance(points.following.simulator(), Replans)
    return (PointPredictor if can_identify else RolloutPredictor)(points, recipe)


@dataclass(frozen=True, eq=False)
class Clearance:
    """A calibrated rule for the next point of a build-up.

    predictor: calibrated.   n_tried: simulated aircraft tested for exceedance.   scores, exceeding:
    (n,) of the identified aircraft, and the share of their flights of the next point that exceed a
    limit; it is 0 for all others.   spare: (n_aircraft,) logarithm of the amplitude that just
    reaches a limit over the predicted one, of the first aircraft.   checks: (n_aircraft, k) as in
    PeakPrediction, of these.
    """

    predictor: PeakPredictor
    points: BuildUp
    recipe: ClearanceRecipe
    n_tried: int
    scores: Array
    exceeding: Array
    spare: Array
    checks: Array

    @property
    def levels(self) -> Array:
        """(k,) level of each check, beyond which the clearance is withdrawn."""
        n, k = self.checks.shape
        rank = min(n, ceil((n + 1) * (1.0 - CHECK_LEVEL / k) - 1e-9))
        return np.sort(self.checks, axis=0)[rank - 1]

    @property
    def amplitude_spare(self) -> float | None:
        """Logarithm of the recommended amplitude over the one predicted to reach a limit.

        At the recommended amplitude at most a share epsilon of flights exceeds a limit.
        """
        rank = floor(self.recipe.epsilon * (len(self.spare) + 1) + 1e-9)
        return float(np.sort(self.spare)[rank - 1]) if rank else None

    @property
    def n_exceeding(self) -> int:
        """Number of aircraft that exceed a limit, each counted by the share of its flights."""
        return int(self.exceeding.sum())

    @property
    def exceeding_share(self) -> float:
        """Share of the aircraft tested that exceed a limit."""
        return float(self.exceeding.sum()) / self.n_tried

    @property
    def is_rare(self) -> bool:
        """Whether fewer aircraft exceed a limit than the recipe asks for."""
        return self.n_exceeding < self.recipe.n_exceeding

    def p_values(self, scores: Array) -> Array:
        """(n,) p-value of each score among aircraft that exceed: high means risk."""
        return (1.0 + self._no_higher(scores, self.exceeding)) / (1.0 + self.exceeding.sum())

    def p_errors(self, scores: Array) -> Array:
        """(n,) standard error of each p-value over other simulated aircraft."""
        p, squares = self.p_values(scores), np.square(self.exceeding)
        low = self._no_higher(scores, squares)
        variance = low * np.square(1.0 - p) + (squares.sum() - low) * np.square(p)
        return np.sqrt(variance) / (1.0 + self.exceeding.sum())

    def _no_higher(self, scores: Array, weights: Array) -> Array:
        """(n,) sum of the weights of the identified aircraft with no higher score."""
        order = np.argsort(self.scores)
        sums = np.concatenate([[0.0], np.cumsum(weights[order])])
        return sums[np.searchsorted(self.scores[order], scores, side="right")]

    @property
    def clear_below(self) -> float:
        """Largest p-value of a cleared point."""
        recipe = self.recipe
        return alert_above(recipe.epsilon, self.n_exceeding, recipe.guarantee)

    def decide(self, records: Sequence[Array], clear_below: float | None = None) -> PointVerdict:
        """Decide on the next point.   records: (n_samples, n_channels) of each flown step, from
        trim.

        clear_below: largest p-value of a cleared point; None for that of the recipe's promise.
        ClearanceError for records that do not fit the flown steps.
        """
        predictor = self.predictor
        if len(records) != len(self.points.flown):
            raise ClearanceError(
                f"{len(records)} records were given: the build-up has {len(self.points.flown)} "
                "flown steps, give one for each"
            )
        for number, (y, step) in enumerate(zip(records, predictor.steps, strict=True), start=1):
            n_channels = len(step.dictionary)
            if y.ndim != 2 or y.shape[1] != n_channels or not np.isfinite(y).all():
                raise ClearanceError(
                    f"the record of step {number} has shape {y.shape}: it needs (n_samples, "
                    f"{n_channels}) without gaps, all channels"
                )
            expected = step.test.maneuver.n_samples(step.dt)
            if not 0.8 * expected <= len(y) <= 1.25 * expected:
                raise ClearanceError(
                    f"the record of step {number} has {len(y)} samples: the manoeuvre takes "
                    f"{expected} of {step.dt:g} s, give exactly the manoeuvre"
                )
        prediction = predictor.predict([y[np.newaxis] for y in records])
        withdrawn = tuple(
            FailedCheck(words, value, level)
            for words, value, level in zip(
                predictor.checks, prediction.checks[0].tolist(), self.levels.tolist(), strict=True
            )
            if not value <= level
        )
        low, middle, high = prediction.quantiles[0].tolist()
        p_value = p_error = None
        if not self.is_rare:
            p_value = float(self.p_values(prediction.score)[0])
            p_error = float(self.p_errors(prediction.score)[0])
        if p_value is None:
            is_safe = high < 1.0
        else:
            is_safe = p_value <= (self.clear_below if clear_below is None else clear_below)
        spare = self.amplitude_spare
        factor = None if spare is None else exp(spare - float(prediction.mean[0]))
        return PointVerdict(
            cleared=is_safe and not withdrawn,
            withdrawn=withdrawn,
            p_value=p_value,
            p_error=p_error,
            reached=(low, middle, high),
            amplitude_deg=None
            if factor is None or withdrawn
            else factor * self.points.following.maneuver.peak_deg,
        )


def calibrate(
    points: BuildUp,
    recipe: ClearanceRecipe,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Clearance:
    """Fly simulated aircraft at the next point; identify the first ones and all that exceed there.

    executor: see Tasks.
    progress: called with (aircraft flown, about how many there will be), each tested for exceedance
    and then those to identify; an exception cancels.
    ClearanceError if too few exceed, but more than RARE.
    """
    predictor = predictor_of(points, recipe)
    rng = stream(recipe.seed, Branch.CLEARANCE, 0)
    tried: list[tuple[Array, Array]] = []
    n_tried, n_exceeding = 0, 0.0
    while n_tried < recipe.n_aircraft or (
        n_tried < MOST_AIRCRAFT and n_exceeding < recipe.n_exceeding
    ):
        if progress:
            needed = n_tried * recipe.n_exceeding / max(n_exceeding, 1.0)
            tested = min(max(round(needed), recipe.n_aircraft), MOST_AIRCRAFT)
            progress(n_tried, tested + recipe.n_aircraft + recipe.n_exceeding)
        theta = predictor.sample(BATCH, rng)
        flights, _ = predictor.following.fly(np.repeat(theta, FLIGHTS, axis=0), rng)
        exceeding = flights.is_unsafe.reshape(BATCH, FLIGHTS).mean(axis=1)
        is_used = (n_tried + np.arange(BATCH) < recipe.n_aircraft) | (exceeding > 0.0)
        tried.append((theta[is_used], exceeding[is_used]))
        n_exceeding += float(exceeding.sum())
        n_tried += BATCH
    if n_exceeding < recipe.n_exceeding and n_exceeding > RARE * n_tried:
        raise ClearanceError(
            f"{n_exceeding:.0f} of {n_tried} simulated aircraft would exceed a limit at the next "
            f"point: {recipe.n_exceeding} are out of reach, lower n_exceeding"
        )
    theta, exceeding = (np.concatenate(parts) for parts in zip(*tried, strict=True))

    starts = range(0, len(theta), BATCH)
    batches = [(theta[first : first + BATCH], first) for first in starts]
    parts: list[tuple[Array, Array, Array]] = []
    with Tasks(executor) as tasks:
        for part in tasks.results(predictor.identified, batches):
            parts.append(part)
            if progress:
                done = min(len(parts) * BATCH, len(theta))
                progress(n_tried + done, n_tried + len(theta))
    scores, spare, checks = (np.concatenate(part) for part in zip(*parts, strict=True))
    first = slice(recipe.n_aircraft)
    return Clearance(
        predictor, points, recipe, n_tried, scores, exceeding, spare[first], checks[first]
    )
