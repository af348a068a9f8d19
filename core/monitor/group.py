"""Groups of failing flights, each with its own miss rate guarantee.

A guarantee over all failing flights may fail within a small group of them. Calibration by groups
has a threshold for each (Mondrian conformal prediction: Vovk, Gammerman and Shafer, Algorithmic
Learning in a Random World, 2005). A flight's group becomes known at some sample, by the same rule
in calibration and in flight. Until then its p-value is the largest over the possible groups, which
can only add alerts.
"""

from abc import ABC, abstractmethod
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import CHANNELS, N_CHANNELS
from core.limits.limits import Specification, magnitudes_of
from core.monitor.calibration import Guarantee, failures_needed, p_values
from core.monitor.file.portable import Section
from core.monitor.file.values import check_alphas
from core.monitor.validity.flown_input import SURFACES
from core.monitor.validity.input_shape import deflections
from core.recipe import family
from core.types import Array, Flags, Indices

NO_GROUP = -1
RETURNED = 0.5
"""A surface has returned once its deflection is below this share of its largest."""


@dataclass(frozen=True)
class GroupRule(ABC):
    """Rule that assigns flights to groups: a dataclass of plain numbers, for the file."""

    kind: ClassVar[str]

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Name of each group, for people."""

    @abstractmethod
    def of(self, y: Array, fail_index: Indices) -> Indices:
        """(n,) group of failing flights; NO_GROUP for flights unlike all calibration flights.

        y: (n, n_samples, 6).   fail_index: (n,) first sample that exceeds a limit.
        """

    @abstractmethod
    def possible(self, y: Array) -> Indices:
        """(n, n_groups) number of samples during which each group is still possible.

        y: (n, n_samples, 6), NaN if unknown.
        """

    @abstractmethod
    def start(self) -> "RunningGroup": ...

    @abstractmethod
    def check(self) -> None:
        """Raise ValueError for impossible values."""


class RunningGroup:
    """Possible groups of one flight, sample by sample: lowest to highest. Here always all."""

    def __init__(self, n_groups: int) -> None:
        self.lowest, self.highest = 0, n_groups - 1

    def update(self, y: Array) -> None: ...


@dataclass(frozen=True)
class FirstLimitRule(GroupRule):
    """Groups by the limit exceeded first, which in flight is known too late.

    If several are exceeded at one sample, the one exceeded most in proportion counts.
    first: channels that some calibration flight exceeded first, one group each.
    limited, limits: channels with a limit, and their limits.
    """

    kind: ClassVar[str] = "first_limit"
    first: tuple[int, ...]
    limited: tuple[int, ...]
    limits: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{CHANNELS[k].label} limit first" for k in self.first)

    def of(self, y: Array, fail_index: Indices) -> Indices:
        share = np.abs(y[np.arange(len(y)), fail_index][:, self.limited]) / self.limits
        share = np.where(np.isnan(share), np.inf, share)
        exceeded = np.array(self.limited)[share.argmax(axis=1)]
        group = np.full(N_CHANNELS, NO_GROUP)
        group[list(self.first)] = np.arange(len(self.first))
        return group[exceeded]

    def possible(self, y: Array) -> Indices:
        return np.full((len(y), len(self.first)), y.shape[1])

    def start(self) -> RunningGroup:
        return RunningGroup(len(self.first))

    def check(self) -> None:
        channels = [*self.first, *self.limited]
        if not all(type(k) is int and 0 <= k < N_CHANNELS for k in channels):
            raise ValueError(f"groups name unknown channels: {channels}")
        if not set(self.first) <= set(self.limited) or len(self.limited) != len(self.limits):
            raise ValueError("groups and their limits do not match")
        if not all(type(limit) is float and limit > 0 for limit in self.limits):
            raise ValueError(f"groups have invalid limits: {list(self.limits)}")


@dataclass(frozen=True)
class DeflectionRule(GroupRule):
    """Groups by the largest deflection of one surface until it returns, or until the failure.

    surface: channel.   low, high: bounds between the groups [rad].
    """

    kind: ClassVar[str] = "largest_deflection"
    surface: int
    low: float
    high: float

    @property
    def names(self) -> tuple[str, ...]:
        low, high = np.rad2deg([self.low, self.high])
        bounds = f"below {low:.2f} deg", f"{low:.2f} to {high:.2f} deg", f"from {high:.2f} deg"
        pairs = zip(CLASSES, bounds, strict=True)
        return tuple(f"{size} deflections, {bound}" for size, bound in pairs)

    def of(self, y: Array, fail_index: Indices) -> Indices:
        """By the deflection that decides in flight, else the largest before the failure."""
        return self._class_of(self.decisive(y, fail_index))

    def decisive(self, y: Array, last: Indices) -> Array:
        """(n,) deflection that determines the group [rad].

        y: (n, n_samples, 6).   last: (n,) last sample that counts.
        """
        flown = np.arange(y.shape[1]) <= last[:, np.newaxis]
        peak, back = self._peaks(np.where(flown, y[..., self.surface], np.nan))
        at = np.minimum(back, y.shape[1] - 1)[:, np.newaxis]
        return np.nan_to_num(np.take_along_axis(peak, at, axis=1)[:, 0])

    def possible(self, y: Array) -> Indices:
        """Until the deflection exceeds the group's bound, or has returned in another group."""
        peak, back = self._peaks(y[..., self.surface])
        least = np.where(np.arange(y.shape[1]) <= back[:, np.newaxis], self._class_of(peak), 0)
        least = np.maximum.accumulate(least, axis=1)
        passed = least[..., np.newaxis] > np.arange(len(CLASSES))
        until = np.where(passed.any(axis=1), passed.argmax(axis=1), y.shape[1])
        is_final = least[:, -1:] == np.arange(len(CLASSES))
        return np.where(is_final, y.shape[1], np.minimum(until, back[:, np.newaxis]))

    def start(self) -> RunningGroup:
        return _RunningDeflection(self)

    def _peaks(self, deflection: Array) -> tuple[Array, Indices]:
        """Largest deflection so far (n, n_samples), and first sample after the return (n,).

        deflection: (n, n_samples), NaN if unknown.
        """
        deflection = np.abs(deflection)
        peak = np.fmax.accumulate(deflection, axis=1)
        is_back = (peak >= RETURNED * self.low) & (deflection < RETURNED * peak)
        return peak, np.where(is_back.any(axis=1), is_back.argmax(axis=1), deflection.shape[1])

    def _class_of(self, peak: Array) -> Indices:
        """Group of a deflection, which may be NaN."""
        return np.searchsorted([self.low, self.high], np.nan_to_num(peak), side="right")

    def check(self) -> None:
        if self.surface not in SURFACES or type(self.surface) is not int:
            raise ValueError(f"groups use the channel {self.surface!r}, which is not a surface")
        if not (type(self.low) is type(self.high) is float and 0 < self.low < self.high < np.inf):
            raise ValueError(f"groups have invalid bounds: {self.low!r} and {self.high!r}")


