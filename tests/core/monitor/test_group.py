"""Groups of failing flights: who belongs where, and what is missed of each."""

from dataclasses import replace

import numpy as np
import pytest

from core.channels import CHANNELS, KEYS
from core.evaluation.rates import evaluate, evaluate_groups
from core.monitor import MonitorRecipe, train
from core.monitor.group import GROUPINGS, FirstLimit, LargestDeflection
from core.specification import Limits, Specification
from tests.support import oscillator

NY, P, RUDDER = (KEYS.index(key) for key in ("Ny", "p", "delta_r"))


def name_of(channel: int) -> str:
    return f"{CHANNELS[channel].label} limit first"


def test_the_first_limit_is_the_one_exceeded_at_the_failure_and_farthest_of_several() -> None:
    y = np.zeros((4, 5, 6))
    y[0, 2, NY] = 0.5
    y[1, 3, P], y[1, 4, NY] = -0.4, 9.0
    y[2, 1, NY], y[2, 1, P] = 0.6, 0.9
    y[3, 2, NY] = np.nan
    fails = np.array([2, 3, 1, 2])
    found = FirstLimit().groups(y, fails, Limits(Ny=0.5, p=0.4))
    assert {name: which.tolist() for name, which in found.items()} == {
        name_of(P): [False, True, True, False],
        name_of(NY): [True, False, False, True],
    }


@pytest.mark.parametrize("specification", [Limits(), "abort", None])
def test_one_limit_or_none_makes_no_groups(specification: Specification) -> None:
    y = np.ones((3, 4, 6))
    assert FirstLimit().groups(y, np.array([0, 1, 2]), specification) == {}


def test_thirds_of_the_deflection_count_nothing_behind_the_failure() -> None:
    y = np.zeros((9, 4, 6))
    y[:, 1, RUDDER] = np.deg2rad([-1, 2, 3, -4, 5, 6, 7, -8, 9])
    y[:, 3, RUDDER] = 1.0  # after each failure
    found = LargestDeflection().groups(y, np.full(9, 2), Limits())
    thirds = np.array(list(found.values()))
    assert thirds.argmax(axis=0).tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert (thirds.sum(axis=0) == 1).all()


def test_deflections_alike_make_no_groups() -> None:
    assert LargestDeflection().groups(np.ones((9, 4, 6)), np.full(9, 2), Limits()) == {}
    assert LargestDeflection().groups(np.ones((0, 4, 6)), np.empty(0, int), Limits()) == {}


def test_each_grouping_splits_the_failing_flights_and_their_misses() -> None:
    rng = np.random.default_rng(2)
    specification = Limits(Ny=0.5, p=0.42)
    dataset = replace(oscillator.collect(rng, n_unsafe=40), specification=specification)
    monitor = train(dataset, MonitorRecipe(epsilon=0.3, t_early=0.5))
    _, y = oscillator.fly(rng, 1500)
    fails = specification.first_exceedance(y)
    whole = evaluate(monitor, y, fails, np.array([0.3]))
    found = evaluate_groups(monitor, y, fails)
    assert set(found) == set(GROUPINGS)
    assert whole.misses[0] > 0
    for groups in found.values():
        assert sum(counts.n_unsafe for counts in groups.values()) == whole.n_unsafe
        assert sum(counts.misses[0] for counts in groups.values()) == whole.misses[0]
        assert sum(counts.n_early for counts in groups.values()) == whole.n_early
