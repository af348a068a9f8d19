"""The certificate of a monitor, with warnings only where they apply."""

from typing import Any

import pytest

from core.evaluation import IN_WORDS, THRESHOLD
from core.evaluation.certificate import (
    UNTESTED,
    certificate,
    warnings_of,
    with_power_of_quiet,
)
from core.evaluation.rates import clopper_pearson


def evaluation(misses: int, false_alerts: int, n: int = 500, **more: Any) -> dict[str, Any]:
    """As stored with a monitor: 500 failing and 500 safe flights, tested at 0.1."""
    counts = {"misses": misses, "false_alerts": false_alerts, "withdrawn": 0}
    curves = {"epsilon": [0.05, 0.1, 0.2], "misses": [4, 0, 19], "false_alerts": [50, 0, 10]}
    return {
        "epsilon": 0.1, "n_unsafe": n, "n_safe": n, "at_epsilon": counts, "curves": curves,
    } | more  # fmt: skip


def test_an_untested_monitor_has_a_warning() -> None:
    assert certificate(None, 0.1) is None
    assert warnings_of(None, 0.1) == [UNTESTED]


def test_the_certificate_uses_the_nearest_tested_epsilon() -> None:
    tested = certificate(evaluation(9, 20, n=100), 0.06)
    assert tested is not None
    assert tested.missed is not None
    assert (tested.epsilon, tested.missed.count) == (0.05, 4)
    assert tested.fail_given_alert is not None
    assert tested.fail_given_alert.total == 96 + 50


@pytest.mark.parametrize("misses", range(40, 80))
def test_the_promise_is_broken_if_the_whole_interval_is_above_it(misses: int) -> None:
    tested = certificate(evaluation(misses, 20), 0.1)
    assert tested is not None
    is_above = clopper_pearson(misses, 500)[0] > 0.1
    assert tested.is_worse_than_promised == is_above
    assert any("worse than its promise" in text for text in tested.warnings) == is_above


@pytest.mark.parametrize("passed", range(60, 110))
def test_a_monitor_is_useless_if_too_few_safe_flights_pass(passed: int) -> None:
    tested = certificate(evaluation(20, 500 - passed), 0.1)
    assert tested is not None
    is_useless = clopper_pearson(passed, 500)[1] < 0.2
    assert tested.is_useless == is_useless
    assert any("of no use" in text for text in tested.warnings) == is_useless


@pytest.mark.parametrize(("misses", "n"), [(20, 100), (21, 100), (1, 3), (60, 200)])
def test_a_monitor_that_misses_twice_its_promise_off_the_plan_has_a_warning(
    misses: int, n: int
) -> None:
    """Measured above 2 epsilon, and surely above epsilon; one miss of three is no evidence."""
    row = {"words": "softer input", "misses": misses, "n_unsafe": n}
    found = warnings_of(evaluation(20, 20, robustness={"lag": row}), 0.1)
    assert any("softer input" in text for text in found) == (misses > 20)
    share = f"{misses / n:.1%}"
    assert all(share in text for text in found)


def test_the_mean_over_aircraft_decides_about_a_warning() -> None:
    row = {"words": "x 1.5", "misses": 30, "n_unsafe": 100, "n_aircraft": 80, "worst": [4, 5]}
    mean = {"miss_rate": 0.15, "miss_interval": [0.11, 0.2]}
    assert warnings_of(evaluation(20, 20, robustness={"near": row | mean}), 0.1) == []
    assert len(warnings_of(evaluation(20, 20, robustness={"near": row}), 0.1)) == 1
    assert warnings_of(evaluation(20, 20, robustness={"near": row | {"n_unsafe": 0}}), 0.1) == []


def test_warnings_give_share_interval_and_promise() -> None:
    (text,) = warnings_of(evaluation(67, 20), 0.1)
    assert "13.4% [10.5%, 16.7%]" in text
    assert "promised at most 0.1" in text


def test_missing_counts_are_none() -> None:
    tested = certificate(evaluation(0, 0, n=0), 0.1)
    assert tested is not None
    assert (tested.missed, tested.quiet, tested.fail_given_alert) == (None, None, None)
    assert tested.warnings == []


def test_withdrawn_flights_are_neither_missed_nor_caught() -> None:
    counts = {"misses": 10, "false_alerts": 30, "withdrawn": 40}
    tested = certificate(evaluation(0, 0, at_epsilon=counts), 0.1)
    assert tested is not None
    assert tested.fail_given_alert is not None
    assert (tested.fail_given_alert.count, tested.fail_given_alert.total) == (450, 480)


def test_invalid_safe_flights_do_not_make_a_monitor_useful() -> None:
    counts = {"misses": 10, "false_alerts": 30, "withdrawn": 0, "safe_withdrawn": 450}
    tested = certificate(evaluation(0, 0, at_epsilon=counts), 0.1)
    assert tested is not None
    assert tested.quiet is not None
    assert tested.quiet.count == 20
    assert tested.is_useless


def test_the_power_of_an_older_version_is_recomputed() -> None:
    counted = {"power": 0.94, "power_interval": [0.9, 0.96], "safe_withdrawn": 70}
    at = evaluation(10, 30)["at_epsilon"] | counted
    curves = {
        "epsilon": [0.1], "misses": [9], "false_alerts": [30], "safe_withdrawn": [70],
        "power": [0.94], "power_interval": [[0.9, 0.96]],
    }  # fmt: skip
    stored = evaluation(0, 0, at_epsilon=at, curves=curves)
    updated = with_power_of_quiet(stored)
    assert updated["at_epsilon"]["power"] == updated["curves"]["power"][0] == pytest.approx(0.8)
    assert updated["curves"]["power_interval"] == [clopper_pearson(400, 500).tolist()]
    assert stored["at_epsilon"]["power"] == 0.94
    older = evaluation(10, 30)
    assert with_power_of_quiet(older) == older


@pytest.mark.parametrize(("quiet", "is_warned"), [(89, False), (90, True), (95, True)])
def test_a_method_no_better_than_a_threshold_has_a_warning(quiet: int, is_warned: bool) -> None:
    methods = [
        {"name": "peak_ahead", "missed": 3, "n_unsafe": 30, "quiet": 90, "n_safe": 100}
        | {"chosen": True},
        {"name": "ensemble", "missed": 9, "n_unsafe": 30, "quiet": 99, "n_safe": 100}
        | {"chosen": False},
        {"name": THRESHOLD, "missed": 3, "n_unsafe": 30, "quiet": quiet, "n_safe": 100}
        | {"chosen": False},
    ]
    found = warnings_of(evaluation(20, 20, methods=methods), 0.1)
    assert [IN_WORDS in text for text in found] == [True] * is_warned
    assert warnings_of(evaluation(20, 20, methods=methods[:2]), 0.1) == []
