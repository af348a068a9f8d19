"""Monitor sets: monitors that differ in what a set shares are refused, naming the two."""

from dataclasses import replace
from typing import Any

import pytest

from core.channels import LATERAL, Dictionary
from core.conditions import NO_CONDITION
from core.monitor.monitor_set import MonitorCase, MonitorSet
from tests.support.flying import exact_monitor

FEWER = Dictionary("fewer", LATERAL.channels[:5])


def two(**other: Any) -> MonitorSet:
    slow = MonitorCase("slow", {"mach": (None, 0.8)}, exact_monitor())
    fast = MonitorCase("fast", {"mach": (0.8, 1.2)}, replace(exact_monitor(), **other))
    return MonitorSet((slow, fast))


def test_at_most_one_monitor_is_found() -> None:
    found = [two().find((mach, *NO_CONDITION[1:])) for mach in (0.79, 0.8, 1.2)]
    assert found == [0, 1, None]
    assert two().why_none((1.2, *NO_CONDITION[1:])) == "no monitor for this Mach number"


@pytest.mark.parametrize(
    ("other", "word"),
    [
        ({"dt": 0.1}, "sample interval"),
        ({"h": 7}, "lead time"),
        ({"dictionary": FEWER}, "channels"),
    ],
)
def test_monitors_that_differ_are_refused(other: Any, word: str) -> None:
    with pytest.raises(ValueError, match=f"of slow and fast differ in their {word}"):
        two(**other)


def one_of(ranges: list[Any]) -> MonitorSet:
    cases = [MonitorCase(f"case {k}", each, exact_monitor()) for k, each in enumerate(ranges)]
    return MonitorSet(tuple(cases))


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ([{}], "case 0 has no range"),
        ([{"mach": (None, None)}], "mach of case 0 has no end"),
        ([{"mach": (None, 0.0)}], "mach of case 0 is empty"),
        ([{"mach": (None, 1.0)}, {"mach": (0.5, 0.9)}], "case 0 includes all of case 1"),
    ],
)
def test_a_new_set_has_no_condition_that_is_never_or_always_chosen(
    ranges: list[Any], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        one_of(ranges).check()
