"""A build-up of a nonlinear aircraft: planned, cleared from flown steps, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from httpx2 import Response
from starlette.testclient import TestClient

from app.campaigns.campaign import Campaign, from_file, load, points_at
from app.campaigns.clearing import identified, updated
from app.campaigns.flying import aborted_flight
from app.campaigns.point import CampaignError, Condition
from app.campaigns.stored import Campaigns
from app.cli import main
from app.recipes.recipes import to_plain
from app.recordings.mapped_recording import MappedRecording
from app.report.campaign import campaign_page
from app.telemetry.mapping.proposal import propose
from app.telemetry.reading import columns_of
from core.clearance.clearance import (
    Clearance,
    ClearanceError,
    ClearanceRecipe,
    RolloutPredictor,
    calibrate,
)
from core.clearance.with_monitor import with_monitor
from core.limits.flight_limits import LoadLimits
from core.planned_test.nonlinear_test import JsbsimTest, NonlinearTest, SixDofTest
from core.simulation.maneuver import MANEUVERS
from core.types import Array, Flags
from tests.support.api import api, finished, store_of
from tests.support.build_up import build_up
from tests.support.recorded import csv_of

TEST = NonlinearTest(
    maneuver=replace(MANEUVERS["rolling_pull_out"], amplitude_jitter=0.03)
).with_usual()
RECIPE = ClearanceRecipe(epsilon=0.1, n_exceeding=50, n_aircraft=150, seed=3)
POINTS = build_up(TEST, (0.6, 0.8))
METHOD = {
    "predictor": {"kind": "linear"},
    "score": {"kind": "nearest_neighbor"},
    "guarantee": "average",
}


@pytest.fixture(scope="module")
def clearance() -> Clearance:
    return calibrate(POINTS, RECIPE)


def flights(n: int, seed: int) -> tuple[list[Array], Flags, Array]:
    """Records of the steps by n aircraft; whether each exceeds at the next point, and its peak."""
    rng = np.random.default_rng(seed)
    steps = [step.simulator() for step in POINTS.flown]
    theta = steps[0].sample(n, rng)
    records = [step.fly(theta, rng)[0].y for step in steps]
    next_flights, peaks = TEST.simulator().fly(theta, rng)
    return records, next_flights.is_unsafe, peaks


def test_at_most_epsilon_of_the_points_that_would_exceed_is_cleared(clearance: Clearance) -> None:
    records, exceeds, peaks = flights(400, 5)
    prediction = RolloutPredictor(POINTS, RECIPE).predict(records)
    cleared = clearance.p_values(prediction.score) <= clearance.clear_below
    cleared &= (prediction.checks <= clearance.levels).all(axis=1)
    n, epsilon = exceeds.sum(), RECIPE.epsilon
    error = np.sqrt(epsilon * (1 - epsilon) * (1 / n + 1 / clearance.n_exceeding))
    assert cleared[exceeds].mean() <= epsilon + 3 * error
    assert cleared[~exceeds].mean() > 0.5
    assert np.corrcoef(prediction.mean, np.log(peaks))[0, 1] > 0.9


def test_a_step_unlike_those_of_simulated_aircraft_withdraws_it(clearance: Clearance) -> None:
    first, second = (records[0] for records in flights(1, 6)[0])
    assert not clearance.decide([first, second]).withdrawn
    more = second.copy()
    more[:, TEST.dictionary.index("Nz")] += 0.4
    assert clearance.decide([first, more]).withdrawn


def test_its_monitor_is_no_part_of_the_clearance(clearance: Clearance) -> None:
    with pytest.raises(ClearanceError, match="linear"):
        with_monitor(clearance)


def recording(path: Path, campaign: Campaign) -> Path:
    """The next point as the nominal aircraft flies it, with a second of trim before."""
    test = campaign.test_of(campaign.next.point)
    simulator = test.simulator()
    y = simulator.fly(simulator.parameters.nominal[np.newaxis], np.random.default_rng(1))[0].y[0]
    y = np.vstack([np.repeat(y[:1], 20, axis=0), y, np.repeat(y[:1], 40, axis=0)])
    keep = [test.dictionary.index(key) for key in test.dictionary.measured]
    head = ["t_s"] + [f"{c.key} [{c.unit}]" for c in test.dictionary.channels if not c.formula]
    path.write_bytes(csv_of(y[:, keep], test.dt, head=",".join(head)))
    return path


def test_the_command_line_flies_a_build_up(tmp_path: Path) -> None:
    file = tmp_path / "pull.json"
    by = ["--by", "Ann"]
    test = ["--aircraft", "f16_polynomial", "--maneuver", "rolling_pull_out"]
    sizes = ["--n-aircraft", "100", "--n-exceeding", "20", "--clearance-epsilon", "0.2"]
    new = ["campaign", "new", str(file), "--name", "Pull-out", *test, *sizes]
    assert main([*new, "--limit", "wing_bending=..250000", "--steps", "0.6", "0.8", "1"]) == 0
    assert main(["campaign", "confirm", str(file), *by]) == 0
    flown = recording(tmp_path / "flight1.csv", load(file))
    assert main(["campaign", "fly", str(file), str(flown), *by]) == 0
    campaign = load(file)
    point = campaign.points[0]
    assert point.flown is not None
    assert len(point.flown.y[0]) == len(campaign.test_of(point).dictionary)
    assert 0.5 < point.flown.reached < 1.0
    assert not point.flown.remark
    assert main(["campaign", "clear", str(file), *by]) in (0, 1)
    cleared = load(file).next.point.clearing
    assert cleared is not None
    assert cleared.steps == (point.name,)
    assert "Pull-out" in campaign_page(load(file))
    assert main(["campaign", "identify", str(file)]) == 1
    next_recipe = tmp_path / "next.json"
    assert main(["campaign", "recipe", str(file), "-o", str(next_recipe)]) == 0
    planned = json.loads(next_recipe.read_text())["dataset"]
    assert planned["maneuver"]["amplitude_deg"] == load(file).next.point.peak_deg


def test_a_recipe_without_identification_has_the_aircraft_as_planned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "turn.json"
    test = ["--aircraft", "f16_polynomial", "--maneuver", "wind_up_turn"]
    assert main(["campaign", "new", str(file), "--name", "Turn", *test]) == 0
    assert main(["campaign", "recipe", str(file), "-o", str(tmp_path / "next.json")]) == 0
    told = capsys.readouterr().out
    assert "aircraft as planned" in told
    assert "identified" not in told


def card(test: SixDofTest) -> str:
    """The printed card of a first point at the amplitude of this test."""
    last = test.maneuver.with_peak(2.0 * test.maneuver.peak_deg)
    condition = Condition("", replace(test, maneuver=last))
    return campaign_page(Campaign("Card", (condition,), points_at(condition, (0.5, 1.0))))


def test_the_card_has_every_control_that_moves_with_its_ramps() -> None:
    turn = card(NonlinearTest(maneuver=MANEUVERS["wind_up_turn"]).with_usual())
    assert "elevator from 0.5 s to 8.5 s steadily to -5 deg" in turn
    pull = card(TEST)
    assert "elevator from 0.5 s to 1.5 s steadily to -5 deg" in pull
    assert "aileron at 1.5 s to -5 deg, at 2.5 s to 0 deg" in pull


def test_the_card_has_the_trim_that_the_checklist_asks_to_confirm() -> None:
    turn = card(NonlinearTest(maneuver=MANEUVERS["wind_up_turn"]).with_usual())
    trim = "altitude 15,000 ft (4572 m), 376 kt true airspeed, Mach 0.6, load factor 2 g"
    assert f"Trim: {trim}." in turn
    assert "Mach 0.165, load factor 1 g" in card(JsbsimTest())


def test_a_campaign_names_its_aircraft_of_jsbsim_with_manoeuvre_and_limits(tmp_path: Path) -> None:
    """On the printed page, and over REST for the page of the program."""
    named = "Cessna C-172 Skyhawk II (c172x) of JSBSim"
    assert named in card(JsbsimTest.of("c172x"))
    test = replace(JsbsimTest.of("c172x"), specification=LoadLimits(Nz_low=0.2))
    assert "normal acceleration at least 0.2 g" in card(test).replace("\N{NO-BREAK SPACE}", " ")
    plan = {"name": "Pull", "conditions": [{"dataset": to_plain(test), "steps": [0.6, 1.0]}]}
    with api(tmp_path) as client:
        path = client.post("/api/v1/campaigns", json=plan).headers["location"]
        (condition,) = client.get(path).json()["conditions"]
    words = condition["plan"].replace("\N{NO-BREAK SPACE}", " ")
    assert words.startswith(named)
    assert "doublet, 2 points up to -6.4 deg" in words
    assert "Mach 0.165" in words
    assert words.endswith("at least 0.2 g")


def test_the_card_of_jsbsim_says_what_full_stick_is() -> None:
    assert "(25 deg: full stick or pedal)" in card(JsbsimTest())


def first_flown(client: TestClient, path: str, point: str, file: Path) -> Response:
    """The answer of a campaign whose first point is confirmed and flown."""
    first = {"point": point, "by": "Ann"}
    assert client.post(f"{path}/confirm", json=first).status_code == 200
    _, campaign = Campaigns(store_of(client)).get(path.rpartition("/")[2])
    sent = recording(file, campaign).read_bytes()
    recorded = client.post("/api/v1/recordings?name=flight.csv", content=sent).json()
    flown = client.post(f"{path}/flown", json=first | {"recording": recorded["id"]})
    assert flown.status_code == 200, flown.text
    return flown


def test_a_build_up_is_flown_over_rest(tmp_path: Path) -> None:
    url = "/api/v1/campaigns"
    dataset = to_plain(TEST) | {"n_unsafe": 50}
    plan = {"name": "Pull", "conditions": [{"dataset": dataset, "steps": [0.6, 1.0]}]}
    with api(tmp_path) as client:
        path = client.post(url, json=plan).headers["location"]
        flown = first_flown(client, path, "60%", tmp_path / "flight.csv")
        assert flown.json()["next"] == "100%"
        assert len(flown.json()["checklist"]) == 4
        assert client.get(f"{path}/derivatives").json() == []
        assert client.get(f"{path}/report").status_code == 200


@pytest.mark.usefixtures("few_flights")
def test_a_build_up_of_jsbsim_is_cleared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jsbsim", reason="JSBSim is not installed: the extra jsbsim")
    for name, fewer in (("N_LEARNED", 80), ("FLIGHTS", 2), ("HALVINGS", 2)):
        monkeypatch.setattr(f"core.clearance.clearance.{name}", fewer)
    maneuver = replace(MANEUVERS["pitch_doublet"].with_peak(-6.4), duration_s=2.0)
    dataset = to_plain(JsbsimTest(maneuver=maneuver, n_obs=20, n_unsafe=20))
    plan = {
        "name": "Pull",
        "conditions": [{"dataset": dataset, "steps": [0.8, 1.0]}],
        "clearance": {"epsilon": 0.1, "n_exceeding": 20, "n_aircraft": 100},
    }
    with api(tmp_path) as client:
        path = client.post("/api/v1/campaigns", json=plan).headers["location"]
        first_flown(client, path, "80%", tmp_path / "flight.csv")
        job = finished(
            client, client.post(f"{path}/clearance", json={"point": "100%", "by": "Ann"})
        )
        assert job["status"] == "done", job
        assert job["result"]["state"] in ("on condition", "hold")
        clearing = client.get(path).json()["points"][1]["clearing"]
        assert clearing["n_exceeding"] >= 20
        asked = {"point": "100%", "t_early": 0.25, "epsilon": 0.1, "n_test": 0}
        job = finished(client, client.post(f"{path}/monitor", json=asked | METHOD))
        assert job["status"] == "done", job


def test_only_linear_aircraft_are_identified(tmp_path: Path) -> None:
    condition = Condition("", TEST)
    campaign = Campaign("pull", (condition,), points_at(condition, (0.6, 1.0)), RECIPE)
    first = campaign.confirmed("Ann")
    assert from_file(json.loads(json.dumps(first.as_plain())), "file") == first
    path = recording(tmp_path / "flight.csv", first)
    with columns_of(path) as columns:
        mapping = propose(columns, dictionary=TEST.dictionary).mapping
        recorded = MappedRecording.of(columns, mapping).scorable()
        assert aborted_flight("x", recorded, TEST, None).reached > 0.4
    assert updated(first, first.points[1]) == TEST
    with pytest.raises(CampaignError):
        identified(first, "")
