"""Campaigns over REST: planning, clearance, flown points, identification, monitors, refusals."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.campaigns import clearing as clearing_module
from app.campaigns.point import Clearing
from app.campaigns.stored import Campaigns
from app.commands.sample_flight import table
from app.store.campaigns import CampaignChanged
from core.clearance import clearance as clearance_module
from core.clearance.clearance import ClearanceRecipe
from core.clearance.with_monitor import WithMonitor
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from tests.support.api import api, finished, problem, store_of

URL = "/api/v1/campaigns"
NOISE = {"Ny": 0.003, "p": 0.002, "r": 0.002, "beta": 0.001, "delta_a": 0.0004, "delta_r": 0.0004}
TEST = {
    "aircraft": {"kind": "attas_id_16kft"},
    "control_law": {"kind": "none"},
    "limits": {"Ny": 0.3},
    "noise": NOISE,
    "imperfections": "none",
}
PLAN = {
    "name": "Rudder",
    "conditions": [
        {"dataset": TEST, "steps": [0.6, 0.8, 1.0], "passes_below": 0.95, "criteria": "no flutter"}
    ],
    "clearance": {"n_exceeding": 20, "n_aircraft": 100},
}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with api(tmp_path) as client:
        yield client


@pytest.mark.parametrize("dataset", ["an F-16", ["Ny"], 5, None, True])
def test_a_dataset_must_be_an_object(client, dataset):
    answer = client.post(URL, json={"name": "Rudder", "conditions": [{"dataset": dataset}]})
    assert "dataset is" in problem(answer, 422)
    answer = client.post(f"{planned(client)}/conditions", json={"dataset": dataset})
    assert "dataset is" in problem(answer, 422)


def planned(client: TestClient, **more: Any) -> str:
    """Address of a new campaign."""
    response = client.post(URL, json=PLAN | more)
    assert response.status_code == 201, response.text
    return response.headers["location"]


def recording(client: TestClient, path: str, scale: float = 1.0) -> str:
    """Id of the next point's recording, flown by the nominal aircraft."""
    _, campaign = Campaigns(store_of(client)).get(path.rpartition("/")[2])
    planned = campaign.test_of(campaign.next.point)
    assert isinstance(planned, DatasetRecipe)
    simulator = LateralSimulator(planned)
    theta = simulator.plant.nominal[np.newaxis]
    y = simulator.fly(theta, np.random.default_rng(1), np.array([scale]))[0].y[0]
    sent = client.post(
        "/api/v1/recordings?name=flight.csv", content=table(y, simulator.recipe.dt).encode()
    )
    assert sent.status_code == 201, sent.text
    return sent.json()["id"]


