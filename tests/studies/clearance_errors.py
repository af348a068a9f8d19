"""Clearance under model errors: wrong clearances, and errors that its checks detect."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS
from core.clearance.clearance import (
    BATCH,
    Clearance,
    ClearanceRecipe,
    PointPredictor,
    calibrate,
)
from core.clearance.joint_model import Law, SurfaceMotion, joint_flow
from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator, SensorNoise
from core.seeds import Branch, stream
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import NoFeedback
from core.types import Array, Flags
from tests.studies.study_command import Progress, run_study
from tests.support.build_up import build_up

Recipe = Callable[[DatasetRecipe], DatasetRecipe]

SOFT_SIDESLIP = 0.1
"""[rad] Above this sideslip the yaw stiffness of a nonlinear aircraft stays constant."""
SUBSTEPS = 10
"""Runge-Kutta steps per sample of a nonlinear aircraft."""


def _same(recipe: DatasetRecipe) -> DatasetRecipe:
    return recipe


def _with_bank(recipe: DatasetRecipe) -> DatasetRecipe:
    aircraft = recipe.aircraft
    assert isinstance(aircraft, PublishedAircraft)
    return replace(recipe, aircraft=replace(aircraft, n_states=4))


def _actuators(bandwidth_rad_s: float) -> Recipe:
    def changed(recipe: DatasetRecipe) -> DatasetRecipe:
        law = recipe.control_law
        actuator = replace(law.actuator, bandwidth_rad_s=bandwidth_rad_s)
        return replace(recipe, control_law=replace(law, actuator=actuator))

    return changed


def _noisier(recipe: DatasetRecipe) -> DatasetRecipe:
    doubled = {key: 2.0 * sigma for key, sigma in asdict(recipe.noise).items()}
    return replace(recipe, noise=SensorNoise(**doubled))


def _rougher(recipe: DatasetRecipe) -> DatasetRecipe:
    maneuver = recipe.maneuver
    return replace(
        recipe, maneuver=replace(maneuver, amplitude_jitter=2.0 * maneuver.amplitude_jitter)
    )


def _without_law(recipe: DatasetRecipe) -> DatasetRecipe:
    return replace(recipe, control_law=NoFeedback(actuator=recipe.control_law.actuator))


@dataclass(frozen=True)
class ModelError:
    """A difference between the aircraft, or its next flight, and the model.

    step, following: change of the planned test, for each flown step and for the next point.
    shift: relative offset of derivatives from D_theta's mean, by name.   spread: factor on the
    width of D_theta.   reads: factor of a recorded channel, by key.   softening: share of the yaw
    stiffness N_beta lost at SOFT_SIDESLIP, growing with the square of sideslip.
    """

    words: str
    step: Recipe = _same
    following: Recipe = _same
    shift: tuple[tuple[str, float], ...] = ()
    spread: float = 1.0
    reads: tuple[tuple[str, float], ...] = ()
    softening: float = 0.0


MODEL_ERRORS = (
    ModelError("as modelled"),
    ModelError("yaw stiffness falls by 20 % with sideslip", softening=0.2),
    ModelError("yaw stiffness falls by 30 % with sideslip", softening=0.3),
    ModelError("yaw stiffness grows by 30 % with sideslip", softening=-0.3),
    ModelError("bank angle acts but is not modelled", _with_bank, _with_bank),
    ModelError("actuators of 10 rad/s", _actuators(10.0), _actuators(10.0)),
    ModelError("actuators of 40 rad/s", _actuators(40.0), _actuators(40.0)),
    ModelError("N_beta 30 % off", shift=(("N_beta", -0.3),)),
    ModelError("N_dr 30 % off", shift=(("N_dr", 0.3),)),
    ModelError("derivatives scatter twice as far", spread=2.0),
    ModelError("noise twice as large", _noisier),
    ModelError("sideslip reads 0.8", reads=(("beta", 0.8),)),
    ModelError("N_y reads 0.85", reads=(("Ny", 0.85),)),
    ModelError("rudder reads 1.1", reads=(("delta_r", 1.1),)),
    ModelError("pilot of the next point twice as rough", following=_rougher),
    ModelError("law switched off at the next point", following=_without_law),
)


@dataclass(frozen=True)
class ErrorTableRecipe:
    """The planned tests of the table and the size of each clearance."""

    tests: tuple[str, ...] = tuple(TESTS)
    """planned tests: by name."""
    steps: tuple[float, ...] = (0.6,)
    """flown steps: shares of the planned amplitude."""
    epsilon: Annotated[float, Bounds(above=0, below=1)] = 0.05
    """accepted share of wrong clearances."""
    n_exceeding: Annotated[int, Bounds(least=20)] = 200
    """exceeding aircraft for calibrating each clearance."""
    n_aircraft: Annotated[int, Bounds(least=100)] = 400
    """aircraft for calibrating its checks, and for flying each error."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if unknown := [name for name in self.tests if name not in TESTS]:
            raise ValueError(f"planned test {unknown[0]!r} was given: choose {', '.join(TESTS)}")


