"""Limits by flight condition, such as Mach number."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from core.conditions import Case, Cases, ranges_from_plain
from core.limits.limits import Limits, specification_from_plain, specification_to_plain


@dataclass(frozen=True)
class LimitCase(Case):
    """A flight condition and its limits."""

    limits: Limits


@dataclass(frozen=True)
class LimitSet(Cases[LimitCase]):
    """Limits by flight condition."""

    kind: ClassVar[str] = "limit set"
    content: ClassVar[str] = "limits"


def limit_set_to_plain(limit_set: LimitSet) -> list[dict[str, Any]]:
    """Plain data, one item for each condition."""
    return [
        {
            "name": case.name,
            "ranges": {key: list(ends) for key, ends in case.ranges.items()},
            "limits": specification_to_plain(case.limits),
        }
        for case in limit_set.cases
    ]


def limit_set_from_plain(plain: Sequence[Mapping[str, Any]]) -> LimitSet:
    cases = []
    for case in plain:
        limits = specification_from_plain(case["limits"])
        if not isinstance(limits, Limits):
            raise ValueError(f"{case['name']} has no limits: give at least one channel's")
        cases.append(LimitCase(case["name"], ranges_from_plain(case["ranges"]), limits))
    return LimitSet(tuple(cases))
