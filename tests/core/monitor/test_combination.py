"""A combination: one rule of several monitors, calibrated as it is flown."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from core.dataset import Dataset
from core.evaluation.rates import evaluate, first_alerts
from core.limits.limits import Limits
from core.monitor import Monitor, MonitorRecipe, combine, train
from core.monitor.combination import Combined
from core.monitor.file import portable
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import MonitorFileError
from core.monitor.peak_forecast import PeakAhead
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from tests.support import oscillator
from tests.support.highest_risk import check_highest_risk, forty_flights
from tests.support.oscillator import DT, N_SAMPLES, TIMES, Array

RECIPES = (
    MonitorRecipe(t_early=0.25),
    MonitorRecipe(t_early=0.5, p_value="exact"),
    MonitorRecipe(t_early=0.5, predictor=PREDICTORS["peak_ridge"], score=SCORES["card_window"]),
)
LEAD = 0.5
H = 10


@pytest.fixture(scope="module")
def members(dataset: Dataset) -> tuple[Monitor, ...]:
    limited = replace(dataset, specification=Limits(Ny=0.5))
    return tuple(train(limited, recipe) for recipe in RECIPES)


@pytest.fixture(scope="module")
def failures() -> tuple[Array, np.ndarray]:
    return forty_flights(21, H)


@pytest.fixture(scope="module")
def combination(members: tuple[Monitor, ...], failures: tuple[Array, np.ndarray]) -> Monitor:
    return combine(members, failures, lead=LEAD, epsilon=0.3)


def test_scores_and_risks_are_those_of_a_plain_loop(
    members: tuple[Monitor, ...],
    failures: tuple[Array, np.ndarray],
    combination: Monitor,
    flights: Array,
) -> None:
    check_highest_risk(combination, members, failures, H, flights[:4])


def test_a_stream_says_what_a_batch_says_also_over_gaps(
    combination: Monitor, flights: Array
) -> None:
    for y, defect in product(flights[:2], ("none", "missing", "late", "repeated", "lost")):
        t, sent = TIMES.copy(), y.copy()
        if defect == "missing":
            sent[20] = np.nan
        if defect == "late":
            t[30:] += 5 * DT
        if defect == "repeated":
            t[25] = t[24]
        if defect == "lost":
            sent[:14] = np.nan
        assert_batch_is_streamed(combination, t, sent)


def assert_batch_is_streamed(combination: Monitor, t: Array, y: Array) -> None:
    batch, stream = combination.assess(t, y), combination.stream()
    for k in range(len(t)):
        said, expected = stream.update(t[k], y[k]), batch[k]
        for name in ("state", "p_value", "alert", "score", "reason", "y_hat"):
            assert getattr(said, name) == getattr(expected, name), (k, name)


def test_a_member_that_is_lost_withdraws_the_combination(
    dataset: Dataset, failures: tuple[Array, np.ndarray], flights: Array
) -> None:
    limited = replace(dataset, specification=Limits(Ny=0.5))
    pair = train(limited, RECIPES[1]), train(limited, RECIPES[2])
    rule = combine(pair, failures, lead=LEAD, epsilon=0.3)
    moving = flights[0, 20:]
    alone = pair[1].assess(TIMES[: len(moving)], moving)
    told = rule.assess(TIMES[: len(moving)], moving)
    assert alone.withdrawal is not None
    assert "had begun before" in alone.withdrawal.reason  # no sample is missing
    assert told.withdrawal == alone.withdrawal
    assert_batch_is_streamed(rule, TIMES[: len(moving)], moving)
    lowest = rule.lowest_scores(moving[None], np.array([len(moving) - 1]))
    assert lowest.tolist() == [math.inf]


def test_whole_flights_are_judged_as_their_samples_are(
    combination: Monitor, flights: Array
) -> None:
    fails = oscillator.fail_indices(flights)
    first = first_alerts(combination, flights, fails)
    for y, fail, alert in zip(flights, fails, first, strict=True):
        alerts = combination.assess(TIMES, y).alert[: fail + 1]
        assert alert == (alerts.argmax() if alerts.any() else N_SAMPLES)


def test_it_shows_the_forecast_of_the_member_that_has_one(
    dataset: Dataset, failures: tuple[Array, np.ndarray], flights: Array
) -> None:
    limited = replace(dataset, specification=Limits(Ny=0.5))
    rest = replace(RECIPES[2], score=SCORES["rest_of_card"])
    pair = train(limited, RECIPES[1]), train(limited, rest)
    rule = from_bytes(combine(pair, failures, lead=LEAD, epsilon=0.3).to_bytes())
    assert rule.forecast is not None
    assert rule.forecast.no_forecast_reason == ""
    told, alone, shown = rule.stream(), pair[1].stream(), []
    for t, y in zip(TIMES, flights[0], strict=True):
        told.update(t, y)
        alone.update(t, y)
        ahead, expected = told.forecast_ahead(), alone.forecast_ahead()
        assert type(ahead) is type(expected)
        assert ahead is None or vars(ahead) == vars(expected)
        shown.append(ahead)
    assert any(isinstance(ahead, PeakAhead) for ahead in shown)


def test_without_such_a_member_it_says_why_it_shows_none(combination: Monitor) -> None:
    assert combination.forecast is not None
    assert "members show no forecast" in combination.forecast.no_forecast_reason
    assert combination.forecast.start(DT).ahead() is None


def test_its_file_gives_the_same_monitor_back(combination: Monitor, flights: Array) -> None:
    twin = from_bytes(combination.to_bytes())
    assert twin.recipe == combination.recipe
    assert twin.to_bytes() == combination.to_bytes()
    for name in ("p_value", "score", "nearest_safe", "nearest_unsafe"):
        told, again = (getattr(m.assess(TIMES, flights[0]), name) for m in (combination, twin))
        np.testing.assert_array_equal(told, again)


def test_a_file_with_a_member_that_is_none_is_refused_by_its_number(combination: Monitor) -> None:
    rule = combination.forecast
    assert isinstance(rule, Combined)
    whole = rule.to_section()
    own = combination.to_bytes()

    def refusal(**changed: np.ndarray) -> str:
        sections = [s for s in combination._sections() if s.name != "members"]
        other = whole._replace(arrays={**whole.arrays, **changed})
        with pytest.raises(MonitorFileError) as error:
            from_bytes(portable.pack([*sections, other]), "sent.fwm")
        return str(error.value)

    cut = whole.arrays["2"][:-3]
    assert "member 2 is cut off" in refusal(**{"2": cut})
    assert "member 2 is uint8 (1," in refusal(**{"2": cut[None]})
    assert "member 3 is itself a combination" in refusal(**{"3": np.frombuffer(own, np.uint8)})
    assert "n_members is 3" in refusal(**{"4": cut})
    short = np.frombuffer(rule.members[0].to_bytes(), np.uint8)
    assert "choose a member's lead" in refusal(**{"2": short, "3": short})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m[:1], "1 monitors were given"),
        (lambda m: (m[0], m[0]), "choose a member's lead"),
        (lambda m: (m[0], replace(m[1], specification=Limits(Ny=0.6))), "in limits"),
        (lambda m: (m[0], replace(m[1], dataset_recipe={})), "in planned test"),
        (lambda m: (replace(m[0], dt=0.1, h=5), m[1]), "in sample interval"),
    ],
)
def test_members_that_do_not_go_together_are_refused(members, failures, change, words) -> None:
    with pytest.raises(ValueError, match=words):
        combine(change(members), failures, lead=LEAD)


def test_members_of_another_history_and_a_combination_are_refused(
    dataset: Dataset, members: tuple[Monitor, ...], combination: Monitor, failures
) -> None:
    limited = replace(dataset, specification=Limits(Ny=0.5))
    other = train(limited, MonitorRecipe(t_early=0.5, n_delay=0))
    with pytest.raises(ValueError, match="number of past outputs"):
        combine((members[1], other), failures, lead=LEAD)
    with pytest.raises(ValueError, match="member 2 was given before"):
        combine((members[1], members[1]), failures, lead=LEAD)
    with pytest.raises(ValueError, match="member 2 is a combination"):
        combine((members[1], combination), failures, lead=LEAD)
    with pytest.raises(ValueError, match="needs at least"):
        combine(members, failures, lead=LEAD, epsilon=0.01)
    with pytest.raises(ValueError, match="forewarn combine"):
        train(limited, combination.recipe)


def test_the_promise_is_kept_where_any_alert_of_any_member_breaks_no_count() -> None:
    """Over many combinations the mean miss rate is at most epsilon; the plain union alerts more."""
    epsilon, n, missed, of_union, false = 0.2, 24, [], [], []
    for seed in range(n):
        rng = np.random.default_rng([31, seed])
        data = oscillator.collect(rng, n_unsafe=15)
        members = [train(data, MonitorRecipe(t_early=lead)) for lead in (0.1, 0.2, 0.3)]
        y = oscillator.fly(rng, 150)[1]
        rule = combine(members, (y, oscillator.fail_indices(y)), lead=0.2, epsilon=epsilon)
        y = oscillator.fly(rng, 200)[1]
        fails = oscillator.fail_indices(y)
        found = evaluate(rule, y, fails, np.array([epsilon]))
        missed.append(found.miss_rate[0])
        false.append(1 - found.power[0])
        last = np.where(fails < N_SAMPLES, fails - rule.h, N_SAMPLES - 1)
        union = np.max([m.highest_p_values(y, last) for m in members], axis=0) > epsilon
        of_union.append(1 - union[fails < N_SAMPLES].mean())
    error = np.std(missed, ddof=1) / math.sqrt(n)
    assert np.mean(missed) <= epsilon + 3 * error
    assert abs(np.mean(of_union) - np.mean(missed)) > 3 * error
