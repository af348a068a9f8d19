"""Which method warns best: each is tried on flights that chose nothing else."""

import numpy as np

from core.evaluation.method_choice import OF_THE_CARD, try_methods
from core.monitor import MonitorRecipe
from core.monitor.group import GROUPINGS
from core.monitor.recipe import METHODS
from tests.support import oscillator


def test_methods_are_tried_by_groups_too() -> None:
    whole = oscillator.collect(np.random.default_rng(51), n_unsafe=80).flights()
    learning, trying = whole.split((0.5, 0.5), 0)
    recipe = MonitorRecipe(epsilon=0.3, groups=GROUPINGS["largest_deflection"])
    dataset = oscillator.collect(np.random.default_rng(52), n_unsafe=60)
    tried = try_methods(dataset, trying, recipe, (learning.y, learning.fail_index))
    assert tried.keys() == METHODS.keys() - {OF_THE_CARD}
    assert all(not monitor.recipe.is_near for monitor, _ in tried.values())
