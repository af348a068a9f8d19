"""Rollouts against python-control: closed loop, zero-order hold and response, plant by plant.

F-16, three states, every derivative random; washed-out yaw damper and roll damper; rudder doublet,
6 s at 0.05 s, no pedal lag. All times are of one run on one machine: read the ratios.
"""

from collections.abc import Callable
from time import perf_counter
from typing import Any

import control
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import Actuator, RateDamper
from core.simulation.rollout import roll_out
from core.simulation.uncertain_plant import Plants
from core.specification import Limits

pytestmark = pytest.mark.benchmark

PLANT = PublishedAircraft("f16_sl_h0_v502").uncertain_plant()
LAW = RateDamper(kr=0.5, kp=0.1)
CONTROLLER = LAW.controller(PLANT)
DT = 0.05
toolbox: Any = control  # its types do not know all that it takes
ROLLOUTS = 4096
RUNS = 60


def pilot() -> np.ndarray:
    """Rudder doublet of 1 s + 1 s from 0.5 s."""
    commands = np.zeros((1, 121, 2))
    commands[0, 10:30, 1], commands[0, 30:50, 1] = np.radians(5.0), -np.radians(5.0)
    return commands


def peer(plants: Plants, commands: np.ndarray) -> np.ndarray:
    """What a user would write with python-control for each plant."""
    w = LAW.actuator.bandwidth_rad_s
    surfaces = toolbox.ss(-w * np.eye(2), w * np.eye(2), np.eye(2), np.zeros((2, 2)))
    damper = toolbox.ss(CONTROLLER.a, CONTROLLER.b[:, :6], CONTROLLER.c, CONTROLLER.d[:, :6])
    times = np.arange(len(commands)) * DT
    y = np.empty((len(plants.a), len(times), 6))
    for i, (a, b, c, d) in enumerate(zip(*plants, strict=True)):
        loop = toolbox.feedback(toolbox.ss(a, b, c, d) * surfaces, damper)
        sampled = toolbox.c2d(loop, DT, "zoh")
        y[i] = toolbox.forced_response(sampled, times, commands.T).outputs.T
    return y


def microseconds(task: Callable[[], Any], n: int, runs: int = RUNS) -> np.ndarray:
    """Time of each of `runs` runs, per rollout."""
    times = []
    for _ in range(runs):
        start = perf_counter()
        task()
        times.append(perf_counter() - start)
    return np.array(times) / n * 1e6


def report(name: str, ours: np.ndarray, theirs: np.ndarray) -> None:
    """Print times and ratios; best against best, median against median."""
    print(
        f"{name:<56} {ours.min():7.3f} us (median {np.median(ours):7.3f})   "
        f"x{theirs.min() / ours.min():<6.0f} (median x{np.median(theirs) / np.median(ours):.0f})"
    )


def test_rollout_against_python_control():
    rng = np.random.default_rng(0)
    plants = PLANT.plants(PLANT.sample(ROLLOUTS, rng))
    commands = pilot()
    few = Plants(*(matrix[:50] for matrix in plants))
    out = np.empty((ROLLOUTS, 121, 6))
    expected = peer(few, commands[0])
    roll_out(plants, CONTROLLER, LAW.actuator, commands, DT, out=out)
    worst = np.abs(out[:50] - expected).max()
    assert worst < 1e-9
    with threadpool_limits(1):  # BLAS threads only slow such small matrices down
        theirs = microseconds(lambda: peer(few, commands[0]), 50, 10)
    print(f"\npython-control {theirs.min():.0f} us a rollout; largest difference {worst:.1e}")

    def given(actuator: Actuator = LAW.actuator, lag: float = 0.0, target: Any = out):
        return lambda: roll_out(
            plants, CONTROLLER, actuator, commands, DT, pedal_lag_s=lag, out=target
        )

    def whole() -> np.ndarray:
        theta = PLANT.sample(ROLLOUTS, rng)
        y = roll_out(PLANT.plants(theta), CONTROLLER, LAW.actuator, commands, DT)
        return Limits(Ny=0.5).first_exceedance(y)

    report("given plants, reused output", microseconds(given(), ROLLOUTS), theirs)
    report("the same, fresh output", microseconds(given(target=None), ROLLOUTS), theirs)
    report("the same, pedal lag 0.1 s", microseconds(given(lag=0.1), ROLLOUTS), theirs)
    whole()
    report("sampling, plants, fresh output, failures", microseconds(whole, ROLLOUTS), theirs)
    limited = given(Actuator(rate_limit_deg_s=60.0))
    limited()
    report("rate limits (Runge-Kutta)", microseconds(limited, ROLLOUTS, 5), theirs)
