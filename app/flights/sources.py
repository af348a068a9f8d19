"""Where a flight's samples come from: a simulated rollout, a stored one, a recording, live ones.

A Track is known as a whole: it can be sought in, and is assessed at once. A LiveSource is not: its
samples come when they come. Both state the interval and what is known of the aircraft.
"""

from collections.abc import AsyncIterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from app.recipes import from_plain
from app.store.store import Store
from core.channels import N_CHANNELS
from core.collection import DatasetRecipe, Rollouts, Simulator
from core.monitor import Monitor
from core.simulation.aircraft import Aircraft, PublishedAircraft
from core.simulation.attitude import attitude
from core.types import Array

BATCH, MOST_BATCHES = 256, 64
"""Rollouts made at a time, and at most so many times, until one has the outcome asked for."""


class SourceError(ValueError):
    """A source that cannot be flown, or not through this monitor; one sentence: why, what to do."""


class Sample(NamedTuple):
    """One sample of a live source. y: (6,).   attitude: phi, theta, psi [rad] where measured."""

    t: float
    y: Array
    attitude: tuple[float, float, float] | None = None


class LiveSource(Protocol):
    """Samples as they come; the flight ends when they do."""

    @property
    def dt(self) -> float:
        """Interval at which samples should come [s]."""
        ...

    @property
    def theta(self) -> dict[str, float] | None:
        """Parameters of a simulated aircraft, by name."""
        ...

    def __aiter__(self) -> AsyncIterator[Sample]:
        """Yield the samples, each as soon as it is there."""
        ...


@dataclass(frozen=True, eq=False)
class Track:
    """A source known from start to end.

    t: (n,) rising [s].   y: (n, 6), NaN where unknown.   dt: sample interval [s].
    attitude: (n, 3) phi, theta, psi [rad]; integrated from the rates for display unless given.
    theta: parameters of a simulated aircraft.   fail_index: first sample past a limit, if known.
    """

    t: Array
    y: Array
    dt: float
    attitude: Array = field(default_factory=lambda: np.empty((0, 3)))
    theta: dict[str, float] | None = None
    fail_index: int | None = None

    def __post_init__(self) -> None:
        """Refuse what has no samples or no order; integrate the attitude where it is missing."""
        n = len(self.t)
        if not n or self.y.shape != (n, N_CHANNELS):
            raise SourceError(
                f"the source has {n} times and samples of shape {self.y.shape}: it needs one row "
                f"of {N_CHANNELS} channels for each time, and one at least"
            )
        if not (np.isfinite(self.t).all() and (np.diff(self.t) > 0).all()):
            raise SourceError("the source's times do not rise throughout: sort or resample it")
        if len(self.attitude) != n:
            object.__setattr__(self, "attitude", attitude(self.t, self.y))

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])


class Simulated(BaseModel):
    """A fresh rollout of a stored dataset's test, of a recipe, or else of the monitor's own test.

    Where theta is given, its parameters are as said and the others nominal.
    """

    model_config = ConfigDict(extra="forbid")

    kind: Literal["simulated"]
    dataset: str | None = Field(default=None, description="id of the dataset whose test is flown")
    recipe: dict[str, Any] | None = Field(
        default=None, description="DatasetRecipe, as for /datasets"
    )
    seed: int = Field(default=0, ge=0, le=2**53, description="same seed, same flight")
    theta: dict[str, float] | None = Field(
        default=None, description="parameters by name; null: random"
    )
    outcome: Literal["any", "unsafe", "safe"] = Field(
        default="any", description="of a random aircraft"
    )


class Replay(BaseModel):
    """A stored rollout; an unsafe one goes on past its failure where it can be simulated again."""

    model_config = ConfigDict(extra="forbid")

    kind: Literal["replay"]
    dataset: str = Field(description="id")
    outcome: Literal["unsafe", "safe"]
    rollout: int = Field(ge=0, description="number among those of this outcome")


class Recorded(BaseModel):
    """A recording as it was scored; monitor and epsilon are those of the scoring."""

    model_config = ConfigDict(extra="forbid")

    kind: Literal["recording"]
    recording: str = Field(description="id")
    scoring: str = Field(description="id of one of its scorings")


SourceRequest = Annotated[Simulated | Replay | Recorded, Field(discriminator="kind")]


def open_source(request: Simulated | Replay, store: Store, monitor: Monitor) -> Track:
    """Make the samples of a flight; slow, for a thread.

    SourceError where there is no such flight or the monitor has another interval; RecipeError for a
    wrong recipe; the store's NotFound.
    """
    if isinstance(request, Replay):
        track = replay(store, request)
    else:
        track = simulate(_recipe(request, store, monitor), request)
    if abs(track.dt - monitor.dt) > 1e-9 * monitor.dt:
        raise SourceError(
            f"the source has a sample each {track.dt:g} s, the monitor needs one each "
            f"{monitor.dt:g} s: choose a dataset with that dt, or train a monitor for this one"
        )
    return track


