"""`forewarn train`: recipes by option and file, for every aircraft and any limit."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import main
from app.jobs.requests import dataset_request, monitor_request, study_request
from app.recipes.recipes import USUAL_MONITOR, from_plain, limits_named, monitor_as_ordered
from core.channels import KEYS
from core.monitor import Monitor, MonitorRecipe, load
from core.monitor.predictor import Ensemble, Scope
from core.planned_test.planned_test import USUAL_NOISE, DatasetRecipe, SensorNoise
from core.recipe import to_plain
from core.simulation.aircraft import AIRCRAFT
from tests.support.places import ROOT

VERSION_0_1_0 = {
    key: part for key, part in to_plain(DatasetRecipe()).items() if key != "imperfections"
}
"""A recipe as a version that knew no imperfections stored it."""


def test_train_writes_a_monitor_that_knows_its_recipe(tmp_path: Path, capsys):
    path = tmp_path / "m.fwm"
    options = ["--n-unsafe", "60", "--t-early", "0.3", "--predictor", "identity", "--seed", "7"]
    options += ["--guarantee", "average"]
    assert main(["train", *options, "--n-test", "200", "-o", str(path)]) == 0
    monitor = load(path)
    assert isinstance(monitor, Monitor)
    assert (monitor.n_unsafe, monitor.h, monitor.seed) == (60, 6, 7)
    assert to_plain(monitor.recipe)["predictor"] == {"kind": "identity"}
    assert monitor.dataset_recipe["aircraft"]["kind"] == "f16_sl_h0_v502"
    said = capsys.readouterr().out
    assert "calibrated on 60 failures" in said
    assert "alerts above a risk of 0.1, for a miss rate of at most 0.1 on average" in said


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
    arguments += ["--set", "dataset.maneuver.interpolation=hold", "--n-test", "0"]
    arguments += ["--n-unsafe", "50"]
    assert main(["train", *arguments, "-o", str(tmp_path / "m.fwm")]) == 0
    recipe = load(tmp_path / "m.fwm").dataset_recipe
    assert recipe["maneuver"]["kind"] == "table"
    assert recipe["maneuver"]["delta_a_deg"] == [0.0, 0.0, 0.0]


def printed_recipe(capsys: pytest.CaptureFixture, *options: str) -> dict[str, Any]:
    assert main(["train", *options, "--print-recipe"]) == 0
    return json.loads(capsys.readouterr().out)["dataset"]


def test_another_method_replaces_that_of_a_recipe_file(tmp_path: Path, capsys):
    recipe = tmp_path / "recipe.json"
    assert main(["train", "--print-recipe"]) == 0
    recipe.write_text(capsys.readouterr().out)
    method = ("--predictor", "linear", "--score", "nearest_neighbor")
    assert main(["train", "--recipe", str(recipe), *method, "--print-recipe"]) == 0
    assert json.loads(capsys.readouterr().out)["monitor"]["predictor"] == {"kind": "linear"}


@pytest.mark.parametrize("limit", ["Nz=..2.2g for 0.2 s", "always (Nz < 2.2 or alpha < 0.1)"])
def test_a_nonlinear_aircraft_refuses_a_computed_limit_by_its_words(limit: str, capsys):
    pitch = ("--aircraft", "f16_polynomial", "--maneuver", "pitch_doublet", "--limit", limit)
    assert main(["train", *pitch, "--print-recipe"]) == 1
    error = capsys.readouterr().err
    assert limit in error
    assert "--rollouts" in error


def test_a_pilot_is_in_the_loop_of_captures_and_where_one_is_asked_for(capsys):
    assert "pilot" not in printed_recipe(capsys)
    assert printed_recipe(capsys, "--maneuver", "bank_capture")["pilot"]["kind"] == "crossover"
    slow = ("--pilot", "crossover", "--set", "dataset.pilot.delay_s=0.3")
    assert printed_recipe(capsys, *slow)["pilot"]["delay_s"] == 0.3
    nobody = ("--maneuver", "bank_capture", "--pilot", "open_loop", "--print-recipe")
    assert main(["train", *nobody]) == 1
    assert "crossover" in capsys.readouterr().err


def test_a_pilot_who_gives_up_trains_a_monitor_of_labels(tmp_path: Path):
    gives_up = ("--pilot", "crossover", "--set", "dataset.pilot.intervention.error_deg=8")
    sizes = ("--n-unsafe", "60", "--n-test", "20", "--guarantee", "average")
    method = ("--predictor", "linear", "--score", "nearest_neighbor")
    out = tmp_path / "gives_up.fwm"
    assert main(["train", *gives_up, *sizes, *method, "--out", str(out)]) == 0
    monitor = load(out)
    assert isinstance(monitor.specification, str)
    assert "8 deg" in monitor.specification
    assert monitor.envelope is None


@pytest.mark.parametrize("kind", [kind for kind in AIRCRAFT if kind != "matrices"])
def test_every_aircraft_brings_its_usual_test(kind: str, tmp_path: Path, capsys):
    recipe = printed_recipe(capsys, "--aircraft", kind)
    usual = replace(DatasetRecipe.usual(AIRCRAFT[kind]), n_unsafe=500)
    assert recipe == limits_named(to_plain(usual.as_trained()))
    assert recipe["control_law"]["kind"] == AIRCRAFT[kind].condition.usual_test.control_law
    arguments = ["--aircraft", kind, "--n-unsafe", "30", "--n-test", "0"]
    assert main(["train", *arguments, "-o", str(tmp_path / "m.fwm")]) == 0


def test_a_recipe_has_the_imperfections_of_a_flight_unless_it_is_a_stored_one(tmp_path, capsys):
    def given(*options: str) -> DatasetRecipe:
        return from_plain(DatasetRecipe(), printed_recipe(capsys, *options))

    clean = DatasetRecipe(n_unsafe=500)
    assert given() == clean.as_trained()
    assert given("--imperfections", "none") == clean
    written = tmp_path / "written.json"
    written.write_text(json.dumps({"dataset": to_plain(clean.as_trained())}))
    assert given("--recipe", str(written)) == clean.as_trained()
    assert clean.as_trained().imperfections.softness_s > 0
    older = to_plain(clean.as_flown())
    del older["imperfections"]["softness_s"]
    written.write_text(json.dumps({"dataset": older}))
    assert given("--recipe", str(written)) == clean.as_flown()
    stored = tmp_path / "stored.json"
    noisy = replace(clean, n_unsafe=60, noise=SensorNoise(p=0.02))
    before = {key: part for key, part in to_plain(noisy).items() if key != "imperfections"}
    stored.write_text(json.dumps({"dataset": before}))
    assert given("--recipe", str(stored)) == noisy
    flown = given("--recipe", str(stored), "--imperfections", "usual")
    assert flown == replace(noisy, imperfections=clean.as_trained().imperfections)
    part = tmp_path / "part.json"
    part.write_text(json.dumps({"dataset": {"n_unsafe": 60}}))
    assert given("--recipe", str(part)) == replace(clean.as_trained(), n_unsafe=60)
    some = given("--noise", "p=0.02", "--set", "dataset.imperfections.turbulence=light")
    assert some.noise == replace(USUAL_NOISE, p=0.02)
    assert some.imperfections == replace(clean.as_trained().imperfections, turbulence="light")
    assert given() == clean.as_trained()


MODEL: dict[str, Any] = {key.upper(): to_plain(AIRCRAFT["matrices"])[key] for key in "abcd"}
MODEL["uncertainty"] = {"spread": {"A[1,0]": 0.15, "C[3,0]": 0.1}}


@pytest.mark.parametrize(
    ("options", "ordered"),
    [
        ([], {}),
        (["--aircraft", "attas_id_16kft"], {"aircraft": {"kind": "attas_id_16kft"}}),
        (["--aircraft", "{model}"], {"aircraft": MODEL}),
        (["--maneuver", "pulse"], {"maneuver": {"kind": "pulse"}}),
        (["--pilot", "crossover"], {"pilot": {"kind": "crossover"}}),
        (["--maneuver", "bank_capture"], {"maneuver": {"kind": "bank_capture"}}),
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
            assert printed == limits_named(to_plain(dataset_request(ordered, 2**40)[1]))
        else:
            order = {"dataset": ordered}
            study = study_request(order, None, 2**40)  # pyright: ignore
            assert printed == limits_named(to_plain(study.dataset))


@pytest.mark.parametrize(
    ("written", "guarantee"),
    [
        ({}, "95%"),
        ({"epsilon": 0.2}, "95%"),
        ({"guarantee": "average"}, "average"),
        ({k: v for k, v in to_plain(MonitorRecipe()).items() if k != "guarantee"}, "average"),
    ],
)
def test_a_monitor_is_ordered_with_the_same_guarantee_at_every_door(
    written, guarantee, tmp_path, capsys
):
    (tmp_path / "order.json").write_text(json.dumps({"monitor": written}))
    assert main(["train", "--recipe", str(tmp_path / "order.json"), "--print-recipe"]) == 0
    printed = json.loads(capsys.readouterr().out)["monitor"]
    order = {"dataset": {}, **written}
    assert printed == to_plain(monitor_request(order, None, 2**40).recipe)  # pyright: ignore
    assert printed["guarantee"] == guarantee
    assert main(["study", "--print-recipe"]) == 0
    assert json.loads(capsys.readouterr().out)["monitor"]["guarantee"] == "average"


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
    limits = printed_recipe(capsys, "--limit", written)["limits"]
    assert limits[key] == pytest.approx(value)
    assert [k for k, limit in limits.items() if limit is not None] == [key]


def test_what_an_option_says_goes_before_the_usual_test(capsys):
    options = ["--aircraft", "attas_id_16kft", "--control-law", "none", "--amplitude", "3"]
    recipe = printed_recipe(capsys, *options, "--limit", "Ny=0.3")
    assert recipe["control_law"]["kind"] == "none"
    assert recipe["maneuver"]["amplitude_deg"] == 3.0
    assert recipe["limits"]["Ny"] == 0.3


def test_the_model_of_the_guide_trains(tmp_path: Path, capsys):
    page = (ROOT / "static" / "guide" / "first-monitor.md").read_text(encoding="utf-8")
    (model,) = re.findall(r"```json\n(.*?)```", page, re.DOTALL)
    (tmp_path / "model.json").write_text(model)
    arguments = ["--aircraft", str(tmp_path / "model.json"), "--n-test", "0", "--n-unsafe", "50"]
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


@pytest.mark.parametrize(
    ("options", "method"),
    [
        ([], ("ensemble", "highest_risk")),
        (["--p-value", "exact"], ("linear", "nearest_neighbor")),
        (["--calibration", "pointwise"], ("linear", "nearest_neighbor")),
        (["--predictor", "linear"], ("linear", "nearest_neighbor")),
        (["--score", "highest_risk"], ("ensemble", "highest_risk")),
        (["--predictor", "peak_ridge"], ("peak_ridge", "rest_of_card")),
        (["--predictor", "response_filter"], ("response_filter", "card_window")),
        (["--predictor", "identity"], ("identity", "nearest_neighbor")),
        (["--score", "rest_of_card"], ("peak_ridge", "rest_of_card")),
        (["--predictor", "peak_ridge", "--score", "card_window"], ("peak_ridge", "card_window")),
    ],
)
def test_a_predictor_alone_has_the_score_that_goes_with_it(capsys, options, method) -> None:
    assert main(["train", *options, "--print-recipe"]) == 0
    monitor = json.loads(capsys.readouterr().out)["monitor"]
    assert (monitor["predictor"]["kind"], monitor["score"]["kind"]) == method


@pytest.mark.parametrize(
    ("monitor", "scope"),
    [
        ({}, "near"),
        ({"predictor": {"kind": "ensemble"}}, "near"),
        ({"predictor": {"kind": "ensemble", "scope": "planned"}}, "planned"),
        ({"groups": {"kind": "largest_deflection"}}, "planned"),
        ({"groups": {"kind": "pooled"}}, "near"),
    ],
)
def test_the_default_promises_for_near_aircraft_but_not_in_groups(monitor, scope: Scope) -> None:
    recipe = from_plain(MonitorRecipe(), monitor_as_ordered(monitor))
    assert recipe.predictor == Ensemble(scope=scope)
    stored = to_plain(USUAL_MONITOR)
    del stored["predictor"]["scope"]
    assert monitor_as_ordered(stored) == stored
    assert from_plain(MonitorRecipe(), stored) == USUAL_MONITOR.as_planned()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--t-early", "9"], "the manoeuvre lasts 6 s, choose a shorter warning lead time"),
        (["--epsilon", "0.001"], "needs at least 2995 unsafe rollouts"),
        (["--maneuver", "bank_capture", "--predictor", "response_filter"], "choose the predictor"),
        (["--aircraft", "ggam_f16c", "--states", "4"], "flies in six degrees of freedom"),
    ],
)
def test_what_cannot_be_trained_is_refused_before_it_is_simulated(
    options, words, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr("app.commands.train.simulate", lambda *_: pytest.fail("simulated"))
    out = tmp_path / "it.fwm"
    assert main(["train", *options, "--out", str(out)]) == 1
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_margins_label_the_rollouts_of_a_simulated_aircraft(tmp_path, capsys):
    out = tmp_path / "margin.fwm"
    small = [
        "--aircraft",
        "attas_id_16kft",
        "--n-unsafe",
        "40",
        "--n-test",
        "60",
        "--out",
        str(out),
    ]
    options = [*small, "--epsilon", "0.2", "--predictor", "linear", "--score", "nearest_neighbor"]
    assert main(["train", *options, "--limit", "phase margin > 73 deg"]) == 0
    assert "simulated 40 unsafe" in capsys.readouterr().out
    assert load(out).specification == "requirement phase margin > 73 deg"


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (["phase margin > 73"], "a phase margin is in deg: write"),
        (["phase margin > 6 dB"], "a phase margin is in deg: write"),
        (["disk margin > 1 deg"], "a disk margin is without a unit: write"),
        (["phase margin < 73 deg"], "write its least value as"),
        (["phase margin > 400 deg"], "above 0 and below 180"),
        (["disk margin > 3"], "above 0 and below 2"),
        (["phase margin > 73 deg", "phase margin > 70 deg"], "omit one"),
        (["gain margin > 6 dB", "Ny=0.5"], "omit one"),
        (["gain margin > 6 dB", "disk margin > 1"], "no change of gain makes any"),
    ],
)
def test_a_margin_that_cannot_label_is_refused(limits, words, tmp_path, capsys):
    given = [part for limit in limits for part in ("--limit", limit)]
    out = str(tmp_path / "m.fwm")
    bare = ["--control-law", "none", "--amplitude", "5"]
    assert main(["train", *bare, *given, "--print-recipe", "--out", out]) == 1
    assert words in capsys.readouterr().err


def test_a_margin_of_an_aircraft_of_jsbsim_is_refused_without_a_path(tmp_path, capsys):
    given = ["--aircraft", "jsbsim", "--limit", "phase margin > 60 deg"]
    assert main(["train", *given, "--print-recipe", "--out", str(tmp_path / "m.fwm")]) == 1
    assert capsys.readouterr().err.startswith("forewarn: stability margins need")


@pytest.mark.parametrize("command", ["study", "campaign"])
def test_margins_are_refused_where_limits_are_compared(command, tmp_path, capsys):
    margins = ["--aircraft", "attas_id_16kft", "--limit", "phase margin > 73 deg"]
    where = ["new", str(tmp_path / "plan.json"), "--name", "x"] if command == "campaign" else []
    assert main([command, *where, *margins]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f"a {command} needs limits" in line
    assert "forewarn train" in line


def test_rollouts_of_others_show_no_margin(tmp_path, capsys):
    rollouts = tmp_path / "rollouts.npz"
    np.savez(rollouts, y=np.zeros((4, 9, 6)), dt=0.05, channels=list(KEYS))
    command = ["train", "--rollouts", str(rollouts), "--limit", "disk margin > 0.4"]
    assert main([*command, "--out", str(tmp_path / "m.fwm")]) == 1
    assert "which rollouts and simulators of others do not show" in capsys.readouterr().err
