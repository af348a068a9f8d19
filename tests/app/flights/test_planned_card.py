"""The test card as it is sent: the planned input, and when the manoeuvres of a source begin."""

from dataclasses import replace

import numpy as np
import pytest

from app.assessment.planned_test import planned_test
from app.flights.planned_card import first_input, planned_card, points_of
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.simulated import simulate
from app.store.campaigns import StoredCampaign
from core.monitor import Monitor
from core.monitor.validity.flown_input import InputSupport
from core.planned_test.collection import DatasetRecipe
from core.simulation.maneuver import (
    BankToBank,
    Capture,
    FrequencySweep,
    Maneuver,
    Multistep3211,
)
from core.simulation.pilot import usual_pilot
from tests.app.flights.test_flights import RECIPE, monitor
from tests.support.flying import EPSILON, exact_monitor


def of_manoeuvre(maneuver: Maneuver) -> Monitor:
    recipe = DatasetRecipe(maneuver=maneuver, pilot=usual_pilot(maneuver), dt=RECIPE.dt)
    return replace(monitor(), dataset_recipe=recipe.to_plain())


def test_the_card_of_a_doublet_has_its_peak_duration_and_steps() -> None:
    planned = RECIPE.maneuver
    card = planned_card(monitor())
    (rudder,) = card.inputs
    assert (card.why, card.point, rudder.channel) == ("", None, "delta_r")
    assert rudder.peak == pytest.approx(np.radians(planned.peak_deg))
    assert rudder.lasts == pytest.approx(sum(planned.segments_s))
    assert card.steps == pytest.approx(np.cumsum([0.0, *planned.segments_s]).tolist())
    assert card.length == pytest.approx(planned.duration_s - planned.lead_in_s)
    assert np.interp([0.5, 1.5, 2.5], rudder.t, rudder.y) == pytest.approx(
        np.radians(planned.peak_deg) * np.array([1, -1, 0]), rel=1e-5
    )


@pytest.mark.parametrize("maneuver", [Multistep3211(), BankToBank()])
def test_steps_are_the_switches_of_the_planned_manoeuvre(maneuver: Multistep3211) -> None:
    planned = [t - maneuver.lead_in_s for t, _ in maneuver.switches]
    assert planned_card(of_manoeuvre(maneuver)).steps == pytest.approx(planned)


def test_a_sweep_has_an_input_and_no_step_but_its_beginning() -> None:
    card = planned_card(of_manoeuvre(FrequencySweep()))
    assert card.steps == [0.0]
    assert len(card.inputs[0].t) > 50


def test_a_capture_shows_its_targets_and_has_the_usual_movements_of_its_surfaces() -> None:
    none = np.empty((0, 1, 3))
    usual = InputSupport(np.array([4]), np.array([0.1]), none, none)
    captures = of_manoeuvre(Capture(amplitude_deg=25.0, then_deg=-10.0))
    captures = replace(captures, inputs=usual)
    card = planned_card(captures)
    assert (card.inputs, card.steps) == ([], [])
    assert all(number in card.why for number in ("bank", "25", "-10"))
    planned = planned_test(captures)
    assert planned.amplitudes.tolist() == [0.1, 0.0]
    assert planned.duration == Capture().duration_s


def test_a_monitor_without_a_recipe_gives_its_reason_in_place_of_the_input() -> None:
    card = planned_card(exact_monitor())
    assert card.inputs == []
    assert card.why


def test_a_track_begins_with_the_first_departure_of_a_control() -> None:
    track = simulate(RECIPE, 1, None, "any")
    script = AssessedTrack(track, monitor(), EPSILON)
    y = track.y.copy()
    assert script.begun == pytest.approx([RECIPE.maneuver.lead_in_s], abs=0.3)
    y[:, planned_test(monitor()).controls] = 0.0
    assert first_input(y, planned_test(monitor())) is None


def test_the_point_of_a_campaign_is_found_by_its_monitor() -> None:
    content = {"points": [{"name": "40%"}, {"name": "60%", "monitor": "m"}]}
    campaign = StoredCampaign("c", "build-up", "", "", 1, content)
    point = points_of([campaign], ["m", "other"])["m"]
    assert (point.number, point.points, point.name) == (2, 2, "60%")
    assert (point.campaign, point.campaign_name) == ("c", "build-up")
