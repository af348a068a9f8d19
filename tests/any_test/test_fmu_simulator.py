"""A functional mock-up unit by the command line: `forewarn train --simulator model.fmu`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed: the extra fmu")

from app.cli import main
from app.commands.options.fmu_simulator import fmu_simulator
from core.monitor import load
from tests.support import pitch_fmu
from tests.support.pitch_fmu import make_fmu

pytestmark = pytest.mark.skipif(bool(pitch_fmu.MISSING), reason=pitch_fmu.MISSING)
POINT: dict[str, Any] = {
    "channels": {"alpha": "alpha_deg", "q": "q", "Nz": "az", "delta_e": "surface"},
    "inputs": {
        "command": [[0.5, 0], [0.5, -0.06], [1.3, -0.06], [1.3, 0.06], [2.1, 0.06], [2.1, 0]]
    },
    "parameters": {"stiffness": 1.1, "control.gain": [1.0, 0.18]},
    "noise": {"alpha": 1e-3, "q": 2e-3, "Nz": 0.01, "delta_e": 5e-4},
    "duration_s": 4.0,
    "dt": 0.05,
}
OPTIONS = ["--limit", "Nz=-1.1..2.9g", "--epsilon", "0.1", "--n-unsafe", "60", "--n-test", "300"]
METHOD = ["--guarantee", "average", "--predictor", "peak_ridge"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    make_fmu(folder / "pitch.fmu", 2)
    make_fmu(folder / "pitch3.fmu", 3)
    (folder / "point.json").write_text(json.dumps(POINT))
    return folder


def train(folder: Path, *options: str) -> int:
    return main(["train", *OPTIONS, *METHOD, "-o", str(folder / "pitch.fwm"), *options])


def test_units_are_those_that_the_model_defines(folder: Path):
    """The same outputs, in rad and in deg, in g and in the model's own unit."""
    plain = POINT["channels"] | {"alpha": "alpha", "Nz": "Nz"}
    (folder / "si.json").write_text(json.dumps(POINT | {"channels": plain}))
    y, si = (
        fmu_simulator(str(folder / "pitch3.fmu"), folder / name).rollouts(
            4, np.random.default_rng(0)
        )[0]
        for name in ("point.json", "si.json")
    )
    np.testing.assert_allclose(y, si, rtol=1e-12)
    assert np.ptp(y[..., 2]) > 1.0


@pytest.mark.parametrize("name", ["pitch.fmu", "pitch3.fmu"])
def test_a_monitor_is_trained_and_tested_on_flights_of_the_model(folder: Path, name: str):
    model, point = str(folder / name), str(folder / "point.json")
    assert train(folder, "--simulator", model, "--point", point) == 0
    monitor = load(folder / "pitch.fwm")
    assert monitor.dictionary.keys == ("alpha", "q", "Nz", "delta_e")
    recipe = monitor.dataset_recipe
    assert recipe["simulator"] == model
    assert recipe["parameters"]["stiffness"] == {"nominal": 6.0, "spread": 1.1}
    assert recipe["point"]["inputs"] == POINT["inputs"]
    assert len(recipe["sha256"]) == 64
    evaluation = monitor.evaluation or {}
    assert evaluation["at_epsilon"]["miss_rate"] < 0.1 + 3 * (0.09 / evaluation["n_unsafe"]) ** 0.5
    assert {"prevention", "robustness"} <= evaluation.keys()


def test_a_channel_that_is_not_known_has_the_unit_and_the_role_of_its_variable(folder: Path):
    more = {"channels": POINT["channels"] | {"stick_command": "command", "incidence": "alpha_deg"}}
    (folder / "more.json").write_text(json.dumps(POINT | more))
    simulator = fmu_simulator(str(folder / "pitch.fmu"), folder / "more.json")
    stick, incidence = simulator.channels.channels[-2:]  # pyright: ignore
    assert (stick.unit, stick.role) == ("rad", "control")
    assert (incidence.unit, incidence.display_unit, incidence.role) == ("rad", "deg", "output")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"channels": {"Nz": "Nzz"}}, "no real output 'Nzz': did you mean Nz?"),
        ({"channels": {"Nz": "alpha"}}, "alpha: 'rad' is not a unit of this quantity"),
        ({"channels": {}}, "has no channels: give some, of parameters stiffness"),
        ({"parameters": {}}, "has no parameters: give some"),
        ({"parameters": {"gain": 1}}, "no real parameter 'gain': choose stiffness, control.gain"),
        ({"inputs": {"alpha": [[0, 1]]}}, "no real input 'alpha'"),
        ({"inputs": {"command": [[1, 0], [0, 1]]}}, "times that decrease"),
        ({"inputs": {"command": [[1]]}}, "inputs.command.0.1 is missing"),
        ({"noise": {"Nx": 1}}, "'Nx' is unknown"),
        ({"dt": -1}, "dt=-1.0 was given"),
        ({"dt": 9}, "shorter than duration_s"),
        ({"length": 9}, "has no 'length'"),
        ({"parameters": {"stiffness": [-1, 0.0]}}, "crashed (SIGABRT)"),
    ],
)
def test_a_point_that_does_not_fit_the_model_is_refused_in_one_sentence(
    given: dict[str, Any], told: str, folder: Path, capsys: pytest.CaptureFixture[str]
):
    (folder / "wrong.json").write_text(json.dumps(POINT | given))
    out = ["-o", str(folder / "refused.fwm")]
    model, point = str(folder / "pitch.fmu"), str(folder / "wrong.json")
    assert train(folder, "--simulator", model, "--point", point, *out) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert not (folder / "refused.fwm").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--simulator", "pitch.fmu"], "inputs command [rad]; outputs alpha [rad], q [rad/s]"),
        (["--simulator", "no.fmu", "--point", "point.json"], "no.fmu is not readable"),
        (["--simulator", "bad.fmu", "--point", "point.json"], "not a functional mock-up unit"),
        (["--simulator", "module:name", "--point", "point.json"], "which has its own: omit it"),
        (["--point", "point.json"], "--point was given without --simulator"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    options: list[str],
    told: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(folder)
    Path("bad.fmu").write_text("no archive")
    assert train(folder, *options) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_without_fmpy_the_extra_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("app.commands.options.fmu_simulator.find_spec", lambda name: None)
    assert train(folder, "--simulator", "pitch.fmu") == 1
    assert "install forewarn[fmu]" in capsys.readouterr().err