def test_a_campaign_is_planned_cleared_flown_and_reported(client: TestClient) -> None:
    """Each state after the other, with names; links to what is stored; a page and a file."""
    path = planned(client)
    made = client.get(path).json()
    assert [point["name"] for point in made["points"]] == ["60%", "80%", "100%"]
    assert {point["criteria"] for point in made["points"]} == {"no flutter"}
    assert made["is_first"]
    assert made["checklist"] == []
    confirmed = client.post(f"{path}/confirm", json={"point": "60%", "by": "Ann"}).json()
    assert confirmed["points"][0]["state"] == "cleared"
    assert client.get(f"{path}/derivatives").json() == []
    flight = recording(client, path)
    flown = client.post(
        f"{path}/flown", json={"point": "60%", "recording": flight, "by": "Bob"}
    ).json()
    point = flown["points"][0]
    assert point["state"] == "complete"
    assert point["flown"]["recording"] == flight
    assert point["flown"]["flight"] is None
    assert point["flown"]["recording_deleted"] is False
    assert point["flown"]["passed"]
    assert (point["flown"]["start"], point["flown"]["end"]) == (5.1, 11.0)
    assert [event["by"] for event in point["events"]] == ["Ann", "Bob"]
    assert (flown["next"], flown["n_complete"]) == ("80%", 1)

    job = finished(client, client.post(f"{path}/clearance", json={"point": "80%", "by": "Ann"}))
    assert job["status"] == "done", job
    assert job["result"]["state"] == "on condition"
    cleared = client.get(path).json()
    clearing = cleared["points"][1]["clearing"]
    assert clearing["cleared"]
    assert clearing["steps"] == ["60%"]
    assert 0.0 < clearing["exceeding_share"] < 1.0
    bound = 1.0 if clearing["p_value"] is None else 0.05
    assert cleared["exceeding_at_most"] == pytest.approx(bound * clearing["exceeding_at_most"])
    assert clearing["exceeding_share"] < clearing["exceeding_at_most"] < 1.0
    assert any("N_y and surface sensors" in item for item in cleared["checklist"])
    client.post(f"{path}/confirm", json={"point": "80%", "by": "Ann"})
    (known,) = client.get(f"{path}/derivatives").json()
    assert [after["sources"] for after in known["after"]] == [["60%"]]
    busy = store_of(client).jobs.add("clearance", {"campaign": made["id"], "point": "100%"})
    problem(client.post(f"{path}/clearance", json={"point": "80%", "by": "Ann"}), 409)
    store_of(client).jobs.update(busy, status="cancelled")
    more = client.post(f"{path}/conditions", json={"name": "Mach 0.6", "steps": [0.5, 1.0]}).json()
    assert more["conditions"][1]["test"]["aircraft"] == made["conditions"][0]["test"]["aircraft"]
    page = client.get(f"{path}/report")
    assert page.headers["content-type"].startswith("text/html")
    assert "Next: 80%" in page.text
    assert "Monitor trained for this point: none." in page.text
    assert "Test conductor, pilot, date:" in page.text
    peak = made["points"][1]["peak_deg"]
    assert f"rudder at 0.5 s to {peak:.3g} deg, at 1.5 s to {-peak:.3g} deg, at 2.5 s" in page.text
    (listed,) = client.get(URL).json()
    assert (listed["next"], listed["state"]) == ("80%", "cleared")

    file = client.get(f"{path}/file")
    assert "attachment" in file.headers["content-disposition"]
    copied = client.post(f"{URL}/file", json=file.json())
    assert copied.status_code == 201, copied.text
    points = client.get(path).json()["points"]
    for event in (event for point in points for event in point["events"]):
        event["by"] += " (by the file)"
    assert copied.json()["points"] == points
    again = client.get(f"{URL}/{copied.json()['id']}/file").json()
    assert client.post(f"{URL}/file", json=again).json()["points"] == points
    client.delete(f"/api/v1/recordings/{flight}")
    gone = client.get(path).json()["points"][0]["flown"]
    assert (gone["recording"], gone["recording_deleted"]) == (None, True)
    assert client.delete(path).status_code == 204
    problem(client.get(path), 404)
    assert len(client.get(URL).json()) == 2


def test_the_next_points_monitor_is_trained_on_the_identified_aircraft(client: TestClient) -> None:
    """Its certificate names the flights; it is noted with the point."""
    wider = TEST | {"limits": {"Ny": 0.305}}
    path = planned(client, conditions=[{"dataset": wider, "steps": [0.6, 0.8, 1.0]}])
    client.post(
        f"{path}/flown", json={"point": "60%", "recording": recording(client, path), "by": "Bob"}
    )
    asked = {"point": "80%", "n_test": 200, "epsilon": 0.1, "guarantee": "average"}
    problem(client.post(f"{path}/monitor", json=asked | {"point": "100%"}), 409)
    assert "dataset is determined" in problem(
        client.post(f"{path}/monitor", json=asked | {"dataset": {}}), 422
    )
    client.post(f"{path}/abort", json={"point": "80%", "by": "Ann", "why": "to the last at once"})
    job = finished(client, client.post(f"{path}/monitor", json=asked | {"point": "100%"}))
    assert job["status"] == "done", job
    monitor = job["result"]["monitor"]
    assert client.get(path).json()["points"][2]["monitor"] == monitor
    certificate = client.get(f"/api/v1/monitors/{monitor}/certificate").text
    assert "60% (flight.csv, 5.10 to 11.00 s)" in certificate
    assert client.get(f"/api/v1/monitors/{monitor}").json()["name"] == "Rudder, 100%"


