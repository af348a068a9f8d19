"""Evaluation: intervals against scipy and simulation, counts by hand and against the twin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from core.dataset import Dataset
from core.evaluation.rates import (
    EPSILONS,
    Evaluation,
    clopper_pearson,
    clustered_interval,
    evaluate,
    first_alerts,
    leads,
)
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from tests.support import oscillator
from tests.support import plain_twin as twin
from tests.support.oscillator import DT, N_SAMPLES, Array, Indices

# --- intervals -----------------------------------------------------------------------------------


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.999])
@pytest.mark.parametrize("n", [1, 2, 17, 500])
def test_clopper_pearson_equals_scipy(n: int, confidence: float) -> None:
    k = np.unique(np.linspace(0, n, 12).astype(int))
    bounds = clopper_pearson(k, n, confidence)
    for successes, interval in zip(k.tolist(), bounds, strict=True):
        expected = stats.binomtest(successes, n).proportion_ci(confidence, "exact")
        np.testing.assert_allclose(interval, expected, rtol=1e-9, atol=1e-14)


def test_fifty_misses_in_five_hundred_are_between_075_and_130() -> None:
    assert clopper_pearson(50, 500) == pytest.approx([0.075, 0.130], abs=5e-4)


def test_no_miss_in_59_certifies_five_per_cent() -> None:
    """One-sided at 95 %: the upper end of the two-sided 90 % interval."""
    assert clopper_pearson(0, 59, 0.90)[1] <= 0.05 < clopper_pearson(0, 58, 0.90)[1]


def test_no_trial_gives_the_whole_interval() -> None:
    assert clopper_pearson([0, 0], [0, 3])[0].tolist() == [0, 1]
    assert clustered_interval(np.zeros((3, 1)), np.zeros((3, 1))).tolist() == [[0, 1]]


def test_clustered_interval_of_one_cluster_is_clopper_pearson() -> None:
    successes, trials = np.array([[0, 3, 20]]), np.array([[20]])
    assert (clustered_interval(successes, trials) == clopper_pearson([0, 3, 20], 20)).all()


def test_a_clustered_interval_widens_with_scatter() -> None:
    trials = np.full(5, 40)
    even, some, much = (
        clustered_interval(np.array(k), trials)
        for k in ([4, 4, 4, 4, 4], [1, 3, 4, 5, 7], [0, 0, 4, 2, 14])
    )
    pooled = clopper_pearson(20, 200)
    assert even[0] <= pooled[0]
    assert pooled[1] <= even[1]
    assert some[1] - some[0] <= much[1] - much[0]
    assert much[0] < pooled[0]
    assert pooled[1] < much[1]


def test_clustered_interval_has_the_effective_size_of_korn_and_graubard() -> None:
    """Written out for clusters of one size: variance of the mean, t quantiles."""
    shares, n = np.array([0, 2, 4, 12, 2]) / 40, 200
    mean, variance = shares.mean(), shares.var(ddof=1) / 5
    t = stats.t(n - 1).ppf(0.975) / stats.t(4).ppf(0.975)
    size = mean * (1 - mean) / variance * t**2
    assert size < n
    expected = clopper_pearson(mean * size, size)
    np.testing.assert_allclose(clustered_interval(40 * shares, np.full(5, 40)), expected)


def test_a_clustered_interval_works_column_by_column() -> None:
    successes, trials = np.array([[1, 4], [3, 9], [4, 30]]), np.array([[40], [35], [50]])
    columns = [clustered_interval(k, trials[:, 0]) for k in successes.T]
    assert (clustered_interval(successes, trials) == columns).all()


@pytest.mark.parametrize(("n_clusters", "trials"), [(10, 125), (20, 60), (5, 100)])
def test_a_clustered_interval_covers_if_clopper_pearson_does_not(
    n_clusters: int, trials: int
) -> None:
    """Monitors of 50 failures at epsilon 0.1: miss rates scatter as Beta(5, 46), mean 5/51.

    2000 repetitions: a standard error of 0.005 on the nominal 0.95.
    """
    rng = np.random.default_rng(5)
    rates = rng.beta(5, 46, size=(n_clusters, 2000))
    misses, truth = rng.binomial(trials, rates), 5 / 51

    def coverage(bounds: Array) -> float:
        return float(np.mean((bounds[:, 0] <= truth) & (truth <= bounds[:, 1])))

    assert coverage(clustered_interval(misses, np.full((n_clusters, 1), trials))) >= 0.93
    assert coverage(clopper_pearson(misses.sum(axis=0), n_clusters * trials)) < 0.90


# --- counts --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def by_hand() -> Monitor:
    """Alerts at 0.25 <= |N_y|, at any epsilon from 0.1 up to 0.9: nine like failures, h = 2."""
    unsafe, safe = np.zeros((9, 8, 6)), np.zeros((2, 8, 6))
    unsafe[:, 3:5, 3], unsafe[:, 5, 3], unsafe[:, 6:] = 0.25, 0.5, np.nan
    dataset = Dataset(
        unsafe=unsafe,
        fail_index=np.full(9, 5),
        safe=safe,
        safe_times=np.tile(np.arange(8), (2, 1)),
        theta_unsafe=np.empty((9, 0)),
        theta_safe=np.empty((2, 0)),
        dt=0.1,
    )
    recipe = MonitorRecipe(
        t_early=0.2,
        predictor=PREDICTORS["last_output"],
        score=SCORES["negative_magnitude"],
        scaling="raw",
    )
    return train(dataset, recipe)


def flights_by_hand() -> tuple[Array, Indices]:
    """(7, 8, 6) with failures at 5, 5, 5, 1 and three safe ones."""
    y = np.zeros((7, 8, 6))
    y[0, 3, 3] = 0.3  # alert two samples before: in time
    y[1, 4, 3] = -0.3  # one sample before: too late
    y[3, 0, 3] = 0.3  # fails at sample 1: no alert could be in time
    y[[0, 1, 2], 5, 3] = y[3, 1, 3] = 0.6
    y[4, 7, 3] = 0.25  # in vain, at the very end and at the very threshold
    y[5, :, 3] = 0.2499
    return y, np.array([5, 5, 5, 1, 8, 8, 8])


def test_only_timely_alerts_count(by_hand: Monitor) -> None:
    result = evaluate(by_hand, *flights_by_hand(), np.array([0.1, 0.5]))
    assert (result.n_unsafe, result.n_safe, result.n_early) == (4, 3, 1)
    assert result.misses.tolist() == [3, 3]
    assert result.false_alerts.tolist() == [1, 1]
    assert result.miss_rate.tolist() == [0.75, 0.75]
    assert result.power == pytest.approx([2 / 3, 2 / 3])
    assert result.fail_given_alert.tolist() == [0.5, 0.5]


def test_a_withdrawal_counts_only_in_time(by_hand: Monitor, monkeypatch) -> None:
    """Failures at 5 with h = 2: withdrawn at 3 is in time, at 4 it is too late."""
    y, fail = np.zeros((3, 8, 6)), np.array([5, 5, 5])
    withdrawn_at = np.array([3, 4, 8])
    monkeypatch.setattr(Monitor, "first_withdrawn", lambda self, y, fail: withdrawn_at)
    result = evaluate(by_hand, y, fail, np.array([0.1]))
    assert (result.misses.tolist(), result.withdrawn.tolist()) == ([2], [1])


def test_every_aircraft_weighs_the_same(by_hand: Monitor) -> None:
    y, fail = flights_by_hand()
    aircraft = np.array([7, 7, 3, 7, 3, 5, 5])  # 2 of 3 and 1 of 1 missed; the last never fails
    result = evaluate(by_hand, y, fail, np.array([0.1, 0.5]), aircraft)
    assert result.failures_of is not None
    assert result.misses_of is not None
    assert result.failures_of.tolist() == [1, 3]
    assert result.misses_of.tolist() == [[1, 1], [2, 2]]
    assert result.miss_rate == pytest.approx([5 / 6, 5 / 6])
    withdrawn = np.array([[0, 0], [1, 0]])  # counted as the misses are, so shares add up to 1
    assert replace(result, withdrawn_of=withdrawn).withdrawn_rate == pytest.approx([1 / 6, 0.0])
    shares = np.array([[1.0], [2 / 3]])
    each = clustered_interval(2 * shares, np.full((2, 1), 2.0))
    np.testing.assert_allclose(result.miss_interval, np.repeat(each, 2, axis=0))


def test_an_alert_at_the_first_sample_is_in_time_for_a_failure_at_h(by_hand: Monitor) -> None:
    y = np.zeros((1, 8, 6))
    y[0, 0, 3] = 0.3
    result = evaluate(by_hand, y, np.array([by_hand.h]), np.array([0.1]))
    assert (result.n_early, result.misses.tolist()) == (0, [0])


def test_leads_run_from_the_first_alert_to_the_failure(by_hand: Monitor) -> None:
    y, fail = flights_by_hand()
    result = leads(first_alerts(by_hand, y, fail, 0.1), fail, 8, 0.1)
    assert result / 0.1 * by_hand.dt == pytest.approx([0.2, 0.1, 0.0, 0.1], abs=1e-12)
    y[:, 5, 3] = 0.2
    alerts = first_alerts(by_hand, y[2:3], fail[2:3], 0.1)
    assert alerts.tolist() == [8]
    assert leads(alerts, fail[2:3], 8, 0.1).tolist() == [-np.inf]


def test_each_rate_has_its_interval() -> None:
    result = Evaluation(
        epsilons=np.array([0.1, 0.2]),
        n_unsafe=500,
        n_safe=400,
        n_early=0,
        misses=np.array([50, 500]),
        false_alerts=np.array([40, 0]),
        withdrawn=np.array([0, 0]),
        safe_withdrawn=np.array([60, 0]),
    )
    assert (result.miss_interval == clopper_pearson([50, 500], 500)).all()
    assert (result.power_interval == clopper_pearson([300, 400], 400)).all()
    assert result.false_alarm_rate.tolist() == [0.1, 0.0]
    assert result.power.tolist() == [0.75, 1.0]
    assert (result.quiet + result.safe_withdrawn + result.false_alerts == 400).all()
    assert (result.fail_given_alert_interval == clopper_pearson([450, 0], [490, 0])).all()
    assert result.fail_given_alert[0] == 450 / 490
    assert np.isnan(result.fail_given_alert[1])


@pytest.mark.parametrize("p_value", ["simple", "exact"])
@pytest.mark.parametrize("calibration", ["pointwise", "trajectory"])
def test_evaluation_equals_the_plain_twin(calibration: str, p_value: str, dataset: Dataset) -> None:
    monitor = train(dataset, MonitorRecipe(calibration=calibration, p_value=p_value))  # pyright: ignore
    y = oscillator.fly(np.random.default_rng(21), 300)[1]
    fail = oscillator.fail_indices(y)
    fail[np.flatnonzero(fail < N_SAMPLES)[0]] = 3
    result = evaluate(monitor, y, fail)
    assert result.epsilons.tolist() == EPSILONS[EPSILONS >= 1 / 13].tolist()
    p = [monitor.p_values(flight) for flight in y]
    miss, power = twin.evaluate(p, fail.tolist(), monitor.h, result.epsilons)
    np.testing.assert_allclose(result.miss_rate, miss, rtol=1e-12)
    np.testing.assert_allclose(result.power, power, rtol=1e-12)
    assert result.n_early == 1
    assert result.miss_rate[0] < result.miss_rate[-1]


def test_evaluation_at_an_epsilon_out_of_reach_is_refused(dataset: Dataset) -> None:
    y = np.zeros((1, N_SAMPLES, 6))
    with pytest.raises(ValueError, match=r"epsilon=0\.02 needs at least 49 unsafe rollouts"):
        evaluate(train(dataset), y, np.array([N_SAMPLES]), np.array([0.02, 0.5]))


def test_leads_are_whole_samples_of_failing_flights_only(dataset: Dataset) -> None:
    monitor = train(dataset)
    alerts = first_alerts(monitor, dataset.unsafe, dataset.fail_index)
    times = leads(alerts, dataset.fail_index, N_SAMPLES, monitor.dt)
    assert times.shape == (12,)
    timely = times >= monitor.lead - 1e-9
    result = evaluate(monitor, dataset.unsafe, dataset.fail_index, np.array([0.1]))
    assert (~timely).sum() == result.misses[0]
    np.testing.assert_allclose(times / DT, np.round(times / DT), atol=1e-9)


@pytest.mark.parametrize("p_value", ["simple", "exact"])
def test_the_first_alert_equals_that_of_the_stream(p_value: str, dataset: Dataset) -> None:
    monitor = train(dataset, MonitorRecipe(p_value=p_value))  # pyright: ignore
    y = oscillator.fly(np.random.default_rng(22), 60)[1]
    fail = oscillator.fail_indices(y)
    result = first_alerts(monitor, y, fail, 0.2)
    for i, end in enumerate(fail.tolist()):
        alerts = monitor.p_values(y[i, : end + 1]) > monitor.alert_above(0.2)
        assert result[i] == (alerts.argmax() if alerts.any() else N_SAMPLES)
    assert 0 < (result < N_SAMPLES).sum() < len(y)
