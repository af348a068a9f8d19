import numpy as np
import pytest

from app.assessment.comparison import Assessed, difference, longest_pass

DT = 0.1
N = 40
T = DT * np.arange(N)


def assessed(risk: np.ndarray, above: float = 0.5, *, t: np.ndarray = T) -> Assessed:
    """Alerts above a risk; NaN is a sample that was not assessed."""
    state = np.where(np.isfinite(risk), 0, 1)
    return Assessed(t, np.nan_to_num(risk, nan=9.0), np.nan_to_num(risk) > above, state)


def bump(start: int, end: int, height: float = 0.9) -> np.ndarray:
    risk = np.full(N, 0.1)
    risk[start:end] = height
    return risk


def test_the_largest_difference_is_dated_and_only_of_samples_that_both_assessed() -> None:
    first, second = bump(10, 20), bump(12, 24)
    second[10] = np.nan  # as different, but not assessed
    second[11] = 0.2
    found = difference(assessed(first), assessed(second))
    assert found.n_both == N - 1
    assert found.largest == pytest.approx((2.0, 0.1, 0.9))
    assert found.only_first == ((pytest.approx(1.1),) * 2,)
    assert found.only_second == ((pytest.approx(2.0), pytest.approx(2.3)),)


def test_a_monitor_does_not_differ_from_itself() -> None:
    same = assessed(bump(10, 20))
    found = difference(same, same)
    assert (found.n_both, found.largest) == (N, (0.0, 0.1, 0.1))
    assert found.only_first == found.only_second == ()


def test_samples_of_other_intervals_are_matched_to_the_nearest_in_time() -> None:
    coarse = assessed(bump(10, 20)[::2], t=T[::2] + 0.01)
    found = difference(coarse, assessed(bump(10, 20)))
    assert found.n_both == N // 2
    assert found.largest is not None
    assert found.largest[1] == found.largest[2]
    elsewhere = assessed(bump(10, 20), t=T + 100.0)
    assert difference(coarse, elsewhere).largest is None


@pytest.mark.parametrize("n", [0, 1])
def test_few_samples_are_compared_too(n: int) -> None:
    few = assessed(bump(0, 5)[:n], t=T[:n])
    assert difference(few, assessed(bump(0, 5))).n_both == n
    assert difference(assessed(bump(0, 5)), few).n_both == n


@pytest.mark.parametrize(
    ("start", "outcome", "lead"),
    [(10, "timely_alert", 1.0), (17, "late_alert", 0.3), (25, "missed", None)],
)
def test_a_warning_is_in_time_late_or_missing(start: int, outcome: str, lead: float | None) -> None:
    warned = assessed(bump(start, 30)).warned(T[20], lead=0.5, longest=10.0)
    assert warned.outcome == outcome
    assert warned.lead == (None if lead is None else pytest.approx(lead))


def test_an_alert_of_an_earlier_manoeuvre_does_not_warn() -> None:
    assert assessed(bump(2, 5)).warned(T[30], lead=0.5, longest=1.0).outcome == "missed"


def test_a_monitor_that_assessed_nothing_in_time_did_not_miss() -> None:
    risk = bump(25, 30)
    risk[:18] = np.nan
    assert assessed(risk).warned(T[20], lead=0.5, longest=10.0).outcome == "unseen"


def test_the_longest_pass_is_the_last_of_equals() -> None:
    t = np.array([0, 1, 2, 1, 2, 3, 4, 0, 1, 2, 3.0])
    assert longest_pass(t) == slice(7, 11)
    assert longest_pass(t[:10]) == slice(3, 7)
    assert longest_pass(t[:1]) == slice(0, 1)
    assert longest_pass(t[:0]) == slice(0, 0)
