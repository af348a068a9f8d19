"""Functional mock-up units in separate processes, against the same equations in Python."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed: the extra fmu")

from core.simulation.flight_process import ModelSimulator, ProcessLimits
from core.simulation.fmu import Fmu
from core.simulation.python_simulator import OwnCodeError
from tests.support import pitch_fmu
from tests.support.own_pitch import doublet, pitch
from tests.support.pitch_fmu import CRASHES, ENDS, FAILS, GROWS, HANGS, make_fmu
from tests.support.short_period import DICTIONARY, DT

pytestmark = pytest.mark.skipif(bool(pitch_fmu.MISSING), reason=pitch_fmu.MISSING)
RNG = np.random.default_rng
VALUES = (pitch_fmu.ALPHA, pitch_fmu.Q, pitch_fmu.NZ, pitch_fmu.SURFACE)


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI 2", "FMI 3"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return of(tmp_path_factory.mktemp("fmu") / "pitch.fmu", request.param)


def of(path: Path, version: int, **how: Any) -> Fmu:
    parameters = pitch_fmu.STIFFNESS, pitch_fmu.GAIN
    references = parameters, [pitch_fmu.COMMAND], VALUES
    return Fmu(str(make_fmu(path, version, **how)), version, DT, *references, [1.0] * 4, [0.0] * 4)


def simulator(model: Fmu, stiffness: float | None = None, **how: Any) -> ModelSimulator:
    """Flies the doublets of `pitch`.   stiffness: of all flights, to break the model."""
    parameters = dict(pitch.parameters)
    if stiffness is not None:
        parameters["stiffness"] = (stiffness, 0.0)
    declared = {"channels": DICTIONARY, "dt": DT, "inputs": doublet, "parameters": parameters}
    return ModelSimulator(model, "pitch.fmu", **declared | how)


@pytest.mark.parametrize("processes", [1, 2, 3])
def test_any_number_of_processes_gives_the_bits_of_the_equations(model: Fmu, processes: int):
    own = simulator(model, processes=processes)
    for _ in range(2):
        y, _, theta = own.rollouts(40, RNG(1))
        expected, _, drawn = pitch.rollouts(40, RNG(1))
        np.testing.assert_array_equal(theta, drawn)
        np.testing.assert_array_equal(y, expected)


def test_given_aircraft_are_flown_and_stopped_as_in_python(model: Fmu):
    own, theta = simulator(model), np.array([[6.0, 1.0], [5.0, 1.2], [7.0, 0.8]])
    np.testing.assert_array_equal(own.fly(theta, RNG(2))[0], pitch.fly(theta, RNG(2))[0])
    which, neutral_from = np.array([2, 0]), np.array([20, 30])
    stopped, expected = (each.stopping(3, RNG(3))(which, neutral_from) for each in (own, pitch))
    np.testing.assert_array_equal(stopped, expected)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (CRASHES, r"crashed \(SIGABRT\)"),
        (HANGS, "more than 1 s"),
        (FAILS, "DoStep returned status 3: no solution"),
        (GROWS, "within 512 MiB of memory"),
    ],
)
def test_a_fault_of_the_model_is_one_error_that_names_the_rollout(
    model: Fmu, fault: float, told: str
):
    limits = ProcessLimits(seconds=1.0, memory=512)
    own = simulator(model, fault, limits=limits, processes=2)
    where = r"pitch\.fmu, rollout 1 of 40 \(stiffness=-\d, gain=[\d.]+\), .*"
    with pytest.raises(OwnCodeError, match=where + told):
        own.rollouts(40, RNG(0))
    assert np.isfinite(own.fly(np.array([[6.0, 1.0]]), RNG(0))[0]).all()


def test_a_flight_that_the_model_ends_has_no_values_after_it(model: Fmu):
    y = simulator(model, ENDS).rollouts(2, RNG(0))[0]
    assert np.isfinite(y[:, 0]).all()
    assert np.isnan(y[:, 1:]).all()


def test_a_reset_that_keeps_the_state_is_refused(tmp_path: Path):
    own = simulator(of(tmp_path / "keeps.fmu", 2, keeps=True))
    with pytest.raises(OwnCodeError, match="reset"):
        own.rollouts(2, RNG(0))


def test_what_cannot_be_loaded_is_one_error(tmp_path: Path, model: Fmu):
    bad = tmp_path / "bad.fmu"
    bad.write_bytes(b"no archive")
    with pytest.raises(OwnCodeError, match=r"pitch\.fmu failed: .*zip"):
        simulator(replace(model, path=str(bad))).rollouts(2, RNG(0))
