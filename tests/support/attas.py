"""A small transport on a rudder doublet: its monitor, flights and real records."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from app.assessment import ScoredRecording, ScoringRecipe
from app.assessment import score as score_repaired
from app.jobs.training import train_and_test
from app.telemetry.recording import Trace, Traces
from app.telemetry.timing.repair import repair
from core.channels import KEYS
from core.limits.limits import Limits
from core.monitor import Monitor, MonitorRecipe
from core.planned_test.collection import DatasetRecipe, Rollouts, collect
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import Doublet
from tests.support.places import RECORDS

DOUBLET = Doublet(amplitude_deg=-3.7, timing_jitter_s=0.1, amplitude_jitter=0.15)
TEST = DatasetRecipe(
    aircraft=PublishedAircraft("attas_id_16kft", n_states=4),
    control_law=CONTROL_LAWS["none"],
    maneuver=DOUBLET,
    specification=Limits(Ny=0.2),
    # the crew's other hand moves the aileron a little, which these models do not know
    noise=SensorNoise(beta=1e-3, p=4e-3, r=1e-3, Ny=4e-3, delta_a=3e-3, delta_r=3e-4),
    n_unsafe=100,
)
COLUMNS = {
    "beta": "beta_rad",
    "p": "p_radps",
    "r": "r_radps",
    "Ny": "ay_g",
    "delta_a": "da_rad",
    "delta_r": "dr_rad",
    "V": "V_mps",
    "phi": "phi_rad",
    "theta": "theta_rad",
}


@cache
def trained(test: DatasetRecipe = TEST, recipe: MonitorRecipe | None = None) -> Monitor:
    """A monitor of this test whose validity is calibrated."""
    dataset = collect(test)
    return train_and_test(dataset, recipe or MonitorRecipe(), 0, lambda *_: None).monitor


def fly(n: int, seed: int, lead_in_s: float = 3.0, duration_s: float = 10.0) -> Rollouts:
    """Fresh flights that begin with a longer rest and go on for longer than the planned test."""
    longer = replace(DOUBLET, lead_in_s=lead_in_s, duration_s=duration_s)
    return LateralSimulator(replace(TEST, maneuver=longer)).rollouts(n, np.random.default_rng(seed))


def recorded(y: np.ndarray, dt: float = TEST.dt, start: float = 0.0, **more: float) -> Traces:
    """Channels y (n, 6) as a recorder keeps them; more: of constant value."""
    t = start + dt * np.arange(len(y), dtype=np.float64)
    values = dict(zip(KEYS, np.ascontiguousarray(y.T), strict=True))
    values |= {key: np.full(len(t), value) for key, value in more.items()}
    return Traces({key: Trace(t, column, source=key) for key, column in values.items()})


def score(
    monitor: Monitor,
    traces: Traces,
    recipe: ScoringRecipe | None = None,
    calls: Sequence[float] = (),
) -> ScoredRecording:
    """Score channels as they were recorded. calls: times of ABORT and KNOCK IT OFF [s]."""
    return score_repaired(monitor, repair(traces), recipe, calls=calls)


def record_file(name: str) -> Path:
    """A real record; the test is skipped where it is not beside this checkout."""
    path = RECORDS / f"{name}.csv"
    if not path.exists():
        pytest.skip(f"the flight records are not beside this checkout: {path.name} is missing")
    return path


def record(name: str) -> Traces:
    """The channels of a real record, those that were recorded."""
    table = np.genfromtxt(record_file(name), delimiter=",", names=True)
    t = table["t_s"]
    found = {key: np.ascontiguousarray(table[column]) for key, column in COLUMNS.items()}
    return Traces(
        {key: Trace(t, x, source=COLUMNS[key]) for key, x in found.items() if np.isfinite(x).any()}
    )
