"""A nonlinear aircraft the whole way: command line, dataset and monitor by REST, flight, report."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import main
from app.flights.planned_card import planned_card
from core.evaluation import THRESHOLD
from core.evaluation.baselines import baselines_for
from core.limits.flight_limits import FLIGHT
from core.monitor import Monitor, load
from core.monitor.recipe import METHODS
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT
from tests.support.api import api, finished, problem

pytestmark = pytest.mark.usefixtures("few_flights")
METHOD = ["--guarantee", "average", "--predictor", "linear", "--score", "nearest_neighbor"]
WIND_UP_TURN: dict[str, Any] = {
    "aircraft": {"kind": "ggam_f16c"},
    "condition": {"load_factor": 2.0},
    "maneuver": {"kind": "wind_up_turn", "amplitude_deg": "auto"},
    "limits": {"alpha_high_deg": 12.0},
    "n_unsafe": 40,
    "max_safe": 40,
    "seed": 2,
}


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory, few_flights: None) -> Path:
    """The monitor of a pitch doublet, trained on the command line."""
    file = tmp_path_factory.mktemp("nonlinear") / "pitch.fwm"
    test = ["--aircraft", "f16_polynomial", "--limit", "Nz=..2.25g", "--limit", "alpha=..12deg"]
    sizes = ["--n-unsafe", "60", "--n-test", "300", "--epsilon", "0.1", "--t-early", "0.25"]
    assert main(["train", *test, *sizes, *METHOD, "-o", str(file)]) == 0
    return file


def test_the_command_line_trains_a_monitor_and_tests_it_on_fresh_flights(trained: Path):
    monitor = load(trained)
    assert isinstance(monitor, Monitor)
    assert monitor.dictionary == FLIGHT
    assert monitor.dataset_recipe["aircraft"]["kind"] == "f16_polynomial"
    assert monitor.dataset_recipe["noise"]["alpha"] > 0.0
    assert monitor.envelope is not None
    assert {*monitor.envelope.intervals(FLIGHT.keys)} == {"Nz", "alpha"}
    evaluation = monitor.evaluation or {}
    assert evaluation["n_unsafe"] + evaluation["n_safe"] == 300
    assert evaluation["at_epsilon"]["miss_rate"] < 0.1 + 3 * (0.09 / evaluation["n_unsafe"]) ** 0.5
    assert evaluation["prevention"]["n_unsafe"] == evaluation["n_unsafe"]


def test_a_flight_shows_the_planned_input(trained: Path):
    monitor = load(trained)
    assert isinstance(monitor, Monitor)
    card = planned_card(monitor)
    assert card.why == ""
    (elevator,) = card.inputs
    assert elevator.channel == "delta_e"
    assert np.degrees(elevator.peak) == pytest.approx(-3.0)
    assert card.steps == [0.0, 1.0, 2.0]
    assert card.length == 5.5


def test_the_best_method_on_flights_of_their_own_is_chosen(tmp_path: Path):
    file, sizes = tmp_path / "turn.fwm", ["--n-unsafe", "60", "--n-test", "300"]
    turn = ["--aircraft", "f16_polynomial", "--maneuver", "wind_up_turn", "--amplitude", "-4.5"]
    limits = ["--epsilon", "0.1", "--t-early", "0.25", "--guarantee", "average"]
    assert main(["train", *turn, *limits, *sizes, "-o", str(file)]) == 0
    monitor = load(file)
    assert isinstance(monitor, Monitor)
    tried = {each["name"]: each for each in (monitor.evaluation or {})["methods"]}
    assert {"ensemble", "peak_ahead", "outputs_ahead", THRESHOLD} <= tried.keys()
    (chosen,) = (name for name, each in tried.items() if each["chosen"])
    predictor, _ = METHODS[chosen]
    assert type(monitor.recipe.predictor) is type(predictor)
    assert monitor.dataset_recipe["condition"]["load_factor"] == 2.0
    assert monitor.dataset_recipe["specification"]["alpha_high_deg"] == 17.5


def test_the_recipe_is_printed_and_read_again(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    given = ["--aircraft", "ggam_a7", "--maneuver", "wind_up_turn", "--limit", "beta=8deg"]
    given += ["--set", "dataset.condition.load_factor=2", "--print-recipe"]
    assert main(["train", *given]) == 0
    printed = capsys.readouterr().out
    recipe = json.loads(printed)["dataset"]
    assert recipe["limits"]["beta_deg"] == pytest.approx(8.0)
    assert recipe["limits"]["Nz_high"] is None
    assert recipe["condition"]["load_factor"] == 2
    (tmp_path / "again.json").write_text(printed)
    assert main(["train", "--recipe", str(tmp_path / "again.json"), "--print-recipe"]) == 0
    assert capsys.readouterr().out == printed


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--limit", "theta=..10deg"], "theta cannot be limited"),
        (["--limit", "Nz=..0.5g"], "below 0.5 g"),
        (["--set", "dataset.condition.mach=1.2"], "mach=1.2"),
        (["--set", "dataset.condition.load_factor=30"], "no trim"),
        (["--maneuver", "wind_up_turn", "--amplitude", "4"], "below 0"),
    ],
)
def test_a_test_that_cannot_be_flown_is_refused(
    given: list[str], told: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["train", "--aircraft", "f16_polynomial", *given, "-o", "refused.fwm"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_a_wind_up_turn_goes_from_request_to_flight(tmp_path: Path):
    with api(tmp_path) as client:
        job = finished(client, client.post("/api/v1/datasets", json=WIND_UP_TURN))
        dataset = client.get(f"/api/v1/datasets/{job['result']['dataset']}").json()
        assert dataset["n_unsafe"] == 40
        assert list(dataset["limits"]) == ["alpha"]
        assert dataset["limits"]["alpha"]["high"] == pytest.approx(np.radians(12.0))
        asked = {"dataset": dataset["id"], "t_early": 0.25, "epsilon": 0.1, "n_test": 0}
        method = {"predictor": {"kind": "linear"}, "score": {"kind": "nearest_neighbor"}}
        asked |= {"guarantee": "average", **method}
        job = finished(client, client.post("/api/v1/monitors", json=asked))
        monitor = job["result"]["monitor"]
        simulated = {"kind": "simulated", "outcome": "unsafe", "seed": 3}
        anyway = {"monitor": monitor, "accept_useless": True}  # so few failures train it
        body = {"source": simulated} | anyway
        flight = client.post("/api/v1/flights", json=body)
        assert flight.status_code == 201, flight.text
        rollout = client.get(f"/api/v1/datasets/{dataset['id']}/rollouts/0").json()
        y = rollout["telemetry"]
        live = {"source": {"kind": "live", "trim": "none"}} | anyway
        flight = client.post("/api/v1/flights", json=live).json()["id"]
        for k in range(0, len(y["t"]), 20):
            samples = {key: values[k : k + 20] for key, values in y.items()}
            sent = client.post(f"/api/v1/flights/{flight}/samples", json=samples)
            assert sent.status_code in (200, 202), sent.text
        seen = client.get(f"/api/v1/flights/{flight}/assessments").json()["frames"]
        assert len(seen[0]["y"]) == len(FLIGHT)
        assert "ok" in {frame["state"] for frame in seen}
        assert any(frame["alert"] for frame in seen)
        sizes = {"dataset": dataset["id"], "n_monitors": 1, "n_test": 30}
        job = finished(client, client.post("/api/v1/studies", json=sizes))
        neighbors = ["linear + nearest neighbor", "no prediction", "PCA"]
        others = [*baselines_for(FLIGHT)]
        assert list(job["result"]["methods"]) == neighbors + others
        assert "derivatives in bounds" not in others
        assert b"<svg" in client.get(job["result"]["figures"]["unsafe_flight.svg"]).content
        sizes |= {"n_unsafe": 20, "leads_s": [0.25]}
        named = ["linear + nearest neighbor", "peaks ahead: rest", "neighbors + peaks"]
        asked = sizes | {"methods": [*named, "predicted magnitude", "test card: rest"]}
        job = finished(client, client.post("/api/v1/sweeps", json=asked))
        (test,) = job["result"]["tests"].values()
        assert [cell["method"] for cell in test["cells"]] == named
        ceiling = client.post("/api/v1/sweeps", json=sizes | {"ceiling": True})
        assert "nonlinear" in problem(ceiling, 422)


def test_the_catalog_offers_nonlinear_aircraft_and_their_manoeuvres(tmp_path: Path):
    with api(tmp_path) as client:
        published = client.get("/api/v1/catalog").json()
    entries = published["families"]["nonlinear_aircraft"]["entries"]
    assert list(entries) == list(NONLINEAR_AIRCRAFT)
    of_tests = {
        name: published["recipes"][name]["schema"]["properties"]["maneuver"]["properties"]["kind"]
        for name in ("dataset", "nonlinear")
    }
    assert "wind_up_turn" in of_tests["nonlinear"]["enum"]
    assert "wind_up_turn" not in of_tests["dataset"]["enum"]
    usual = published["families"]["maneuver"]["entries"]["wind_up_turn"]["usual_tests"]["nonlinear"]
    assert usual["condition"]["load_factor"] == 2.0
    assert usual["limits"]["alpha_high_deg"] == 17.5
    assert usual["limits"]["Nz_high"] is None
