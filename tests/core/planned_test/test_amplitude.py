import re
from dataclasses import replace

import numpy as np
import pytest

from core.limits.limits import Limits
from core.monitor import MonitorRecipe, train
from core.planned_test import amplitude
from core.planned_test.amplitude import AmplitudeError, suggest_amplitude
from core.planned_test.collection import CollectionError, collect, fresh
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.simulation.aircraft import AIRCRAFT, PublishedAircraft, Uncertainty
from core.simulation.maneuver import LATERAL_MANEUVERS, Maneuver, Table
from core.simulation.pilot import usual_pilot

RECIPE = DatasetRecipe()


def share_at(recipe: DatasetRecipe, peak_deg: float) -> float:
    """Share of other aircraft than those of the pilot run."""
    flown = replace(recipe, maneuver=recipe.maneuver.with_peak(peak_deg))
    return LateralSimulator(flown).rollouts(4000, np.random.default_rng(5)).is_unsafe.mean()


@pytest.mark.parametrize("kind", AIRCRAFT)
def test_the_usual_test_of_every_aircraft_trains(kind: str):
    recipe = replace(DatasetRecipe.usual(AIRCRAFT[kind]), n_unsafe=30)
    assert 0.15 < share_at(recipe, recipe.maneuver.peak_deg) < 0.35
    monitor = train(collect(recipe), MonitorRecipe(epsilon=0.1), fresh(recipe))
    assert monitor.n_unsafe == 30


@pytest.mark.parametrize("maneuver", LATERAL_MANEUVERS.values(), ids=LATERAL_MANEUVERS)
@pytest.mark.parametrize("share", [0.1, 0.25, 0.5])
def test_the_wanted_share_fails_at_the_suggested_amplitude(maneuver: Maneuver, share: float):
    limits = Limits(p=0.2) if maneuver.captured == "bank" else Limits(Ny=0.2)
    pilot = usual_pilot(maneuver)
    recipe = replace(RECIPE, maneuver=maneuver, pilot=pilot, specification=limits)
    suggested = suggest_amplitude(recipe, share)
    assert abs(share_at(recipe, suggested.amplitude_deg) - share) < 0.07
    assert abs(suggested.share - share) < 0.02


def test_the_amplitude_is_proportional_to_the_limit_of_a_linear_aircraft():
    half = suggest_amplitude(replace(RECIPE, specification=Limits(Ny=0.25))).amplitude_deg
    assert suggest_amplitude(RECIPE).amplitude_deg / half == pytest.approx(2, rel=0.01)


def test_the_same_seed_suggests_the_same_amplitude_and_the_sign_stays():
    mirrored = replace(RECIPE, maneuver=RECIPE.maneuver.with_peak(-3.0))
    suggested = suggest_amplitude(RECIPE)
    amplitude._remembered.cache_clear()
    assert suggest_amplitude(RECIPE) == suggested
    assert suggest_amplitude(mirrored) == replace(suggested, amplitude_deg=-suggested.amplitude_deg)


def test_an_amplitude_is_found_once_for_monitors_of_one_test(monkeypatch: pytest.MonkeyPatch):
    short = replace(RECIPE, dt=0.25, n_obs=5)
    found = suggest_amplitude(short)
    monkeypatch.setattr(amplitude, "_share", lambda *_: pytest.fail("flown again"))
    assert suggest_amplitude(replace(short, n_unsafe=7, n_obs=3, max_safe=9)) == found


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"specification": Limits(Ny=50.0)}, "0 % of the rollouts exceed a limit even at 45 deg"),
        ({"specification": Limits(Ny=1e-6)}, "100 % of the rollouts exceed a limit even at 0.01"),
        (
            {"aircraft": PublishedAircraft("f16_sl_h0_v502", 3, Uncertainty(0.0))},
            "the aircraft are too similar",
        ),
    ],
)
def test_an_error_names_the_reason_if_no_amplitude_works(changed, message):
    with pytest.raises(AmplitudeError, match=message):
        suggest_amplitude(replace(RECIPE, **changed))


def test_a_table_at_trim_and_a_share_of_one_are_refused():
    level = Table(t_s=(0.0,), delta_a_deg=(0.0,), delta_r_deg=(0.0,))
    with pytest.raises(ValueError, match="stays at trim"):
        suggest_amplitude(replace(RECIPE, maneuver=level))
    with pytest.raises(AmplitudeError, match="between 0 and 1"):
        suggest_amplitude(RECIPE, 1.0)


@pytest.mark.parametrize("peak_deg", [0.5, 60.0])
def test_a_collection_that_cannot_end_suggests_an_amplitude(peak_deg: float):
    recipe = replace(RECIPE, maneuver=RECIPE.maneuver.with_peak(peak_deg), max_rollouts=5000)
    with pytest.raises(CollectionError, match="pilot rollouts exceed") as caught:
        collect(recipe)
    named = re.search(r"At an amplitude of ([\d.]+) deg", str(caught.value))
    assert named
    works = replace(recipe, maneuver=recipe.maneuver.with_peak(float(named[1])))
    assert len(collect(works).unsafe) == recipe.n_unsafe
