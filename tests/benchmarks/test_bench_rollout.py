"""Rollouts against python-control: closed loop, zero-order hold and response, plant by plant.

F-16, three states, every derivative random; washed-out yaw damper and roll damper; rudder doublet,
6 s at 0.05 s, no pedal lag. All times are of one run on one machine: read the ratios.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from core.kernels.compiled import on_this_thread
from core.limits.limits import Limits
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import Actuator, RateDamper
from core.simulation.imperfections import Imperfections
from core.simulation.rollout import roll_out
from core.simulation.uncertain_plant import Plants
from tests.benchmarks.pairs import in_turns

pytestmark = pytest.mark.benchmark

PLANT = PublishedAircraft("f16_sl_h0_v502").uncertain_plant()
LAW = RateDamper(kr=0.5, kp=0.1)
CONTROLLER = LAW.controller(PLANT)
DT = 0.05
toolbox: Any = control  # its types do not know all that it takes
ROLLOUTS = 4096
FEW = 50


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


def report(name: str, ours: Callable[[], Any], theirs: Callable[[], Any], rounds: int = 10) -> None:
    """Print our time of one rollout and the ratios; a round is 4096 of ours and 50 of theirs."""
    pair = in_turns(ours, theirs, rounds).per(ROLLOUTS, FEW)
    median, shortest = np.median(pair.ours) * 1e6, pair.ours.min() * 1e6
    print(f"{name:<46} {shortest:7.3f} us (median {median:7.3f})   {pair}")


def test_rollout_against_python_control():
    rng = np.random.default_rng(0)
    plants = PLANT.plants(PLANT.sample(ROLLOUTS, rng))
    commands = pilot()
    few = Plants(*(matrix[:FEW] for matrix in plants))
    expected = peer(few, commands[0])
    out = roll_out(plants, CONTROLLER, LAW.actuator, commands, DT)
    worst = np.abs(out[:FEW] - expected).max()
    assert worst < 1e-9
    print(f"\nlargest difference from python-control {worst:.1e}")

    def given(actuator: Actuator = LAW.actuator, lag: float = 0.0):
        return lambda: roll_out(plants, CONTROLLER, actuator, commands, DT, pedal_lag_s=lag)

    def theirs() -> np.ndarray:
        return peer(few, commands[0])

    def whole() -> np.ndarray:
        theta = PLANT.sample(ROLLOUTS, rng)
        y = roll_out(PLANT.plants(theta), CONTROLLER, LAW.actuator, commands, DT)
        return Limits(Ny=0.5).first_exceedance(y)

    limited = given(Actuator(rate_limit_deg_s=60.0))
    with threadpool_limits(1):  # BLAS threads only slow such small matrices down
        report("given plants", given(), theirs)
        report("the same, pedal lag 0.1 s", given(lag=0.1), theirs)
        report("sampling, plants, fresh output, failures", whole, theirs)
        report("rate limits (Runge-Kutta)", limited, theirs, 5)


def test_flown_rollouts_against_noise_and_jitter_alone():
    """The usual imperfections, noise and jitter of a flight; one thread, as numpy has one."""
    flown = DatasetRecipe().as_flown()
    noisy = replace(flown, imperfections=Imperfections())
    clean, rng = DatasetRecipe(), np.random.default_rng(0)

    def make(recipe: DatasetRecipe) -> Callable[[], Any]:
        simulator = LateralSimulator(recipe)
        return lambda: simulator.rollouts(ROLLOUTS, rng)

    print()
    with on_this_thread(), threadpool_limits(1):
        pairs = {
            name: in_turns(make(flown), make(recipe), 10).per(ROLLOUTS)
            for name, recipe in (("without any", clean), ("noise and jitter", noisy))
        }
    for name, pair in pairs.items():
        ours, theirs = pair.ours.min() * 1e6, pair.theirs.min() * 1e6
        print(f"as flown {ours:.1f} us, {name} {theirs:.1f} us: {1 / pair.ratio:.2f} x as long")
    assert pairs["noise and jitter"].ratio > 1 / 1.5
