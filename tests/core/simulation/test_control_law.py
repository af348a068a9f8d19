from dataclasses import FrozenInstanceError, replace
from typing import Any

import control as python_control
import numpy as np
import pytest

from core.simulation.aircraft import AIRCRAFT, MatrixAircraft, PublishedAircraft
from core.simulation.control_law import (
    CONTROL_LAWS,
    FEEDBACK,
    Actuator,
    NoFeedback,
    OutputFeedback,
    RateDamper,
    StateSpaceLaw,
    check_usable,
    closed_loops,
)
from core.simulation.uncertain_plant import Uncertainty

control: Any = python_control  # its types do not know all that it takes
F16_3 = PublishedAircraft("f16_sl_h0_v502", 3).uncertain_plant()
F16_4 = PublishedAircraft("f16_sl_h0_v502", 4).uncertain_plant()


def response(controller, s):
    """K(s), rows delta_a and delta_r, columns FEEDBACK."""
    a, b, c, d = controller
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


def dutch_roll(plant, law):
    """Damping ratio of the slowest oscillation of the nominal closed loop."""
    (loop,), _ = closed_loops(plant.nominal_plant(), law.controller(plant), law.actuator)
    poles = np.linalg.eigvals(loop)
    slowest = min(poles[poles.imag > 1e-9], key=abs)
    return -slowest.real / abs(slowest)


def test_f16_regulator_has_the_published_closed_loop_poles():
    # Stevens, Lewis and Johnson, 3rd ed., Example 5.3-1, with the four-state F-16
    law = CONTROL_LAWS["f16_sl_ofb"]
    (loop,), _ = closed_loops(F16_4.nominal_plant(), law.controller(F16_4), law.actuator)
    poles = np.sort_complex(np.linalg.eigvals(loop))
    published = np.array(
        [
            *(-15.08, -11.47 - 17.20j, -11.47 + 17.20j, -3.11 - 0.92j, -3.11 + 0.92j),
            *(-0.816 - 0.143j, -0.816 + 0.143j),
        ]
    )
    np.testing.assert_allclose(poles, published, atol=0.006)


@pytest.mark.parametrize("s", [0.3j, 1.0 + 2.0j])
def test_output_feedback_is_the_gain_matrix_behind_a_washout(s):
    k = response(CONTROL_LAWS["f16_sl_ofb"].controller(F16_4), s)
    expected = np.zeros((2, 7), complex)
    for column, gains in {
        "r": np.array([-0.56, -1.19]) * s / (s + 1),
        "p": (-0.44, -0.21),
        "beta": (0.11, -0.44),
        "phi": (-0.35, 0.26),
    }.items():
        expected[:, FEEDBACK.index(column)] = gains
    np.testing.assert_allclose(k, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "gain", "corner", "bandwidth"),
    [
        ("b747_yaw_damper_mathworks", 2.34, 0.2, 20.2),
        ("b747_yaw_damper_bryson", 2.0, 1 / 3, 10.0),
    ],
)
def test_747_yaw_damper_turns_the_rudder_with_the_washed_out_yaw_rate(
    name, gain, corner, bandwidth
):
    # delta_r = +k s/(s + corner) r: N_delta_r is negative
    plant = PublishedAircraft("b747_40k_m0p8", 4).uncertain_plant()
    law = CONTROL_LAWS[name]
    assert law.actuator == Actuator(bandwidth)
    s = 0.7j
    expected = np.zeros((2, 7), complex)
    expected[1, FEEDBACK.index("r")] = -gain * s / (s + corner)
    np.testing.assert_allclose(response(law.controller(plant), s), expected, atol=1e-15)
    assert dutch_roll(plant, law) > 0.25 > dutch_roll(plant, NoFeedback())


@pytest.mark.parametrize("n_states", [3, 4])
@pytest.mark.parametrize(
    ("name", "aircraft"),
    [
        ("f16_damper", "f16_sl_h0_v502"),
        ("f104a_damper", "f104a_sl_m0p8"),
        ("f4c_damper", "f4c_35k_m0p6"),
        ("attas_damper", "attas_id_16kft"),
        ("nt33a_damper", "nt33a_fc1_pa"),
    ],
)
def test_rate_damper_damps_its_aircraft(name, aircraft, n_states):
    plant = PublishedAircraft(aircraft, n_states).uncertain_plant()
    assert dutch_roll(plant, CONTROL_LAWS[name]) > 1.3 * dutch_roll(plant, NoFeedback())


