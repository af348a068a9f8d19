"""`--dt` adjusts what depends on it, where that is not said."""

import json

import pytest

from app.cli import main
from app.commands.options.recipe import MOST_DELAY
from core.monitor import MonitorRecipe
from core.planned_test.planned_test import DatasetRecipe


def printed(capsys: pytest.CaptureFixture, *options: str) -> tuple[dict, str]:
    """The recipe that options give, and what is said beside it."""
    assert main(["train", *options, "--print-recipe"]) == 0
    told = capsys.readouterr()
    return json.loads(told.out), told.err


def test_the_usual_interval_changes_nothing(capsys: pytest.CaptureFixture):
    recipe, told = printed(capsys, "--dt", str(DatasetRecipe().dt))
    assert (recipe, told) == printed(capsys)
    assert told == ""


@pytest.mark.parametrize("dt", [0.004, 0.02, 0.03, 0.07, 0.1, 0.2, 1.0])
def test_any_interval_gives_a_test_that_lasts_and_looks_as_long(
    dt: float, capsys: pytest.CaptureFixture
):
    recipe, told = printed(capsys, "--dt", str(dt))
    dataset, usual = recipe["dataset"], DatasetRecipe()
    steps = dataset["maneuver"]["duration_s"] / dt
    assert steps == pytest.approx(round(steps))
    assert 0 <= dataset["maneuver"]["duration_s"] - usual.maneuver.duration_s < dt
    assert dt / dataset["substeps"] <= usual.dt * (1 + 1e-9)
    assert dataset["n_obs"] == min(usual.n_obs, round(steps) + 1)
    span, n_delay = MonitorRecipe().n_delay * usual.dt, recipe["monitor"]["n_delay"]
    assert n_delay in (1, MOST_DELAY) or abs(n_delay * dt - span) <= dt / 2
    assert (n_delay == 1) == (dt >= 0.07)
    assert told.startswith(f"forewarn: for --dt {dt:g}: ")


def test_what_is_said_is_not_adjusted(capsys: pytest.CaptureFixture):
    said = ("--n-delay", "3", "--n-obs", "7", "--substeps", "2", "--duration", "6.3")
    recipe, told = printed(capsys, "--dt", "0.07", *said)
    assert (recipe["monitor"]["n_delay"], recipe["dataset"]["n_obs"]) == (3, 7)
    assert (recipe["dataset"]["substeps"], recipe["dataset"]["maneuver"]["duration_s"]) == (2, 6.3)
    assert told == ""
    assert main(["train", "--dt", "0.07", "--duration", "6.0", "--print-recipe"]) == 1
    assert "give a whole number of steps" in capsys.readouterr().err
