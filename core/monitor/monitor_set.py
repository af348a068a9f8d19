"""Monitors of one test by flight condition, such as Mach number and altitude."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from core.conditions import CONDITIONS, Case, Cases


class SetMember(Protocol):
    """The properties of a monitor, or of its record, that a set uses."""

    @property
    def dictionary(self) -> Any: ...
    @property
    def dt(self) -> float: ...
    @property
    def h(self) -> int: ...


SHARED: dict[str, Callable[[SetMember], object]] = {
    "channels": lambda monitor: monitor.dictionary,
    "sample interval": lambda monitor: monitor.dt,
    "lead time": lambda monitor: monitor.h,
}
"""In which all monitors of a set agree, in words."""

M = TypeVar("M", bound=SetMember)


@dataclass(frozen=True, eq=False)
class MonitorCase(Case, Generic[M]):
    """A flight condition and its monitor, used unchanged at its own epsilon."""

    monitor: M


@dataclass(frozen=True, eq=False)
class MonitorSet(Cases[MonitorCase[M]], Generic[M]):
    """Monitors by flight condition. ValueError for monitors that differ in what a set shares."""

    kind: ClassVar[str] = "monitor set"
    content: ClassVar[str] = "monitor"
    may_overlap: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        first, *others = self.cases
        for case in others:
            for word, of in SHARED.items():
                if of(case.monitor) != of(first.monitor):
                    raise ValueError(
                        f"the monitors of {first.name} and {case.name} differ in their {word}: "
                        f"choose monitors with the same {word}"
                    )

    def check(self) -> None:
        """ValueError for a condition without a range, and for a range that is empty."""
        for case in self.cases:
            for key, (low, high) in case.ranges.items():
                if low is None and high is None:
                    raise ValueError(
                        f"the range of {key} of {case.name} has no end: give one or both, or leave "
                        f"out {key}"
                    )
                lowest = CONDITIONS[key].lowest
                if high is not None and lowest is not None and high <= lowest:
                    raise ValueError(
                        f"the range of {key} of {case.name} is empty: it ends before {high:g}, and "
                        f"{CONDITIONS[key].label} is at least {lowest:g}"
                    )
            if not case.ranges:
                raise ValueError(
                    f"{case.name} has no range, so its monitor would be used everywhere: give a "
                    f"range of {', '.join(CONDITIONS)}, or fly with that monitor alone"
                )