def simulate(recipe: DatasetRecipe, request: Simulated) -> Track:
    """Fly the test once; SourceError where no rollout has the outcome or a parameter is unknown."""
    simulator = Simulator(recipe)
    rng = np.random.default_rng(request.seed)
    if request.theta is not None:
        _make_certain(simulator, request.theta)
        rollouts = simulator.rollouts(1, rng)
        return _track(simulator, rollouts, 0)
    for _ in range(MOST_BATCHES):
        rollouts = simulator.rollouts(BATCH, rng)
        wanted = np.ones(BATCH, bool)
        if request.outcome != "any":
            wanted = rollouts.is_unsafe == (request.outcome == "unsafe")
        if wanted.any():
            return _track(simulator, rollouts, int(wanted.argmax()))
    raise SourceError(
        f"none of {BATCH * MOST_BATCHES} random aircraft was {request.outcome}: choose another "
        "outcome, theta or amplitude"
    )


def replay(store: Store, request: Replay) -> Track:
    """Return a stored rollout, with the samples after its failure where they can be had again."""
    stored = store.datasets.rollout(request.dataset, request.outcome, request.rollout)
    info = store.datasets.info(request.dataset)
    y = stored.y
    if stored.fail_index is not None:
        y = _whole_rollout(info.recipe, stored.theta, y)
    t = times(len(y), info.dt)
    pitch = trim_angles(info.recipe)[1]
    return Track(
        t, y, info.dt, attitude(t, y, pitch), theta=stored.theta, fail_index=stored.fail_index
    )


def trim_angles(plain: dict[str, Any]) -> tuple[float, float]:
    """Angle of attack and pitch at trim [rad] of a dataset recipe's aircraft; 0 where unknown."""
    aircraft = aircraft_of(plain)
    return (0.0, 0.0) if aircraft is None else _trim_angles(aircraft)


def aircraft_of(plain: dict[str, Any]) -> Aircraft | None:
    """Aircraft of a dataset recipe in plain data; None where it says none that is known here."""
    try:
        return from_plain(DatasetRecipe(), plain, "dataset").aircraft if plain else None
    except ValueError:
        return None


def _recipe(request: Simulated, store: Store, monitor: Monitor) -> DatasetRecipe:
    plain = request.recipe
    if request.dataset is not None:
        if plain is not None:
            raise SourceError("dataset and recipe were both given: give one, or neither")
        plain = store.datasets.info(request.dataset).recipe
    if plain is None:
        plain = monitor.dataset_recipe
    if not plain:
        raise SourceError("no recipe says what to simulate here: give one, or a simulated dataset")
    return from_plain(DatasetRecipe(), plain, "dataset")


def _make_certain(simulator: Simulator, theta: dict[str, float]) -> None:
    """Leave the simulator one aircraft to draw; its control law stays that of the nominal one."""
    plant = simulator.plant
    if unknown := [name for name in theta if name not in plant.names]:
        raise SourceError(
            f"theta names {', '.join(unknown)}: this aircraft's parameters are "
            f"{', '.join(plant.names)}"
        )
    if not all(np.isfinite(value) for value in theta.values()):
        raise SourceError("theta holds what is not a finite number: give one for each parameter")
    nominal = plant.nominal.copy()
    for name, value in theta.items():
        nominal[plant.names.index(name)] = value
    simulator.plant = replace(plant, nominal=nominal, spread=np.zeros_like(plant.spread))


def _track(simulator: Simulator, rollouts: Rollouts, i: int) -> Track:
    y, fail_index = rollouts.y[i], int(rollouts.fail_index[i])
    theta = dict(zip(simulator.plant.names, rollouts.theta[i].tolist(), strict=True))
    recipe = simulator.recipe
    t = times(len(y), recipe.dt)
    return Track(
        t,
        y.copy(),
        recipe.dt,
        attitude(t, y, _trim_angles(recipe.aircraft)[1]),
        theta=theta,
        fail_index=fail_index if fail_index < len(y) else None,
    )


def times(n: int, dt: float) -> Array:
    """Times of n samples from 0 on [s]: the very ones that batch scores are made with."""
    return (np.arange(n) * dt).astype(np.float64)


def _trim_angles(aircraft: Aircraft) -> tuple[float, float]:
    if isinstance(aircraft, PublishedAircraft):
        return aircraft.model.alpha0, aircraft.model.theta0
    return 0.0, 0.0


def _whole_rollout(plain: dict[str, Any], theta: dict[str, float], y: Array) -> Array:
    """The rollout simulated again to its planned end; as stored unless the same bits come out.

    Scatter of the pilot and sensor noise are not stored: with them, it ends at the failure.
    """
    try:
        simulator = Simulator(from_plain(DatasetRecipe(), plain, "dataset"))
        _make_certain(simulator, theta)
    except ValueError:
        return y
    again = simulator.rollouts(1, np.random.default_rng(0)).y[0]
    same = bool(plain) and np.array_equal(again[: len(y)], y)
    return again if same else y
