"""The validity matrix: the monitor of each published aircraft on flights of every other.

An exceeding flight of another aircraft counts as a miss unless an alert or a withdrawal came in
time, at least a lead before the exceedance. The matrix counts the share of such flights.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from core.channels import KEYS
from core.evaluation.rates import clopper_pearson
from core.limits.limits import Limits
from core.monitor.monitor import Monitor
from core.monitor.recipe import MonitorRecipe
from core.monitor.training import train
from core.planned_test.amplitude import AmplitudeError, suggest_amplitude
from core.planned_test.collection import collect, fresh
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.seeds import Branch, stream
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import MANEUVERS
from core.simulation.published import MODELS, ModelName
from core.types import Array, Indices
from tests.studies.study_command import Progress, run_study

Command = Literal["same", "retuned"]
COMMANDS: tuple[Command, ...] = ("same", "retuned")
DOUBLET_DEG = -6.2
"""Rudder doublet of every monitor's planned test."""
EXCEEDING = 0.25
"""Share of flights that exceed: of the own aircraft, and of others with a retuned doublet."""
N_PEAKS = 2_000
"""Flights for choosing a limit."""
BATCH = 400
NY = KEYS.index("Ny")
N_FAILING = 1
"""Position of the exceeding flights among the counts."""
UNLIMITED_G = 1e6
FEW = 100
"""Exceeding flights below which a bound says little."""


@dataclass(frozen=True)
class MatrixRecipe:
    """The pairs, and the number of flights of each."""

    monitors: tuple[ModelName, ...] = tuple(MODELS)
    """published aircraft to train monitors for"""
    aircraft: tuple[ModelName, ...] = tuple(MODELS)
    """published aircraft to fly"""
    n_unsafe: int = 200
    """unsafe rollouts for training each monitor"""
    n_failing: int = 400
    """exceeding flights of each pair, if there are any"""
    most_flights: int = 4_000
    """largest number of flights of each pair"""
    seed: int = 1
    """seed of every random draw; the streams of a pair do not depend on the other pairs"""

    def __post_init__(self) -> None:
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

    command: `same` as in training, or `retuned` so that a quarter of the flights exceeds.
    missed: exceeding flights without a timely alert, valid or not; valid_and_missed: those without
    a timely withdrawal either.
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
        """Whether the monitor was trained for this aircraft."""
        return self.monitor == self.aircraft

    @property
    def share_invalid(self) -> float:
        """Share of all flights."""
        return (self.invalid_safe + self.invalid_failing) / (self.n_safe + self.n_failing)

    @property
    def share_unwarned(self) -> float | None:
        """P(valid and missed | exceeds); None if no flight exceeds."""
        return self.valid_and_missed / self.n_failing if self.n_failing else None

    @property
    def most_unwarned(self) -> float:
        """One-sided upper 95 % bound (Clopper-Pearson) of that share."""
        return float(clopper_pearson(self.valid_and_missed, self.n_failing, confidence=0.9)[1])


def pairs(recipe: MatrixRecipe, progress: Progress | None = None) -> Iterator[Pair]:
    """Train each monitor and fly every aircraft through it; pairs in the order of the recipe.

    An aircraft without an amplitude at which a quarter exceeds is flown only with the same command.
    progress: called with (monitors done, total).
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
    """The test of a monitor: no control law, and a limit that a quarter of its flights exceeds."""
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
    flights = LateralSimulator(unlimited).rollouts(N_PEAKS, stream(seed, Branch.PILOT_RUN))
    peaks = np.abs(flights.y[..., NY]).max(axis=1)
    limit = float(f"{np.quantile(peaks, 1 - EXCEEDING):.3g}")
    return replace(unlimited, specification=Limits(Ny=limit))


def _flown(planned: DatasetRecipe, aircraft: ModelName, command: Command) -> DatasetRecipe | None:
    """The test flown with an aircraft; None if it cannot be retuned."""
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
    """Fly until enough flights exceed; only one batch if none of it does."""
    numbers = (tuple(MODELS).index(part) for part in (name, aircraft))
    rng = stream(recipe.seed, Branch.PAIRS, *numbers, COMMANDS.index(command))
    simulator, counts, n_flights = LateralSimulator(flown), np.zeros(6, np.int64), 0
    while n_flights < recipe.most_flights:
        flights = simulator.rollouts(min(BATCH, recipe.most_flights - n_flights), rng)
        n_flights += len(flights.y)
        counts += counts_of(monitor, flights.y, flights.fail_index)
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


def counts_of(monitor: Monitor, y: Array, fail_index: Indices) -> Indices:
    """(6,) the counts of a Pair, in the order of its fields."""
    fails = fail_index < y.shape[1]
    first_invalid = monitor.first_withdrawn(y, fail_index)
    invalid, late = first_invalid < y.shape[1], first_invalid > fail_index - monitor.h
    risk = monitor.highest_p_values(y[fails], fail_index[fails] - monitor.h)
    missed = np.zeros(len(y), bool)
    missed[fails] = risk <= monitor.alert_above()
    kinds = ~fails, fails, invalid & ~fails, invalid & fails, missed, missed & late
    return np.array([np.count_nonzero(kind) for kind in kinds])


def plain(pair: Pair) -> dict[str, Any]:
    """Return a pair with its shares, as JSON's types."""
    shares = {
        "share_invalid": pair.share_invalid,
        "share_unwarned": pair.share_unwarned,
        "most_unwarned": pair.most_unwarned,
    }
    return asdict(pair) | shares


def in_words(flown: Sequence[Pair], _: object = None) -> str:
    """One line a pair, and what is worst."""
    head = (
        f"{'monitor':15} {'aircraft':15} {'doublet':>8} {'flights':>7} {'exceed':>6} "
        f"{'invalid':>7} {'missed':>6}   valid and missed"
    )
    lines = [head, *map(_line, flown)]
    own = [pair for pair in flown if pair.is_own]
    others = [pair for pair in flown if not pair.is_own and pair.n_failing >= FEW]
    if own:
        worst = max(own, key=lambda pair: pair.share_invalid)
        lines.append(f"own aircraft called invalid: at most {worst.share_invalid:.1%}")
    if others:
        worst = max(others, key=lambda pair: pair.most_unwarned)
        epsilon = MonitorRecipe().epsilon
        above = sum(pair.most_unwarned > epsilon for pair in others)
        lines.append(
            f"others, of the flights that exceed, valid and missed: {worst.share_unwarned:.1%}, "
            f"surely below {worst.most_unwarned:.1%}, where it is most ({worst.monitor} on "
            f"{worst.aircraft}); above epsilon {epsilon:g} in {above} of {len(others)} pairs"
        )
    return "\n".join(lines)


def _line(pair: Pair) -> str:
    unwarned = "none exceeds"
    if pair.share_unwarned is not None:
        unwarned = f"{pair.share_unwarned:.1%}, surely below {pair.most_unwarned:.1%}"
    n_missed = f"{pair.missed / pair.n_failing:.0%}" if pair.n_failing else "-"
    return (
        f"{pair.monitor:15} {pair.aircraft:15} {pair.amplitude_deg:7.3g}° "
        f"{pair.n_safe + pair.n_failing:7} {pair.n_failing:6} {pair.share_invalid:7.1%} "
        f"{n_missed:>6}   {unwarned}"
    )


if __name__ == "__main__":
    run_study(MatrixRecipe, pairs, in_words, plain)
