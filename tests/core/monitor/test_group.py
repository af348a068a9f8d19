"""Groups of failing flights: membership, calibration and misses per group."""

import numpy as np
import pytest

from core.channels import CHANNELS, KEYS
from core.dataset import Dataset
from core.evaluation.rates import evaluate, evaluate_groups
from core.limits.limits import Limits, Specification
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.file.loading import from_bytes
from core.monitor.group import GROUPINGS, DeflectionRule, FirstLimit, LargestDeflection
from core.types import Array, Indices
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
    groups = FirstLimit().groups(y, fails, Limits(Ny=0.5, p=0.4))
    assert {name: which.tolist() for name, which in groups.items()} == {
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
    groups = LargestDeflection().groups(y, np.full(9, 2), Limits())
    thirds = np.array(list(groups.values()))
    assert thirds.argmax(axis=0).tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert (thirds.sum(axis=0) == 1).all()


def test_deflections_alike_make_no_groups() -> None:
    assert LargestDeflection().groups(np.ones((9, 4, 6)), np.full(9, 2), Limits()) == {}
    assert LargestDeflection().groups(np.ones((0, 4, 6)), np.empty(0, int), Limits()) == {}


def test_each_grouping_splits_the_failing_flights_and_their_misses() -> None:
    rng = np.random.default_rng(2)
    specification = Limits(Ny=0.5, p=0.42)
    dataset = oscillator.collect(rng, n_unsafe=40, specification=specification)
    monitor = train(dataset, MonitorRecipe(epsilon=0.3, t_early=0.5))
    _, y = oscillator.fly(rng, 1500)
    fails = specification.first_exceedance(y)
    whole = evaluate(monitor, y, fails, np.array([0.3]))
    found = evaluate_groups(monitor, y, fails)
    assert set(found) == set(GROUPINGS) - {"pooled"}
    assert whole.misses[0] > 0
    for groups in found.values():
        assert sum(counts.n_unsafe for counts in groups.values()) == whole.n_unsafe
        assert sum(counts.misses[0] for counts in groups.values()) == whole.misses[0]
        assert sum(counts.n_early for counts in groups.values()) == whole.n_early


TWO_LIMITS = Limits(Ny=0.5, beta=0.1)
GROUPED = {
    "first_limit": GROUPINGS["first_limit"],
    "largest_deflection": LargestDeflection(3.3, 3.8),
}


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    rng = np.random.default_rng(3)
    return oscillator.collect(rng, n_unsafe=150, specification=TWO_LIMITS)


@pytest.fixture(scope="module", params=[*GROUPED, "thirds"])
def grouped(request: pytest.FixtureRequest, dataset: Dataset) -> Monitor:
    grouping = GROUPED.get(request.param, LargestDeflection())
    return train(dataset, MonitorRecipe(epsilon=0.2, groups=grouping))


def fresh(seed: int, n: int = 400) -> tuple[Array, Indices]:
    _, y = oscillator.fly(np.random.default_rng(seed), n)
    return y, TWO_LIMITS.first_exceedance(y)


def plain_groups(rule: object, flight: Array) -> list[set[int]]:
    """Reference implementation: the groups still possible after each sample."""
    if not isinstance(rule, DeflectionRule):
        return [{0, 1}] * len(flight)
    possible, peak, back = [], 0.0, False
    for value in np.abs(flight[:, rule.surface]):
        if not back and value >= peak:
            peak = value
        group = int(peak >= rule.low) + int(peak >= rule.high)
        back |= bool(value < peak / 2 and peak >= rule.low / 2) or group == 2
        possible.append({group} if back else set(range(group, 3)))
    return possible


def test_the_risk_is_the_highest_over_the_groups_that_are_possible(grouped: Monitor) -> None:
    groups = grouped.groups
    assert groups is not None
    flights, fails = fresh(4, 40)
    flights[3, 20:23] = np.nan
    flights[4, 15, groups.rule.surface if isinstance(groups.rule, DeflectionRule) else P] = np.nan
    last = np.minimum(fails - grouped.h, flights.shape[1] - 1)
    highest = grouped.highest_p_values(flights[5:], last[5:])
    for k, flight in enumerate(flights):
        batch = grouped.assess(np.arange(len(flight)) * grouped.dt, flight)
        stream = grouped.stream()
        streamed = [stream.update(i * grouped.dt, y) for i, y in enumerate(flight)]
        assert [a.p_value for a in streamed] == batch.columns()["p_value"]
        assert [a.group for a in streamed] == batch.columns()["group"] == [a.group for a in batch]
        for possible, assessment in zip(plain_groups(groups.rule, flight), streamed, strict=True):
            if assessment.score is not None:
                counts = [
                    sum(alpha >= assessment.score for alpha in groups.alphas[g]) for g in possible
                ]
                assert assessment.p_value == (1 + max(counts)) / (groups.n_unsafe + 1)
                assert assessment.group == (
                    groups.rule.names[min(possible)] if len(counts) == 1 else None
                )
        if k >= 5:
            assert highest[k - 5] == np.nanmax([0.0, *batch.p_value[: last[k] + 1]])


def test_each_group_is_calibrated_on_as_many_of_its_own_failures(
    dataset: Dataset, grouped: Monitor
) -> None:
    groups, rule = grouped.groups, grouped.recipe.groups
    assert groups is not None
    pooled = train(dataset, MonitorRecipe(epsilon=0.2))
    assert np.array_equal(grouped.alphas, pooled.alphas)
    assert grouped.n_unsafe == groups.n_unsafe < pooled.n_unsafe
    of = groups.rule.of(dataset.unsafe, dataset.fail_index)
    counts = np.bincount(of)
    if rule == LargestDeflection():
        assert counts.min() >= groups.n_unsafe >= 48
    else:
        assert counts.min() == groups.n_unsafe
    for alphas in groups.alphas:
        assert np.isin(alphas, pooled.alphas).all()


@pytest.mark.parametrize("rule", GROUPED)
def test_each_group_keeps_the_miss_rate_that_pooling_breaks(rule: str) -> None:
    epsilon, flights, n_monitors = 0.2, fresh(8, 3000), 8
    missed = {}
    for grouping in (GROUPINGS["pooled"], GROUPED[rule]):
        rates = []
        for seed in range(n_monitors):
            rng = np.random.default_rng([5, seed])
            own = oscillator.collect(rng, n_unsafe=120, specification=TWO_LIMITS)
            recipe = MonitorRecipe(epsilon=epsilon, groups=grouping)
            groups = evaluate_groups(train(own, recipe), *flights)[rule]
            rates.append([float(counts.miss_rate[0]) for counts in groups.values()])
        missed[grouping] = np.array(rates)
    error = missed[GROUPED[rule]].std(axis=0, ddof=1) / np.sqrt(n_monitors)
    assert (missed[GROUPED[rule]].mean(axis=0) <= epsilon + 3 * error).all()
    assert missed[GROUPINGS["pooled"]].mean(axis=0).max() > epsilon + 0.03


def test_a_grouped_monitor_survives_its_file(grouped: Monitor) -> None:
    loaded, (y, _) = from_bytes(grouped.to_bytes()), fresh(6, 3)
    assert loaded.recipe == grouped.recipe
    assert loaded.n_unsafe == grouped.n_unsafe
    assert loaded.alert_above() == grouped.alert_above()
    for flight in y:
        assert np.array_equal(loaded.p_values(flight), grouped.p_values(flight), equal_nan=True)


def test_too_few_failures_in_a_group_are_refused_with_the_number_needed(
    dataset: Dataset,
) -> None:
    recipe = MonitorRecipe(epsilon=0.015, groups=GROUPINGS["largest_deflection"])
    told = r"needs at least 66 failures in each group; of 150 .* collect about 2\d\d unsafe"
    with pytest.raises(ValueError, match=told):
        train(dataset, recipe)
    alike = MonitorRecipe(groups=LargestDeflection(80.0, 85.0))
    with pytest.raises(ValueError, match=r"0 are in the group 'medium .*change its bounds"):
        train(dataset, alike)
    one_limit = oscillator.collect(np.random.default_rng(1), n_unsafe=12)
    with pytest.raises(ValueError, match="in one group: choose groups pooled"):
        train(one_limit, MonitorRecipe(groups=GROUPINGS["first_limit"]))
    with pytest.raises(ValueError, match="groups need p_value simple"):
        MonitorRecipe(groups=GROUPINGS["first_limit"], p_value="exact")
    with pytest.raises(ValueError, match="give the smaller one as low_deg"):
        LargestDeflection(4.0, 3.0)