def test_a_monitor_is_a_part_of_a_clearance(client, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clearance gives the monitor's recipe, and the checklist asks for it."""
    risks = np.full(120, 0.3)
    monkeypatch.setattr(
        clearing_module, "with_monitor", lambda rule, *_: WithMonitor(rule.recipe, risks)
    )
    wider = TEST | {"limits": {"Ny": 0.305}, "n_unsafe": 60}
    path = planned(client, conditions=[{"dataset": wider, "steps": [0.6, 1.0]}])
    client.post(
        f"{path}/flown", json={"point": "60%", "recording": recording(client, path), "by": "Bob"}
    )
    asked = {"point": "100%", "by": "Ann", "with_monitor": True}
    job = finished(client, client.post(f"{path}/clearance", json=asked))
    assert job["status"] == "done", job
    campaign = client.get(path).json()
    clearing = campaign["points"][1]["clearing"]
    epsilon = clearing["monitor_epsilon"]
    assert 0.28 < epsilon < 0.3
    assert clearing["p_value"] <= clearing["clear_below"] == 0.5
    assert (clearing["cleared"], campaign["state"]) == (True, "on condition")
    assert f"ε = {epsilon:.2g}" in campaign["checklist"][-1]
    assert f"ε = {epsilon:.2g}" in client.get(f"{path}/report").text
    refused = client.post(f"{path}/monitor", json={"point": "100%", "epsilon": 0.1})
    assert "epsilon was given" in problem(refused, 409)
    asked = {"point": "100%", "n_test": 100}
    job = finished(client, client.post(f"{path}/monitor", json=asked))
    assert job["status"] == "done", job
    recipe = client.get(f"/api/v1/monitors/{job['result']['monitor']}").json()["recipe"]
    assert (recipe["predictor"]["kind"], recipe["epsilon"]) == ("input_filter", epsilon)
    file = client.get(f"{path}/file").json()
    assert file["points"][1]["clearing"]["monitor_epsilon"] == epsilon


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": ""}, "name is"),
        ({"name": 3}, "name is 3"),
        ({"conditions": []}, "give 1 or more"),
        ({"conditions": [{"steps": [1.0]}]}, "has 2 to 50"),
        ({"conditions": [{"steps": [1.0, 0.5]}]}, "one sign and grow"),
        ({"conditions": [{"steps": "all"}]}, "steps"),
        ({"conditions": [{"steps": [1.0, 2.0, 3.0]}]}, "at most 1"),
        ({"conditions": [{"amplitudes": [1]}]}, "amplitudes is unknown"),
        ({"conditions": [{"passes_below": 2.0}]}, "1 or less"),
        ({"conditions": [{"passes_below": True}]}, "passes_below"),
        ({"conditions": [{"criteria": 3}]}, "conditions.0.criteria is 3"),
        ({"conditions": [{"dataset": TEST, "steps": [1e300, 1e308]}]}, "at most"),
        ({"conditions": [{"name": 7}]}, "conditions.0.name is 7"),
        (
            {"conditions": [{"name": "a"}, {"name": "a"}]},
            "two flight conditions have the same name",
        ),
        ({"conditions": [{"dataset": {"aircraft": {"kind": "b52"}}}]}, "b52"),
        ({"clearance": {"epsilon": 2.0}}, "epsilon"),
        ({"clearance": {"n_exceeding": 20, "epsilon": 0.01}}, "needs at least 99"),
        ({"pilot": "Ann"}, "pilot is unknown"),
    ],
)
def test_invalid_plans_are_refused(client: TestClient, change: dict[str, Any], words: str) -> None:
    """With what is needed; nothing is stored."""
    assert words in problem(client.post(URL, json=PLAN | change), 422)
    assert client.get(URL).json() == []


def test_invalid_decisions_change_nothing(client: TestClient) -> None:
    """Of another point than the next, without a reason, twice, or by a recording that is none."""
    path = planned(client)
    before = client.get(path).json()
    by = {"by": "Ann"}
    for action in ("confirm", "hold", "abort", "clearance"):
        words = problem(client.post(f"{path}/{action}", json={"point": "80%"} | by), 409)
        assert "'80%' is not the next point: '60%' is" in words
    words = problem(client.post(f"{path}/clearance", json={"point": "60%"} | by), 409)
    assert "no step flown before '60%'" in words
    words = problem(client.post(f"{path}/abort", json={"point": "60%"} | by), 409)
    assert "say why" in words
    flown = {"point": "60%", "recording": "000000000000"} | by
    problem(client.post(f"{path}/flown", json=flown), 404)
    flown |= {"recording": recording(client, path)}
    assert "give both" in problem(client.post(f"{path}/flown", json=flown | {"start": 1}), 422)
    away = flown | {"start": 90, "end": 99}
    assert "not inside" in problem(client.post(f"{path}/flown", json=away), 422)
    assert client.get(path).json() == before
    for action, status in (("confirm", 404), ("derivatives", 404)):
        address = f"{URL}/000000000000/{action}"
        response = (
            client.get(address)
            if action == "derivatives"
            else client.post(address, json={"point": "60%"})
        )
        problem(response, status)
    assert "is not a campaign file" in problem(client.post(f"{URL}/file", json={"a": 1}), 422)


def test_the_second_of_two_simultaneous_decisions_is_refused(client: TestClient) -> None:
    """What was stored meanwhile stays."""
    path = planned(client)
    campaigns = Campaigns(store_of(client))
    stored, campaign = campaigns.get(path.rpartition("/")[2])
    campaigns.put(stored, campaign.on_hold("Ann", "gust"))
    with pytest.raises(CampaignChanged, match="changed by another person"):
        campaigns.put(stored, campaign.confirmed("Bob"))
    assert client.get(path).json()["points"][0]["state"] == "hold"


