"""Margins of a closed loop equal those of python-control, and closed forms."""

from typing import Any

import control
import numpy as np
import pytest

from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import (
    CONTROL_LAWS,
    FEEDBACK,
    Actuator,
    Controller,
    NoFeedback,
)
from core.simulation.stability_margins import loop_margins, stability_margins
from core.simulation.uncertain_plant import Plants

SURFACES = ["aileron", "rudder"]


def margins_of_loop(above: list[float], below: list[float]) -> tuple[float, float, float]:
    """Margins of above(s) / below(s), polynomials with the highest power first."""
    poles = np.roots(below), np.roots(np.polyadd(below, above))
    gain, phase, disk = loop_margins(*(np.atleast_2d(each).astype(complex) for each in poles))
    return float(gain[0]), float(phase[0]), float(disk[0])


@pytest.mark.parametrize("damping", [0.1, 0.3, 0.7, 1.0])
def test_a_second_order_loop_has_the_phase_margin_of_its_damping(damping: float):
    """L = w^2 / (s (s + 2 zeta w)), as in Ogata, Modern Control Engineering, chapter 7."""
    frequency = 3.0
    below = np.sqrt(np.sqrt(1 + 4 * damping**4) - 2 * damping**2)
    gain, phase, _ = margins_of_loop([frequency**2], [1, 2 * damping * frequency, 0])
    assert gain == np.inf
    assert phase == pytest.approx(np.rad2deg(np.arctan(2 * damping / below)), abs=0.02)


def test_a_third_order_loop_has_the_gain_margin_of_routh():
    """k / (s (s + 1)^2) is stable for k < 2; beyond, an oscillation grows."""
    for k in (0.5, 1.0, 1.9):
        gain, _, _ = margins_of_loop([k], [1, 2, 1, 0])
        assert gain == pytest.approx(20 * np.log10(2 / k), abs=0.01)
    assert margins_of_loop([2.5], [1, 2, 1, 0]) == (0, 0, 0)


def test_a_loop_that_lower_gain_makes_unstable_has_a_margin_downwards():
    """(k s + k) / (s^2 - s) closes to s^2 + (k - 1) s + k, stable for k > 1."""
    gain, _, _ = margins_of_loop([4.0, 4.0], [1, -1, 0])
    assert gain == pytest.approx(20 * np.log10(4.0), abs=0.01)


def test_the_published_disk_margin():
    """Seiler, Packard and Gahinet, "An Introduction to Disk Margins", section 2: 25 / (s^3 + 10 s^2
    + 10 s + 10) has the gain margin 3.6, the phase margin 29.1 deg and the disk margin .46."""
    gain, phase, disk = margins_of_loop([25], [1, 10, 10, 10])
    assert 10 ** (gain / 20) == pytest.approx(3.6, abs=0.01)
    assert phase == pytest.approx(29.1, abs=0.1)
    assert disk == pytest.approx(0.46, abs=0.005)


def broken_loops(
    plants: Plants, k: int, law: Controller, actuator: Actuator
) -> list[control.StateSpace]:
    """The loop of each surface of aircraft k, the other one closed, by python-control."""
    a, b, c, d = (matrix[k] for matrix in plants)
    phi = np.zeros((1, len(a)))
    phi[0, 3:4] = 1
    aircraft = control.ss(
        a,
        b,
        np.vstack([c, phi]),
        np.vstack([d, np.zeros((1, 2))]),
        inputs=SURFACES,
        outputs=list(FEEDBACK),
        name="aircraft",
    )
    feedback = control.ss(*law, inputs=list(FEEDBACK), outputs=["ka", "kr"], name="law")
    lag = control.TransferFunction([actuator.bandwidth_rad_s], [1, actuator.bandwidth_rad_s])
    loops = []
    for i in range(2):
        moved, still, fed = SURFACES[i], SURFACES[1 - i], ["ka", "kr"][1 - i]
        parts = [
            control.ss(lag, inputs=["u"], outputs=[moved], name="moved"),
            control.ss(-lag, inputs=[fed], outputs=[still], name="still"),
        ]
        returned = ["ka", "kr"][i]
        loops.append(
            control.interconnect([aircraft, feedback, *parts], inputs=["u"], outputs=[returned])
        )
    return loops


@pytest.mark.parametrize(
    ("name", "states", "law"),
    [
        ("f16_sl_h0_v502", 3, "f16_damper"),
        ("f16_sl_h0_v502", 4, "f16_sl_ofb"),
        ("attas_id_16kft", 4, "attas_damper"),
    ],
)
def test_margins_of_aircraft_equal_python_control(name: Any, states: Any, law: str):
    plant = PublishedAircraft(name, states).uncertain_plant()
    recipe = CONTROL_LAWS[law]
    controller = recipe.controller(plant)
    theta = plant.sample(6, np.random.default_rng(4))
    plants = plant.plants(np.vstack([plant.nominal, theta]))
    ours = stability_margins(plants, controller, recipe.actuator)
    w = np.geomspace(0.02, 200, 4_000)
    for k in range(7):
        gains, phases, disks = [], [], []
        for loop in broken_loops(plants, k, controller, recipe.actuator):
            gm, pm, _, wg, wp, _ = control.stability_margins(loop, returnall=True)
            counts = (wg > w[0]) & (wg < w[-1])
            gains += np.abs(20 * np.log10(gm[counts])).tolist()
            phases += np.abs(pm[(wp > w[0]) & (wp < w[-1])]).tolist()
            disks.append(float(np.ravel(control.disk_margins(loop, w, skew=0.0)[0])[0]))
        least = (min(each, default=np.inf) for each in (gains, phases, disks))
        np.testing.assert_allclose([each[k] for each in ours], list(least), rtol=2e-3, atol=0.02)


def test_without_feedback_no_change_of_a_surface_makes_the_aircraft_unstable():
    plant = PublishedAircraft("attas_id_16kft", 4).uncertain_plant()
    law = NoFeedback().controller(plant)
    gain, phase, disk = stability_margins(plant.nominal_plant(), law, Actuator())
    assert (gain[0], phase[0]) == (np.inf, np.inf)
    assert disk[0] == pytest.approx(2.0)
