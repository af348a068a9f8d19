"""Nonlinear rollouts in a second of one core: trim and 6 s at 100 Hz.

All times are of one run on one machine. The goal is 2,000.
"""

import time

import numpy as np
import pytest

from core.kernels.compiled import on_this_thread
from core.limits.flight_limits import LoadLimits
from core.planned_test.maneuver_simulator import Drawn
from core.planned_test.nonlinear_test import NonlinearTest
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT

pytestmark = pytest.mark.benchmark
N, ROUNDS = 400, 5


@pytest.mark.parametrize("name", NONLINEAR_AIRCRAFT)
def test_trimmed_rollouts_of_six_seconds(name: str) -> None:
    aircraft, limits = NONLINEAR_AIRCRAFT[name], LoadLimits(Nz_high=7.0)
    test = NonlinearTest(aircraft=aircraft, specification=limits, dt=0.01)
    simulator = test.simulator()
    theta = simulator.parameters.sample(N, np.random.default_rng(0))
    commands = test.maneuver.pilot(test.dt, 1, np.random.default_rng(0))
    drawn, used = Drawn(theta, commands, np.zeros(N, np.int64), ()), []
    with on_this_thread():
        simulator.outputs(drawn)
        for _ in range(ROUNDS):
            before = time.process_time()
            simulator.outputs(drawn)
            used.append(time.process_time() - before)
    print(f"\n{name}: {N / min(used):.0f} rollouts a core-second")