def test_rate_damper_follows_the_sign_of_the_surfaces():
    flipped = MatrixAircraft(
        a=((-0.3, 0.0, -1.0), (-30.0, -3.7, 0.7), (8.5, 0.0, -0.5)),
        b=((0.0, 0.0), (42.0, 0.0), (0.0, 3.5)),
        c=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-5.0, 0.0, 0.0)),
        d=((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.7)),
        uncertainty=Uncertainty(0.1),
        states=("beta", "p", "r"),
    ).uncertain_plant()
    law = RateDamper()
    np.testing.assert_array_equal(law.controller(flipped).d, -law.controller(F16_3).d)
    assert dutch_roll(flipped, law) > 2 * dutch_roll(flipped, NoFeedback())


def test_damper_without_a_sign_is_refused():
    dead = MatrixAircraft(
        a=((-1.0,),),
        b=((0.0, 1.0),),
        c=((0.0,), (1.0,), (0.0,), (0.0,)),
        d=((0.0, 0.0),) * 4,
        uncertainty=Uncertainty(0.1),
    ).uncertain_plant()
    with pytest.raises(ValueError, match="aileron does not change the roll rate"):
        RateDamper().controller(dead)
    with pytest.raises(ValueError, match="rudder does not change the yaw rate"):
        RateDamper(kp=0.0).controller(dead)
    RateDamper(kp=0.0, kr=0.0).controller(dead)


def test_feedback_of_phi_needs_the_four_state_plant():
    with pytest.raises(ValueError, match=r"feeds back phi.*beta, p, r;.*fourth state is phi"):
        CONTROL_LAWS["f16_sl_ofb"].controller(F16_3)
    with pytest.raises(ValueError, match="feeds back phi"):
        StateSpaceLaw(inputs=("phi",), a=(), b=(), c=((),), d=((1.0,),)).controller(F16_3)


@pytest.mark.parametrize("name", CONTROL_LAWS)
def test_every_law_is_a_finite_state_space_that_keeps_the_f16_usable(name):
    law = CONTROL_LAWS[name]
    controller = law.controller(F16_4)
    m = len(controller.a)
    assert [matrix.shape for matrix in controller] == [(m, m), (m, 7), (2, m), (2, 7)]
    assert all(np.isfinite(matrix).all() for matrix in controller)
    check_usable(F16_4, controller, law.actuator, 6.0)
    with pytest.raises(FrozenInstanceError):
        law.actuator = Actuator(5.0)  # type: ignore[misc]


@pytest.mark.parametrize("name", AIRCRAFT)
def test_every_aircraft_is_usable_without_feedback(name):
    plant = AIRCRAFT[name].uncertain_plant()
    check_usable(plant, NoFeedback().controller(plant), Actuator(), 30.0)


def test_mildly_unstable_spiral_is_usable():
    plant = PublishedAircraft("attas_id_16kft", 4).uncertain_plant()  # spiral pole +0.0174 rad/s
    (loop,), _ = closed_loops(plant.nominal_plant(), NoFeedback().controller(plant), Actuator())
    assert 0.01 < np.linalg.eigvals(loop).real.max() < 0.03
    check_usable(plant, NoFeedback().controller(plant), Actuator(), 60.0)


def test_unstable_closed_loop_is_refused_with_its_pole():
    law = RateDamper(kr=-4.0, kp=0.0)
    controller = law.controller(F16_4)
    with pytest.raises(ValueError, match=r"pole at \d.*rad/s and grows by .* within 6 s; check"):
        check_usable(F16_4, controller, law.actuator, 6.0)
    check_usable(F16_4, controller, law.actuator, 0.5)


