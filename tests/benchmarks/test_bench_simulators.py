"""Simulators of others: flights in a second of CPU, and in a second with one and two processes.

An FMU of three states, and aircraft of JSBSim with trim, 6 s at 100 Hz. All times are of one run on
one machine: read the ratios.
"""

import os
import resource
import time
from pathlib import Path

import numpy as np
import pytest

from core.simulation.flight_process import ModelSimulator
from core.simulation.fmu import Fmu
from core.simulation.jsbsim import PROPERTIES, Jsbsim, functions_of
from tests.support import pitch_fmu

pytestmark = pytest.mark.benchmark
N = 400


def measured(own: ModelSimulator, n: int) -> tuple[float, float]:
    """Flights a second of CPU of the processes, with their start, and flights a second."""
    used = cpu()
    theta = own.rollouts(32, np.random.default_rng(0))[2]
    before = time.perf_counter()
    own.fly(np.resize(theta, (n, theta.shape[1])), np.random.default_rng(0))
    elapsed = time.perf_counter() - before
    own.end()
    return n / (cpu() - used), n / elapsed


def cpu() -> float:
    """CPU of ended children [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def compared(label: str, simulators: list[ModelSimulator], n: int) -> None:
    (per_core, alone), (_, together) = (measured(each, n) for each in simulators)
    print(
        f"\n{label}: {per_core:.0f} flights a second of CPU, with the start of the process; "
        f"{alone:.0f} a second by one process, {together:.0f} by two ({together / alone:.2f} times "
        f"as many), load {os.getloadavg()[0]:.1f}"
    )


@pytest.mark.skipif(bool(pitch_fmu.MISSING), reason=pitch_fmu.MISSING)
@pytest.mark.parametrize("version", [2, 3])
def test_flights_of_an_fmu(version: int, tmp_path: Path) -> None:
    path = pitch_fmu.make_fmu(tmp_path / "pitch.fmu", version)
    parameters = pitch_fmu.STIFFNESS, pitch_fmu.GAIN
    outputs = pitch_fmu.ALPHA, pitch_fmu.Q, pitch_fmu.NZ, pitch_fmu.SURFACE
    references = parameters, [pitch_fmu.COMMAND], outputs
    model = Fmu(str(path), version, 0.01, *references, [1.0] * 4, [0.0] * 4)
    simulators = [
        ModelSimulator(
            model,
            "pitch.fmu",
            channels=["alpha", "q", "Nz", "delta_e"],
            dt=0.01,
            parameters={"stiffness": (6.0, 1.1), "gain": (1.0, 0.2)},
            inputs=0.06 * np.repeat([0.0, -1.0, 1.0, 0.0], [50, 80, 80, 391]),
            processes=n,
        )
        for n in (1, 2)
    ]
    compared(f"FMI {version}", simulators, 5 * N)


@pytest.mark.parametrize(
    ("aircraft", "altitude", "speed"),
    [("c172p", 1500.0, 55.0), ("f16", 3000.0, 180.0), ("T38", 3000.0, 200.0)],
)
def test_flights_of_jsbsim(aircraft: str, altitude: float, speed: float) -> None:
    keys = ["alpha", "q", "Nz", "V"]
    functions, outputs = functions_of(aircraft), [PROPERTIES[key] for key in keys]
    control = ["fcs/elevator-cmd-norm"]
    model = Jsbsim(aircraft, altitude, speed, 0.01, functions, control, outputs, [1.0] * 4)
    simulators = [
        ModelSimulator(
            model,
            f"jsbsim:{aircraft}",
            channels=keys,
            dt=0.01,
            parameters=dict.fromkeys(functions, (1.0, 0.1)),
            inputs=0.2 * np.repeat([0.0, -1.0, 1.0, 0.0], [50, 50, 50, 451]),
            processes=n,
        )
        for n in (1, 2)
    ]
    compared(aircraft, simulators, N)
