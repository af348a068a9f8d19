"""Collection: roll out the manoeuvre on random aircraft until enough of them turned unsafe."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import NamedTuple

import numpy as np
from scipy import stats

from core.channels import KEYS
from core.dataset import Dataset
from core.recipe import to_plain
from core.seeds import Branch, stream
from core.simulation.aircraft import AIRCRAFT, Aircraft
from core.simulation.control_law import CONTROL_LAWS, ControlLaw, check_usable
from core.simulation.maneuver import MANEUVERS, Maneuver
from core.simulation.rollout import roll_out
from core.specification import SPECIFICATIONS, Limits
from core.types import Array, Flags, Indices

Progress = Callable[[int, int], object]

FIRST_CHUNK, LARGEST_CHUNK = 256, 4096
CHUNK_STEPS = 2_000_000
"""Steps of all rollouts of a chunk: about 100 MB."""
CERTAINTY = 1e-6
MOST_SAMPLES = 20_000
"""Steps of a rollout, so that a chunk of them stays within memory."""
FRESH_BATCH, MOST_FRESH = 1_000, 20_000
"""Fresh flights of a batch, and in all unless asked for more."""


class CollectionError(ValueError):
    """A collection that would not end, or that leaves too few safe rollouts."""


@dataclass(frozen=True)
class SensorNoise:
    """White Gaussian noise on what the monitor sees, 1 sigma a channel in its SI unit.

    It is not fed back; the specification judges the outputs without it.
    """

    beta: float = 0.0
    p: float = 0.0
    r: float = 0.0
    Ny: float = 0.0
    delta_a: float = 0.0
    delta_r: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a deviation that is negative or not a number."""
        for field in fields(self):
            if not 0 <= getattr(self, field.name) < np.inf:
                raise ValueError(
                    f"noise {field.name}={getattr(self, field.name)} was given: a standard "
                    "deviation is a finite number, 0 or more"
                )

    def add_to(self, y: Array, rng: np.random.Generator) -> None:
        """Add noise to y (n, n_samples, 6) in place, channel by channel."""
        for c, key in enumerate(KEYS):
            if deviation := getattr(self, key):
                y[..., c] += deviation * rng.standard_normal(y.shape[:2])


class Rollouts(NamedTuple):
    """Labelled trajectories of one manoeuvre.

    y: (n, n_samples, 6) measured outputs.   fail_index: (n,) first sample that exceeds a limit,
    n_samples for a safe rollout.   theta: (n, n_parameters).
    """

    y: Array
    fail_index: Indices
    theta: Array

    @property
    def is_unsafe(self) -> Flags:
        """(n,) whether the rollout exceeds a limit."""
        return self.fail_index < self.y.shape[1]

    def some(self, which: slice | Flags) -> "Rollouts":
        """Return the rollouts of a slice or a mask."""
        return Rollouts(self.y[which], self.fail_index[which], self.theta[which])


@dataclass(frozen=True)
class DatasetRecipe:
    """The planned test and how much of it to simulate.

    The default is an F-16 with yaw and roll damper on a rudder doublet that about a quarter of the
    aircraft fail.
    """

    aircraft: Aircraft = AIRCRAFT["f16_sl_h0_v502"]
    control_law: ControlLaw = CONTROL_LAWS["f16_damper"]
    maneuver: Maneuver = replace(MANEUVERS["rudder_doublet"], amplitude_deg=9.5)  # noqa: RUF009
    specification: Limits = SPECIFICATIONS["limits"]
    noise: SensorNoise = SensorNoise()
    dt: float = 0.05
    """sample interval of the telemetry [s]."""
    substeps: int = 1
    """parts of dt after which limits are checked; a crossing between two samples then counts at the
    later one."""
    n_unsafe: int = 50
    """unsafe rollouts to collect."""
    n_obs: int = 50
    """observation times kept of each safe rollout."""
    seed: int = 0
    """of every random draw; the same recipe makes the same dataset."""
    max_rollouts: int = 1_000_000
    """budget; a collection that cannot end within it stops early."""
    max_safe: int = 50_000
    """safe rollouts kept, the first ones; more are counted only."""

    def __post_init__(self) -> None:
        """Refuse sizes that make no dataset."""
        if not 0 < self.dt < self.maneuver.duration_s:
            raise ValueError(
                f"dt={self.dt} s was given: it must be positive and shorter than the manoeuvre's "
                f"{self.maneuver.duration_s:g} s"
            )
        n_samples = self.maneuver.n_samples(self.dt)
        if n_samples * self.substeps > MOST_SAMPLES:
            raise ValueError(
                f"a rollout of {n_samples} samples in {self.substeps} substeps was asked for: at "
                f"most {MOST_SAMPLES} steps fit, choose a larger dt or a shorter manoeuvre"
            )
        for name, lowest in {
            "substeps": 1,
            "n_unsafe": 2,
            "n_obs": 1,
            "seed": 0,
            "max_rollouts": 1,
            "max_safe": 1,
        }.items():
            if getattr(self, name) < lowest:
                raise ValueError(
                    f"{name}={getattr(self, name)} was given: it must be at least {lowest}"
                )
        if self.n_obs > n_samples:
            raise ValueError(
                f"n_obs={self.n_obs} was given: a rollout has {n_samples} samples, choose fewer "
                "observation times or a smaller dt"
            )


