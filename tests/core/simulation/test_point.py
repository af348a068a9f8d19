"""The inputs of a test point as pilots fly them."""

import numpy as np
import pytest

from core.simulation.point import PointRecipe

RNG = np.random.default_rng
STEPS = {"stick": ((0.5, 1.0), (0.5, 3.0), (1.0, 3.0), (2.0, 1.0)), "pedal": ((0.0, -2.0),)}
EXACT = PointRecipe(inputs=STEPS, duration_s=3.0, dt=0.1, timing_jitter_s=0.0, amplitude_jitter=0.0)


def test_inputs_are_lines_between_breakpoints_and_hold_at_the_ends():
    stick, pedal = EXACT.pilot()(RNG(0)).T
    assert (pedal == -2.0).all()
    assert (stick[:5] == 1.0).all()
    assert (stick[5:11] == 3.0).all()
    np.testing.assert_allclose(stick[11:21], np.linspace(2.8, 1.0, 10))
    assert (stick[21:] == 1.0).all()


def test_scatter_scales_from_the_first_value_and_shifts_all_inputs_of_a_flight():
    inputs = {"stick": ((1.0, 1.0), (2.0, 3.0)), "pedal": ((1.0, 0.0), (2.0, 1.0))}
    recipe = PointRecipe(
        inputs=inputs, duration_s=3.0, dt=0.5, timing_jitter_s=0.02, amplitude_jitter=0.1
    )
    rng, pilot = RNG(1), recipe.pilot()
    flights = np.array([pilot(rng) for _ in range(2000)])
    stick, pedal = np.moveaxis(flights, 2, 0)
    np.testing.assert_allclose(stick - 1.0, 2.0 * pedal, atol=1e-12)
    factor = pedal[:, -1]
    shift = 0.5 - pedal[:, 3] / factor
    assert np.std(factor) == pytest.approx(0.1, rel=0.1)
    assert np.std(shift) == pytest.approx(0.02, rel=0.1)
    assert abs(np.corrcoef(factor, shift)[0, 1]) < 0.1
