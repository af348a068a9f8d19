"""The pair matrix of validity: the monitor of each published aircraft on flights of every other.

A flight of another aircraft that exceeds its limit unwarned is no miss where it was called invalid.
What counts is the share of the exceeding flights that are neither.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from core.amplitude import AmplitudeError, suggest_amplitude
from core.channels import KEYS
from core.collection import collect, fresh
from core.evaluation.rates import clopper_pearson
from core.monitor.monitor import Monitor
from core.monitor.training import train
from core.planned_test import DatasetRecipe, Simulator
from core.seeds import Branch, stream
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import MANEUVERS
from core.simulation.published import MODELS, ModelName
from core.specification import Limits
from core.types import Array, Indices

Command = Literal["same", "retuned"]
COMMANDS: tuple[Command, ...] = ("same", "retuned")
DOUBLET_DEG = -6.2
"""Rudder doublet that every monitor is trained for."""
EXCEEDING = 0.25
"""Share of the own aircraft that exceeds the limit, and of another where its doublet is retuned."""
N_PEAKS = 2_000
"""Flights that a limit is taken from."""
BATCH = 400
NY = KEYS.index("Ny")
N_FAILING = 1
"""Where the exceeding flights stand among the counts."""
UNLIMITED_G = 1e6
Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class MatrixRecipe:
    """Which pairs, and how many flights of each."""

    monitors: tuple[ModelName, ...] = tuple(MODELS)
    """published aircraft that monitors are trained for."""
    aircraft: tuple[ModelName, ...] = tuple(MODELS)
    """published aircraft that are flown."""
    n_unsafe: int = 200
    """unsafe rollouts that each monitor is trained on."""
    n_failing: int = 400
    """exceeding flights of each pair, as far as there are any."""
    most_flights: int = 4_000
    """flights of each pair at most."""
    seed: int = 1
    """seed of every random draw: each pair has streams of its own, whichever others are asked."""

    def __post_init__(self) -> None:
        """Refuse what is no published aircraft, and no flights."""
        for name in (*self.monitors, *self.aircraft):
            if name not in MODELS:
                raise ValueError(f"no published model {name!r}; there are {', '.join(MODELS)}")
        for name, lowest in {"n_unsafe": 50, "n_failing": 1, "most_flights": 1, "seed": 0}.items():
            if getattr(self, name) < lowest:
                raise ValueError(
                    f"{name}={getattr(self, name)} was given: it must be at least {lowest}"
                )


@dataclass(frozen=True)
class Pair:
    """Flights of one aircraft through the monitor of another, or through its own.

    command: `same` as the monitor was trained for, or `retuned` so that a quarter exceeds.
    missed: exceeding flights without a timely alert, valid or not; of these valid_and_missed.
    """

    monitor: str
    aircraft: str
    command: Command
    amplitude_deg: float
    limit_g: float
    n_safe: int
    n_failing: int
    invalid_safe: int
    invalid_failing: int
    missed: int
    valid_and_missed: int

    @property
    def is_own(self) -> bool:
        """Whether the aircraft is the one that the monitor was trained for."""
        return self.monitor == self.aircraft

    @property
    def share_invalid(self) -> float:
        """Of all flights."""
        return (self.invalid_safe + self.invalid_failing) / (self.n_safe + self.n_failing)

    @property
    def share_unwarned(self) -> float | None:
        """P(valid and missed | exceeds); None where no flight exceeds."""
        return self.valid_and_missed / self.n_failing if self.n_failing else None

    @property
    def most_unwarned(self) -> float:
        """Upper 95 % bound of that share (Clopper and Pearson, one-sided)."""
        return float(clopper_pearson(self.valid_and_missed, self.n_failing, confidence=0.9)[1])


def pairs(recipe: MatrixRecipe, progress: Progress | None = None) -> Iterator[Pair]:
    """Train each monitor and fly every aircraft through it; pairs in the order of the recipe.

    An aircraft of which no amplitude makes a quarter exceed is flown with the same command only.
    progress: called with (monitors done, monitors in all).
    """
    for done, name in enumerate(recipe.monitors):
        if progress:
            progress(done, len(recipe.monitors))
        planned = planned_for(name, recipe)
        monitor = train(collect(planned), fresh=fresh(planned))
        for aircraft in recipe.aircraft:
            for command in COMMANDS:
                if flown := _flown(planned, aircraft, command):
                    yield _pair(recipe, monitor, name, aircraft, command, flown)


def planned_for(name: ModelName, recipe: MatrixRecipe) -> DatasetRecipe:
    """The test of a monitor: without a law, at the limit that a quarter of its aircraft exceeds."""
    number = tuple(MODELS).index(name)
    seed = int(stream(recipe.seed, Branch.PAIRS, number).integers(2**32))
    unlimited = DatasetRecipe(
        aircraft=PublishedAircraft(name, 4),
        control_law=CONTROL_LAWS["none"],
        maneuver=MANEUVERS["rudder_doublet"].with_peak(DOUBLET_DEG),
        specification=Limits(Ny=UNLIMITED_G),
        n_unsafe=recipe.n_unsafe,
        seed=seed,
    ).as_flown()
    flights = Simulator(unlimited).rollouts(N_PEAKS, stream(seed, Branch.PILOT_RUN))
    peaks = np.abs(flights.y[..., NY]).max(axis=1)
    limit = float(f"{np.quantile(peaks, 1 - EXCEEDING):.3g}")
    return replace(unlimited, specification=Limits(Ny=limit))


def _flown(planned: DatasetRecipe, aircraft: ModelName, command: Command) -> DatasetRecipe | None:
    """What is flown of an aircraft; None where it is not retuned."""
    flown = replace(planned, aircraft=PublishedAircraft(aircraft, 4))
    if command == "same":
        return flown
    if flown == planned:
        return None
    try:
        amplitude = suggest_amplitude(flown, EXCEEDING).amplitude_deg
    except AmplitudeError:
        return None
    return replace(flown, maneuver=flown.maneuver.with_peak(amplitude))


def _pair(
    recipe: MatrixRecipe,
    monitor: Monitor,
    name: ModelName,
    aircraft: ModelName,
    command: Command,
    flown: DatasetRecipe,
) -> Pair:
    """Fly until enough exceed; one batch alone where none of it does."""
    numbers = (tuple(MODELS).index(part) for part in (name, aircraft))
    rng = stream(recipe.seed, Branch.PAIRS, *numbers, COMMANDS.index(command))
    simulator, counts, n_flights = Simulator(flown), np.zeros(6, np.int64), 0
    while n_flights < recipe.most_flights:
        flights = simulator.rollouts(min(BATCH, recipe.most_flights - n_flights), rng)
        n_flights += len(flights.y)
        counts += _counts(monitor, flights.y, flights.fail_index)
        if not 0 < counts[N_FAILING] < recipe.n_failing:
            break
    return Pair(
        name,
        aircraft,
        command,
        flown.maneuver.peak_deg,
        float(flown.specification.magnitudes[NY]),
        *counts.tolist(),
    )


def _counts(monitor: Monitor, y: Array, fail_index: Indices) -> Indices:
    """(6,) the counts of a Pair, in the order of its fields."""
    fails = fail_index < y.shape[1]
    invalid = monitor.first_withdrawn(y, fail_index) < y.shape[1]
    risk = monitor.highest_p_values(y[fails], fail_index[fails] - monitor.h)
    missed = np.zeros(len(y), bool)
    missed[fails] = risk <= monitor.alert_above()
    kinds = ~fails, fails, invalid & ~fails, invalid & fails, missed, missed & ~invalid
    return np.array([np.count_nonzero(kind) for kind in kinds])
