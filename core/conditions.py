"""Flight conditions, such as a range of Mach number, and sets of cases of which one holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf, isfinite
from typing import ClassVar, Generic, Literal, Self, TypeVar

ConditionKey = Literal["mach", "dynamic_pressure", "configuration", "altitude", "V"]


@dataclass(frozen=True)
class ConditionChannel:
    """A quantity that defines flight conditions, with its words for people.

    lowest, highest: values that are plausible for an aircraft, in `unit`; None for any.
    """

    key: ConditionKey
    symbol: str
    unit: str
    label: str
    lowest: float | None = None
    highest: float | None = None

    def is_plausible(self, value: float) -> bool:
        low, high = self.plausible
        return low <= value <= high

    @property
    def plausible(self) -> tuple[float, float]:
        return _ends((self.lowest, self.highest))


CONDITIONS: dict[ConditionKey, ConditionChannel] = {
    channel.key: channel
    for channel in (
        ConditionChannel("mach", "M", "", "Mach number", 0.0, 10.0),
        ConditionChannel("dynamic_pressure", "q", "Pa", "dynamic pressure", 0.0, 1e6),
        ConditionChannel("configuration", "conf", "", "number of the configuration"),
        ConditionChannel("altitude", "h", "m", "altitude", -1e3, 1e5),
        ConditionChannel("V", "V", "m/s", "true airspeed", 0.0, 2e3),
    )
}
CONDITION_KEYS: tuple[ConditionKey, ...] = tuple(CONDITIONS)
Condition = tuple[float | str, ...]
"""In the order of CONDITION_KEYS: a value, or the word for its absence."""
MISSING, STALE, IMPLAUSIBLE = "missing", "stale", "implausible"
NO_CONDITION: Condition = (MISSING,) * len(CONDITION_KEYS)
Range = tuple[float | None, float | None]
"""From the first (included) to the second (excluded); None for no end."""


@dataclass(frozen=True)
class Case:
    """A flight condition, with what holds there.

    ranges: by channel; channels without a range do not matter.
    """

    name: str
    ranges: Mapping[ConditionKey, Range]

    def __post_init__(self) -> None:
        for key, (low, high) in self.ranges.items():
            if key not in CONDITIONS:
                raise ValueError(
                    f"{self.name} has a range of {key!r}: choose {', '.join(CONDITIONS)}"
                )
            if not all(end is None or isfinite(end) for end in (low, high)):
                raise ValueError(f"the range of {key} of {self.name} has a non-finite end")
            if low is not None and high is not None and low >= high:
                raise ValueError(
                    f"the range of {key} of {self.name} is empty: it begins at {low:g} and ends "
                    f"before {high:g}"
                )

    def holds(self, condition: Condition) -> bool:
        """Whether a condition is this one; a channel with a range must have a value."""
        for key, value in zip(CONDITION_KEYS, condition, strict=True):
            if key in self.ranges:
                low, high = _ends(self.ranges[key])
                if isinstance(value, str) or not low <= value < high:
                    return False
        return True

    def overlaps(self, other: Self) -> bool:
        """Whether one condition could be both."""
        return all(
            max(low, other_low) < min(high, other_high)
            for key in CONDITION_KEYS
            for (low, high), (other_low, other_high) in [
                (_ends(self.ranges.get(key)), _ends(other.ranges.get(key)))
            ]
        )

    def includes(self, other: Self) -> bool:
        """Whether this one holds wherever the other does."""
        return all(
            low <= other_low and other_high <= high
            for key in self.ranges
            for (low, high), (other_low, other_high) in [
                (_ends(self.ranges[key]), _ends(other.ranges.get(key)))
            ]
        )


AnyCase = TypeVar("AnyCase", bound=Case)


@dataclass(frozen=True)
class Cases(Generic[AnyCase]):
    """Cases by flight condition, of which one is chosen at a time.

    kind, content: words for the set and for what its cases hold.   may_overlap: whether two may
    hold at once, so that the one chosen stays chosen on a boundary.
    """

    kind: ClassVar[str]
    content: ClassVar[str]
    may_overlap: ClassVar[bool] = False
    cases: tuple[AnyCase, ...]

    def __post_init__(self) -> None:
        if not self.cases:
            raise ValueError(
                f"the {self.kind} has no condition: give at least one, with its {self.content}"
            )
        for case, other in combinations(self.cases, 2):
            if case.name == other.name:
                raise ValueError(f"two conditions are called {case.name!r}: use different names")
            if not self.may_overlap and case.overlaps(other):
                raise ValueError(
                    f"{case.name} and {other.name} overlap: let one end where the other begins"
                )
            for outer, inner in ((case, other), (other, case)):
                if outer.includes(inner):
                    raise ValueError(
                        f"{outer.name} includes all of {inner.name}: give ranges that overlap at "
                        "their ends at most"
                    )

    @property
    def needed(self) -> list[ConditionKey]:
        """Channels needed to decide which case holds."""
        return [key for key in CONDITION_KEYS if any(key in case.ranges for case in self.cases)]

    def find(self, condition: Condition, last: int | None = None) -> int | None:
        """Number of the case of a condition; None if it is no case or unknown.

        last: number of the case chosen before, which stays chosen while it holds.
        """
        if last is not None and self.cases[last].holds(condition):
            return last
        holding = (k for k, case in enumerate(self.cases) if case.holds(condition))
        return next(holding, None)

    def why_none(self, condition: Condition) -> str:
        values = dict(zip(CONDITION_KEYS, condition, strict=True))
        unknown = [
            f"{CONDITIONS[key].label} is {values[key]}"
            for key in self.needed
            if isinstance(values[key], str)
        ]
        if unknown:
            return " and ".join(unknown)
        needed = (CONDITIONS[key].label for key in self.needed)
        return f"no {self.content} for this {' and '.join(needed)}"


def check_declared(declared: Mapping[ConditionKey, float]) -> None:
    """ValueError for a declared value that no aircraft has."""
    for key, value in declared.items():
        known = CONDITIONS[key]
        if not isfinite(value):
            raise ValueError(f"the condition {key} is not a finite number: give its value")
        if not known.is_plausible(value):
            low, high = known.plausible
            between = f"{low:g} to {high:g} {known.unit}".rstrip()
            raise ValueError(f"{key} of {value:g} is implausible: give {between}")


def ranges_from_plain(
    plain: Mapping[ConditionKey, Sequence[float | None]],
) -> dict[ConditionKey, Range]:
    return {key: (low, high) for key, (low, high) in plain.items()}


def _ends(interval: Range | None) -> tuple[float, float]:
    low, high = interval or (None, None)
    return -inf if low is None else low, inf if high is None else high
