from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest

from core.collection import DatasetRecipe
from core.simulation.aircraft import PublishedAircraft, Uncertainty
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import Doublet
from core.study import StudyRecipe, study
from tests.support import plain_twin as twin

pytestmark = pytest.mark.benchmark


def test_the_whole_study() -> None:
    dataset = DatasetRecipe(
        aircraft=PublishedAircraft("f16_sl_h0_v502", 3, Uncertainty(0.2, "uniform")),
        control_law=CONTROL_LAWS["none"],
        maneuver=Doublet(surface="rudder", amplitude_deg=5.0, pedal_lag_s=0.0),
    )
    recipe = StudyRecipe(dataset=dataset)
    result, ours = study(recipe), []
    for seed in range(5):
        begin = perf_counter()
        result = study(replace(recipe, dataset=replace(dataset, seed=seed)))
        ours.append(perf_counter() - begin)
    epsilons = next(iter(result.methods.values())).epsilons
    begin = perf_counter()
    plain = twin.study(epsilons=epsilons, amplitude_deg=5.0, seed=1)
    theirs = perf_counter() - begin
    print(
        f"\nwhole study: {np.median(ours):.3f} s; python-control + scikit-learn {theirs:.1f} s: "
        f"ratio {theirs / np.median(ours):.0f} x"
    )
    for (name, method), (miss, power) in zip(result.methods.items(), plain.values(), strict=True):
        print(
            f"  {name:27} mean power {method.power.mean():.3f} (twin {np.nanmean(power):.3f}), "
            f"mean miss {method.miss_rate.mean():.3f} (twin {np.nanmean(miss):.3f})"
        )
