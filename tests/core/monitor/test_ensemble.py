"""The usual rule: neighbours and the peak to come, calibrated as one."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from core.dataset import Dataset
from core.evaluation.rates import evaluate, first_alerts
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.calibration import p_values
from core.monitor.ensemble import NeighborsAndPeak, halves, worst_of
from core.monitor.file import portable
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import MonitorFileError
from core.monitor.group import GROUPINGS
from core.monitor.peak_forecast import PeakAhead
from core.monitor.peak_ridge import RidgeForecast
from core.monitor.predictor import PREDICTORS, Ensemble
from core.monitor.recipe import METHODS
from core.monitor.score import SCORES
from core.planned_test.collection import combination_failures
from core.planned_test.planned_test import DatasetRecipe
from core.recipe import from_plain, to_plain
from core.seeds import Branch
from tests.support import oscillator
from tests.support.highest_risk import check_highest_risk, forty_flights
from tests.support.oscillator import DT, N_SAMPLES, TIMES, Array

EPSILON = 0.3


def recipe_of(method: str, **choices) -> MonitorRecipe:
    predictor, score = METHODS[method]
    recipe = MonitorRecipe(epsilon=EPSILON, predictor=predictor, score=score, **choices)
    return recipe.as_planned()


RECIPE = recipe_of("ensemble")
H = 5


@pytest.fixture(scope="module")
def failures() -> tuple[Array, np.ndarray]:
    return forty_flights(41, H)


@pytest.fixture(scope="module")
def monitor(dataset: Dataset, failures: tuple[Array, np.ndarray]) -> Monitor:
    return train(dataset, RECIPE, failures=failures)


@pytest.fixture(scope="module")
def parts(dataset: Dataset) -> tuple[Monitor, Monitor]:
    """Neighbours and peak as separate monitors."""
    return train(dataset, recipe_of("outputs_ahead")), train(dataset, recipe_of("peak_ahead"))


def test_the_risk_is_the_higher_one_of_both_parts_calibrated_on_fresh_failures(
    monitor: Monitor,
    parts: tuple[Monitor, Monitor],
    failures: tuple[Array, np.ndarray],
    flights: Array,
) -> None:
    check_highest_risk(monitor, parts, failures, H, flights[:4])


def test_it_forecasts_the_outputs_of_the_linear_map_and_the_peak_of_its_part(
    monitor: Monitor, parts: tuple[Monitor, Monitor], flights: Array
) -> None:
    np.testing.assert_array_equal(
        monitor.assess(TIMES, flights[0]).y_hat, parts[0].assess(TIMES, flights[0]).y_hat
    )
    stream, alone, shown = monitor.stream(), parts[1].stream(), []
    for t, y in zip(TIMES, flights[0], strict=True):
        assert stream.update(t, y).y_hat is not None
        alone.update(t, y)
        ahead, expected = stream.forecast_ahead(), alone.forecast_ahead()
        assert ahead is not None
        assert expected is not None
        assert vars(ahead) == vars(expected)
        shown.append(ahead)
    assert any(isinstance(ahead, PeakAhead) for ahead in shown)


@pytest.mark.parametrize("defect", ["none", "missing", "late", "repeated", "lost", "moving"])
@pytest.mark.parametrize("which", ["monitor", "near_monitor"])
def test_a_stream_gives_what_a_batch_gives_also_over_gaps(
    which: str, flights: Array, defect: str, request: pytest.FixtureRequest
) -> None:
    monitor: Monitor = request.getfixturevalue(which)
    for y in flights[:3]:
        t, sent = TIMES.copy(), y.copy()
        if defect == "missing":
            sent[20] = np.nan
        if defect == "late":
            t[30:] += 5 * DT
        if defect == "repeated":
            t[25] = t[24]
        if defect == "lost":
            sent[:14] = np.nan
        if defect == "moving":
            sent = sent[20:]
        batch, stream = monitor.assess(t[: len(sent)], sent), monitor.stream()
        for k in range(len(sent)):
            sample, expected = stream.update(t[k], sent[k]), batch[k]
            for name in ("state", "p_value", "alert", "score", "reason"):
                assert getattr(sample, name) == getattr(expected, name), (k, name)
        is_lost = batch.withdrawal is not None
        assert is_lost == (defect in ("lost", "moving"))


def test_neighbours_alone_count_while_the_peak_lacks_a_sample(
    monitor: Monitor, parts: tuple[Monitor, Monitor], flights: Array
) -> None:
    y = flights[0].copy()
    y[20] = np.nan
    alone, both = parts[1].assess(TIMES, y), monitor.assess(TIMES, y)
    near = parts[0].assess(TIMES, y)
    only_near = np.isnan(alone.p_value) & ~np.isnan(near.p_value)
    assert only_near.any()
    np.testing.assert_array_equal(both.score[only_near], -near.p_value[only_near])


def test_a_flight_that_begins_in_the_manoeuvre_gets_no_risk(
    monitor: Monitor, flights: Array
) -> None:
    moving = flights[0, 20:]
    lowest = monitor.lowest_scores(moving[None], np.array([len(moving) - 1]))
    assert lowest.tolist() == [math.inf]


@pytest.mark.parametrize("which", ["monitor", "near_monitor"])
def test_whole_flights_are_judged_as_their_samples_are(
    which: str, flights: Array, request: pytest.FixtureRequest
) -> None:
    monitor: Monitor = request.getfixturevalue(which)
    fails = oscillator.fail_indices(flights)
    first = first_alerts(monitor, flights, fails)
    for y, fail, alert in zip(flights, fails, first, strict=True):
        alerts = monitor.assess(TIMES, y).alert[: fail + 1]
        assert alert == (alerts.argmax() if alerts.any() else N_SAMPLES)


# --- aircraft and hands near the planned ones -----------------------------------------------------


NEAR = replace(RECIPE, predictor=Ensemble(scope="near"))


def failing(seed: int, n: int, gain: float = 1.0) -> tuple[Array, np.ndarray]:
    """The first n failing flights, of outputs that are larger by a factor."""
    y = gain * oscillator.fly(np.random.default_rng(seed), 60 * n)[1]
    fails = oscillator.fail_indices(y)
    chosen = np.flatnonzero(fails < N_SAMPLES)[:n]
    assert len(chosen) == n
    return y[chosen], fails[chosen]


@pytest.fixture(scope="module")
def populations() -> list[tuple[Array, np.ndarray]]:
    """Failing flights that calibrate, and those of another population."""
    return [failing(47, 30), failing(48, 30, 1.3)]


@pytest.fixture(scope="module")
def near_monitor(dataset: Dataset, populations: list[tuple[Array, np.ndarray]]) -> Monitor:
    return train(dataset, NEAR, failures=populations[0], near=populations[1:])


def test_the_worst_of_populations_gives_the_largest_p_value_of_each_score() -> None:
    rng = np.random.default_rng(49)
    populations = [rng.integers(-5, 5, 20).astype(float) for _ in range(3)]
    populations[1][:3] = np.inf
    scores = np.linspace(-6, 6, 25)
    largest = np.max([p_values(scores, np.sort(each)) for each in populations], axis=0)
    np.testing.assert_array_equal(p_values(scores, worst_of(populations)), largest)


def test_the_peak_of_the_next_samples_is_a_third_part(
    near_monitor: Monitor, parts: tuple[Monitor, Monitor], dataset: Dataset, flights: Array
) -> None:
    score = SCORES["card_window"]
    window = train(dataset, replace(RECIPE, predictor=PREDICTORS["peak_ridge"], score=score))
    for y in flights[:4]:
        each = [monitor.assess(TIMES, y).p_value for monitor in (*parts, window)]
        np.testing.assert_array_equal(near_monitor.assess(TIMES, y).score, -np.fmax.reduce(each))


def test_the_promise_of_a_near_scope_is_that_of_the_worst_population(
    near_monitor: Monitor, populations: list[tuple[Array, np.ndarray]], dataset: Dataset
) -> None:
    alphas = [
        np.sort(near_monitor.lowest_scores(y, fails - near_monitor.h)) for y, fails in populations
    ]
    np.testing.assert_array_equal(near_monitor.alphas, np.maximum(*alphas))
    assert not (alphas[0] == alphas[1]).all()


def test_a_near_scope_needs_as_many_failing_flights_of_each_population(
    dataset: Dataset, populations: list[tuple[Array, np.ndarray]]
) -> None:
    own, (y, fails) = populations
    with pytest.raises(ValueError, match="choose scope planned"):
        train(dataset, NEAR, failures=own)
    with pytest.raises(ValueError, match="29 failing flights among 29: give 30"):
        train(dataset, NEAR, failures=own, near=[(y[1:], fails[1:])])
    late = np.where(np.arange(30) == 0, N_SAMPLES, fails)
    with pytest.raises(ValueError, match="29 failing flights among 30: give 30"):
        train(dataset, NEAR, failures=own, near=[(y, late)])
    with pytest.raises(ValueError, match="groups need the scope planned"):
        replace(NEAR, groups=GROUPINGS["largest_deflection"])
    assert NEAR.as_planned() == RECIPE


def test_a_recipe_of_before_scopes_is_of_the_planned_aircraft(monitor: Monitor) -> None:
    plain = to_plain(RECIPE)
    del plain["predictor"]["scope"]
    assert from_plain(MonitorRecipe(), plain) == RECIPE
    assert monitor.forecast is not None
    assert monitor.forecast.to_section().version == 1


# --- failures ------------------------------------------------------------------------------------


def test_without_fresh_failures_half_of_them_trains_and_half_calibrates(dataset: Dataset) -> None:
    training, calibrating = halves(len(dataset.unsafe))
    assert sorted([*training, *calibrating]) == list(range(len(dataset.unsafe)))
    assert len(training) == len(calibrating)
    halved = train(dataset, RECIPE)
    some = replace(
        dataset, unsafe=dataset.unsafe[training], fail_index=dataset.fail_index[training]
    )
    fresh = dataset.unsafe[calibrating], dataset.fail_index[calibrating]
    same = train(some, RECIPE, failures=fresh)
    np.testing.assert_array_equal(halved.alphas, same.alphas)
    np.testing.assert_array_equal(halved.unsafe_points, same.unsafe_points)
    assert set(halved.unsafe_where[:, 0]) == set(training)
    assert halved.dataset_digest == dataset.digest()


def test_a_specification_known_by_its_label_is_learned_from_the_training_failures(
    flights: Array,
) -> None:
    data = oscillator.collect(np.random.default_rng(45), n_unsafe=30)
    y = oscillator.fly(np.random.default_rng(46), 200)[1]
    failures = y, oscillator.fail_indices(y)
    monitor = train(replace(data, specification="departure"), RECIPE, failures=failures)
    fresh = evaluate(monitor, flights, oscillator.fail_indices(flights), np.array([EPSILON]))
    assert fresh.misses[0] <= fresh.n_unsafe / 2
    assert fresh.power[0] > 0.5


def test_failures_of_another_shape_or_none_are_refused(
    dataset: Dataset, failures: tuple[Array, np.ndarray]
) -> None:
    y, fails = failures
    with pytest.raises(ValueError, match="roll out the same manoeuvre"):
        train(dataset, RECIPE, failures=(y[:, 1:], fails))
    with pytest.raises(ValueError, match="give failing flights"):
        train(dataset, RECIPE, failures=(y, np.full(len(y), N_SAMPLES)))
    one = replace(dataset, unsafe=dataset.unsafe[:1], fail_index=dataset.fail_index[:1])
    with pytest.raises(ValueError, match="needs 2 or more"):
        train(one, RECIPE)


def test_each_group_gets_enough_fresh_failures_and_its_own_threshold() -> None:
    grouping = GROUPINGS["largest_deflection"]
    test = replace(DatasetRecipe(n_unsafe=12, groups=grouping, seed=5).as_flown())
    fresh, made = combination_failures(test, 12, branch=Branch.ENSEMBLE)
    assert len(fresh.y) < made
    fitted = grouping.fit(fresh.y, fresh.fail_index, test.specification)
    assert fitted is not None
    assert min(np.count_nonzero(fitted[1] == group) for group in range(3)) == 12


def test_a_monitor_by_groups_is_calibrated_on_the_fresh_failures(dataset: Dataset) -> None:
    y = oscillator.fly(np.random.default_rng(43), 400)[1]
    fails = oscillator.fail_indices(y)
    groups = GROUPINGS["largest_deflection"]
    grouped = train(dataset, replace(RECIPE, groups=groups), failures=(y, fails))
    assert grouped.groups is not None
    failing = fails < N_SAMPLES
    assert len(grouped.alphas) == failing.sum()
    fitted = groups.fit(y[failing], fails[failing], dataset.specification)
    assert fitted is not None
    assert grouped.groups.rule == fitted[0]
    batch, stream = grouped.assess(TIMES, y[0]), grouped.stream()
    for t, sample, p in zip(TIMES, y[0], batch.p_value, strict=True):
        assert stream.update(t, sample).p_value == p


def test_the_promise_is_kept_over_many_monitors() -> None:
    epsilon, n, missed = 0.2, 24, []
    for seed in range(n):
        rng = np.random.default_rng([44, seed])
        data = oscillator.collect(rng, n_unsafe=15)
        y = oscillator.fly(rng, 150)[1]
        monitor = train(data, RECIPE, failures=(y, oscillator.fail_indices(y)))
        y = oscillator.fly(rng, 300)[1]
        found = evaluate(monitor, y, oscillator.fail_indices(y), np.array([epsilon]))
        missed.append(found.miss_rate[0])
    error = np.std(missed, ddof=1) / math.sqrt(n)
    assert np.mean(missed) <= epsilon + 3 * error
    assert np.mean(missed) > epsilon / 4


# --- the file ------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ["monitor", "near_monitor"])
def test_its_file_gives_the_same_monitor_back(
    which: str, flights: Array, request: pytest.FixtureRequest
) -> None:
    monitor: Monitor = request.getfixturevalue(which)
    twin = from_bytes(monitor.to_bytes())
    assert twin.recipe == monitor.recipe
    assert twin.to_bytes() == monitor.to_bytes()
    assert isinstance(twin.forecast, NeighborsAndPeak)
    assert isinstance(twin.forecast.peak, RidgeForecast)
    for name in ("p_value", "score", "y_hat", "nearest_safe", "nearest_unsafe"):
        told, again = (getattr(m.assess(TIMES, flights[0]), name) for m in (monitor, twin))
        np.testing.assert_array_equal(told, again)
    last = np.full(len(flights), 30)
    np.testing.assert_array_equal(
        monitor.lowest_scores(flights, last), twin.lowest_scores(flights, last)
    )


@pytest.mark.parametrize("name", ["neighbor_alphas", "peak_alphas", "window_alphas"])
def test_calibration_scores_of_a_part_that_are_not_sorted_are_refused(
    near_monitor: Monitor, name: str
) -> None:
    monitor = near_monitor
    assert monitor.forecast is not None
    whole = monitor.forecast.to_section()
    others = [section for section in monitor._sections() if section.name != "ensemble"]
    for wrong in (whole.arrays[name][::-1].copy(), np.empty(0), np.full(3, np.nan)):
        section = whole._replace(arrays={**whole.arrays, name: wrong})
        with pytest.raises(MonitorFileError, match=f"ensemble {name}"):
            from_bytes(portable.pack([*others, section]))
    with pytest.raises(MonitorFileError, match="section ensemble do not match"):
        from_bytes(portable.pack(others))


def test_its_predictor_and_score_go_together_only() -> None:
    for predictor, score in product(PREDICTORS, SCORES):
        if (predictor == "ensemble") != (score == "highest_risk"):
            choice = {"predictor": PREDICTORS[predictor], "score": SCORES[score]}
            if "ensemble" in predictor or score == "highest_risk":
                with pytest.raises(ValueError, match="go with the score highest_risk"):
                    MonitorRecipe(**choice)
