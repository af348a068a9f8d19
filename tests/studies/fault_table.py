"""Sensor fault study: inject one fault at a time and count which checks find it.

The flights are of the monitor's aircraft with all imperfections, recorded with attitude and
airspeed. One sensor at a time gets a wrong gain, sign or unit, a delay or a bias. The recording is
then mapped again from names without units, and scored unchanged.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import cos, tan
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from app.assessment.score import score
from app.telemetry.contents import ColumnWriter, open_columns
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.recording import Trace, Traces
from app.telemetry.timing.repair import RepairedTraces, repair
from core.channels import KEYS
from core.clearance.sensors import GRAVITY
from core.monitor import Monitor, train
from core.planned_test.collection import DatasetRecipe, collect, fresh
from core.planned_test.planned_test import LateralSimulator
from core.seeds import Branch, stream
from core.simulation.aircraft import PublishedAircraft
from core.simulation.attitude import SurfaceSigns, surface_signs
from core.simulation.imperfections import channel_array
from core.simulation.published import ModelName
from core.types import Array
from tests.studies.study_command import Progress, run_study

Kind = Literal["safe", "failing"]
KINDS: tuple[Kind, ...] = ("safe", "failing")
SENSORS = (*KEYS, "phi", "psi", "V")
REST_S, AFTERWARDS_S = 3.0, 3.0
"""[s] Recorded before the usual manoeuvre and after it."""
ATTITUDE_NOISE, SPEED_NOISE = float(np.radians(0.05)), 0.3
"""[rad], [m/s] 1 sigma, white."""
SURE = 0.9
"""Below this confidence a mapping asks a person to check."""
NO_FAULT = "none"
NONE = "-"
MEANS = ("mapping", "validity", "flown_input", "compatibility", "found")
BATCH = 100


class Reading(NamedTuple):
    """x: (n,), one sample each dt [s].   noise: 1 sigma.   unit: factor of a wrong unit."""

    x: Array
    dt: float
    noise: float
    unit: float


def _late(seconds: float) -> Callable[[Reading], Array]:
    def apply(reading: Reading) -> Array:
        t = reading.dt * np.arange(len(reading.x))
        return np.interp(t - seconds, t, reading.x)

    return apply


def _biased(noises: float) -> Callable[[Reading], Array]:
    return lambda reading: reading.x + noises * reading.noise


FAULTS: dict[str, Callable[[Reading], Array]] = {
    "gain x0.8": lambda reading: 0.8 * reading.x,
    "gain x1.25": lambda reading: 1.25 * reading.x,
    "sign": lambda reading: -reading.x,
    "unit": lambda reading: reading.unit * reading.x,
    "delay 50 ms": _late(0.05),
    "delay 100 ms": _late(0.1),
    "delay 200 ms": _late(0.2),
    "bias 3 sigma": _biased(3.0),
    "bias 10 sigma": _biased(10.0),
    "bias 30 sigma": _biased(30.0),
}
"""By name. A bias is constant over the recording."""
P, R = KEYS.index("p"), KEYS.index("r")
UNITS = {"Ny": GRAVITY, "V": 1.0 / 0.3048}
"""m/s2 instead of g, ft/s instead of m/s; other sensors read degrees instead of radians."""


@dataclass(frozen=True)
class FaultTableRecipe:
    """Which aircraft, sensors and faults, and how many flights of each."""

    aircraft: ModelName = "attas_id_16kft"
    """published aircraft; its usual test is trained for and flown"""
    sensors: tuple[str, ...] = SENSORS
    """sensors to fault, one at a time"""
    faults: tuple[str, ...] = tuple(FAULTS)
    """faults to inject in each sensor"""
    n_flights: int = 8
    """flights of each kind, safe and failing, for each fault"""
    n_unsafe: int = 100
    """unsafe rollouts for training the monitor"""
    seed: int = 1
    """seed of every random draw; every fault uses the same flights"""

    def __post_init__(self) -> None:
        for name, known in (("sensors", SENSORS), ("faults", FAULTS)):
            if unknown := [each for each in getattr(self, name) if each not in known]:
                raise ValueError(f"{name} {unknown[0]!r}: choose {', '.join(known)}")
        for name, lowest in {"n_flights": 1, "n_unsafe": 50, "seed": 0}.items():
            if getattr(self, name) < lowest:
                raise ValueError(
                    f"{name}={getattr(self, name)} was given: it must be at least {lowest}"
                )


@dataclass(frozen=True)
class FaultCounts:
    """How many of n flights each check found the fault in.

    mapping: the proposed mapping changed, or a channel is no longer sure.
    validity: a manoeuvre is invalid.   flown_input: the flown input got a remark.
    compatibility: the sensors disagree by kinematics.   found: any of these.
    """

    sensor: str
    fault: str
    kind: Kind
    n: int
    mapping: int
    validity: int
    flown_input: int
    compatibility: int
    found: int


class RecordedFlight(NamedTuple):
    """channels: (n,) by key, SI and g.   dt: [s].   noise: 1 sigma by key."""

    channels: dict[str, Array]
    dt: float
    noise: Mapping[str, float]


def fault_table(
    recipe: FaultTableRecipe, progress: Progress | None = None
) -> Iterator[FaultCounts]:
    """Train, fly, and count: first flights without a fault, then by sensor and fault."""
    planned = DatasetRecipe.usual(PublishedAircraft(recipe.aircraft, 4)).as_flown()
    planned = replace(planned, n_unsafe=recipe.n_unsafe, seed=recipe.seed)
    monitor = train(collect(planned), fresh=fresh(planned))
    expected = surface_signs(planned.aircraft.uncertain_plant())
    flights = flights_of(planned, recipe)
    faults = [(NO_FAULT, NO_FAULT)]
    faults += [(sensor, fault) for sensor in recipe.sensors for fault in recipe.faults]
    before = {kind: [_proposed(flight, expected) for flight in flights[kind]] for kind in KINDS}
    for done, (sensor, fault) in enumerate(faults):
        if progress:
            progress(done, len(faults))
        for kind in KINDS:
            counts = np.zeros(5, np.int64)
            for flight, proposal in zip(flights[kind], before[kind], strict=True):
                at_fault = flight if sensor == NO_FAULT else _with(flight, sensor, fault)
                findings = _findings(monitor, at_fault, proposal, expected)
                counts += np.array([*findings, any(findings)])
            yield FaultCounts(sensor, fault, kind, len(flights[kind]), *counts.tolist())


def flights_of(
    planned: DatasetRecipe, recipe: FaultTableRecipe
) -> dict[Kind, list[RecordedFlight]]:
    """n_flights of each kind, with attitude and airspeed."""
    usual = planned.maneuver
    duration = usual.duration_s - usual.lead_in_s + REST_S + AFTERWARDS_S
    longer = replace(usual, lead_in_s=REST_S, duration_s=duration)
    simulator = LateralSimulator(replace(planned, maneuver=longer))
    rng = stream(recipe.seed, Branch.TEST)
    flights: dict[Kind, list[RecordedFlight]] = {kind: [] for kind in KINDS}
    while min(len(made) for made in flights.values()) < recipe.n_flights:
        truth: dict[int, tuple[Array, Array]] = {}

        def look(block: slice, y: Array, trim: Array) -> None:
            truth[block.start] = y, trim  # noqa: B023

        rollouts = simulator.recorded(BATCH, rng, look)
        true, trims = map(np.concatenate, zip(*(truth[k] for k in sorted(truth)), strict=True))
        for y, from_trim, trim, unsafe in zip(
            rollouts.y, true, trims, rollouts.is_unsafe, strict=True
        ):
            made = flights["failing" if unsafe else "safe"]
            if len(made) < recipe.n_flights:
                made.append(_recorded(planned, y + trim, from_trim + trim, rng))
    return flights


def _recorded(
    planned: DatasetRecipe, y: Array, true: Array, rng: np.random.Generator
) -> RecordedFlight:
    """Add attitude, integrated from the true rates, and airspeed to a flight (n, 6)."""
    aircraft, dt, n = planned.aircraft, planned.dt, len(y)
    assert isinstance(aircraft, PublishedAircraft)
    theta, p, r = aircraft.model.theta0, true[:, P], true[:, R]
    channels = dict(zip(KEYS, y.T, strict=True))
    channels["phi"] = _integral(p + tan(theta) * r, dt) + ATTITUDE_NOISE * rng.standard_normal(n)
    channels["theta"] = theta + ATTITUDE_NOISE * rng.standard_normal(n)
    channels["psi"] = _integral(r / cos(theta), dt) + ATTITUDE_NOISE * rng.standard_normal(n)
    channels["V"] = aircraft.model.speed + SPEED_NOISE * rng.standard_normal(n)
    noise = dict(zip(KEYS, channel_array(planned.noise).tolist(), strict=True))
    noise |= dict.fromkeys(("phi", "theta", "psi"), ATTITUDE_NOISE) | {"V": SPEED_NOISE}
    return RecordedFlight(channels, dt, noise)


def _integral(rate: Array, dt: float) -> Array:
    """Trapezoidal rule, from 0."""
    return np.concatenate([[0.0], np.cumsum(0.5 * dt * (rate[1:] + rate[:-1]))])


def _with(flight: RecordedFlight, sensor: str, fault: str) -> RecordedFlight:
    unit = UNITS.get(sensor, float(np.degrees(1.0)))
    reading = Reading(flight.channels[sensor], flight.dt, flight.noise[sensor], unit)
    return flight._replace(channels=flight.channels | {sensor: FAULTS[fault](reading)})


def _findings(
    monitor: Monitor, flight: RecordedFlight, before: Proposal, expected: SurfaceSigns
) -> tuple[bool, bool, bool, bool]:
    """Whether mapping, validity, flown input and compatibility find the fault."""
    scored = score(monitor, _repaired(flight))
    flown = [scored.samples["y"][m.first : m.last + 1] for m in scored.manoeuvres]
    inputs = [each for y in flown for each in monitor.flown_input(y, monitor.last_counted(y))]
    return (
        _is_other(before, _proposed(flight, expected)),
        any(manoeuvre.validity.valid is False for manoeuvre in scored.manoeuvres),
        any(each.remarks for each in inputs),
        any(check.remarks for check in scored.compatibility),
    )


def _repaired(flight: RecordedFlight) -> RepairedTraces:
    n = len(flight.channels["beta"])
    t: Array = flight.dt * np.arange(n, dtype=np.float64)
    return repair(Traces({key: Trace(t, x, source=key) for key, x in flight.channels.items()}))


def _proposed(flight: RecordedFlight, expected: SurfaceSigns) -> Proposal:
    """The mapping proposed for a file whose names give no unit."""
    table = {"t": flight.dt * np.arange(len(flight.channels["beta"]))} | flight.channels
    with tempfile.TemporaryDirectory(prefix="forewarn-") as place:
        writer = ColumnWriter(Path(place), 2**24)
        group = writer.add_group()
        for name, values in table.items():
            writer.append(writer.add_signal(group, name), values)
        writer.finish("csv")
        return propose(open_columns(Path(place)), expected=expected)


def _is_other(before: Proposal, now: Proposal) -> bool:
    """Whether a proposal changed, or is no longer sure of a channel."""
    if before.mapping.channels != now.mapping.channels:
        return True
    was, is_now = (
        {key for key, why in proposal.rationales.items() if why.confidence >= SURE}
        for proposal in (before, now)
    )
    return bool(was - is_now)


def in_words(rows: Sequence[FaultCounts], _: object = None) -> str:
    """One line a fault: how many of the safe and of the failing flights each means found."""
    n = rows[0].n if rows else 0
    head = f"{'sensor':8} {'fault':14}" + "".join(
        f" {name.replace('_', ' '):>14}" for name in MEANS
    )
    lines = [f"found in so many of {n} safe + {n} failing flights, by:", head]
    for safe, failing in zip(rows[:: len(KINDS)], rows[1 :: len(KINDS)], strict=True):
        counts = (f"{getattr(safe, name)} + {getattr(failing, name)}" for name in MEANS)
        cells = "".join(f" {'-' if count == '0 + 0' else count:>14}" for count in counts)
        lines.append(f"{safe.sensor:8} {safe.fault:14}{cells}")
    return "\n".join(lines)


if __name__ == "__main__":
    run_study(FaultTableRecipe, fault_table, in_words, asdict)