class _RunningDeflection(RunningGroup):
    def __init__(self, rule: DeflectionRule) -> None:
        super().__init__(len(CLASSES))
        self._surface, self._bounds = rule.surface, [rule.low, rule.high]
        self._least_peak, self._peak = RETURNED * rule.low, 0.0

    def update(self, y: Array) -> None:
        if self.lowest == self.highest:
            return
        deflection = abs(y.item(self._surface))
        if deflection >= self._peak:
            self._peak = deflection
            self.lowest = bisect_right(self._bounds, deflection)
        elif self._peak >= self._least_peak and deflection < RETURNED * self._peak:
            self.highest = self.lowest


RULES: dict[str, type[FirstLimitRule] | type[DeflectionRule]] = {
    rule.kind: rule for rule in (FirstLimitRule, DeflectionRule)
}


@dataclass(frozen=True)
class Grouping(ABC):
    """How failing flights are grouped; each group has its own threshold."""

    @abstractmethod
    def fit(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> tuple[GroupRule, Indices] | None:
        """Fit a rule and assign each flight a group; None for fewer than two groups.

        y: (n, n_samples, 6).   fail_index: (n,) first sample that exceeds a limit, of each flight.
        Flights that determined the rule get NO_GROUP, because they must not calibrate it.
        """

    def groups(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> dict[str, Flags]:
        """Flights of each group, by name; empty for fewer than two groups.

        y, fail_index: as in `fit`.
        """
        fitted = self.fit(y, fail_index, specification)
        return {} if fitted is None else members(fitted[0], y, fail_index)


def members(rule: GroupRule, y: Array, fail_index: Indices) -> dict[str, Flags]:
    """Failing flights of each group, by name; arguments as in `GroupRule.of`."""
    group = rule.of(y, fail_index)
    return {name: group == k for k, name in enumerate(rule.names)}


@dataclass(frozen=True)
class Pooled(Grouping):
    """No groups: one threshold for all failing flights."""

    def fit(self, y: Array, fail_index: Indices, specification: Specification) -> None: ...


@dataclass(frozen=True)
class FirstLimit(Grouping):
    """By the limit a flight exceeds first; unknown in flight, so the highest risk counts."""

    def fit(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> tuple[GroupRule, Indices] | None:
        limits = magnitudes_of(specification)
        if limits is None or not np.isfinite(limits).any() or not len(y):
            return None
        limited = tuple(np.flatnonzero(np.isfinite(limits)).tolist())
        every = FirstLimitRule(limited, limited, tuple(limits[list(limited)].tolist()))
        exceeded = np.unique(every.of(y, fail_index))
        rule = FirstLimitRule(tuple(limited[k] for k in exceeded), limited, every.limits)
        return (rule, rule.of(y, fail_index)) if len(rule.first) > 1 else None


@dataclass(frozen=True)
class LargestDeflection(Grouping):
    """By the largest deflection of the surface that moves most: small, medium, large inputs."""

    low_deg: Annotated[float, Bounds(least=0)] = 0.0
    """small deflections below [deg]; 0: a third of the failing flights."""
    high_deg: Annotated[float, Bounds(least=0)] = 0.0
    """large deflections from [deg]; 0: a third of the failing flights."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if (self.low_deg or self.high_deg) and not 0 < self.low_deg < self.high_deg:
            raise ValueError(
                f"low_deg={self.low_deg:g} and high_deg={self.high_deg:g} were given: give the "
                "smaller one as low_deg, or neither"
            )

    def fit(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> tuple[GroupRule, Indices] | None:
        """Three groups; None if the deflections differ by less than 0.01 deg."""
        if len(y) < len(CLASSES):
            return None
        peaks = np.abs(deflections(y, fail_index, SURFACES)).max(axis=1)
        farthest = int(np.median(peaks, axis=0).argmax())
        surface = SURFACES[farthest]
        if self.low_deg:
            low, high = np.deg2rad([self.low_deg, self.high_deg]).tolist()
            rule = DeflectionRule(surface, low, high)
            return rule, rule.of(y, fail_index)
        low, high, _ = _thirds(peaks[:, farthest])
        low, high, chose = _thirds(DeflectionRule(surface, low, high).decisive(y, fail_index))
        rule = DeflectionRule(surface, low, high)
        group = rule.of(y, fail_index)
        low_deg, high_deg = np.rad2deg([low, high]).round(2)
        if not 0.0 < low_deg < high_deg or group.min() > 0:
            return None
        group[chose] = NO_GROUP
        return rule, group


def _thirds(peaks: Array) -> tuple[float, float, Indices]:
    """Peaks that divide them into thirds, and the flights these belong to."""
    order = peaks.argsort(kind="stable")
    chose = order[[len(peaks) // 3, 2 * len(peaks) // 3]]
    low, high = peaks[chose].tolist()
    return low, high, chose


CLASSES = "small", "medium", "large"
GROUPINGS: dict[str, Grouping] = family(
    "grouping",
    Grouping,
    {
        "pooled": Pooled(),
        "first_limit": FirstLimit(),
        "largest_deflection": LargestDeflection(),
    },
)


@dataclass(frozen=True, eq=False)
class Groups:
    """Calibration by groups, with equally many failures in each, so that one p-value applies.

    alphas: (n_groups, n) sorted calibration scores of each group.
    """

    section: ClassVar[str] = "groups"
    rule: GroupRule
    alphas: Array

    @classmethod
    def calibrate(
        cls,
        fitted: tuple[GroupRule, Indices] | None,
        alphas: Array,
        epsilon: float,
        guarantee: Guarantee,
    ) -> Self:
        """Calibrate each group with its first failures, as many as the smallest group has.

        fitted: result of `Grouping.fit`.   alphas: (n_unsafe,) scores, in the order of flights.
        ValueError if a group has too few failures for epsilon, with the number needed.
        """
        if fitted is None:
            raise ValueError(
                f"all {len(alphas)} failing flights are in one group: choose groups pooled"
            )
        rule, group = fitted
        by_group = [alphas[group == k] for k in range(len(rule.names))]
        smallest = min(range(len(by_group)), key=lambda k: len(by_group[k]))
        n, needed = len(by_group[smallest]), failures_needed(epsilon, guarantee)
        if n < needed:
            enough = (
                f"collect about {-(-len(alphas) * needed // n)} unsafe rollouts"
                if n
                else "change its bounds"
            )
            raise ValueError(
                f"epsilon={epsilon:g} needs at least {needed} failures in each group; of "
                f"{len(alphas)} failing flights {n} are in the group {rule.names[smallest]!r}: "
                f"{enough}, raise epsilon, or choose groups pooled"
            )
        return cls(rule, np.sort([scores[:n] for scores in by_group]))

    @property
    def n_unsafe(self) -> int:
        return self.alphas.shape[1]

    @property
    def n_early(self) -> int:
        """Failures too early for a warning, in the group with most of them."""
        return int(np.isposinf(self.alphas).sum(axis=1).max())

    def p_values(self, scores: Array, y: Array) -> tuple[Array, Indices]:
        """p-value and group of each sample of a flight: (n,) each, NaN without a score.

        scores: (n,), NaN for none.   y: (n, 6).
        """
        (until,) = self.rule.possible(y[np.newaxis])
        possible = np.arange(len(y)) < until[:, np.newaxis]
        each = np.array([p_values(scores, alphas) for alphas in self.alphas])
        group = np.where(possible.sum(axis=0) == 1, possible.argmax(axis=0), NO_GROUP)
        return np.where(possible, each, -np.inf).max(axis=0), group

    def highest_p_values(
        self, y: Array, last: Indices, lowest_scores: Callable[[Array, Indices], Array]
    ) -> Array:
        """Highest p-value of each flight over its samples 0..last; 0 where last < 0.

        y: (n, n_samples, 6).   lowest_scores: function of (y, last), over samples 0..last.
        """
        highest = np.zeros(len(y))
        for until, alphas in zip(self.rule.possible(y).T, self.alphas, strict=True):
            while_possible = np.minimum(until - 1, last)
            p = p_values(lowest_scores(y, while_possible), alphas)
            highest = np.where(while_possible < 0, highest, np.maximum(highest, p))
        return highest

    def start(self) -> "RunningGroups":
        return RunningGroups(self)

    def to_section(self) -> Section:
        header = {"kind": self.rule.kind, "rule": asdict(self.rule)}
        return Section(self.section, 1, True, header, {"alphas": self.alphas})

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the section of a file. ValueError for impossible values."""
        rule, alphas = _rule_of(section.header), section.arrays["alphas"]
        check_alphas("alphas of groups", alphas, (len(rule.names), alphas.shape[-1]))
        return cls(rule, np.ascontiguousarray(alphas))


def _rule_of(header: Mapping[str, Any]) -> GroupRule:
    values: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in header["rule"].items()
    }
    rule = RULES[header["kind"]](**values)
    rule.check()
    return rule


class RunningGroups:
    """p-values of one flight, sample by sample; bit for bit those of the whole flight."""

    def __init__(self, groups: Groups) -> None:
        self._names, self._running = groups.rule.names, groups.rule.start()
        self._alphas: list[list[float]] = groups.alphas.tolist()
        self._n = groups.n_unsafe

    @property
    def name(self) -> str | None:
        """Name of the group; None while unknown."""
        is_known = self._running.lowest == self._running.highest
        return self._names[self._running.lowest] if is_known else None

    def update(self, y: Array) -> None:
        self._running.update(y)

    def p_value(self, score: float) -> float:
        possible = self._alphas[self._running.lowest : self._running.highest + 1]
        below = min(bisect_left(alphas, score) for alphas in possible)
        return (self._n - below + 1) / (self._n + 1)
