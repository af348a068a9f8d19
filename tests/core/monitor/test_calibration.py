"""Rank, threshold, p-value and alert rule against exact rationals and against crepes."""

import re
from fractions import Fraction
from math import ceil, inf, nan

import crepes
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from core.monitor.calibration import (
    alert_above,
    check_epsilon,
    confident_rank,
    failures_needed,
    p_values,
    rank,
    smallest_epsilon,
    threshold,
)

LEVELS = st.integers(-5, 5).map(float) | st.just(inf)


def epsilons(n: int) -> list[Fraction]:
    """Per cents, and the p-values of n failures themselves."""
    return [Fraction(j, 100) for j in range(1, 100)] + [Fraction(j, n + 1) for j in range(1, n + 1)]


@pytest.mark.parametrize("n", range(1, 61))
def test_alert_iff_p_value_exceeds_epsilon_in_exact_rationals(n: int) -> None:
    alphas = np.arange(n, dtype=np.float64)
    scores = np.concatenate([alphas, alphas - 0.5, [n, inf]])
    exact_p = [Fraction(1 + sum(alpha >= s for alpha in alphas), n + 1) for s in scores]
    p = p_values(scores, alphas)
    assert p.tolist() == [float(value) for value in exact_p]
    for epsilon in epsilons(n):
        alerts = [value > epsilon for value in exact_p]
        k = ceil((n + 1) * (1 - epsilon))
        assert rank(float(epsilon), n) == k
        assert threshold(float(epsilon), alphas) == (alphas[k - 1] if k <= n else inf)
        assert (scores <= threshold(float(epsilon), alphas)).tolist() == alerts
        if epsilon * (n + 1) < 1:
            assert all(alerts)
            with pytest.raises(ValueError, match="unsafe rollouts"):
                check_epsilon(float(epsilon), n)
        else:
            assert (p > check_epsilon(float(epsilon), n)).tolist() == alerts


@pytest.mark.parametrize(("n", "epsilon", "k"), [(19, 0.95, 1), (9, 0.7, 3), (49, 0.94, 3)])
def test_rank_is_right_where_floats_are_one_too_high(n: int, epsilon: float, k: int) -> None:
    assert ceil((n + 1) * (1 - epsilon)) == k + 1
    assert rank(epsilon, n) == k


def test_epsilon_that_a_float_just_misses_is_put_on_the_grid() -> None:
    """1 - 0.9 lies below 0.1: unsnapped, p = 1/10 would alert."""
    assert 1 - 0.9 < 0.1
    assert check_epsilon(1 - 0.9, 9) == 0.1
    assert check_epsilon(0.1 + 0.2, 9) == 0.1 + 0.2
    assert check_epsilon(0.15, 9) == 0.15


@pytest.mark.parametrize("epsilon", [0.0, 1.0, -0.1, 1.5, nan])
def test_epsilon_outside_0_to_1_is_refused(epsilon: float) -> None:
    with pytest.raises(ValueError, match=r"was given: .* between 0 and 1"):
        check_epsilon(epsilon, 50)


def test_too_small_epsilon_is_refused_with_the_rollouts_it_needs() -> None:
    message = "epsilon=0.01 needs at least 99 unsafe rollouts; this monitor has 50"
    with pytest.raises(ValueError, match=message):
        check_epsilon(0.01, 50)
    assert check_epsilon(0.01, 99) == 0.01


@pytest.mark.parametrize("n", range(1, 61))
def test_what_a_refusal_advises_is_accepted(n: int) -> None:
    for epsilon in (0.999 / (n + 1), 0.5 / (n + 1), 0.0123 / (n + 1)):
        with pytest.raises(ValueError, match="unsafe rollouts") as refusal:
            check_epsilon(epsilon, n)
        needed, raised = re.findall(
            r"at least (\d+) unsafe|raise epsilon to (\S+)", str(refusal.value)
        )
        check_epsilon(epsilon, int(needed[0]))
        check_epsilon(float(raised[1]), n)
        assert rank(epsilon, int(needed[0]) - 1) > int(needed[0]) - 1
    assert check_epsilon(smallest_epsilon(n), n) == smallest_epsilon(n)


@given(st.lists(LEVELS, min_size=1), st.lists(LEVELS, min_size=1))
def test_p_values_equal_crepes_with_ties(alphas: list[float], scores: list[float]) -> None:
    peer = crepes.ConformalClassifier().fit(np.array(alphas))
    expected = peer.predict_p(np.array(scores), smoothing=False)
    assert p_values(scores, np.sort(alphas)).tolist() == expected.tolist()


@given(st.lists(LEVELS, min_size=1), st.floats(-6, 6), st.floats(-6, 6))
def test_p_value_falls_as_the_score_rises(alphas: list[float], a: float, b: float) -> None:
    low, high = p_values(sorted([a, b]), np.sort(alphas))
    assert low >= high
    assert 1 / (len(alphas) + 1) <= high
    assert low <= 1


def test_without_a_score_there_is_no_p_value() -> None:
    p = p_values([nan, -1.0, nan], np.array([0.0, inf]))
    np.testing.assert_array_equal(p, [nan, 1.0, nan])


def test_the_ends_of_epsilon_are_refused_or_kept() -> None:
    with pytest.raises(ValueError, match="needs at least 1000000000000000000 unsafe rollouts"):
        check_epsilon(5e-324, 50)
    largest = float(np.nextafter(1, 0))
    assert check_epsilon(largest, 50) == largest


# --- the promise of one monitor ------------------------------------------------------------------


@pytest.mark.parametrize(("n", "j"), [(28, 0), (29, 1), (50, 2), (100, 5), (200, 13), (500, 39)])
def test_ranks_of_the_promise_with_confidence(n: int, j: int) -> None:
    """Published ranks at epsilon 0.1, and the Beta quantile that each stands for."""
    assert confident_rank(0.1, n) == j
    if j:
        assert stats.beta(j, n + 1 - j).sf(0.1) <= 0.05 < stats.beta(j + 1, n - j).sf(0.1)
        assert alert_above(0.1, n, "95%") == j / (n + 1)


@pytest.mark.parametrize(("epsilon", "n"), [(0.1, 29), (0.05, 59), (0.02, 149), (0.01, 299)])
def test_failures_that_the_promise_with_confidence_needs(epsilon: float, n: int) -> None:
    assert failures_needed(epsilon, "95%") == n
    assert confident_rank(epsilon, n - 1) == 0 < confident_rank(epsilon, n)
    assert smallest_epsilon(n, "95%") <= epsilon < smallest_epsilon(n - 1, "95%")
    with pytest.raises(ValueError, match=f"95 % confidence needs at least {n} unsafe rollouts"):
        alert_above(epsilon, n - 1, "95%")


def test_the_promise_with_confidence_holds_for_all_but_one_monitor_in_twenty() -> None:
    """Of uniform scores that chose nothing, a monitor's own miss rate is known exactly."""
    rng, n, epsilon = np.random.default_rng(4), 100, 0.1
    alphas = np.sort(rng.random((20_000, n)), axis=1)
    j = confident_rank(epsilon, n)
    share = (1 - alphas[:, n - j] > epsilon).mean()  # it alerts iff s <= alpha_(n + 1 - j)
    assert 0.02 < share <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 20_000)
    assert (1 - alphas[:, rank(epsilon, n) - 1] > epsilon).mean() > 0.4
