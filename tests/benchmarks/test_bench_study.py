from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from core.evaluation.study import StudyRecipe, study
from core.planned_test.collection import DatasetRecipe
from core.simulation.aircraft import PublishedAircraft, Uncertainty
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import Doublet
from tests.benchmarks.pairs import in_turns
from tests.support import plain_twin as twin

pytestmark = pytest.mark.benchmark


def test_the_whole_study() -> None:
    dataset = DatasetRecipe(
        aircraft=PublishedAircraft("f16_sl_h0_v502", 3, Uncertainty(0.2, "uniform")),
        control_law=CONTROL_LAWS["none"],
        maneuver=Doublet(surface="rudder", amplitude_deg=5.0, pedal_lag_s=0.0),
    )
    recipe = StudyRecipe(dataset=dataset)
    result = study(recipe)
    epsilons = next(iter(result.methods.values())).epsilons
    seeds, plain = count(), {}

    def ours() -> None:
        study(replace(recipe, dataset=replace(dataset, seed=next(seeds))))

    def theirs() -> None:
        plain.update(twin.study(epsilons=epsilons, amplitude_deg=5.0, seed=1)["pointwise"])

    pair = in_turns(ours, theirs, warm=False)
    print(
        f"\nwhole study: {np.median(pair.ours):.3f} s; python-control + scikit-learn "
        f"{np.median(pair.theirs):.1f} s: {pair}"
    )
    for (name, method), (miss, power) in zip(result.methods.items(), plain.values(), strict=False):
        print(
            f"  {name:27} mean power {method.power.mean():.3f} (twin {np.nanmean(power):.3f}), "
            f"mean miss {method.miss_rate.mean():.3f} (twin {np.nanmean(miss):.3f})"
        )
