import csv
import json
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.monitor import Monitor, load
from core.simulation.aircraft import AIRCRAFT

FIRST_PNG_BYTES = b"\x89PNG\r\n\x1a\n"
RECORDS = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="module")
def attas_monitor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train, by the command line, a monitor for the real records: 0.2 g, noise, jitter."""
    path = tmp_path_factory.mktemp("monitor") / "attas.fwm"
    noise = {"beta": 5e-4, "p": 4e-3, "r": 1e-3, "Ny": 4e-3, "delta_a": 3e-4, "delta_r": 3e-4}
    arguments = ["--aircraft", "attas_id_16kft", "--states", "4", "--control-law", "none"]
    arguments += ["--limit", "Ny=0.2", "--amplitude", "-3.7", "--n-unsafe", "200"]
    arguments += ["--set", "dataset.maneuver.timing_jitter_s=0.1"]
    arguments += ["--set", "dataset.maneuver.amplitude_jitter=0.15"]
    for key, sigma in noise.items():
        arguments += ["--noise", f"{key}={sigma}"]
    assert main(["train", *arguments, "-o", str(path)]) == 0
    return path


def small_study(out: Path, *more: str) -> list[str]:
    return ["study", "--n-monitors", "2", "--n-test", "100", "-o", str(out), *more]


def test_study_writes_table_data_and_both_figures(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(small_study(tmp_path / "out")) == 0
    printed = capsys.readouterr().out
    files = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert sorted(files) == [
        "miss_and_power.png",
        "miss_and_power.svg",
        "rollouts.png",
        "rollouts.svg",
        "study.csv",
        "study.json",
    ]
    assert files["rollouts.png"].startswith(FIRST_PNG_BYTES)
    assert b"<svg" in files["miss_and_power.svg"]
    study = json.loads(files["study.json"])
    rows = list(csv.DictReader(files["study.csv"].decode().splitlines()))
    assert len(rows) == 5 * len(study["methods"]["PCA"]["epsilon"])
    for row in rows:
        method = study["methods"][row["method"]]
        index = method["epsilon"].index(float(row["epsilon"]))
        assert float(row["miss_rate"]) == pytest.approx(method["miss_rate"][index], rel=1e-5)
        assert float(row["power_low"]) <= float(row["power"]) <= float(row["power_high"])
    lines = [line for line in printed.splitlines() if line.startswith(tuple(study["methods"]))]
    assert [line[:27].strip() for line in lines] == study["ranking"]


def test_study_repeats_to_the_byte_for_a_seed(tmp_path: Path):
    for name in ("one", "two"):
        assert main(small_study(tmp_path / name, "--seed", "3")) == 0
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name


@pytest.mark.parametrize("moment", ["core.study.evaluate", "app.figures.study_curves"])
def test_interrupted_study_leaves_nothing_behind(
    moment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(moment, interrupt)
    assert main(small_study(tmp_path / "out")) == 130
    assert "interrupted, nothing was written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_train_writes_a_monitor_that_knows_its_recipe(tmp_path: Path, capsys):
    path = tmp_path / "m.fwm"
    options = ["--n-unsafe", "60", "--t-early", "0.3", "--predictor", "identity", "--seed", "7"]
    assert main(["train", *options, "--n-test", "200", "-o", str(path)]) == 0
    monitor = load(path)
    assert isinstance(monitor, Monitor)
    assert (monitor.n_unsafe, monitor.h, monitor.seed) == (60, 6, 7)
    assert monitor.recipe.to_json()["predictor"] == {"kind": "identity"}
    assert monitor.dataset_recipe["aircraft"]["kind"] == "f16_sl_h0_v502"
    assert "calibrated on 60 failures" in capsys.readouterr().out


def test_printed_recipe_makes_the_same_monitor(tmp_path: Path, capsys):
    options = ["--n-unsafe", "30", "--limit", "beta_deg=6", "--amplitude", "9", "--dt", "0.04"]
    assert main(["train", *options, "--print-recipe"]) == 0
    recipe = tmp_path / "recipe.json"
    recipe.write_text(capsys.readouterr().out)
    for name, arguments in {"a": options, "b": ["--recipe", str(recipe)]}.items():
        assert main(["train", *arguments, "--n-test", "50", "-o", str(tmp_path / name)]) == 0
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    specification = load(tmp_path / "a").dataset_recipe["specification"]
    assert specification["beta"] == pytest.approx(np.radians(6))
    assert specification["Ny"] is None


def test_users_own_matrices_and_manoeuvre_table_train_a_monitor(tmp_path: Path):
    example = AIRCRAFT["matrices"]
    model = {
        "A": [list(row) for row in example.a],  # pyright: ignore
        "B": [list(row) for row in example.b],  # pyright: ignore
        "C": [list(row) for row in example.c],  # pyright: ignore
        "D": [list(row) for row in example.d],  # pyright: ignore
        "uncertainty": {"spread": {"A[0,0]": 0.2, "C[3,0]": 0.2, "B[2,1]": 0.2}},
    }
    (tmp_path / "model.json").write_text(json.dumps(model))
    (tmp_path / "kick.csv").write_text("t_s,delta_r_deg\n0,6\n1,-6\n2,0\n")
    arguments = ["--aircraft", str(tmp_path / "model.json"), "--control-law", "none"]
    arguments += ["--maneuver", str(tmp_path / "kick.csv"), "--limit", "Ny=0.45"]
    arguments += ["--set", "dataset.maneuver.interpolation=hold", "--n-test", "100"]
    assert main(["train", *arguments, "-o", str(tmp_path / "m.fwm")]) == 0
    recipe = load(tmp_path / "m.fwm").dataset_recipe
    assert recipe["maneuver"]["kind"] == "table"
    assert recipe["maneuver"]["delta_a_deg"] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "--aircraft", "concorde"], "aircraft 'concorde' is unknown: choose f16_sl"),
        (["train", "--maneuver", "loop"], "maneuver 'loop' is unknown: choose rudder_doublet"),
        (["train", "--amplitude", "0.1"], "raise the amplitude"),
        (["train", "--amplitude", "80"], "lower the amplitude"),
        (["train", "--epsilon", "0.01"], "epsilon=0.01 needs at least 99 unsafe rollouts"),
        (["train", "--limit", "Nz=1"], "there is no channel 'Nz'"),
        (["train", "--limit", "Ny"], "write it as CHANNEL=NUMBER"),
        (["train", "--limit", "Ny=-1"], "a limit is a positive, finite magnitude"),
        (["train", "--t-early", "0"], "the lead must be positive"),
        (["train", "--t-early", "9"], "the manoeuvre lasts 6 s"),
        (["train", "--set", "dataset.colour=red"], "recipe.dataset has no 'colour'"),
        (["train", "--set", "dataset.dt=fast"], "recipe.dataset.dt is 'fast'"),
        (["train", "--set", "dataset.dt"], "write it as PATH=VALUE"),
        (["train", "--recipe", "absent.json"], "absent.json cannot be read"),
        (["train", "-o", "absent/m.fwm"], "absent is no directory"),
        (["train", "-o", "."], ". is a directory: give the path of the file"),
        (["train", "--n-test", "-1"], "n_test=-1 was given"),
        (["train", "--maneuver", "table"], "give --maneuver FILE.csv"),
        (["train", "--aircraft", "matrices"], "give --aircraft FILE.json"),
        (["train", "--control-law", "state_space"], "state_space' is only an example"),
        (["train", "--dt", "1e-6"], "at most 20000 steps fit"),
        (["train", "--score", "negative_magnitude", "--predictor", "pca"], "choose the predictor"),
        (["study", "--n-monitors", "0"], "n_monitors=0 was given"),
        (["score", "absent.fwm", "absent.csv"], "absent.fwm cannot be read"),
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


def test_study_into_a_file_is_refused_before_the_work(tmp_path: Path, monkeypatch, capsys):
    (tmp_path / "taken").write_text("mine")
    monkeypatch.setattr("core.study.study", lambda *_: pytest.fail("the study ran"))
    assert main(["study", "-o", str(tmp_path / "taken" / "out")]) == 1
    assert "taken is a file: give a directory" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


def test_an_aircraft_without_a_law_flies_without_one(capsys):
    assert main(["train", "--aircraft", "attas_id_16kft", "--print-recipe"]) == 0
    assert json.loads(capsys.readouterr().out)["dataset"]["control_law"]["kind"] == "none"


def test_study_of_another_limit_compares_that_channels_magnitude(tmp_path: Path, capsys):
    assert main(small_study(tmp_path / "out", "--limit", "beta_deg=5.5")) == 0
    assert "predicted |beta|" in capsys.readouterr().out


def test_units_taken_for_others_are_called_outside_training(attas_monitor: Path, tmp_path, capsys):
    rows = [f"{0.05 * k:.2f},{0.01 * k:.3f},0,0,0,0,0" for k in range(100)]
    head = "t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad"
    (tmp_path / "units.csv").write_text("\n".join([head, *rows]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "units.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    report = capsys.readouterr().out
    assert "OUTSIDE TRAINING: |beta| reaches 0.99 rad" in report
    assert "|p|" not in report


def test_crossing_is_doubted_where_the_limited_channel_is_missing(attas_monitor, tmp_path, capsys):
    text = Path(record("attas_rud1.csv")).read_text().splitlines()
    names = text[0].split(",")
    rows = [line.split(",") for line in text[1:]]
    for row in rows[200:231]:
        row[names.index("ay_g")] = ""
    (tmp_path / "holes.csv").write_text("\n".join([text[0], *(",".join(row) for row in rows)]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "holes.csv"), "--trim", "4"]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    assert "1.24 s of the limited channels are missing" in capsys.readouterr().out


def test_cut_off_monitor_is_refused_by_score(attas_monitor: Path, tmp_path: Path, capsys):
    broken = tmp_path / "broken.fwm"
    broken.write_bytes(attas_monitor.read_bytes()[:-100])
    assert main(["score", str(broken), "any.csv", "-o", str(tmp_path / "out")]) == 1
    assert "cut off or was altered" in capsys.readouterr().err


def record(name: str) -> str:
    path = RECORDS / name
    if not path.exists():
        pytest.skip(f"the flight records are not beside this checkout: {path.name} is missing")
    return str(path)


def test_real_doublet_that_crosses_the_limit_is_warned_of(attas_monitor: Path, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [str(attas_monitor), record("attas_rud1.csv"), "--trim", "4", "-o", str(out)]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    assert "first crossing at 8.76 s" in report
    assert "at least the promised 0.25 s" in report
    assert (out / "scored.png").read_bytes().startswith(FIRST_PNG_BYTES)
    rows = list(csv.DictReader((out / "assessments.csv").read_text().splitlines()))
    assert {row["state"] for row in rows} == {"ok"}
    first = next(float(row["t_s"]) for row in rows if row["alert"] == "1")
    assert f"first alert   at {first:.2f} s" in report


def test_real_record_that_keeps_the_limit_gets_no_alert(attas_monitor: Path, tmp_path, capsys):
    arguments = [str(attas_monitor), record("attas_ail1.csv"), "--trim", "4"]
    assert main(["score", *arguments, "-o", str(tmp_path / "out")]) == 0
    report = capsys.readouterr().out
    assert "first alert   none" in report
    assert "first crossing none" in report


def test_assessments_of_a_scored_file_can_be_scored_again(attas_monitor: Path, tmp_path, capsys):
    first, second = tmp_path / "first", tmp_path / "second"
    base = ["score", str(attas_monitor)]
    assert main([*base, record("attas_rud1.csv"), "--trim", "4", "-o", str(first)]) == 0
    assert main([*base, str(first / "assessments.csv"), "-o", str(second)]) == 0
    tables = [(out / "assessments.csv").read_bytes() for out in (first, second)]
    assert tables[0] == tables[1]


def test_file_with_gaps_says_which_samples_were_not_assessed(attas_monitor: Path, tmp_path, capsys):
    lines = ["t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad"]
    lines += [f"{0.05 * k:.2f},0,0,0,{'nan' if k == 10 else 0},0,0" for k in range(40)]
    (tmp_path / "gap.csv").write_text("\n".join(lines))
    arguments = ["score", str(attas_monitor), str(tmp_path / "gap.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    assert "samples: 37 ok, 2 warming_up, 0 stale, 1 invalid" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "out/assessments.csv").read_text().splitlines()))
    assert [row["p_value"] == "" for row in rows] == [k in (10, 11, 12) for k in range(40)]


def test_file_that_cannot_be_assessed_at_all_is_no_success(attas_monitor: Path, tmp_path, capsys):
    lines = ["t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad", "0,,0,0,0,0,0", "0.05,0,,0,0,0,0"]
    (tmp_path / "holes.csv").write_text("\n".join(lines))
    arguments = ["score", str(attas_monitor), str(tmp_path / "holes.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 1
    assert "no sample could be assessed" in capsys.readouterr().out
