"""Aircraft of JSBSim in separate processes."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("jsbsim", reason="JSBSim is not installed: the extra jsbsim")

from core.simulation.flight_process import ModelSimulator
from core.simulation.jsbsim import FOOT, PROPERTIES, Jsbsim, _Aircraft, functions_of
from core.simulation.python_simulator import OwnCodeError
from core.types import Array

RNG = np.random.default_rng
ELEVATOR = "fcs/elevator-cmd-norm"
DT, N_SAMPLES = 0.05, 41
KEYS = ("alpha", "q", "Nz", "delta_e")
FUNCTIONS = {"f16": 40, "T38": 25, "c172p": 31, "737": 25, "fokker100": 28}
"""Aerodynamic functions of aircraft."""


def model(aircraft: str = "c172p", altitude: float = 1500.0, speed: float = 55.0) -> Jsbsim:
    functions, outputs = functions_of(aircraft), [PROPERTIES[key] for key in KEYS]
    return Jsbsim(aircraft, altitude, speed, DT, functions, [ELEVATOR], outputs, [1.0] * 4)


def simulator(jsbsim: Jsbsim, spread: float = 0.1, **how: Any) -> ModelSimulator:
    commands = np.repeat([0.0, -0.2, 0.2, 0.0], [6, 10, 10, 15])
    declared = {
        "channels": KEYS,
        "dt": DT,
        "inputs": commands,
        "parameters": dict.fromkeys(jsbsim.functions, (1.0, spread)),
    }
    return ModelSimulator(jsbsim, f"jsbsim:{jsbsim.aircraft}", **declared | how)


def test_any_number_of_processes_gives_the_same_bits():
    flights = [simulator(model(), processes=n).rollouts(40, RNG(1))[0] for n in (1, 2, 3)]
    assert len(np.unique(flights[0].reshape(40, -1), axis=0)) == 40
    for other in flights[1:]:
        np.testing.assert_array_equal(flights[0], other)


def test_flights_of_several_threads_at_once_are_those_of_one():
    own = simulator(model(), processes=1)
    alone = [own.rollouts(20, RNG(seed))[0] for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda seed: own.rollouts(20, RNG(seed))[0], range(4)))
    np.testing.assert_array_equal(together, alone)


def test_a_copy_for_another_process_flies_the_same():
    original = simulator(model())
    flown = original.rollouts(3, RNG(1))[0]
    copied: ModelSimulator = pickle.loads(pickle.dumps(original))
    np.testing.assert_array_equal(copied.rollouts(3, RNG(1))[0], flown)


@pytest.mark.parametrize(
    ("aircraft", "altitude", "speed"),
    [
        *(("f16", 3000, 180), ("T38", 3000, 200), ("c172p", 1500, 55), ("737", 3000, 180)),
        ("fokker100", 5000, 190),  # its system for push-back reads a property of FlightGear
    ],
)
def test_aircraft_of_any_factors_fly_trimmed_and_respond(
    aircraft: str, altitude: float, speed: float
):
    own = simulator(model(aircraft, altitude, speed))
    y, _, theta = own.rollouts(60, RNG(2))
    assert theta.shape == (60, FUNCTIONS[aircraft])
    trimmed = y[:, :6]
    assert np.ptp(trimmed, axis=1).max() < 1e-3
    np.testing.assert_allclose(trimmed[..., KEYS.index("Nz")], 1.0, atol=0.02)
    assert np.ptp(y[..., KEYS.index("Nz")], axis=1).min() > 0.1


def test_every_function_changes_the_flight():
    jsbsim = model()
    pitch = ("CLwbh", "CLDe", "CLq", "CDwbh", "Cmo", "Cmalpha", "Cmq", "Cmadot", "Cmde")
    factors = np.ones((len(pitch) + 1, len(jsbsim.functions)))
    for row, name in zip(factors, pitch, strict=False):
        row[[each.endswith(f"/{name}") for each in jsbsim.functions]] = 1.3
    y = simulator(jsbsim).fly(factors, RNG(0))[0]
    changes = np.abs(y[:-1] - y[-1]).max(axis=(1, 2))
    assert (changes > 1e-3).all()


def test_a_small_doublet_is_that_of_its_own_linearisation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """JSBSim's linearisation about the same trim, whose states are propagated exactly."""
    from jsbsim import FGLinearization

    jsbsim = model()
    monkeypatch.chdir(tmp_path)
    aircraft = _Aircraft(jsbsim)
    ones = np.ones(len(jsbsim.functions))
    commands = 0.02 * np.repeat([0.0, -1.0, 1.0, 0.0], [1, 10, 10, 20])[:, np.newaxis]
    y = aircraft.fly(ones, commands)
    aircraft._trim(ones)
    linear: Any = FGLinearization(aircraft._fdm)
    a, b = np.array(linear.system_matrix), np.array(linear.input_matrix)
    expected = _propagated(a, b[:, linear.u_names.index("DeCmd")], commands[:, 0])
    for key, state in (("alpha", "Alpha"), ("q", "Q")):
        flown = y[:, KEYS.index(key)] - y[0, KEYS.index(key)]
        predicted = expected[:, linear.x_names.index(state)]
        assert np.abs(flown).max() > 1e-3
        np.testing.assert_allclose(flown, predicted, atol=0.05 * np.abs(flown).max())


