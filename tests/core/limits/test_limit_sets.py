"""Limit sets: at most one condition applies, and `find` equals a search over all."""

from itertools import product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.conditions import CONDITION_KEYS, NO_CONDITION
from core.limits.limit_sets import LimitCase, LimitSet, limit_set_from_plain, limit_set_to_plain
from core.limits.limits import Limits
from tests.support.repetition import examples

NUMBERS = st.integers(0, 4).map(float)
ENDS = st.tuples(st.none() | NUMBERS, st.none() | NUMBERS).filter(
    lambda ends: None in ends or ends[0] < ends[1]  # pyright: ignore
)
RANGES = st.dictionaries(st.sampled_from(CONDITION_KEYS), ENDS)


def case(name: str, ranges: Any, ny: float = 0.5) -> LimitCase:
    return LimitCase(name, ranges, Limits(Ny=ny))


@settings(max_examples=examples(100), deadline=None)
@given(one=RANGES, other=RANGES, condition=st.tuples(*[NUMBERS] * len(CONDITION_KEYS)))
def test_conditions_overlap_if_one_flight_can_be_both(one: Any, other: Any, condition: Any):
    cases = case("one", one), case("other", other)
    both = all(c.holds(condition) for c in cases)
    if both:
        assert cases[0].overlaps(cases[1])
    grid = product(range(-1, 6), repeat=len(CONDITION_KEYS))
    somewhere = any(all(c.holds(point) for c in cases) for point in grid)
    assert cases[0].overlaps(cases[1]) == somewhere
    if not somewhere:
        number = LimitSet(cases).find(condition)
        assert number == next((k for k, c in enumerate(cases) if c.holds(condition)), None)


def test_the_overlap_is_named() -> None:
    both = case("slow", {"mach": (None, 0.8)}), case("fast", {"mach": (0.7, 1.2)})
    with pytest.raises(ValueError, match="slow and fast overlap"):
        LimitSet(both)


def test_a_range_ends_before_its_second_number_and_missing_values_are_named() -> None:
    limits = LimitSet((case("slow", {"mach": (None, 0.8)}), case("fast", {"mach": (0.8, 1.2)})))
    assert [limits.find((mach, *NO_CONDITION[1:])) for mach in (0.79, 0.8, 1.2)] == [0, 1, None]
    assert limits.find(("stale", 1.0, 1.0, 1.0)) is None
    assert limits.needed == ["mach"]
    assert limits.why_none(("stale", *NO_CONDITION[1:])) == "Mach number is stale"
    assert limits.why_none((1.2, *NO_CONDITION[1:])) == "no limits for this Mach number"
    assert limit_set_from_plain(limit_set_to_plain(limits)) == limits


@pytest.mark.parametrize(
    ("cases", "words"),
    [
        ((), "at least one"),
        ((case("a", {}), case("b", {"mach": (0.5, 1.0)})), "overlap"),
        ((case("a", {"mach": (0.0, 1.0)}), case("a", {"mach": (1.0, 2.0)})), "use different names"),
    ],
)
def test_a_set_is_unambiguous(cases: tuple[LimitCase, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LimitSet(cases)


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"mach": (1.0, 1.0)}, "is empty"),
        ({"mach": (float("nan"), 1.0)}, "non-finite"),
        ({"temperature": (0.0, 1.0)}, "choose mach"),
    ],
)
def test_a_range_has_a_known_channel_and_is_not_empty(ranges: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        case("a", ranges)
