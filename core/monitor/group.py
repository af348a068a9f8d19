"""Groups of failing flights: a promise kept over all of them may be broken in each of a few.

A monitor that is calibrated by groups has a threshold for each (Mondrian conformal prediction:
Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World, 2005). The group of a flight is
known from a sample on, alike in calibration and in flight; until then its p-value is the largest
over the groups that are still possible, which only adds alerts.
"""

from abc import ABC, abstractmethod
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import CHANNELS, N_CHANNELS
from core.monitor.calibration import Guarantee, failures_needed, p_values
from core.monitor.file.portable import Section
from core.monitor.validity.flown_input import SURFACES
from core.monitor.validity.input_shape import deflections
from core.recipe import family
from core.specification import Specification, magnitudes_of
from core.types import Array, Flags, Indices

NO_GROUP = -1
RETURNED = 0.5
"""Share of its largest deflection below which a surface has come back from it."""


@dataclass(frozen=True)
class GroupRule(ABC):
    """Which group a flight belongs to; rules are dataclasses of plain numbers, for the file."""

    kind: ClassVar[str]

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """What people call each group."""

    @abstractmethod
    def of(self, y: Array, fail_index: Indices) -> Indices:
        """(n,) group of failing flights; NO_GROUP for what is like no flight of calibration.

        y: (n, n_samples, 6).   fail_index: (n,) first sample that exceeds a limit.
        """

    @abstractmethod
    def possible(self, y: Array) -> Indices:
        """(n, n_groups) samples, from the first one on, at which each group is still possible.

        y: (n, n_samples, 6), NaN where it is not known.
        """

    @abstractmethod
    def begin(self) -> "RunningGroup":
        """Begin a flight."""

    @abstractmethod
    def check(self) -> None:
        """Refuse what no training gives. ValueError."""


class RunningGroup:
    """Which groups one flight may belong to, sample by sample: all of them, here."""

    def __init__(self, n_groups: int) -> None:
        self.lowest, self.highest = 0, n_groups - 1

    def update(self, y: Array) -> None:
        """Take the next sample y (6,)."""


