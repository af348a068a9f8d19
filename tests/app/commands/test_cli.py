import csv
import json
import re
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import COMMANDS, main
from app.jobs.requests import dataset_request, study_request
from core.monitor import Monitor, load
from core.planned_test import USUAL_NOISE, DatasetRecipe, SensorNoise
from core.recipe import from_plain, to_plain
from core.simulation.aircraft import AIRCRAFT
from core.simulation.imperfections import USUAL_IMPERFECTIONS
from tests.support.attas import record_file
from tests.support.places import ROOT

pytestmark = pytest.mark.usefixtures("read_here")
FIRST_PNG_BYTES = b"\x89PNG\r\n\x1a\n"
LEAST = ("--n-monitors", "1", "--n-test", "20")
FIGURES = "app.report.study_figures.render"
VERSION_0_1_0 = {
    key: part for key, part in to_plain(DatasetRecipe()).items() if key != "imperfections"
}
"""A recipe as a version that knew no imperfections stored it."""
HEAD = "t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad"


@pytest.fixture(scope="module")
def attas_monitor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train, by the command line and its defaults, a monitor for the real records."""
    path = tmp_path_factory.mktemp("monitor") / "attas.fwm"
    arguments = ["--aircraft", "attas_id_16kft", "--states", "4", "--control-law", "none"]
    arguments += ["--amplitude", "-3.7", "--n-unsafe", "200"]
    assert main(["train", *arguments, "-o", str(path)]) == 0
    return path


def small_study(out: Path, *more: str) -> list[str]:
    return ["study", "--n-monitors", "2", "--n-test", "100", "-o", str(out), *more]


def contents(directory: Path) -> dict[str, bytes]:
    """Read each file of a directory, by name."""
    return {path.name: path.read_bytes() for path in directory.iterdir()}


@pytest.fixture(scope="module")
def small_studied(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], str]:
    """Run a small study once: its files, and what was printed."""
    out, printed = tmp_path_factory.mktemp("study") / "out", StringIO()
    with redirect_stdout(printed):
        assert main(small_study(out, "--seed", "3")) == 0
    return contents(out), printed.getvalue()


def test_study_writes_table_data_and_both_figures(small_studied: tuple[dict[str, bytes], str]):
    files, printed = small_studied
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


def test_study_repeats_to_the_byte_for_a_seed(small_studied, tmp_path: Path):
    assert main(small_study(tmp_path / "again", "--seed", "3")) == 0
    assert contents(tmp_path / "again") == small_studied[0]


@pytest.mark.parametrize("moment", ["core.study.evaluate", "app.report.study_figures.study_curves"])
def test_interrupted_study_leaves_nothing_behind(
    moment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(FIGURES, lambda _, stem: {f"{stem}.svg": b""})
    monkeypatch.setattr(moment, interrupt)
    assert main(small_study(tmp_path / "out", *LEAST)) == 130
    assert "interrupted, nothing was written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


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
        (["trian"], "there is no command 'trian': did you mean train?"),
        (["qq"], f"there is no command 'qq': choose {', '.join(COMMANDS)}"),
        (["train", "--ampltude", "3"], "train takes no '--ampltude': did you mean --amplitude?"),
        (["train", "--outcom", "safe"], "train takes no '--outcom': did you mean --out?"),
        (["--jsn"], "'--jsn' needs a command before it: did you mean --json?"),
        (["study", "--nmonitors=3"], "study takes no '--nmonitors=3': did you mean --n-monitors?"),
    ],
)
def test_what_is_mistyped_is_told_the_right_word(arguments, line, capsys):
    assert main(arguments) == 2
    assert capsys.readouterr().err == f"forewarn: {line}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--aircraft", "atas"], "aircraft 'atas' is unknown: did you mean attas_id_16kft?"),
        (["--manoeuvre", "rudder_doublte"], "did you mean rudder_doublet?"),
        (["--set", "dataset.sead=3"], "recipe.dataset has no 'sead': did you mean seed?"),
        (["--limit", "nY=0.5"], "there is no channel 'nY': did you mean Ny?"),
        (["--calibration", "trajectry"], "'trajectry' is unknown: did you mean trajectory?"),
        (["--states", "5"], "--states: 5 is unknown: choose 3, 4"),
        (["--seed", "one"], "--seed: 'one' was given: give a whole number"),
        (["--amplitude", "most"], "--amplitude: 'most' was given: give a number, or auto"),
    ],
)
def test_a_mistyped_value_is_told_the_right_one_in_one_line(arguments, words, capsys):
    try:
        code = main(["train", *arguments])
    except SystemExit as ended:
        code = ended.code
    assert code in (1, 2)
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("outcome", ["unsafe", "safe"])
def test_a_sample_flight_is_read_back_as_it_was_flown(outcome: str, tmp_path: Path, capsys):
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


def test_results_are_printed_as_json_also_of_another_limit(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(tmp_path / "data"))

    def answer(*arguments: str) -> dict[str, Any]:
        main([*arguments, "--json"])
        return json.loads(capsys.readouterr().out)

    trained = answer("train", "--n-test", "100", "--out", "m.fwm")
    assert trained["evaluation"]["n_test"] == 100
    assert trained["file"] == "m.fwm"
    assert trained["dataset"]["n_unsafe"] == load(tmp_path / "m.fwm").n_unsafe
    answer("sample-flight")
    for command in ("score", "report"):
        told = answer(command, "m.fwm", "flight.csv")
        (manoeuvre,) = told["scorings"][0]["manoeuvres"]
        assert manoeuvre["exceedance"]["channel"] == "Ny"
        assert told["scorings"][0]["compatibility"][0]["unchecked"] == "without bank angle"
        assert all(Path(name).exists() for name in told["files"])
    monkeypatch.setattr(FIGURES, lambda _, stem: {f"{stem}.svg": b""})
    study = answer(*small_study(tmp_path / "out", *LEAST, "--limit", "beta_deg=5.5"))
    assert "predicted |beta|" in study["methods"]
    assert study == json.loads((tmp_path / "out" / "study.json").read_text())


def test_train_writes_a_monitor_that_knows_its_recipe(tmp_path: Path, capsys):
    path = tmp_path / "m.fwm"
    options = ["--n-unsafe", "60", "--t-early", "0.3", "--predictor", "identity", "--seed", "7"]
    assert main(["train", *options, "--n-test", "200", "-o", str(path)]) == 0
    monitor = load(path)
    assert isinstance(monitor, Monitor)
    assert (monitor.n_unsafe, monitor.h, monitor.seed) == (60, 6, 7)
    assert to_plain(monitor.recipe)["predictor"] == {"kind": "identity"}
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
            "raise the amplitude, lower the limit or raise max_rollouts. At an amplitude of 9.",
        ),
        (["train", "--amplitude", "80"], "lower the amplitude"),
        (["train", "--epsilon", "0.01"], "epsilon=0.01 needs at least 99 unsafe rollouts"),
        (["train", "--limit", "Ny=90", "--amplitude", "auto"], "exceed a limit even at 45 deg"),
        (["train", "--limit", "Nz=1"], "there is no channel 'Nz'"),
        (["train", "--limit", "Ny"], "write it as CHANNEL=NUMBER"),
        (["train", "--limit", "Ny=5deg"], "lateral acceleration is in g: write Ny=5g if"),
        (["train", "--limit", "beta_deg=5deg"], "sideslip is in deg or rad: write beta=5deg if"),
        (["train", "--limit", "beta=7"], "if 7deg was meant, give 0.1222 rad, or on the command"),
        (["train", "--limit", "p=20"], "--limit p=20deg/s"),
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
        (["score", "m.fwm", "f.csv", "--trim", "long"], "'long': write a number of seconds, trim"),
        (["score", "m.fwm", "f.csv", "--epsilon", "0.1,x"], "'x': write a miss rate between 0 and"),
        (
            ["score", "m.fwm", "f.csv", "--manoeuvres", "all"],
            "'all': write detected, entire, or S",
        ),
        (["score", "m.fwm", "f.csv", "--manoeuvres", "1:a"], "'a': write a number of seconds"),
        (["score", "m.fwm", "f.csv", "--manoeuvres", "3:1"], "3 to 1 s has no length"),
        (["score", "m.fwm", "f.csv", "--mapping", "absent.json"], "absent.json cannot be read"),
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
    monkeypatch.setattr("app.commands.study.study", lambda *_, **__: pytest.fail("it ran"))
    assert main(["study", "-o", str(tmp_path / "taken" / "out")]) == 1
    assert "taken is a file: give a directory" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


def printed_recipe(capsys: pytest.CaptureFixture, *options: str) -> dict[str, Any]:
    assert main(["train", *options, "--print-recipe"]) == 0
    return json.loads(capsys.readouterr().out)["dataset"]


@pytest.mark.parametrize("kind", [kind for kind in AIRCRAFT if kind != "matrices"])
def test_every_aircraft_brings_its_usual_test(kind: str, tmp_path: Path, capsys):
    recipe = printed_recipe(capsys, "--aircraft", kind)
    assert recipe == to_plain(DatasetRecipe.usual(AIRCRAFT[kind]).as_flown())
    assert recipe["control_law"]["kind"] == AIRCRAFT[kind].usual_test.control_law
    arguments = ["--aircraft", kind, "--n-unsafe", "20", "--n-test", "20"]
    assert main(["train", *arguments, "-o", str(tmp_path / "m.fwm")]) == 0


def test_a_recipe_has_the_imperfections_of_a_flight_unless_it_is_a_stored_one(tmp_path, capsys):
    def given(*options: str) -> DatasetRecipe:
        return from_plain(DatasetRecipe(), printed_recipe(capsys, *options))

    clean = DatasetRecipe()
    assert given() == clean.as_flown()
    assert given("--imperfections", "none") == clean
    written = tmp_path / "written.json"
    written.write_text(json.dumps({"dataset": to_plain(clean.as_flown())}))
    assert given("--recipe", str(written)) == clean.as_flown()
    stored = tmp_path / "stored.json"
    noisy = replace(clean, n_unsafe=60, noise=SensorNoise(p=0.02))
    before = {key: part for key, part in to_plain(noisy).items() if key != "imperfections"}
    stored.write_text(json.dumps({"dataset": before}))
    assert given("--recipe", str(stored)) == noisy
    flown = given("--recipe", str(stored), "--imperfections", "usual")
    assert flown == replace(noisy, imperfections=USUAL_IMPERFECTIONS)
    part = tmp_path / "part.json"
    part.write_text(json.dumps({"dataset": {"n_unsafe": 60}}))
    assert given("--recipe", str(part)) == replace(clean.as_flown(), n_unsafe=60)
    some = given("--noise", "p=0.02", "--set", "dataset.imperfections.turbulence=light")
    assert some.noise == replace(USUAL_NOISE, p=0.02)
    assert some.imperfections == replace(USUAL_IMPERFECTIONS, turbulence="light")
    assert given() == clean.as_flown()


MODEL: dict[str, Any] = {key.upper(): to_plain(AIRCRAFT["matrices"])[key] for key in "abcd"}
MODEL["uncertainty"] = {"spread": {"A[1,0]": 0.15, "C[3,0]": 0.1}}


@pytest.mark.parametrize(
    ("options", "ordered"),
    [
        ([], {}),
        (["--aircraft", "attas_id_16kft"], {"aircraft": {"kind": "attas_id_16kft"}}),
        (["--aircraft", "{model}"], {"aircraft": MODEL}),
        (["--maneuver", "pulse"], {"maneuver": {"kind": "pulse"}}),
        (["--noise", "p=0.02", "--n-unsafe", "60"], {"noise": {"p": 0.02}, "n_unsafe": 60}),
        (["--imperfections", "none", "--seed", "2"], {"imperfections": "none", "seed": 2}),
        (["--recipe", "{stored}"], VERSION_0_1_0),
    ],
)
def test_an_order_means_the_same_on_the_command_line_and_over_rest(
    options, ordered, tmp_path, capsys
):
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    (tmp_path / "stored.json").write_text(json.dumps({"dataset": VERSION_0_1_0}))
    paths = {name: tmp_path / f"{name}.json" for name in ("model", "stored")}
    options = [option.format(**paths) for option in options]
    for kind in ("train", "study"):
        assert main([kind, *options, "--print-recipe"]) == 0
        printed = json.loads(capsys.readouterr().out)["dataset"]
        if kind == "train":
            assert printed == to_plain(dataset_request(ordered, 2**40).recipe)
        else:
            order = {"dataset": ordered}
            assert printed == to_plain(study_request(order, None, 2**40).dataset)  # pyright: ignore


def test_the_study_is_without_imperfections_unless_they_are_asked_for(capsys):
    for options, expected in (
        ([], DatasetRecipe()),
        (["--imperfections", "usual"], DatasetRecipe().as_flown()),
    ):
        assert main(["study", *options, "--print-recipe"]) == 0
        assert json.loads(capsys.readouterr().out)["dataset"] == to_plain(expected)


@pytest.mark.parametrize(
    ("written", "key", "value"),
    [
        ("beta=7deg", "beta", np.radians(7)),
        ("beta=7°", "beta", np.radians(7)),
        ("beta_deg=7", "beta", np.radians(7)),
        ("beta=0.1 rad", "beta", 0.1),
        ("p=20deg/s", "p", np.radians(20)),
        ("Ny=5e-1g", "Ny", 0.5),
    ],
)
def test_a_limit_is_read_in_the_unit_it_is_written_in(written: str, key: str, value, capsys):
    specification = printed_recipe(capsys, "--limit", written)["specification"]
    assert specification[key] == pytest.approx(value)
    assert [k for k, limit in specification.items() if limit is not None] == [key]


def test_what_an_option_says_goes_before_the_usual_test(capsys):
    options = ["--aircraft", "attas_id_16kft", "--control-law", "none", "--amplitude", "3"]
    recipe = printed_recipe(capsys, *options, "--limit", "Ny=0.3")
    assert recipe["control_law"]["kind"] == "none"
    assert recipe["maneuver"]["amplitude_deg"] == 3.0
    assert recipe["specification"]["Ny"] == 0.3


def test_the_model_of_the_readme_trains_with_the_defaults(tmp_path: Path, capsys):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (model,) = re.findall(r"```json\n(.*?)```", readme, re.DOTALL)
    (tmp_path / "model.json").write_text(model)
    arguments = ["--aircraft", str(tmp_path / "model.json"), "--n-test", "50"]
    assert main(["train", *arguments, "-o", str(tmp_path / "m.fwm")]) == 0
    assert "% of 400 pilot rollouts exceed a limit" in capsys.readouterr().err


def test_an_amplitude_is_found_for_any_limit_and_for_a_table(tmp_path: Path, capsys):
    recipe = printed_recipe(capsys, "--limit", "beta_deg=3", "--amplitude", "auto")
    assert 2 < recipe["maneuver"]["amplitude_deg"] < 9
    (tmp_path / "kick.csv").write_text("t_s,delta_r_deg\n0,1\n1,-1\n2,0\n")
    table = ["--maneuver", str(tmp_path / "kick.csv"), "--amplitude", "auto"]
    first, second, last = printed_recipe(capsys, *table)["maneuver"]["delta_r_deg"]
    assert first == -second > 2
    assert last == 0


def test_units_taken_for_others_are_called_outside_training(attas_monitor: Path, tmp_path, capsys):
    rows = [f"{0.05 * k:.2f},{0.01 * k:.3f},{rest(k)},0,0" for k in range(100)]
    (tmp_path / "units.csv").write_text("\n".join([HEAD, *rows]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "units.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    report = capsys.readouterr().out
    assert "No control input was detected" in report
    assert re.search(r"OUTSIDE +units: beta peaks at 5\d\.\d deg, 1\d\S* times its", report)
    assert "The guarantee is withdrawn" in report


def test_an_exceedance_is_not_known_where_the_limited_channel_is_missing(
    attas_monitor, tmp_path, capsys
):
    text = record_file("attas_rud1").read_text().splitlines()
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


def test_real_doublet_that_crosses_the_limit_is_warned_of(attas_monitor: Path, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [str(attas_monitor), str(record_file("attas_rud1")), "-o", str(out)]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    assert "beta     beta_rad [rad]" in report
    assert "from 25 Hz to 20 Hz" in report
    assert "manoeuvre 1, 5.30 to 11.30 s: LIMIT EXCEEDED, warned " in report
    assert "exceedance         at 8.76 s" in report
    assert "at least the promised 0.25 s" in report
    assert "Of flights like the simulated ones" in report
    assert "limit exceeded" in (out / "scored.svg").read_text()
    assert not (out / "scored.png").exists()
    rows = read_table(out)
    assert {row["state"] for row in rows if row["manoeuvre"] == "0"} == {"ok"}
    assert {row["state"] for row in rows if row["manoeuvre"] == "-1"} == {"invalid"}
    first = next(float(row["t_s"]) for row in rows if row["alert"] == "true")
    assert f"first alert        at {first:.2f} s" in report


def test_real_record_of_another_manoeuvre_is_no_verdict(attas_monitor: Path, tmp_path, capsys):
    arguments = [str(attas_monitor), str(record_file("attas_ail1")), "-o", str(tmp_path / "out")]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    assert "INVALID, no verdict" in report
    assert "first alert        withdrawn" in report
    assert "aileron moved by 14 deg, which the planned manoeuvre leaves alone" in report
    rows = read_table(tmp_path / "out")
    assert all(row["p_value"] == "" and row["alert"] == "false" for row in rows)
    assert sum(row["withdrawn_p_value"] != "" for row in rows) == 121


def test_scoring_again_repeats_to_the_byte(attas_monitor: Path, tmp_path: Path):
    for name in ("one", "two"):
        arguments = [str(attas_monitor), str(record_file("attas_rud1")), "-o", str(tmp_path / name)]
        assert main(["score", *arguments]) == 0
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name


def test_assessments_of_a_scored_file_can_be_scored_again(attas_monitor: Path, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    base = ["score", str(attas_monitor)]
    assert main([*base, str(record_file("attas_rud1")), "-o", str(first)]) == 0
    again = [str(first / "assessments.csv"), "--trim", "none", "-o", str(second)]
    assert main([*base, *again]) == 0
    assert (first / "assessments.csv").read_bytes() == (second / "assessments.csv").read_bytes()


def test_written_mapping_can_be_corrected_and_given_back(attas_monitor: Path, tmp_path, capsys):
    base = ["score", str(attas_monitor), str(record_file("attas_rud1"))]
    assert main([*base, "-o", str(tmp_path / "out")]) == 0
    mapping = json.loads((tmp_path / "out" / "mapping.json").read_text())
    assert mapping["channels"]["delta_r"]["signal"] == "dr_rad"
    mapping["channels"]["delta_r"]["sign"] *= -1
    (tmp_path / "mine.json").write_text(json.dumps(mapping))
    given = ["--mapping", str(tmp_path / "mine.json"), "-o", str(tmp_path / "reversed")]
    capsys.readouterr()
    assert main([*base, *given]) == 0
    report = capsys.readouterr().out
    assert "mapping, as given:" in report
    assert "-dr_rad [rad]" in report
    assert "it went the other way first, or its sign is reversed" in report
    assert json.loads((tmp_path / "reversed" / "mapping.json").read_text()) == mapping


def test_mapping_given_for_an_aircraft_is_used_for_its_next_file(
    attas_monitor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(tmp_path / "data"))
    base = ["score", str(attas_monitor), str(record_file("attas_rud1")), "--aircraft", "D-ADAM"]
    assert main([*base, "-o", str(tmp_path / "out")]) == 0
    mapping = json.loads((tmp_path / "out" / "mapping.json").read_text())
    mapping["channels"]["Ny"]["bias"] = 0.125
    mapping["channels"]["delta_a"]["bias"] = 0.1
    (tmp_path / "mine.json").write_text(json.dumps(mapping))
    given = ["--mapping", str(tmp_path / "mine.json"), "-o", str(tmp_path / "given")]
    assert main([*base, *given]) == 0
    capsys.readouterr()
    assert main([*base, "-o", str(tmp_path / "next")]) == 0
    report = capsys.readouterr().out
    assert "bias removed: 0.125 g" in report
    assert "bias removed: 5.73 deg" in report
    assert json.loads((tmp_path / "next" / "mapping.json").read_text()) == mapping


def test_monitors_and_epsilons_side_by_side(attas_monitor: Path, tmp_path: Path, capsys):
    copy = tmp_path / attas_monitor.name
    copy.write_bytes(attas_monitor.read_bytes())
    arguments = [str(attas_monitor), str(copy), str(record_file("attas_rud1"))]
    arguments += ["--epsilon", "0.1,0.5", "-o", str(tmp_path / "out")]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    labels = [f"{name}-epsilon-{e}" for name in ("attas", "attas-2") for e in ("0.1", "0.5")]
    assert re.findall(r"^== (.*) ==$", report, re.MULTILINE) == labels
    tables = {label: read_table(tmp_path / "out" / label) for label in labels}
    assert tables["attas-epsilon-0.5"] == tables["attas-2-epsilon-0.5"]
    p_values = {tuple(row["p_value"] for row in table) for table in tables.values()}
    assert len(p_values) == 1
    assert (tmp_path / "out" / "mapping.json").exists()


def test_a_monitor_of_no_use_scores_alone_only_where_that_is_accepted(
    attas_monitor: Path, tmp_path: Path, capsys
):
    tested = load(attas_monitor)
    counts = {"misses": 0, "false_alerts": 995, "withdrawn": 0}
    evaluation = {**(tested.evaluation or {}), "n_safe": 1000, "at_epsilon": counts}
    useless = tmp_path / "useless.fwm"
    replace(tested, evaluation=evaluation).save(useless)
    arguments = [str(useless), str(record_file("attas_rud1")), "-o", str(tmp_path / "out")]
    assert main(["score", *arguments]) != 0
    said = capsys.readouterr().err
    assert "useless.fwm: the monitor is of no use: only " in said
    assert "accept that it is: --accept-useless" in said
    assert not (tmp_path / "out").exists()
    assert main(["score", *arguments, "--accept-useless", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["accept_useless"] is True
    assert any("of no use" in warning for warning in told["scorings"][0]["warnings"])
    beside = [str(useless), str(attas_monitor), str(record_file("attas_rud1"))]
    assert main(["score", *beside, "-o", str(tmp_path / "both")]) == 0


def test_manoeuvres_are_scored_between_the_times_given(attas_monitor: Path, tmp_path, capsys):
    arguments = [str(attas_monitor), str(record_file("attas_rud1")), "-o", str(tmp_path / "out")]
    assert main(["score", *arguments, "--manoeuvres", "5:11,20:26"]) == 0
    report = capsys.readouterr().out
    assert "manoeuvre 1, 5.00 to 11.00 s" in report
    assert "manoeuvre 2, 20.00 to 26.00 s" in report
    out = ["--manoeuvres", "20:40", "-o", str(tmp_path / "no")]
    assert main(["score", *arguments[:2], *out]) == 1
    assert "20 to 40 s is not inside the recording" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_file_without_a_needed_channel_names_it(attas_monitor: Path, tmp_path: Path, capsys):
    text = record_file("attas_rud1").read_text().replace("beta_rad", "alpha2_rad")
    (tmp_path / "flight.csv").write_text(text)
    arguments = ["score", str(attas_monitor), str(tmp_path / "flight.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 1
    *signals, error = capsys.readouterr().err.strip().splitlines()
    assert f"{tmp_path / 'flight.csv'}: the monitor needs beta" in error
    assert "what is missing, or choose a monitor that does not need it" in error
    assert signals[0] == "signals of the file: 12"
    assert "    alpha2_rad" in signals
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mapping.json"]


def test_bad_rows_are_left_out_and_said(attas_monitor: Path, tmp_path: Path, capsys):
    lines = record_file("attas_rud1").read_text().splitlines()
    lines[300] = lines[300].replace(",", ",x", 1)
    (tmp_path / "bad.csv").write_text("\n".join(lines))
    arguments = ["score", str(attas_monitor), str(tmp_path / "bad.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    report = capsys.readouterr().out
    assert "bad rows, left out: 1" in report
    assert "line 301:" in report


def test_file_with_gaps_says_which_samples_were_not_assessed(attas_monitor: Path, tmp_path, capsys):
    lines = [f"{0.05 * k:.2f},{1e-4 * (k % 3)},{rest(k)},0,0" for k in range(40)]
    lines[10] = "0.5,nan,nan,nan,nan,nan,nan"
    (tmp_path / "gap.csv").write_text("\n".join([HEAD, *lines]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "gap.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    assert "samples: 37 ok, 2 warming_up, 0 stale, 1 invalid" in capsys.readouterr().out
    rows = read_table(tmp_path / "out")
    withdrawn = [row["withdrawn_p_value"] == "" for row in rows]
    assert withdrawn == [k in (10, 11, 12) for k in range(40)]


def test_file_that_cannot_be_assessed_at_all_is_no_success(attas_monitor: Path, tmp_path, capsys):
    lines = [HEAD]
    for k in range(40):
        beta, others = (1e-4 * (k % 3), ",,") if k < 20 else ("", rest(k))
        lines.append(f"{0.05 * k:.2f},{beta},{others},0,0")
    (tmp_path / "holes.csv").write_text("\n".join(lines))
    arguments = ["score", str(attas_monitor), str(tmp_path / "holes.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 1
    assert re.search(r"OUTSIDE +rate: .*; 0 of \d+ samples", capsys.readouterr().out)


def rest(k: int) -> str:
    """Roll rate, yaw rate and N_y of an aircraft that hardly moves."""
    return f"{1e-4 * (k % 2)},{1e-4 * (k % 3)},{1e-3 * (k % 2)}"


def read_table(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "assessments.csv").read_text().splitlines()))
