"""A training recipe proposed from a recording: manoeuvre, limits, channels, and what is missing."""

import numpy as np
import pytest

from app.commands.sample_flight import table
from core.channels import KEYS
from core.monitor import MonitorRecipe, train
from core.planned_test import DatasetRecipe, Simulator
from core.recipe import from_plain
from core.simulation.maneuver import Doublet, Multistep3211, Pulse
from tests.support.api import api, finished, problem, store_of
from tests.support.attas import record_file
from tests.support.recorded import RECORDINGS, csv_of, uploaded


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api(tmp_path_factory.mktemp("data")) as client:
        yield client


def proposal(client, content, **query):
    recording = uploaded(client, content)
    answer = client.get(f"{RECORDINGS}/{recording['id']}/training-proposal", params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def flown(maneuver, law="none"):
    """The nominal F-4C, recorded on a manoeuvre."""
    plain = {"aircraft": {"kind": "f4c_35k_m0p6"}, "control_law": {"kind": law}}
    recipe = from_plain(DatasetRecipe(maneuver=maneuver), plain)
    simulator = Simulator(recipe)
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
def test_the_card_that_was_flown_is_proposed(client, maneuver, kind, unit):
    found = proposal(client, flown(maneuver))["recipe"]["dataset"]["maneuver"]
    assert (found["kind"], found["surface"]) == (kind, "rudder")
    assert found["amplitude_deg"] == pytest.approx(maneuver.amplitude_deg, rel=0.1)
    assert found[unit] == pytest.approx(getattr(maneuver, unit), abs=0.11)


def test_a_proposal_with_an_aircraft_is_a_recipe_that_can_be_trained(client):
    made = proposal(client, flown(Doublet(amplitude_deg=6.0)))
    assert (made["aircraft"], made["missing_channels"], made["can_train"]) == (None, [], True)
    assert made["channels"] == list(KEYS)
    recipe = made["recipe"]["dataset"] | {"aircraft": {"kind": "f4c_35k_m0p6"}, "n_unsafe": 5}
    answer = client.post("/api/v1/datasets", json=recipe | {"max_safe": 200})
    assert finished(client, answer)["status"] == "done"


def test_the_attas_record_is_a_rudder_doublet(client):
    made = proposal(client, record_file("attas_rud1").read_bytes())
    maneuver = made["recipe"]["dataset"]["maneuver"]
    assert maneuver["kind"] == "rudder_doublet"
    assert -5.0 < maneuver["amplitude_deg"] < -2.0
    assert made["can_train"]


def test_a_recording_without_sideslip_cannot_be_trained_for_and_the_reason_is_given(client):
    made = proposal(client, record_file("citation_20190312_dutchroll").read_bytes())
    assert made["missing_channels"] == ["beta"]
    assert made["can_train"] is False
    assert any("six channels" in reason for reason in made["reasons"])


def test_limits_and_lead_are_those_of_the_monitor_that_scored(client, dataset):
    monitor = train(dataset, MonitorRecipe())
    stored = store_of(client).monitors.add(monitor, "oscillator").id
    made = proposal(client, flown(Doublet(amplitude_deg=6.0)), monitor=stored)
    limits = made["recipe"]["dataset"]["limits"]
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
