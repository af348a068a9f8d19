"""An aircraft of JSBSim from the form's requests to a flight, as a nonlinear one."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jsbsim", reason="JSBSim is not installed: the extra jsbsim")

from app.catalog import catalog
from app.cli import main
from app.recipes.recipes import dataset_recipe
from core.limits.flight_limits import FLIGHT
from core.planned_test.nonlinear_test import JsbsimTest
from core.simulation.jsbsim import (
    USUALLY,
    JsbsimAircraft,
    aircraft_names,
    functions_of,
    usual_condition,
)
from core.simulation.maneuver import MANEUVERS
from core.simulation.nonlinear import TrimCondition
from tests.support.api import api, finished, problem

pytestmark = pytest.mark.usefixtures("few_flights")
DOUBLET: dict[str, Any] = {
    "aircraft": {"kind": "jsbsim", "model": "c172p"},
    "maneuver": {"kind": "pitch_doublet", "amplitude_deg": -6.4, "duration_s": 2.5},
    "imperfections": "none",
    "n_unsafe": 20,
}
METHOD: dict[str, Any] = {
    "predictor": {"kind": "linear"},
    "score": {"kind": "nearest_neighbor"},
    "guarantee": "average",
}
ANYWAY = {"accept_useless": True}  # so few failures train it


def test_a_doublet_goes_from_request_to_flight(tmp_path: Path):
    with api(tmp_path) as client:
        job = finished(client, client.post("/api/v1/datasets", json=DOUBLET))
        dataset = client.get(f"/api/v1/datasets/{job['result']['dataset']}").json()
        assert dataset["name"].startswith("JSBSim c172p, pitch doublet")
        assert dataset["n_unsafe"] == 20
        assert dataset["limits"]["Nz"]["high"] == 2.0
        rollout = client.get(f"/api/v1/datasets/{dataset['id']}/rollouts/0").json()
        assert list(rollout["theta"]) == functions_of("c172p")
        assert list(rollout["telemetry"]) == ["t", *FLIGHT.keys]
        asked = {"dataset": dataset["id"], "t_early": 0.25, "epsilon": 0.1, "n_test": 0, **METHOD}
        job = finished(client, client.post("/api/v1/monitors", json=asked))
        simulated = {"kind": "simulated", "outcome": "unsafe", "seed": 3}
        body = {"monitor": job["result"]["monitor"], "source": simulated, **ANYWAY}
        flight = client.post("/api/v1/flights", json=body)
        assert flight.status_code == 201, flight.text


def test_a_job_shows_its_progress_and_can_be_cancelled(tmp_path: Path):
    with api(tmp_path) as client:
        many = DOUBLET | {"n_unsafe": 5000}
        job = client.post("/api/v1/datasets", json=many).json()["id"]
        deadline = time.monotonic() + 120
        while not client.get(f"/api/v1/jobs/{job}").json()["progress"]:
            assert time.monotonic() < deadline
        assert client.post(f"/api/v1/jobs/{job}/cancel").is_success
        while (status := client.get(f"/api/v1/jobs/{job}").json()["status"]) == "running":
            assert time.monotonic() < deadline
        assert status == "cancelled"


def test_its_flights_repeat_and_stop_as_those_of_other_aircraft():
    simulator = JsbsimTest().as_trained().simulator()
    flights = simulator.rollouts(20, np.random.default_rng(2))
    again = simulator.rollouts(20, np.random.default_rng(2))
    np.testing.assert_array_equal(flights.y, again.y)
    assert 0 < flights.is_unsafe.sum() < 20
    every, n_samples = np.arange(20), flights.y.shape[1]
    stopped = simulator.stopping(20, np.random.default_rng(2))
    np.testing.assert_array_equal(stopped(every, np.full(20, n_samples)), flights.fail_index)
    assert (stopped(every, np.full(20, 8)) == n_samples).all()


@pytest.mark.parametrize(("key", "surface", "rate"), [("q", 2, -1), ("p", 0, -1), ("r", 1, -1)])
def test_positive_surfaces_turn_it_nose_down_and_to_the_left(key: str, surface: int, rate: int):
    names = "aileron_doublet", "rudder_doublet", "pitch_doublet"
    maneuver = replace(MANEUVERS[names[surface]].with_peak(3.0), duration_s=2.0)
    simulator = JsbsimTest(maneuver=maneuver, n_obs=1).simulator()
    flights, _ = simulator.fly(simulator.parameters.nominal[np.newaxis], np.random.default_rng(0))
    assert np.sign(flights.y[0, 15, simulator.dictionary.index(key)]) == rate


def test_aircraft_without_trim_are_drawn_again_but_given_ones_refused():
    point = TrimCondition(altitude_m=1500.0, mach=0.115)  # slow, where some have no trim
    maneuver = replace(MANEUVERS["pitch_doublet"], duration_s=1.0)
    aircraft = JsbsimAircraft(spread=0.2)
    test = JsbsimTest(aircraft=aircraft, condition=point, maneuver=maneuver, n_obs=1)
    simulator = test.simulator()
    drawn = simulator.parameters.sample(100, np.random.default_rng(1))
    flights = simulator.rollouts(100, np.random.default_rng(1))
    again = (flights.theta != drawn).any(axis=1)
    assert 0 < again.sum() < 60
    assert np.isfinite(flights.y).all()
    with pytest.raises(ValueError, match=f"{again.sum()} of 100 aircraft have no trim"):
        simulator.fly(drawn, np.random.default_rng(2))


def test_a_turn_begins_at_its_load_factor():
    turn = {"aircraft": DOUBLET["aircraft"], "maneuver": {"kind": "wind_up_turn"}}
    test, _ = dataset_recipe(turn)
    assert isinstance(test, JsbsimTest)
    assert test.condition.load_factor == JsbsimTest.turn
    simulator = test.simulator()
    flights, _ = simulator.fly(simulator.parameters.nominal[np.newaxis], np.random.default_rng(0))
    start = dict(zip(simulator.dictionary.keys, flights.y[0, 0].tolist(), strict=True))
    assert start["Nz"] == pytest.approx(JsbsimTest.turn, rel=0.01)
    assert start["phi"] == pytest.approx(np.arccos(1 / JsbsimTest.turn), rel=0.01)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"aircraft": {"kind": "jsbsim", "model": "c172q"}}, "did you mean c172p?"),
        (
            {"condition": {"altitude_m": 1500, "mach": 0.05}},
            "no trim at 16.72 m/s (Mach 0.05)",
        ),
        ({"maneuver": {"kind": "pitch_capture"}}, "choose the pilot open_loop"),
        ({"pilot": {"kind": "crossover"}}, "choose the pilot open_loop"),
        ({"limits": {"Nz_high": 0.5}}, "below 0.5 g"),
    ],
)
def test_a_test_that_cannot_be_flown_is_refused(changes: dict[str, Any], told: str, tmp_path: Path):
    with api(tmp_path) as client:
        assert told in problem(client.post("/api/v1/datasets", json=DOUBLET | changes), 422)


def test_the_command_line_names_it_too(capsys: pytest.CaptureFixture[str]):
    given = ["--aircraft", "jsbsim", "--set", "dataset.aircraft.model=T38", "--print-recipe"]
    given += ["--set", "dataset.condition.mach=0.6", "--limit", "Nz=..3g"]
    assert main(["train", *given]) == 0
    recipe = json.loads(capsys.readouterr().out)["dataset"]
    assert recipe["aircraft"]["model"] == "T38"
    assert recipe["limits"]["Nz_high"] == 3.0
    assert recipe["noise"]["alpha"] > 0.0


def test_the_catalog_offers_its_aircraft_and_only_what_they_can_fly():
    recipe = catalog()["recipes"]["jsbsim"]
    assert recipe["needs"] == ""
    entry = catalog()["families"]["jsbsim_aircraft"]["entries"]["jsbsim"]
    assert entry["schema"]["properties"]["model"]["enum"] == [*aircraft_names()]
    kinds = recipe["schema"]["properties"]["maneuver"]["properties"]["kind"]["enum"]
    assert "wind_up_turn" in kinds
    assert "pitch_capture" not in kinds
    assert "control_law" not in recipe["schema"]["properties"]


@pytest.mark.parametrize("model", ["c310", "737", "J3Cub"])
def test_an_aircraft_brings_a_condition_where_it_has_a_trim(model: str):
    aircraft = {"kind": "jsbsim", "model": model}
    test, _ = dataset_recipe({"aircraft": aircraft})
    assert isinstance(test, JsbsimTest)
    high, mach = usual_condition(model)
    assert (test.condition.altitude_m, test.condition.mach) == (high, mach)
    assert catalog()["recipes"]["jsbsim"]["conditions"][model] == {
        "altitude_m": high,
        "mach": mach,
    }
    drawn = test.simulator().rollouts(4, np.random.default_rng(0))
    assert np.isfinite(drawn.y).all()
    given, _ = dataset_recipe({"aircraft": aircraft, "condition": {"mach": 0.31}})
    assert isinstance(given, JsbsimTest)
    assert (given.condition.altitude_m, given.condition.mach) == (high, 0.31)


def test_usual_conditions_are_of_aircraft_that_there_are():
    named = " ".join(USUALLY.values()).split()
    assert len(set(named)) == len(named)
    assert set(named) <= set(aircraft_names())


def test_without_jsbsim_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr("core.simulation.jsbsim.find_spec", lambda name: None)
    catalog.cache_clear()
    try:
        assert catalog()["recipes"]["jsbsim"]["needs"] == "forewarn[jsbsim]"
        with api(tmp_path) as client:
            refused = client.post("/api/v1/datasets", json=DOUBLET)
            assert "install forewarn[jsbsim]" in problem(refused, 422)
    finally:
        catalog.cache_clear()
    with pytest.raises(ValueError, match="install"):
        JsbsimTest().simulator()
