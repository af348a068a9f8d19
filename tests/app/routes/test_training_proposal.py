"""Training recipes proposed from recordings: manoeuvre, limits and channels."""

import numpy as np
import pytest

from app.commands.sample_flight import table
from core.channels import KEYS
from core.monitor import MonitorRecipe, train
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.recipe import from_plain
from core.simulation.maneuver import Doublet, Multistep3211, Pulse
from tests.support.api import finished, problem, store_of
from tests.support.attas import record_file
from tests.support.recorded import RECORDINGS, csv_of, uploaded


def proposal(client, content, **query):
    recording = uploaded(client, content)
    answer = client.get(f"{RECORDINGS}/{recording['id']}/training-proposal", params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def flown(maneuver, law="none"):
    """The nominal F-4C, recorded on a manoeuvre."""
    plain = {"aircraft": {"kind": "f4c_35k_m0p6"}, "control_law": {"kind": law}}
    recipe = from_plain(DatasetRecipe(maneuver=maneuver), plain)
    simulator = LateralSimulator(recipe)
    theta = simulator.plant.nominal[np.newaxis]
    return table(simulator.fly(theta, np.random.default_rng(1))[0].y[0], recipe.dt).encode()


@pytest.mark.parametrize(
    ("maneuver", "kind", "unit"),
    [
        (Doublet(amplitude_deg=-4.0, half_s=0.7), "rudder_doublet", "half_s"),
        (Pulse(amplitude_deg=3.0, width_s=1.5), "pulse", "width_s"),
        (Multistep3211(amplitude_deg=3.0, unit_s=0.6, duration_s=8.0), "multistep_3211", "unit_s"),
    ],
)
def test_the_flown_card_is_proposed(client, maneuver, kind, unit):
    found = proposal(client, flown(maneuver))["recipe"]["dataset"]["maneuver"]
    assert (found["kind"], found["surface"]) == (kind, "rudder")
    assert found["amplitude_deg"] == pytest.approx(maneuver.amplitude_deg, rel=0.1)
    assert found[unit] == pytest.approx(getattr(maneuver, unit), abs=0.11)


def test_a_proposal_with_an_aircraft_is_a_recipe_that_can_be_trained(client):
    made = proposal(client, flown(Doublet(amplitude_deg=6.0)))
    assert (made["missing_channels"], made["can_train"]) == ([], True)
    recipe = made["recipe"]["dataset"] | {"aircraft": {"kind": "f4c_35k_m0p6"}, "n_unsafe": 5}
    answer = client.post("/api/v1/datasets", json=recipe | {"max_safe": 200})
    assert finished(client, answer)["status"] == "done"


def test_the_attas_record_is_a_rudder_doublet(client):
    made = proposal(client, record_file("attas_rud1").read_bytes())
    maneuver = made["recipe"]["dataset"]["maneuver"]
    assert maneuver["kind"] == "rudder_doublet"
    assert -5.0 < maneuver["amplitude_deg"] < -2.0
    assert made["can_train"]


def test_a_monitor_trained_as_proposed_scores_a_recording_without_sideslip(client):
    content = record_file("citation_20190312_dutchroll").read_bytes()
    recording = uploaded(client, content)
    made = client.get(f"{RECORDINGS}/{recording['id']}/training-proposal").json()
    assert (made["missing_channels"], made["can_train"]) == (["beta"], True)
    recipe = made["recipe"]
    assert recipe["score"] == {"kind": "negative_magnitude", "key": "Ny"}
    aircraft = {"aircraft": {"kind": "attas_id_16kft"}, "n_unsafe": 40}
    order = recipe | {"dataset": recipe["dataset"] | aircraft, "n_test": 0, "epsilon": 0.2}
    job = finished(client, client.post("/api/v1/monitors", json=order))
    assert job["status"] == "done", job["error"]
    body = {"monitor": job["result"]["monitor"]}
    scored = client.post(f"{RECORDINGS}/{recording['id']}/scorings", json=body)
    assert scored.status_code == 201, scored.text


def test_without_a_limited_channel_no_method_works(client):
    rows = np.zeros((200, 6))
    rows[60:80, 5] = 0.05
    made = proposal(client, csv_of(rows).replace(b"Ny", b"other"))
    assert "Ny" in made["missing_channels"]
    assert made["can_train"] is False
    assert "score" not in made["recipe"]


def test_limits_and_lead_come_from_the_given_monitor(client, dataset):
    monitor = train(dataset, MonitorRecipe())
    stored = store_of(client).monitors.add(monitor, "oscillator").id
    made = proposal(client, flown(Doublet(amplitude_deg=6.0)), monitor=stored)
    limits = made["recipe"]["dataset"]["limits"]
    assert monitor.limits is not None
    assert [limits[key] for key in KEYS] == [
        limit if np.isfinite(limit) else None for limit in monitor.limits
    ]
    assert made["recipe"]["t_early"] == monitor.lead
    unknown = client.get(f"{RECORDINGS}/none/training-proposal")
    assert problem(unknown, 404)


def test_a_recording_without_input_has_no_proposed_manoeuvre(client):
    made = proposal(client, csv_of(np.zeros((100, 6))))
    assert "maneuver" not in made["recipe"]["dataset"]
    assert made["manoeuvre"] is None