class ErrorRow(NamedTuple):
    """Counts of aircraft with one error.   wrongly: exceeding ones that the prediction clears;
    wrongly_unflagged: those of them without a failed check."""

    test: str
    error: str
    n_exceed: int
    wrongly: int
    wrongly_unflagged: int
    n_safe: int
    safe_cleared: int
    flagged: int


def error_table(recipe: ErrorTableRecipe, progress: Progress | None = None) -> Iterator[ErrorRow]:
    """Each error on each planned test.   progress: called with (rows done, rows)."""
    total = len(recipe.tests) * len(MODEL_ERRORS)
    for of_test, name in enumerate(recipe.tests):
        points = build_up(TESTS[name], recipe.steps)
        rule = calibrate(
            points,
            ClearanceRecipe(
                epsilon=recipe.epsilon,
                n_exceeding=recipe.n_exceeding,
                n_aircraft=recipe.n_aircraft,
                seed=recipe.seed,
            ),
        )
        for number, error in enumerate(MODEL_ERRORS):
            if progress:
                progress(of_test * len(MODEL_ERRORS) + number, total)
            rng = stream(recipe.seed, Branch.CLEARANCE, 2, of_test, number)
            yield _row(name, error, rule, recipe.n_aircraft, rng)


def _row(
    name: str, error: ModelError, rule: Clearance, n: int, rng: np.random.Generator
) -> ErrorRow:
    """Fly and identify n aircraft with an error, as if they had none."""
    predictor = PointPredictor(rule.points, rule.recipe)
    steps = [_Truth(step, error, error.step) for step in rule.points.flown]
    following = _Truth(rule.points.following, error, error.following)
    exceeds, cleared, flagged = [], [], []
    for first in range(0, n, BATCH):
        theta = _theta(predictor, error, min(BATCH, n - first), rng)
        exceeds.append(following.fly(theta, rng)[1])
        prediction = predictor.predict([step.fly(theta, rng)[0] for step in steps])
        cleared.append(rule.p_values(prediction.score) <= rule.clear_below)
        flagged.append(~(prediction.checks <= rule.levels).all(axis=1))
    exceed, clear, flag = (np.concatenate(parts) for parts in (exceeds, cleared, flagged))
    counts = (exceed, exceed & clear, exceed & clear & ~flag)
    counts += (~exceed, ~exceed & clear & ~flag, flag)
    return ErrorRow(name, error.words, *(int(np.count_nonzero(flags)) for flags in counts))


def _theta(predictor: PointPredictor, error: ModelError, n: int, rng: np.random.Generator) -> Array:
    plant = predictor.plant
    theta = plant.nominal + error.spread * (plant.sample(n, rng) - plant.nominal)
    for name, part in error.shift:
        k = plant.names.index(name)
        theta[:, k] += part * plant.nominal[k]
    return theta