def systems():
    """Laws from python-control, with their expected values at s."""
    lead = control.tf([2.0, 1.0], [1.0, 5.0], inputs=["r"], outputs=["delta_r"])
    constant = control.tf([0.3], [1.0], inputs=["Ny"], outputs=["delta_r"])
    matrix = control.tf(
        [[[0.5, 0.0], [0.1]], [[0.0], [3.0]]],
        [[[1.0, 1.0], [1.0, 2.0, 4.0]], [[1.0], [1.0, 7.0]]],
        inputs=["phi", "beta"],
        outputs=["delta_r", "delta_a"],
    )
    space = control.ss(
        [[-1.0, 2.0], [0.0, -3.0]], [[1.0], [0.5]], [[1.0, 0.0], [0.0, 2.0]], [[0.1], [0.0]],
        inputs=["delta_a"], outputs=["delta_a", "delta_r"],
    )  # fmt: skip
    return [lead, constant, matrix, space]


@pytest.mark.parametrize("system", systems())
def test_law_from_python_control_keeps_its_frequency_response(system):
    law = StateSpaceLaw.from_lti(system, actuator=Actuator(15.0))
    s = 0.4 + 1.7j
    expected = np.zeros((2, 7), complex)
    value = np.atleast_2d(system(s))
    for i, output in enumerate(system.output_labels):
        for j, fed_back in enumerate(system.input_labels):
            expected[FEEDBACK.index(output) - 4, FEEDBACK.index(fed_back)] = value[i, j]
    np.testing.assert_allclose(response(law.controller(F16_4), s), expected, atol=1e-13)
    assert law.actuator == Actuator(15.0)
    assert hash(law) == hash(replace(law))


def test_labels_of_a_law_may_be_given_separately():
    law = StateSpaceLaw.from_lti(control.tf([1.0], [1.0, 1.0]), inputs=("p",), outputs=("delta_a",))
    assert response(law.controller(F16_3), 1j)[0, FEEDBACK.index("p")] == pytest.approx(
        1 / (1 + 1j)
    )


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (
            control.tf([1.0], [1.0, 0.5], 0.05, inputs=["r"], outputs=["delta_r"]),
            r"discrete in time \(dt=0.05\); convert",
        ),
        (
            control.tf([1.0, 0.0, 0.0], [1.0, 1.0], inputs=["r"], outputs=["delta_r"]),
            r"from r to delta_r is improper \(order 2 over 1\); add poles",
        ),
        (control.tf([1.0], [1.0, 1.0]), r"inputs are u\[0\]; name each input once, from beta"),
        (control.tf([1.0], [1.0, 1.0], inputs=["r"]), r"outputs are y\[0\]; name each output"),
        (control.frd([1.0, 2.0], [1.0, 2.0]), "is a FrequencyResponseData; give a continuous"),
    ],
)
def test_impossible_laws_are_refused(system, message):
    with pytest.raises(ValueError, match=message):
        StateSpaceLaw.from_lti(system)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"a": ((1.0, 2.0),)}, r"matrix a of the control law has the shape \[\(1, 2\)\]"),
        ({"b": ((1.0,), (2.0,))}, r"matrix b .* it needs \(1, 1\)"),
        ({"d": ((float("nan"),),)}, "matrix d of the control law needs finite numbers"),
        ({"inputs": ("r", "r")}, "inputs are r, r; name each input once"),
        ({"outputs": ()}, "outputs are none; name each output once"),
    ],
)
def test_law_with_wrong_matrices_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(StateSpaceLaw(), **change)


@pytest.mark.parametrize(
    "parameters",
    [
        {"bandwidth_rad_s": 0.0},
        {"bandwidth_rad_s": float("nan")},
        {"rate_limit_deg_s": -1.0},
        {"position_limit_deg": float("inf")},
    ],
)
def test_impossible_actuator_is_refused(parameters):
    with pytest.raises(ValueError, match=f"{next(iter(parameters))}=.*give a finite number"):
        Actuator(**parameters)


def test_impossible_washout_and_gains_are_refused():
    with pytest.raises(ValueError, match="washout_rad_s is 0"):
        RateDamper(washout_rad_s=0.0).controller(F16_3)
    with pytest.raises(ValueError, match="gains are not all finite"):
        OutputFeedback(rudder=(float("nan"), 0.0, 0.0, 0.0)).controller(F16_4)
