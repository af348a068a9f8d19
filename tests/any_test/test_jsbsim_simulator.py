"""An aircraft of JSBSim by the command line: `forewarn train --simulator jsbsim:NAME`."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jsbsim", reason="JSBSim is not installed: the extra jsbsim")

from app.cli import main
from app.commands.options.jsbsim_simulator import jsbsim_simulator
from core.channels import SIX_DOF

POINT: dict[str, Any] = {
    "altitude_m": 1500,
    "speed_m_s": 55,
    "inputs": {"fcs/elevator-cmd-norm": [[0.5, 0], [0.5, -0.3], [1, -0.3], [1, 0.3], [1.5, 0]]},
    "duration_s": 2.0,
    "dt": 0.05,
}


def point(folder: Path, **changes: Any) -> Path:
    file = folder / "point.json"
    file.write_text(json.dumps(POINT | changes))
    return file


def test_channels_are_the_known_ones_that_the_aircraft_has(tmp_path: Path):
    own = jsbsim_simulator("jsbsim:c172p", point(tmp_path))
    assert own.channels == SIX_DOF
    assert len(own.parameters) == 31
    assert set(own.parameters.values()) == {(1.0, 0.1)}
    y = own.rollouts(2, np.random.default_rng(0))[0]
    np.testing.assert_allclose(y[:, 0, SIX_DOF.index("V")], 55.0, rtol=1e-6)
    t38 = jsbsim_simulator("jsbsim:T38", point(tmp_path))
    assert "delta_e" not in t38.measured, "its flight controls write no angle of the elevator"


def test_own_channels_have_the_unit_at_the_end_of_their_property(tmp_path: Path):
    channels = {
        "Nz": "accelerations/Nz",
        "V": "velocities/vt-fps",
        "airspeed": "velocities/vc-kts",
        "elevator": "fcs/elevator-pos-rad",
    }
    changes = {"channels": channels, "parameters": {"aero/coefficient/Cmalpha": 0.3}}
    own = jsbsim_simulator("jsbsim:c172p", point(tmp_path, **changes))
    known: Any = own.channels
    shown = [(each.unit, each.display_unit, each.role) for each in known.channels[2:]]
    assert shown == [("m/s", "kts", "output"), ("rad", "deg", "control")]
    assert own.parameters["aero/coefficient/Cmalpha"] == (1.0, 0.3)
    y = own.rollouts(2, np.random.default_rng(0))[0][:, 0]
    np.testing.assert_allclose(y[:, 1], 55.0, rtol=1e-6)
    assert (y[:, 2] < 55.0).all()
    assert (y[:, 2] > 45.0).all()


@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        ("c172q", {}, "no aircraft 'c172q': did you mean c172p?"),
        ("c172p", {"speed_m_s": None}, "has no speed_m_s"),
        ("c172p", {"inputs": {}}, "has no inputs: give some, such as fcs/elevator-cmd-norm"),
        ("c172p", {"altitude_m": -5}, "altitude_m=-5.0 was given"),
        ("c172p", {"parameters": {"aero/Cm": 1}}, "has no function 'aero/Cm'"),
        ("c172p", {"channels": {"Nz": "velocities/vt-fps"}}, "not a unit of this quantity"),
        ("c172p", {"inputs": {"fcs/elevator": [[0, 0]]}}, "it has no property fcs/elevator"),
        ("c172p", {"speed_m_s": 12}, "no trim at 12 m/s (Mach 0.0359) and 1500 m"),
        ("c172p", {"spread": 0}, "repeat another one"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_one_sentence(
    name: str,
    changes: dict[str, Any],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    changes = {"timing_jitter_s": 0, "amplitude_jitter": 0, **changes}
    file = f"{point(tmp_path, **changes)}"
    options = ["--limit", "Nz=..2g", "-o", str(tmp_path / "refused.fwm"), "--point", file]
    assert main(["train", "--simulator", f"jsbsim:{name}", *options]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_without_a_point_what_it_needs_is_named(capsys: pytest.CaptureFixture[str]):
    assert main(["train", "--simulator", "jsbsim:c172p", "--limit", "Nz=..2g"]) == 1
    assert "--point FILE.json, with altitude_m" in capsys.readouterr().err


def test_without_an_aircraft_an_example_is_named(capsys: pytest.CaptureFixture[str]):
    assert main(["train", "--simulator", "jsbsim:", "--limit", "Nz=..2g"]) == 1
    assert "such as jsbsim:c172p" in capsys.readouterr().err


def test_without_a_limit_the_channels_are_named_and_a_limit_that_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    given = ["--simulator", "jsbsim:c172p", "--point", f"{point(tmp_path)}"]
    assert main(["train", *given, "-o", str(tmp_path / "refused.fwm")]) == 1
    told = capsys.readouterr().err
    assert f"limit any of {', '.join(SIX_DOF.keys)}" in told
    assert re.search(r"--limit Nz=\.\.\d\.\d+, in g", told)


def test_without_jsbsim_the_extra_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("app.commands.options.jsbsim_simulator.find_spec", lambda name: None)
    assert main(["train", "--simulator", "jsbsim:c172p", "--limit", "Nz=..2g"]) == 1
    assert "install forewarn[jsbsim]" in capsys.readouterr().err