class _Truth:
    """A planned test as flown, with an error."""

    def __init__(self, planned: DatasetRecipe, error: ModelError, changed: Recipe) -> None:
        self._simulator, self._error = LateralSimulator(changed(planned)), error

    def fly(self, theta: Array, rng: np.random.Generator) -> tuple[Array, Flags]:
        """Records (n, n_samples, 6), and (n,) whether they exceed a limit."""
        if self._error.softening:
            y = softened(self._simulator, theta, self._error.softening, rng)
            recipe = self._simulator.recipe
            exceeds = recipe.specification.first_exceedance(y) < y.shape[1]
            recipe.noise.add_to(y, rng)
        else:
            rollouts, _ = self._simulator.fly(theta, rng)
            y, exceeds = rollouts.y, rollouts.is_unsafe
        for key, factor in self._error.reads:
            y[..., KEYS.index(key)] *= factor
        return y, exceeds


def softened(
    simulator: LateralSimulator, theta: Array, softening: float, rng: np.random.Generator
) -> Array:
    """True outputs (n, n_samples, 6) of aircraft whose yaw stiffness falls with sideslip.

    N_beta (1 - softening min((beta / SOFT_SIDESLIP)^2, 1)), by the fourth-order Runge-Kutta method.
    """
    recipe, n = simulator.recipe, len(theta)
    plants, names = simulator.plant.plants(theta), simulator.plant.states
    beta, r = names.index("beta"), names.index("r")
    law = Law(simulator.controller, recipe.control_law.actuator)
    flow, h = joint_flow(plants, law, SurfaceMotion(np.ones((n, 2)), np.zeros((n, 2))))
    k, nx = flow.shape[1] - 6, len(names)
    flow, h = flow[:, :k, :k], h[:, :, :k]
    lost = softening * plants.a[:, r, beta]
    pilot = np.broadcast_to(
        recipe.maneuver.pilot(recipe.dt, n, rng), (n, recipe.maneuver.n_samples(recipe.dt), 2)
    )
    lag, bandwidth = recipe.maneuver.pedal_lag_s, law.actuator.bandwidth_rad_s
    step = recipe.dt / SUBSTEPS

    def rate(state: Array, pedals: Array) -> Array:
        moved = (flow @ state[..., np.newaxis])[..., 0]
        moved[:, nx : nx + 2] += bandwidth * pedals
        sideslip = state[:, beta]
        moved[:, r] -= lost * np.minimum(np.square(sideslip / SOFT_SIDESLIP), 1.0) * sideslip
        return moved

    state, pedals = np.zeros((n, k)), np.zeros((n, 2))
    y = np.empty((n, pilot.shape[1], len(KEYS)))
    fade = np.exp(-0.5 * step / lag) if lag else 0.0
    for sample in range(pilot.shape[1]):
        y[:, sample] = (h @ state[..., np.newaxis])[..., 0]
        command = pilot[:, sample]
        for _ in range(SUBSTEPS):
            middle = command + fade * (pedals - command)
            after = command + fade * (middle - command)
            k1 = rate(state, pedals)
            k2 = rate(state + 0.5 * step * k1, middle)
            k3 = rate(state + 0.5 * step * k2, middle)
            k4 = rate(state + step * k3, after)
            state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            pedals = after
    return y


def in_words(rows: Sequence[ErrorRow], _: object = None) -> str:
    """One line an error of a test."""
    lines = [
        "wrongly: of exceeding aircraft those that the prediction clears; unflagged: those of them "
        "that no check withdraws",
        f"{'':8} {'error':44} {'exceed':>6} {'wrongly':>8} {'unflagged':>9} {'safe cleared':>12} "
        f"{'flagged':>8}",
    ]
    for row in rows:
        n = row.n_exceed + row.n_safe
        shares = [
            f"{part / whole:.3f}" if whole else "-"
            for part, whole in (
                (row.wrongly, row.n_exceed),
                (row.wrongly_unflagged, row.n_exceed),
                (row.safe_cleared, row.n_safe),
                (row.flagged, n),
            )
        ]
        lines.append(
            f"{row.test:8} {row.error:44} {row.n_exceed / n:6.2f} {shares[0]:>8} {shares[1]:>9} "
            f"{shares[2]:>12} {shares[3]:>8}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    run_study(ErrorTableRecipe, error_table, in_words, ErrorRow._asdict)