class Simulator:
    """The planned test made ready to roll out on random aircraft."""

    def __init__(self, recipe: DatasetRecipe) -> None:
        self.recipe = recipe
        self.plant = recipe.aircraft.uncertain_plant()
        self.controller = recipe.control_law.controller(self.plant)
        check_usable(
            self.plant,
            self.controller,
            recipe.control_law.actuator,
            recipe.maneuver.duration_s,
        )

    def rollouts(self, n: int, rng: np.random.Generator) -> Rollouts:
        """Roll out n aircraft drawn from D_theta."""
        recipe = self.recipe
        theta = self.plant.sample(n, rng)
        y = roll_out(
            self.plant.plants(theta),
            self.controller,
            recipe.control_law.actuator,
            recipe.maneuver.pilot(recipe.dt, n, rng),
            recipe.dt,
            pedal_lag_s=recipe.maneuver.pedal_lag_s,
            substeps=recipe.substeps,
        )
        first = recipe.specification.first_exceedance(y)
        if recipe.substeps > 1:
            first = -(-first // recipe.substeps)
            y = np.ascontiguousarray(y[:, :: recipe.substeps])
            first = np.minimum(first, y.shape[1])
        recipe.noise.add_to(y, rng)
        return Rollouts(y, first, theta)

    def chunk(self, number: int) -> Rollouts:
        """Roll out the chunk of this number of the recipe's seed, each with its own stream."""
        recipe = self.recipe
        steps = recipe.maneuver.n_samples(recipe.dt) * recipe.substeps
        largest = max(FIRST_CHUNK, min(LARGEST_CHUNK, CHUNK_STEPS // steps))
        size = min(FIRST_CHUNK << min(number, 30), largest)
        return self.rollouts(size, stream(recipe.seed, Branch.ROLLOUTS, number))


def collect(
    recipe: DatasetRecipe,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Roll out until recipe.n_unsafe rollouts turned unsafe; keep the safe ones met on the way.

    executor: where chunks are rolled out; here, on the kernels' threads, unless given. The result
    depends on the recipe alone.
    progress: called with (unsafe rollouts found, rollouts made); what it raises cancels.
    CollectionError where the budget cannot suffice or too few safe rollouts remain.
    """
    simulator = Simulator(recipe)
    parts: list[Rollouts] = []
    n_unsafe = n_made = n_safe_stored = 0
    for rollouts in _chunks(simulator, executor):
        rollouts = rollouts.some(slice(recipe.max_rollouts - n_made))
        unsafe = np.flatnonzero(rollouts.is_unsafe)
        missing = recipe.n_unsafe - n_unsafe
        if len(unsafe) >= missing:
            rollouts = rollouts.some(slice(unsafe[missing - 1] + 1))
        n_made += len(rollouts.y)
        n_unsafe += min(len(unsafe), missing)
        keep = rollouts.is_unsafe | (
            n_safe_stored + np.cumsum(~rollouts.is_unsafe) <= recipe.max_safe
        )
        if not keep.all():
            rollouts = rollouts.some(keep)
        n_safe_stored += np.count_nonzero(~rollouts.is_unsafe)
        parts.append(rollouts)
        if progress:
            progress(n_unsafe, n_made)
        if n_unsafe == recipe.n_unsafe:
            return _dataset(simulator, parts, n_made - n_unsafe)
        _check_budget(recipe, n_unsafe, n_made)
    raise AssertionError("chunks never end")


def fresh(recipe: DatasetRecipe, most: int = MOST_FRESH) -> Iterator[Rollouts]:
    """Roll out flights that neither train nor test a monitor of this recipe, for its validity.

    Batches as large as memory likes, `most` flights in all; made as they are asked for.
    """
    simulator = Simulator(recipe)
    rng, made = stream(recipe.seed, Branch.VALIDITY), 0
    steps = recipe.maneuver.n_samples(recipe.dt) * recipe.substeps
    size = max(1, min(FRESH_BATCH, CHUNK_STEPS // steps))
    while made < most:
        flights = simulator.rollouts(min(size, most - made), rng)
        made += len(flights.y)
        yield flights


def evaluation_flights(recipe: DatasetRecipe, n: int) -> Rollouts:
    """Roll out n flights that neither train a monitor of this recipe nor calibrate its validity."""
    return Simulator(recipe).rollouts(n, stream(recipe.seed, Branch.TEST))


def _chunks(simulator: Simulator, executor: Executor | None) -> Iterator[Rollouts]:
    """Chunks in order; with an executor, a few of them under way ahead of time."""
    if executor is None:
        yield from map(simulator.chunk, count())
        return
    under_way = deque(executor.submit(simulator.chunk, number) for number in range(4))
    try:
        for number in count(4):
            yield under_way.popleft().result()
            under_way.append(executor.submit(simulator.chunk, number))
    finally:
        for future in under_way:
            future.cancel()


def _check_budget(recipe: DatasetRecipe, n_unsafe: int, n_made: int) -> None:
    highest = float(stats.beta.ppf(1 - CERTAINTY, n_unsafe + 1, n_made - n_unsafe or 1))
    if n_made < recipe.max_rollouts and recipe.n_unsafe <= highest * recipe.max_rollouts:
        return
    raise CollectionError(
        f"{n_unsafe} of {n_made} rollouts were unsafe (rate about {n_unsafe / n_made:.2g}, surely "
        f"below {highest:.2g}): {recipe.n_unsafe} unsafe ones are out of reach within "
        f"{recipe.max_rollouts} rollouts; raise the amplitude, lower the limit or raise "
        "max_rollouts"
    )


def _dataset(simulator: Simulator, parts: list[Rollouts], n_safe_met: int) -> Dataset:
    recipe = simulator.recipe
    y, fail_index, theta = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    is_unsafe = fail_index < y.shape[1]
    if n_safe_met == 0:
        raise CollectionError(
            f"all {recipe.n_unsafe} rollouts were unsafe and a monitor needs safe ones too: lower "
            "the amplitude, raise the limit or raise n_unsafe"
        )
    unsafe, fail_index = y[is_unsafe], fail_index[is_unsafe]
    unsafe[np.arange(y.shape[1]) > fail_index[:, None]] = np.nan
    safe = y[~is_unsafe]
    return Dataset(
        unsafe=unsafe,
        fail_index=fail_index,
        safe=safe,
        safe_times=_safe_times(recipe, len(safe), y.shape[1]),
        theta_unsafe=theta[is_unsafe],
        theta_safe=theta[~is_unsafe],
        dt=recipe.dt,
        theta_names=simulator.plant.names,
        n_safe_met=n_safe_met,
        seed=recipe.seed,
        recipe=to_plain(recipe),
        specification=recipe.specification,
    )


def _safe_times(recipe: DatasetRecipe, n_safe: int, n_samples: int) -> Indices:
    """(n_safe, n_obs) random sample indices of each safe rollout, without repetition, ascending."""
    rng = stream(recipe.seed, Branch.SAFE_TIMES)
    times = np.empty((n_safe, recipe.n_obs), np.int64)
    for start in range(0, n_safe, LARGEST_CHUNK):
        part = times[start : start + LARGEST_CHUNK]
        order = rng.random((len(part), n_samples)).argsort(axis=1)
        part[:] = np.sort(order[:, : recipe.n_obs], axis=1)
    return times
