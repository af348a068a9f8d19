"""`forewarn choose-epsilon`: both ways to ask, and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from app.cli import main
from core.monitor import train
from core.planned_test.collection import DatasetRecipe, collect


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("monitor") / "it.fwm"
    train(collect(DatasetRecipe(n_unsafe=40, seed=2))).save(path)
    return path


def test_an_epsilon_is_chosen_by_costs_or_by_targets(file: Path, capsys) -> None:
    few = ["choose-epsilon", str(file), "--n-test", "400"]
    assert main([*few, "--cost-of-miss", "5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n_unsafe"] + found["n_safe"] == 200
    assert found["cost"] == (5 * found["misses"] + found["false_alerts"]) / 200
    assert main([*few, "--cost-of-miss", "5"]) == 0
    assert "false alarms a flight" in capsys.readouterr().out
    assert main([*few, "--most-missed", "0.4", "--most-false-alarms", "0.4"]) == 0
    text = capsys.readouterr().out
    assert "on fresh flights not used to choose it" in text
    assert "with 95 % confidence at most" in text
    assert f"called invalid: {found['withdrawn']} failing flights before an alert" in text


def test_what_cannot_be_chosen_is_one_error(file: Path, tmp_path: Path, capsys) -> None:
    for options, words in (
        ([], "Give both --most-missed"),
        (["--most-missed", "0.1"], "given: --most-missed. Give both"),
        (["--cost-of-miss", "1", "--n-test", "0"], "--n-test=0 was given"),
        (
            ["--most-missed", "0.01", "--most-false-alarms", "0.9", "--n-test", "400"],
            "out of reach: missed at most 1 %.",
        ),
    ):
        assert main(["choose-epsilon", str(file), *options]) != 0
        assert words in capsys.readouterr().err
    bare = tmp_path / "bare.fwm"
    replace(train(collect(DatasetRecipe(n_unsafe=20))), dataset_recipe={}).save(bare)
    assert main(["choose-epsilon", str(bare), "--cost-of-miss", "1"]) != 0
    assert "was not simulated here" in capsys.readouterr().err
