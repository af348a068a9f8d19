"""The command line: help, mistyped and bad arguments, results as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import COMMANDS, main
from core.monitor import load

pytestmark = pytest.mark.usefixtures("read_here")
LEAST = ("--n-monitors", "1", "--n-test", "20")
FIGURES = "app.report.studies.study_figures.render"


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_prints_its_options(name: str, capsys: pytest.CaptureFixture):
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: forewarn {name} [-h] ")


def test_help_names_every_command(capsys: pytest.CaptureFixture):
    with pytest.raises(SystemExit):
        main(["--help"])
    words = capsys.readouterr().out.split()
    assert set(COMMANDS) <= set(words)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["trian"], "'trian': did you mean train?"),
        (["qq"], f"'qq': choose {', '.join(COMMANDS)}"),
        (["train", "--ampltude", "3"], "'--ampltude': did you mean --amplitude?"),
        (["train", "--outcom", "safe"], "'--outcom': did you mean --out?"),
        (["--jsn"], "'--jsn' needs a command before it: did you mean --json?"),
        (["study", "--nmonitors=3"], "'--nmonitors=3': did you mean --n-monitors?"),
        (["restore", "a.fwbackup", "b.fwbackup"], "restore takes FILE: leave out 'b.fwbackup'"),
        (["study", "3"], "study takes options only: leave out '3'"),
    ],
)
def test_an_unknown_word_gets_the_closest_one_in_one_line(arguments, line, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("forewarn: ")
    assert error.endswith(f"{line}\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--aircraft", "atas"], "aircraft 'atas' is unknown: did you mean attas_id_16kft?"),
        (["--manoeuvre", "rudder_doublte"], "did you mean rudder_doublet?"),
        (["--set", "dataset.sead=3"], "recipe.dataset has no 'sead': did you mean seed?"),
        (["--limit", "nY=0.5"], "unknown channel 'nY': did you mean Ny?"),
        (["--calibration", "trajectry"], "'trajectry' is unknown: did you mean trajectory?"),
        (["--states", "5"], "--states: 5 is unknown: choose 3, 4"),
        (["--seed", "one"], "--seed: 'one' was given: give a whole number"),
        (["--amplitude", "most"], "--amplitude: 'most' was given: give a number, or auto"),
    ],
)
def test_a_mistyped_value_gets_the_closest_one_in_one_line(arguments, words, capsys):
    try:
        code = main(["train", *arguments])
    except SystemExit as ended:
        code = ended.code
    assert code in (1, 2)
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "value", "remedy"),
    [
        ("--trim", "long", "give a number of seconds"),
        ("--epsilon", "0.1,x", "give miss rates between 0 and 1"),
        ("--manoeuvres", "all", "give detected, entire, or START:END"),
        ("--manoeuvres", "1:a", "give detected, entire, or START:END"),
    ],
)
def test_a_mistyped_setting_of_a_scoring_gets_one_line(option, value, remedy, capsys):
    with pytest.raises(SystemExit):
        main(["score", "m.fwm", "f.csv", option, value])
    error = capsys.readouterr().err
    assert f"{option}: {value!r} was given: {remedy}" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("outcome", ["unsafe", "safe"])
def test_a_sample_flight_has_its_outcome_and_units(outcome: str, tmp_path: Path, capsys):
    path = tmp_path / "flight.csv"
    assert main(["sample-flight", "--out", str(path), "--outcome", outcome, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    rows = np.genfromtxt(path, delimiter=",", names=True)
    exceeds = np.abs(rows["ay_g"]) >= 0.5
    assert exceeds.any() == (outcome == "unsafe")
    if outcome == "unsafe":
        assert answer["exceeds_at"] == pytest.approx(rows["t_s"][exceeds.argmax()])
    assert (rows["beta_deg"][:100] == 0).all()
    assert 5 < np.abs(rows["dr_deg"]).max() < 30


def test_a_sample_flight_uses_the_aircraft_and_amplitude_given(tmp_path: Path, capsys):
    path = tmp_path / "flight.csv"
    chosen = ["sample-flight", "--out", str(path), "--aircraft", "attas_id_16kft"]
    assert main([*chosen, "--amplitude", "2.56", "--outcome", "safe"]) == 0
    assert "attas_id_16kft" in capsys.readouterr().out
    deflection = np.abs(np.genfromtxt(path, delimiter=",", names=True)["dr_deg"]).max()
    assert 1.5 < deflection < 3.5  # with the damper
    assert main([*chosen, "--amplitude", "0.1"]) == 1
    assert "--amplitude further from 0" in capsys.readouterr().err


def test_train_score_report_and_study_print_json(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(tmp_path / "data"))

    def answer(*arguments: str) -> dict[str, Any]:
        main([*arguments, "--json"])
        return json.loads(capsys.readouterr().out)

    trained = answer("train", "--n-unsafe", "50", "--n-test", "100", "--out", "m.fwm")
    assert trained["evaluation"]["n_test"] == 100
    assert trained["file"] == "m.fwm"
    assert trained["dataset"]["n_unsafe"] == load(tmp_path / "m.fwm").n_unsafe
    answer("sample-flight")
    for command in ("score", "report"):
        result = answer(command, "m.fwm", "flight.csv")
        (manoeuvre,) = result["scorings"][0]["manoeuvres"]
        assert manoeuvre["exceedance"]["channel"] == "Ny"
        assert result["scorings"][0]["compatibility"][0]["unchecked"] == "without bank angle"
        assert all(Path(name).exists() for name in result["files"])
    monkeypatch.setattr(FIGURES, lambda _, stem: {f"{stem}.svg": b""})
    study = answer("study", *LEAST, "-o", str(tmp_path / "out"), "--limit", "beta_deg=5.5")
    assert "predicted |beta|" in study["methods"]
    assert study == json.loads((tmp_path / "out" / "study.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "--aircraft", "concorde"], "aircraft 'concorde' is unknown: choose f16_sl"),
        (["train", "--maneuver", "loop"], "maneuver 'loop' is unknown: choose rudder_doublet"),
        (
            [
                "train",
                "--amplitude",
                "0.1",
                "--imperfections",
                "none",
                "--set",
                "dataset.max_rollouts=2000",
            ],
            "raise the amplitude, lower the limit or raise --max-rollouts. At an amplitude of 9.",
        ),
        (["train", "--amplitude", "80"], "lower the amplitude"),
        (["train", "--n-unsafe", "50", "--epsilon", "0.01"], "needs at least 299 unsafe rollouts"),
        (["train", "--limit", "Ny=29", "--amplitude", "auto"], "exceed a limit even at 45 deg"),
        (["train", "--limit", "Nz=1"], "unknown channel 'Nz'"),
        (["train", "--limit", "Ny"], "write it as CHANNEL=NUMBER"),
        (["train", "--limit", "Ny=5deg"], "lateral acceleration is in g: write Ny=5g if"),
        (["train", "--limit", "beta_deg=5deg"], "sideslip is in deg or rad: write beta=5deg if"),
        (["train", "--limit", "beta=7"], "for 7deg give 0.1222 rad"),
        (["train", "--limit", "p=20"], "--limit p=20deg/s"),
        (["train", "--limit", "Ny=-1"], "a limit is a positive, finite magnitude"),
        (["train", "--t-early", "0"], "the lead must be positive"),
        (["train", "--t-early", "9"], "the manoeuvre lasts 6 s"),
        (["train", "--set", "dataset.colour=red"], "recipe.dataset has no 'colour'"),
        (["train", "--set", "dataset.dt=fast"], "recipe.dataset.dt is 'fast'"),
        (["train", "--set", "dataset.dt"], "write it as PATH=VALUE"),
        (["train", "--recipe", "absent.json"], "absent.json is not readable"),
        (["train", "-o", "absent/m.fwm"], "absent is not a directory"),
        (["train", "-o", "."], ". is a directory: give the path of the file"),
        (["train", "--n-test", "-1"], "--n-test=-1 was given"),
        (["train", "--maneuver", "table"], "give --maneuver FILE.csv"),
        (["train", "--aircraft", "matrices"], "give --aircraft FILE.json"),
        (["train", "--control-law", "state_space"], "state_space' is only an example"),
        (["train", "--dt", "1e-6"], "at most 20000 steps fit"),
        (["train", "--score", "negative_magnitude", "--predictor", "pca"], "choose the predictor"),
        (["study", "--n-monitors", "0"], "--n-monitors=0 was given"),
        (["score", "absent.fwm", "absent.csv"], "absent.fwm cannot be read"),
        (["score", "m.fwm", "f.csv", "--manoeuvres", "3:1"], "3 to 1 s has no length"),
        (["score", "m.fwm", "f.csv", "--mapping", "absent.json"], "absent.json is not readable"),
    ],
)
def test_bad_input_gets_one_line_and_leaves_nothing(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) != 0
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--amplitude", "999"], "-45 to 45 deg"),
        (["--amplitude=-46"], "-45 to 45 deg"),
        (["--out", "flight.xlsx"], ".csv"),
    ],
)
def test_a_sample_flight_that_cannot_be_written_is_one_clear_error(
    words: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sample-flight", *words]) == 1
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
