"""Simulated tracks: a test flown once, or a stored rollout flown to its planned end."""

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from app.recipes.recipes import from_plain, simulated_test
from core.planned_test.collection import DatasetRecipe, Rollouts
from core.planned_test.maneuver_simulator import ManeuverSimulator
from core.planned_test.planned_test import LateralSimulator, ManeuverTest
from core.simulation.aircraft import Aircraft, PublishedAircraft
from core.simulation.attitude import attitude, attitude_of
from core.simulation.imperfections import Imperfections
from core.simulation.nonlinear_aircraft import NonlinearAircraft
from core.simulation.simulator import Parameters
from core.types import Array

BATCH, MOST_BATCHES = 256, 64
"""Rollouts per batch, and most batches, in the search for the requested outcome."""


class SourceError(ValueError):
    """A source that cannot be flown, or not with this monitor."""


@dataclass(frozen=True, eq=False)
class Track:
    """A source known from start to end.

    t: (n,) rising [s].   y: (n, 6), NaN where unknown.   dt: sample interval [s].
    attitude: (n, 3) phi, theta, psi [rad]; integrated from the rates for display unless given.
    theta: parameters of a simulated aircraft.   fail_index: first sample past a limit, if known.
    planned: (n, 3) attitude of the test as planned, if it can be simulated.
    """

    t: Array
    y: Array
    dt: float
    attitude: Array = field(default_factory=lambda: np.empty((0, 3)))
    theta: dict[str, float] | None = None
    fail_index: int | None = None
    planned: Array | None = None

    def __post_init__(self) -> None:
        if len(self.attitude) != len(self.t):
            object.__setattr__(self, "attitude", attitude(self.t, self.y))


def times(n: int, dt: float) -> Array:
    """Times of n samples from 0 on [s], equal to the bit to those of batch scores."""
    return (np.arange(n) * dt).astype(np.float64)


def simulate(
    recipe: ManeuverTest,
    seed: int = 0,
    theta: dict[str, float] | None = None,
    outcome: Literal["any", "unsafe", "safe"] = "any",
) -> Track:
    """Fly the test once. SourceError if no rollout has the outcome or a parameter is unknown.

    theta: given parameters, the others nominal; None for a random aircraft.
    """
    simulator = recipe.simulator()
    rng = np.random.default_rng(seed)
    if theta is not None and isinstance(simulator, LateralSimulator):
        _make_certain(simulator, theta)
        rollouts = simulator.rollouts(1, rng)
        return _track(simulator, rollouts, 0)
    if theta is not None:
        rollouts, _ = simulator.fly(_given(simulator.parameters, theta)[np.newaxis], rng)
        return _track(simulator, rollouts, 0)
    batch = min(BATCH, recipe.most_at_once)
    for _ in range(MOST_BATCHES):
        rollouts = simulator.rollouts(batch, rng)
        wanted = np.ones(batch, bool)
        if outcome != "any":
            wanted = rollouts.is_unsafe == (outcome == "unsafe")
        if wanted.any():
            return _track(simulator, rollouts, int(wanted.argmax()))
    raise SourceError(
        f"none of {batch * MOST_BATCHES} random aircraft was {outcome}: choose another "
        "outcome, theta or amplitude"
    )


def _make_certain(simulator: LateralSimulator, theta: dict[str, float]) -> None:
    """Fix the simulator's aircraft; its control law stays that of the nominal one."""
    plant = simulator.plant
    nominal = _given(plant.parameters, theta)
    simulator.plant = replace(plant, nominal=nominal, spread=np.zeros_like(plant.spread))


def _given(parameters: Parameters, theta: dict[str, float]) -> Array:
    """(n_parameters,) these values, the others nominal. SourceError."""
    if unknown := [name for name in theta if name not in parameters.names]:
        raise SourceError(
            f"theta has unknown parameters {', '.join(unknown)}: this aircraft has "
            f"{', '.join(parameters.names)}"
        )
    if not all(np.isfinite(value) for value in theta.values()):
        raise SourceError("theta contains a non-finite number: give a finite one per parameter")
    values = parameters.nominal.copy()
    for name, value in theta.items():
        values[parameters.names.index(name)] = value
    return values


def _track(simulator: ManeuverSimulator, rollouts: Rollouts, i: int) -> Track:
    y, fail_index = rollouts.y[i], int(rollouts.fail_index[i])
    theta = dict(zip(simulator.parameters.names, rollouts.theta[i].tolist(), strict=True))
    recipe: Any = simulator.test
    t = times(len(y), recipe.dt)
    return Track(
        t,
        y.copy(),
        recipe.dt,
        attitude_of(simulator.dictionary, t, y, _trim_angles(recipe.aircraft)[1]),
        theta=theta,
        fail_index=fail_index if fail_index < len(y) else None,
        planned=planned_attitude(recipe, len(y)),
    )


def planned_attitude(recipe: ManeuverTest, n: int) -> Array | None:
    """Attitude (n, 3) [rad] of the test on the nominal aircraft, flown and measured exactly.

    None where it has fewer samples, or none that are finite.
    """
    exact = replace(recipe.maneuver, timing_jitter_s=0.0, amplitude_jitter=0.0)
    unmeasured = type(recipe.noise)()
    plan = replace(recipe, maneuver=exact, noise=unmeasured, imperfections=Imperfections())
    simulator = plan.simulator()
    nominal = simulator.parameters.nominal[np.newaxis]
    y = simulator.fly(nominal, np.random.default_rng(0))[0].y[0, :n]
    if len(y) < n or not np.isfinite(y).all():
        return None
    t, theta0 = times(n, recipe.dt), _trim_angles(recipe.aircraft)[1]
    return attitude_of(simulator.dictionary, t, y, theta0)


def _trim_angles(aircraft: Aircraft | NonlinearAircraft) -> tuple[float, float]:
    if isinstance(aircraft, PublishedAircraft):
        return aircraft.model.alpha0, aircraft.model.theta0
    return 0.0, 0.0


def whole_rollout(plain: dict[str, Any], theta: dict[str, float], y: Array) -> Array:
    """The rollout simulated to its planned end; as stored unless the result has the same bits.

    Noise, gusts and the pilot's scatter are not stored: a rollout with any of them ends at its
    failure.
    """
    try:
        simulator = LateralSimulator(from_plain(DatasetRecipe(), plain, "dataset"))
        _make_certain(simulator, theta)
    except ValueError:
        return y
    whole = simulator.rollouts(1, np.random.default_rng(0)).y[0]
    return whole if plain and np.array_equal(whole[: len(y)], y) else y


def trim_angles(plain: dict[str, Any]) -> tuple[float, float]:
    """Angle of attack and pitch at trim [rad] of a dataset recipe's aircraft; 0 if unknown."""
    test = simulated_test(plain)
    return (0.0, 0.0) if test is None else _trim_angles(test.aircraft)