@dataclass(frozen=True)
class FirstLimitRule(GroupRule):
    """By the limit that is exceeded first, which in flight is known too late.

    Of several at one sample, the one exceeded farthest in proportion.
    first: channels that some flight of calibration exceeded first, a group each.
    limited, limits: channels with a limit, and their limits.
    """

    kind: ClassVar[str] = "first_limit"
    first: tuple[int, ...]
    limited: tuple[int, ...]
    limits: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The limit."""
        return tuple(f"{CHANNELS[k].label} limit first" for k in self.first)

    def of(self, y: Array, fail_index: Indices) -> Indices:
        """By the sample of the failure."""
        share = np.abs(y[np.arange(len(y)), fail_index][:, self.limited]) / self.limits
        share = np.where(np.isnan(share), np.inf, share)
        exceeded = np.array(self.limited)[share.argmax(axis=1)]
        group = np.full(N_CHANNELS, NO_GROUP)
        group[list(self.first)] = np.arange(len(self.first))
        return group[exceeded]

    def possible(self, y: Array) -> Indices:
        """All groups, always."""
        return np.full((len(y), len(self.first)), y.shape[1])

    def begin(self) -> RunningGroup:
        """Begin a flight of which every group stays possible."""
        return RunningGroup(len(self.first))

    def check(self) -> None:
        """Refuse channels that are none, or limits that are no magnitudes."""
        channels = [*self.first, *self.limited]
        if not all(type(k) is int and 0 <= k < N_CHANNELS for k in channels):
            raise ValueError(f"groups name the channels {channels}")
        if not set(self.first) <= set(self.limited) or len(self.limited) != len(self.limits):
            raise ValueError("groups and their limits do not fit together")
        if not all(type(limit) is float and limit > 0 for limit in self.limits):
            raise ValueError(f"groups have the limits {list(self.limits)}")


@dataclass(frozen=True)
class DeflectionRule(GroupRule):
    """By the largest deflection of one surface until it comes back, or until the failure.

    surface: channel.   low, high: [rad] between the groups.
    """

    kind: ClassVar[str] = "largest_deflection"
    surface: int
    low: float
    high: float

    @property
    def names(self) -> tuple[str, ...]:
        """The bounds."""
        low, high = np.rad2deg([self.low, self.high])
        bounds = f"below {low:.2f} deg", f"{low:.2f} to {high:.2f} deg", f"from {high:.2f} deg"
        return tuple(f"{one} deflections, {of}" for one, of in zip(CLASSES, bounds, strict=True))

    def of(self, y: Array, fail_index: Indices) -> Indices:
        """By the deflection that decides in flight; the largest before the failure if none does."""
        return self._class_of(self.decisive(y, fail_index))

    def decisive(self, y: Array, last: Indices) -> Array:
        """(n,) deflection [rad] that decides.

        y: (n, n_samples, 6).   last: (n,) last sample that counts.
        """
        flown = np.arange(y.shape[1]) <= last[:, np.newaxis]
        peak, back = self._peaks(np.where(flown, y[..., self.surface], np.nan))
        at = np.minimum(back, y.shape[1] - 1)[:, np.newaxis]
        return np.nan_to_num(np.take_along_axis(peak, at, axis=1)[:, 0])

    def possible(self, y: Array) -> Indices:
        """Until the deflection exceeds a group's, or has come back and is another's."""
        peak, back = self._peaks(y[..., self.surface])
        least = np.where(np.arange(y.shape[1]) <= back[:, np.newaxis], self._class_of(peak), 0)
        least = np.maximum.accumulate(least, axis=1)
        passed = least[..., np.newaxis] > np.arange(len(CLASSES))
        until = np.where(passed.any(axis=1), passed.argmax(axis=1), y.shape[1])
        is_own = least[:, -1:] == np.arange(len(CLASSES))
        return np.where(is_own, y.shape[1], np.minimum(until, back[:, np.newaxis]))

    def begin(self) -> RunningGroup:
        """Begin a flight."""
        return _RunningDeflection(self)

    def _peaks(self, deflection: Array) -> tuple[Array, Indices]:
        """Largest deflection so far (n, n_samples), and the first sample that is back (n,).

        deflection: (n, n_samples), NaN where it is not known.
        """
        deflection = np.abs(deflection)
        peak = np.fmax.accumulate(deflection, axis=1)
        is_back = (peak >= RETURNED * self.low) & (deflection < RETURNED * peak)
        return peak, np.where(is_back.any(axis=1), is_back.argmax(axis=1), deflection.shape[1])

    def _class_of(self, peak: Array) -> Indices:
        """The group of a deflection, NaN for none yet."""
        return np.searchsorted([self.low, self.high], np.nan_to_num(peak), side="right")

    def check(self) -> None:
        """Refuse what is no surface, and bounds that are none."""
        if self.surface not in SURFACES or type(self.surface) is not int:
            raise ValueError(f"groups are by the channel {self.surface!r}, which is no surface")
        if not (type(self.low) is type(self.high) is float and 0 < self.low < self.high < np.inf):
            raise ValueError(f"groups have the bounds {self.low!r} and {self.high!r}")


class _RunningDeflection(RunningGroup):
    def __init__(self, rule: DeflectionRule) -> None:
        super().__init__(len(CLASSES))
        self._surface, self._bounds = rule.surface, [rule.low, rule.high]
        self._begun, self._peak = RETURNED * rule.low, 0.0

    def update(self, y: Array) -> None:
        if self.lowest == self.highest:
            return
        deflection = abs(y.item(self._surface))
        if deflection >= self._peak:
            self._peak = deflection
            self.lowest = bisect_right(self._bounds, deflection)
        elif self._peak >= self._begun and deflection < RETURNED * self._peak:
            self.highest = self.lowest


RULES: dict[str, type[FirstLimitRule] | type[DeflectionRule]] = {
    rule.kind: rule for rule in (FirstLimitRule, DeflectionRule)
}


@dataclass(frozen=True)
class Grouping(ABC):
    """How failing flights are grouped, each group with a threshold of its own."""

    @abstractmethod
    def fit(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> tuple[GroupRule, Indices] | None:
        """Return a rule for flights like these and the group of each; None for less than two.

        y: (n, n_samples, 6).   fail_index: (n,) first sample that exceeds a limit, of each flight.
        A flight that chose the rule is of NO_GROUP, as it must not calibrate it.
        """

    def groups(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> dict[str, Flags]:
        """Which flights belong to each group, by its name; empty where there are not two groups.

        y, fail_index: as of `fit`.
        """
        found = self.fit(y, fail_index, specification)
        return {} if found is None else members(found[0], y, fail_index)


def members(rule: GroupRule, y: Array, fail_index: Indices) -> dict[str, Flags]:
    """Which failing flights belong to each group, by its name; arguments as of `GroupRule.of`."""
    group = rule.of(y, fail_index)
    return {name: group == k for k, name in enumerate(rule.names)}


@dataclass(frozen=True)
class Pooled(Grouping):
    """No groups: all failing flights have one threshold."""

    def fit(self, y: Array, fail_index: Indices, specification: Specification) -> None:
        """Return nothing."""


@dataclass(frozen=True)
class FirstLimit(Grouping):
    """By the limit that a flight exceeds first, known too late: the highest of the risks counts."""

    def fit(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> tuple[GroupRule, Indices] | None:
        """One group for each limit that some flight exceeds first."""
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
    """By the largest deflection of the surface that moves farthest: small, medium, large inputs."""

    low_deg: Annotated[float, Bounds(least=0)] = 0.0
    """below it deflections are small [deg]; 0: a third of the failing flights."""
    high_deg: Annotated[float, Bounds(least=0)] = 0.0
    """from it on deflections are large [deg]; 0: a third of the failing flights."""

    def __post_init__(self) -> None:
        """Refuse bounds of which one is missing, or that are not in order."""
        check_bounds(self)
        if (self.low_deg or self.high_deg) and not 0 < self.low_deg < self.high_deg:
            raise ValueError(
                f"low_deg={self.low_deg:g} and high_deg={self.high_deg:g} were given: give the "
                "smaller one as low_deg, or neither"
            )

    def fit(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> tuple[GroupRule, Indices] | None:
        """Three groups; none where the deflections scatter by less than .01 deg."""
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
    """The peaks that part them in thirds, and whose they are."""
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
    """Calibration by groups: as many failures of each, so that all alert above one p-value.

    alphas: (n_groups, n) sorted calibration scores of each group.
    """

    section: ClassVar[str] = "groups"
    rule: GroupRule
    alphas: Array

    @classmethod
    def calibrate(
        cls,
        found: tuple[GroupRule, Indices] | None,
        alphas: Array,
        epsilon: float,
        guarantee: Guarantee,
    ) -> Self:
        """Calibrate each group with its first failures, as many as the smallest group has.

        found: as `Grouping.fit` returns it.   alphas: (n_unsafe,) scores, in the order of flights.
        ValueError where a group cannot serve the epsilon, with how many failures could.
        """
        if found is None:
            raise ValueError(
                f"the {len(alphas)} failing flights are all of one group: choose groups pooled"
            )
        rule, group = found
        own = [alphas[group == k] for k in range(len(rule.names))]
        smallest = min(range(len(own)), key=lambda k: len(own[k]))
        n, needed = len(own[smallest]), failures_needed(epsilon, guarantee)
        if n < needed:
            enough = (
                f"collect about {-(-len(alphas) * needed // n)} unsafe rollouts"
                if n
                else "change its bounds"
            )
            raise ValueError(
                f"epsilon={epsilon:g} needs at least {needed} failures of each group; of "
                f"{len(alphas)} failing flights {n} are of the group {rule.names[smallest]!r}: "
                f"{enough}, raise epsilon, or choose groups pooled"
            )
        return cls(rule, np.sort([scores[:n] for scores in own]))

    @property
    def n_unsafe(self) -> int:
        """Failures of each group."""
        return self.alphas.shape[1]

    @property
    def n_early(self) -> int:
        """Most failures of a group that came too early to be warned of."""
        return int(np.isposinf(self.alphas).sum(axis=1).max())

    def p_values(self, scores: Array, y: Array) -> tuple[Array, Indices]:
        """p-value and group of each sample of a flight: (n,) each, NaN where there is no score.

        scores: (n,), NaN where there is none.   y: (n, 6).
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

        y: (n, n_samples, 6).   lowest_scores: of (y, last), over samples 0..last.
        """
        highest = np.zeros(len(y))
        for until, alphas in zip(self.rule.possible(y).T, self.alphas, strict=True):
            while_possible = np.minimum(until - 1, last)
            p = p_values(lowest_scores(y, while_possible), alphas)
            highest = np.where(while_possible < 0, highest, np.maximum(highest, p))
        return highest

    def begin(self) -> "RunningGroups":
        """Begin a flight."""
        return RunningGroups(self)

    def to_section(self) -> Section:
        """Return the section of a monitor's file."""
        header = {"kind": self.rule.kind, "rule": asdict(self.rule)}
        return Section(self.section, 1, True, header, {"alphas": self.alphas})

    @classmethod
    def of_section(cls, section: Section) -> Self:
        """Read the section of a file. ValueError where it holds what no training gives."""
        rule, alphas = _rule_of(section.header), section.arrays["alphas"]
        if alphas.ndim != 2 or len(alphas) != len(rule.names) or alphas.dtype != np.float64:
            raise ValueError(f"groups have alphas of shape {alphas.shape}, {alphas.dtype}")
        if not alphas.size or np.isnan(alphas).any() or (alphas == -np.inf).any():
            raise ValueError("groups hold no scores, or what is no number")
        if (alphas[:, 1:] < alphas[:, :-1]).any():
            raise ValueError("alphas of groups are not sorted")
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
    """The p-value of one flight's samples by its group, bit for bit as of the whole flight."""

    def __init__(self, groups: Groups) -> None:
        self._names, self._running = groups.rule.names, groups.rule.begin()
        self._alphas: list[list[float]] = groups.alphas.tolist()
        self._n = groups.n_unsafe

    @property
    def name(self) -> str | None:
        """Name of the group; None while it is not known."""
        is_known = self._running.lowest == self._running.highest
        return self._names[self._running.lowest] if is_known else None

    def update(self, y: Array) -> None:
        """Take the next sample y (6,)."""
        self._running.update(y)

    def p_value(self, score: float) -> float:
        """p-value of the newest sample's score."""
        possible = self._alphas[self._running.lowest : self._running.highest + 1]
        below = min(bisect_left(own, score) for own in possible)
        return (self._n - below + 1) / (self._n + 1)