def _propagated(a: Array, b: Array, commands: Array) -> Array:
    n = len(a)
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n], augmented[:n, n] = a, b
    step = expm(augmented * DT)
    x = np.zeros((len(commands), n))
    for k, command in enumerate(commands[:-1]):
        x[k + 1] = step[:n, :n] @ x[k] + step[:n, n] * command
    return x


def test_the_tanks_are_as_full_for_each_flight():
    own, theta = simulator(model()), np.ones((20, 31))
    y = own.fly(theta, RNG(0))[0]
    np.testing.assert_array_equal(y, np.repeat(y[:1], 20, axis=0))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"speed": 10.0}, "no trim at 10 m/s"),
        ({"inputs": ["fcs/elevator-cmd-nrm"]}, "did you mean fcs/elevator-cmd-norm"),
        ({"outputs": ["aero/alfa-rad"] * 4}, "no property aero/alfa-rad"),
    ],
)
def test_what_cannot_fly_is_one_error(wrong: dict[str, Any], told: str):
    with pytest.raises(OwnCodeError, match=f"jsbsim:c172p.*{told}"):
        simulator(replace(model(), **wrong)).rollouts(2, RNG(0))


def test_an_aircraft_without_trim_is_drawn_again_and_counted():
    slow = model(speed=40.0)
    one, two = (simulator(slow, 0.3, processes=n) for n in (1, 2))
    (y, _, theta), (other, _, _) = (own.rollouts(60, RNG(0)) for own in (one, two))
    assert np.isfinite(y).all()
    np.testing.assert_array_equal(y, other)
    assert one.redrawn == two.redrawn
    assert " of 6" in one.redrawn
    drawn = np.ones((60, 31)) + 0.3 * RNG(0).standard_normal((60, 31))
    again = (drawn != theta).any(axis=1)
    assert 0 < again.sum() < 20
    np.testing.assert_array_equal(one.fly(theta, RNG(0))[0], y)
    whole = np.full(60, len(y[0]))
    np.testing.assert_array_equal(one.stopping(60, RNG(0))(np.arange(60), whole), y)
    with pytest.raises(OwnCodeError, match="no trim at 40 m/s"):
        one.fly(drawn, RNG(0))


def test_an_unknown_aircraft_is_named():
    with pytest.raises(ValueError, match="no aircraft 'c172q': did you mean c172p"):
        functions_of("c172q")


def test_speed_is_in_metres_per_second():
    jsbsim = replace(model(), outputs=[PROPERTIES["V"]], scale=[FOOT])
    y = simulator(jsbsim, channels=["V"]).rollouts(2, RNG(0))[0]
    np.testing.assert_allclose(y[:, 0], 55.0, rtol=1e-6)
