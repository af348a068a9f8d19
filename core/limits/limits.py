"""The limits of a test: which samples exceed them, and how near a sample is."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from math import inf, isfinite
from typing import Annotated, Any, NamedTuple, Self

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS, LATERAL, Channel, Dictionary
from core.kernels.reductions import exceeds_any, first_exceedance
from core.types import Array, Flags, Indices

Magnitude = Annotated[
    float | None, Bounds(above=0, words="a limit is a positive, finite magnitude")
]


class Envelope(NamedTuple):
    """Limits as numbers, one for each channel: a sample is safe strictly between low and high.

    low, high: (n_channels,), infinite for none.   rest: (n_channels,) value in trimmed flight,
    between them, from which margins count.
    """

    low: Array
    high: Array
    rest: Array

    @classmethod
    def of_magnitudes(cls, limits: Array) -> "Envelope":
        return cls(-limits, limits, np.zeros_like(limits))

    @classmethod
    def unlimited(cls, n_channels: int) -> "Envelope":
        return cls.of_magnitudes(np.full(n_channels, inf))

    def first_exceedance(self, y: Array, trim: Array | None = None) -> Indices:
        """First sample of each trajectory that exceeds a limit.

        y: (n, n_samples, n_channels). A limited channel that is not finite has diverged and
        exceeds.   trim: (n, n_channels) from which y counts; None: 0.
        Returns (n,) sample indices; n_samples without an exceedance.
        """
        trim = np.zeros((1, y.shape[2])) if trim is None else trim
        return first_exceedance(y, trim, self.low, self.high)

    @classmethod
    def widest(cls, envelopes: Sequence["Envelope | None"]) -> "Envelope | None":
        """Each channel's loosest bounds: what exceeds them exceeds each of the envelopes.

        None where one is unknown, or they limit no channel in common.
        """
        known = [each for each in envelopes if each is not None]
        if len(known) < len(envelopes):
            return None
        low, high, rest = (np.array(each) for each in zip(*known, strict=True))
        widest = cls(low.min(axis=0), high.max(axis=0), rest[0])
        return widest if widest.limited.any() else None

    @property
    def limited(self) -> Flags:
        """(n_channels,) whether a channel has a limit, at any sample if limits change in time."""
        known = np.isfinite(self.low) | np.isfinite(self.high)
        return np.asarray(known.reshape(-1, known.shape[-1]).any(axis=0))

    def exceeds(self, y: Array) -> Flags:
        """(...,) whether a sample exceeds a limit; missing values do not.

        y: (..., n_channels). The limits may be of each sample, (n, n_channels).
        """
        if y.ndim == 1:
            return exceeds_any(self.low, self.high, y)
        beyond = np.zeros(y.shape[:-1], bool)
        for c in np.flatnonzero(self.limited):
            x = y[..., c]
            beyond |= np.isfinite(x) & ((x <= self.low[..., c]) | (x >= self.high[..., c]))
        return beyond

    def shares(self, y: Array) -> Array:
        """(..., n_channels) how much of the way from rest to the nearest limit: 1 at the limit.

        y: (..., n_channels).
        """
        return shares_of(y, self.low, self.high, self.rest)

    def margin(self, y: Array) -> Array:
        """(...,) the share of the channel nearest to its limit, see `shares`."""
        return self.shares(y).max(axis=-1)

    def exceeded(self, c: int, value: float) -> float:
        """The limit of channel c that a value exceeds, see `exceeded_end`."""
        return exceeded_end(float(self.low[c]), float(self.high[c]), value)

    def is_beyond(self, c: int, value: float) -> bool:
        """Whether a value of channel c exceeds its limits; NaN does not."""
        return bool(value <= self.low[c] or value >= self.high[c])

    def intervals(self, keys: Sequence[str]) -> "dict[str, SafeInterval]":
        """The limits of the limited channels by key."""
        ends = zip(*(ends.tolist() for ends in self), strict=True)
        return {
            key: SafeInterval(*(end if isfinite(end) else None for end in (low, high)), rest=rest)
            for key, (low, high, rest) in zip(keys, ends, strict=True)
            if isfinite(low) or isfinite(high)
        }

    def row(self, k: int) -> "Envelope":
        """The limits of sample k, where they are of each sample."""
        return Envelope(self.low[k], self.high[k], self.rest[k])

    def is_as(self, other: "Envelope") -> bool:
        """Whether both permit the same values."""
        return np.array_equal(self.low, other.low) and np.array_equal(self.high, other.high)


def shares_of(y: Array, low: Array | float, high: Array | float, rest: Array | float) -> Array:
    """How much of the way from rest to the nearest limit values are: 1 at the limit.

    y, low, high, rest: of shapes that broadcast.
    """
    return np.maximum((y - rest) / (high - rest), (rest - y) / (rest - low))


def exceeded_end(low: float, high: float, value: float) -> float:
    """The end of an interval that a value is beyond; of a symmetric interval the magnitude."""
    return low if value <= low != -high else high


@dataclass(frozen=True)
class Limits:
    """Unsafe as soon as the magnitude of one channel reaches its limit: the limit itself is unsafe.

    One optional limit for each channel, in SI units (N_y in g). The default is the paper's.
    """

    beta: Magnitude = None
    p: Magnitude = None
    r: Magnitude = None
    Ny: Magnitude = 0.5
    delta_a: Magnitude = None
    delta_r: Magnitude = None

    def __post_init__(self) -> None:
        if all(limit is None for limit in asdict(self).values()):
            raise ValueError("no limit was given: set at least one channel's, for example Ny=0.5")
        check_bounds(self, "limit ")

    @property
    def magnitudes(self) -> Array:
        """(6,) limit of each channel in channel order; infinite where there is none."""
        limits = [getattr(self, key) for key in KEYS]
        return np.array([np.inf if limit is None else limit for limit in limits])

    @property
    def envelope(self) -> Envelope:
        return Envelope.of_magnitudes(self.magnitudes)

    def first_exceedance(self, y: Array) -> Indices:
        """See `Envelope.first_exceedance`.   y: (n, n_samples, 6)."""
        return self.envelope.first_exceedance(y)


SPECIFICATIONS = {"limits": Limits()}


@dataclass(frozen=True)
class SafeInterval:
    """The safe values of a channel, without the ends. None: no limit on that side.

    rest: value in trimmed flight, between the ends, from which margins count.
    """

    low: float | None = None
    high: float | None = None
    rest: float = 0.0

    def __post_init__(self) -> None:
        low, high = self.ends
        if (low, high) == (-inf, inf):
            raise ValueError("no limit was given: give low, high or both")
        if not low < self.rest < high or not isfinite(self.rest):
            raise ValueError(
                f"limits {low:g} to {high:g} were given with {self.rest:g} in trimmed flight: it "
                "must be between them"
            )

    @property
    def ends(self) -> tuple[float, float]:
        return -inf if self.low is None else self.low, inf if self.high is None else self.high


@dataclass(frozen=True)
class IntervalLimits:
    """Unsafe as soon as a channel leaves its interval; an end of the interval itself is unsafe.

    dictionary: of the samples.   intervals: by channel key; other channels have no limit.
    """

    dictionary: Dictionary
    intervals: Mapping[str, SafeInterval]

    def __post_init__(self) -> None:
        if not self.intervals:
            raise ValueError("no limit was given: set at least one channel's")
        for key in self.intervals:
            self.dictionary.index(key)

    @classmethod
    def of(
        cls,
        dictionary: Dictionary,
        ends: Mapping[str, tuple[float | None, float | None]],
        rest: Mapping[str, float],
    ) -> Self:
        """Limits from low and high by channel.   rest: values in trimmed flight, by channel.

        ValueError if trimmed flight exceeds one.
        """
        for key, (low, high) in ends.items():
            given = -inf if low is None else low, inf if high is None else high
            if not given[0] < rest[key] < given[1]:
                known = dictionary.by_key[key]
                raise ValueError(
                    f"{known.named} is {known.read(rest[key])} in trimmed flight, which its limit "
                    f"excludes, {ends_in_words(known, *given)}: give another limit, or another "
                    "trim"
                )
        return cls(dictionary, {key: SafeInterval(*ends[key], rest[key]) for key in ends})

    @cached_property
    def envelope(self) -> Envelope:
        envelope = Envelope.unlimited(len(self.dictionary))
        for key, interval in self.intervals.items():
            c = self.dictionary.index(key)
            envelope.low[c], envelope.high[c] = interval.ends
            envelope.rest[c] = interval.rest
        return envelope


Specification = Limits | IntervalLimits | str | None
"""What is unsafe for a monitor: limits, a label where only verdicts are known, or None where
unknown. Only limits can be judged from telemetry."""
PlainSpecification = dict[str, Any] | str | None
"""A specification as JSON: a magnitude or an interval by channel, the label, or null."""


def limits_in_words(dictionary: Dictionary, limits: Envelope | None) -> str:
    """`|N_y| 0.5 g`, `α below 25 deg or N_z -1 to 4.9 g`: limits in words."""
    if limits is None:
        return "unknown limits"
    ends = zip(dictionary.channels, limits.low, limits.high, strict=True)
    return " or ".join(
        f"|{channel.symbol}| {channel.read(high)}"
        if -low == high
        else f"{channel.symbol} {ends_in_words(channel, low, high)}"
        for channel, low, high in ends
        if isfinite(low) or isfinite(high)
    )


def ends_in_words(channel: Channel, low: float, high: float) -> str:
    """`-1 g to 4.9 g`, `below 25 deg`: the safe values.   low, high: infinite for none."""
    if isfinite(low) and isfinite(high):
        return f"{channel.read(low)} to {channel.read(high)}"
    return f"above {channel.read(low)}" if isfinite(low) else f"below {channel.read(high)}"


def magnitudes_of(specification: Specification) -> Array | None:
    """(6,) largest permitted magnitudes; None without limits of this kind."""
    return specification.magnitudes if isinstance(specification, Limits) else None


def envelope_of(specification: Specification) -> Envelope | None:
    """The limits as numbers; None without limits."""
    known = isinstance(specification, Limits | IntervalLimits)
    return specification.envelope if known else None


def specification_to_plain(specification: Specification) -> PlainSpecification:
    if isinstance(specification, IntervalLimits):
        return {key: asdict(interval) for key, interval in specification.intervals.items()}
    return asdict(specification) if isinstance(specification, Limits) else specification


def specification_from_plain(
    plain: PlainSpecification, dictionary: Dictionary = LATERAL
) -> Specification:
    """Rebuild a specification; channels that are not named have no limit. Raises ValueError."""
    if plain is None or isinstance(plain, str):
        return plain
    if unknown := [key for key in plain if key not in dictionary.keys]:
        raise ValueError(
            f"limits name the channel {unknown[0]!r}: choose {', '.join(dictionary.keys)}"
        )
    if dictionary == LATERAL and not any(isinstance(limit, dict) for limit in plain.values()):
        return Limits(**{key: plain.get(key) for key in KEYS})
    return IntervalLimits(dictionary, {key: SafeInterval(**limit) for key, limit in plain.items()})