def test_a_point_aborted_in_flight_keeps_its_recording(client: TestClient) -> None:
    """As how far it came; where it exceeded, nothing clears what follows."""
    path = planned(client)
    by = {"by": "Bob"}
    flown = {"point": "60%", "recording": recording(client, path)} | by
    client.post(f"{path}/flown", json=flown)
    abort = {"point": "80%", "why": "broke off"} | by
    words = problem(client.post(f"{path}/abort", json=abort | {"start": 0, "end": 9}), 422)
    assert "give its id" in words
    problem(client.post(f"{path}/abort", json=abort | {"recording": "000000000000"}), 404)
    assert client.get(path).json()["next"] == "80%"
    far = recording(client, path, 2.0)
    told = client.post(f"{path}/abort", json=abort | {"recording": far}).json()["points"][1]
    assert told["state"] == "aborted"
    assert told["flown"]["recording"] == far
    assert told["flown"]["exceeded"].startswith("Ny at ")
    assert not told["flown"]["passed"]
    assert "broke off; flight.csv, entire recording: reached" in told["events"][-1]["words"]
    job = finished(client, client.post(f"{path}/clearance", json={"point": "100%"} | by))
    assert job["result"]["state"] == "hold"
    point = client.get(path).json()["points"][2]
    assert "80% did not pass" in point["clearing"]["withdrawn"]
    page = client.get(f"{path}/report").text
    assert "exceeded Ny at" in page
    copied = client.post(f"{URL}/file", json=client.get(f"{path}/file").json())
    assert copied.json()["points"][1]["flown"]["exceeded"] == told["flown"]["exceeded"]


def test_an_exceedance_puts_the_next_point_on_hold(client: TestClient) -> None:
    """It did not pass: no prediction clears what follows."""
    path = planned(client)
    flown = {"point": "60%", "recording": recording(client, path, 1.62), "by": "Bob"}
    told = client.post(f"{path}/flown", json=flown).json()["points"][0]
    assert not told["flown"]["passed"]
    assert not told["flown"]["exceeded"]
    assert "NOT PASSED" in told["events"][-1]["words"]
    job = finished(client, client.post(f"{path}/clearance", json={"point": "80%", "by": "Ann"}))
    assert job["result"]["state"] == "hold"
    point = client.get(path).json()["points"][1]
    assert "60% did not pass" in point["clearing"]["withdrawn"]
    words = problem(client.post(f"{path}/confirm", json={"point": "80%", "by": "Ann"}), 409)
    assert "'80%' cannot be confirmed in state 'hold'" in words


def test_a_point_that_hardly_any_aircraft_exceeds_is_cleared_without_a_p_value(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clearance_module, "MOST_AIRCRAFT", 1_000)
    harmless = {"dataset": TEST | {"limits": {"Ny": 3.0}}, "steps": [0.6, 0.8]}
    path = planned(client, conditions=[harmless])
    flown = {"point": "60%", "recording": recording(client, path), "by": "Bob"}
    assert client.post(f"{path}/flown", json=flown).status_code == 200
    job = finished(client, client.post(f"{path}/clearance", json={"point": "80%", "by": "Ann"}))
    assert job["result"]["state"] == "on condition", job
    clearing = client.get(path).json()["points"][1]["clearing"]
    assert (clearing["p_value"], clearing["clear_below"]) == (None, None)


def test_a_smaller_step_is_planned_before_a_refused_point(client: TestClient) -> None:
    path = planned(client)
    decision = {"point": "80%", "by": "Ann"}
    assert client.get(path).json()["smaller_step"] is None
    flown = {"point": "60%", "recording": recording(client, path), "by": "Bob"}
    assert client.post(f"{path}/flown", json=flown).status_code == 200
    refused = client.post(f"{path}/smaller-step", json=decision)
    assert "compute its clearance first" in problem(refused, 409)
    campaigns = Campaigns(store_of(client))
    stored, campaign = campaigns.get(path.rpartition("/")[2])
    peak = campaign.next.point.peak_deg / 0.8
    clearing = Clearing(
        False, 0.3, 0.1, (0.8, 0.9, 1.1), 0.727 * peak, (), 210, 1_000, ClearanceRecipe(), ("60%",)
    )
    campaigns.put(stored, campaign.changed(1, "hold", "Ann", clearing=clearing))
    proposed = client.get(path).json()["smaller_step"]
    assert proposed == {"name": "72%", "peak_deg": pytest.approx(0.72 * peak)}
    told = client.post(f"{path}/smaller-step", json=decision).json()
    assert (told["next"], told["state"], told["smaller_step"]) == ("72%", "planned", None)
    assert told["points"][2]["clearing"]["p_value"] == 0.3
