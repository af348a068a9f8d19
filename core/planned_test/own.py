"""A user's own simulator as a planned test: an object, checked, and judged by limits."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import Dictionary
from core.computed import complete
from core.limits.limits import IntervalLimits, Limits, Specification, envelope_of
from core.monitor.group import GROUPINGS, Grouping
from core.rollouts import LABEL, dictionary_of, labels, unlike
from core.seeds import Branch, stream
from core.simulation.python_simulator import (
    FlightByFlight,
    OwnCodeError,
    numbers,
    parameters_of,
    rollout_in_words,
    running,
)
from core.simulation.python_simulator import simulator as simulator
from core.simulation.simulator import Parameters, Rollouts, Stopped
from core.types import Array, Flags, Indices


@dataclass(frozen=True, eq=False)
class OwnSimulator:
    """A user's simulator: its flights are checked, and judged by limits.

    own: has dictionary or channels, parameters, dt and rollouts(n, rng) -> (y, fail_index, theta),
    see `Dataset.from_rollouts`; fail_index may be None. It may have fly(theta, rng), which returns
    the same, stopping(n, rng), see `Stops`, or one whose function returns y, and noise, which is
    added here. This class has `fly` and `stopping` only if `own` has them.
    name: for messages and provenance.   dictionary: its channels, and computed ones.
    n_samples: of each flight; 0 if not yet known.   counts: of flights "asked" for and "flown".
    """

    own: Any
    name: str
    dictionary: Dictionary
    parameters: Parameters
    dt: float
    specification: Specification = LABEL
    n_samples: int = 0
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        for name in ("fly", "stopping"):
            if callable(getattr(self.own, name, None)):
                object.__setattr__(self, name, getattr(self, f"_{name}"))

    @classmethod
    def of(cls, own: Any, name: str) -> "OwnSimulator":
        """Check a declaration; without limits as yet. OwnCodeError."""
        with running(name):
            lacks = [part for part in ("parameters", "dt", "rollouts") if not hasattr(own, part)]
            channels = getattr(own, "dictionary", None) or getattr(own, "channels", None)
        if lacks or channels is None or isinstance(own, type):
            what = f"of type {type(own).__name__} without {', '.join(lacks) or 'channels'}"
            remedy = "give an object with dictionary, parameters, dt and rollouts(n, rng)"
            if isinstance(own, type):
                what = "a class"
            elif callable(own):
                remedy = "declare it by @simulator(channels=, dt=, parameters=, inputs=)"
            raise OwnCodeError(f"{name} is {what}, not a simulator: {remedy}")
        if not isinstance(channels, Dictionary):
            channels = dictionary_of(channels)
        noise = getattr(own, "noise", {})
        if not isinstance(noise, Mapping):
            raise OwnCodeError(f"{name} has noise={noise!r}: give {{channel: sigma}}")
        for key, sigma in noise.items():
            channels.index(key)
            needed = "give its sigma, 0 or more"
            if not 0 <= numbers(sigma, f"{name}: noise of {key}", needed) < np.inf:
                raise OwnCodeError(f"{name} has noise={sigma} in {key}: {needed}")
        needed = "give its sample interval in seconds"
        dt = numbers(own.dt, f"{name}: dt", needed)
        if dt.shape or not 0 < dt < np.inf:
            raise OwnCodeError(f"{name} has dt={own.dt}: {needed}")
        counts = own.counts if isinstance(own, FlightByFlight) else Counter[str]()
        return cls(own, name, channels, parameters_of(own), float(dt), counts=counts)

    def judged(
        self, dictionary: Dictionary, limits: Limits | IntervalLimits | None, n_samples: int
    ) -> Self:
        """Judged by limits, with computed channels in its dictionary; None: labels tell."""
        specification = LABEL if limits is None else limits
        return replace(
            self, dictionary=dictionary, specification=specification, n_samples=n_samples
        )

    def rollouts(self, n: int, rng: np.random.Generator) -> Rollouts:
        y, fail_index, theta = self._given(n, self.own.rollouts, n, rng)
        fails, unknown = self._failures(y, fail_index)
        self._check(unknown, theta)
        return Rollouts(self._measured(y, rng), fails, theta)

    def outputs(self, n: int, seed: int) -> Array:
        """(n, n_samples, n_measured) of n flights, to see them before limits are set. OwnCodeError.

        Refuses flights that are alike, or differ at the same seed.
        """
        (y, _, theta), (again, _, _) = (
            self._given(n, self.own.rollouts, n, stream(seed, Branch.PILOT_RUN)) for _ in range(2)
        )
        if not np.array_equal(y, again, equal_nan=True):
            raise OwnCodeError(
                f"{self.name} returned other flights at the same seed: draw all random numbers "
                "from the generator that it is given"
            )
        self._check(~np.isfinite(y[:, :1]), theta)
        if hasattr(self, "fly") and not isinstance(self.own, FlightByFlight):  # else found last
            self._given(2, self.own.fly, theta[:2].copy(), stream(seed, Branch.PILOT_RUN))
        self.check_unlike(y)
        self._check_units(y)
        return y

    def _check_units(self, y: Array) -> None:
        """OwnCodeError if most flights reach values that no aircraft does."""
        by_key = self.dictionary.by_key
        for c, key in enumerate(self.dictionary.measured):
            channel, peaks = by_key[key], np.nanmax(np.abs(y[..., c]), axis=1)
            if channel.largest is not None and np.median(peaks) > channel.largest:
                raise OwnCodeError(
                    f"{self.name} returned {key} up to {peaks.max():.4g} {channel.unit}, where "
                    f"{channel.largest:.4g} {channel.unit} is the most of any aircraft: return it "
                    f"in {channel.unit}"
                )

    def reached(self, y: Array) -> str:
        """Largest values of the limited channels in flights, as the beginning of a remedy.

        y: (n, n_samples, n_measured).
        """
        if (envelope := envelope_of(self.specification)) is None:
            return ""
        ends = complete(self.dictionary, y, self.dt)
        ranges = [
            f"{channel.key} from {np.nanmin(ends[..., c]):.3g} to {np.nanmax(ends[..., c]):.3g} "
            f"{channel.unit} with limits {envelope.low[c]:.4g} and {envelope.high[c]:.4g}"
            for c, channel in enumerate(self.dictionary.channels)
            if np.isfinite([envelope.low[c], envelope.high[c]]).any()
        ]
        return (
            f"the first {len(y)} flights have {'; '.join(ranges)}: check the units of outputs "
            "and limits, "
        )

    def check_unlike(self, y: Array) -> None:
        """OwnCodeError if flights repeat others: those that train and those that test would too."""
        if n := int((~unlike(y)).sum()):
            raise OwnCodeError(
                f"{self.name} returned {n} flights of {len(y)} that repeat another one: give its "
                "parameters spreads and its flights inputs, and draw every flight from the "
                "generator that it is given"
            )

    def _fly(self, theta: Array, rng: np.random.Generator) -> tuple[Rollouts, Array]:
        y, fail_index, theta = self._given(len(theta), self.own.fly, theta, rng)
        fails, unknown = self._failures(y, fail_index)
        envelope, peaks = envelope_of(self.specification), np.zeros(len(y))
        if envelope is not None:
            margins = envelope.margin(complete(self.dictionary, y, self.dt))
            peaks = np.nan_to_num(margins, posinf=0.0).max(axis=1)
        peaks[unknown.any(axis=(1, 2))] = np.inf
        return Rollouts(self._measured(y, rng), fails, theta), peaks

    def _stopping(self, n: int, rng: np.random.Generator) -> Stopped:
        with running(self.name):
            repeat = self.own.stopping(n, rng)
        if not callable(repeat):
            raise OwnCodeError(
                f"{self.name}: stopping(n, rng) returned type {type(repeat).__name__}: return a "
                "function of flights and samples"
            )

        def stopped(which: Indices, neutral_from: Indices) -> Indices:
            if not len(which):
                return which
            with running(self.name, repeat):
                given = repeat(which, neutral_from)
            again = numbers(given, f"{self.name}: y of stopped flights", f"return {len(which)}")
            if again.shape == which.shape:
                return again.astype(np.int64)
            theta = np.empty((len(which), len(self.parameters.names)))
            y = self._given(len(which), lambda: (again, None, theta))[0]
            fails, unknown = self._failures(y, None)
            self._check(unknown)
            return fails

        return stopped

    def _measured(self, y: Array, rng: np.random.Generator) -> Array:
        """Outputs with the noise of the sensors, and computed channels."""
        noise = getattr(self.own, "noise", {})
        for key in noise:
            c = self.dictionary.measured.index(key)
            y[..., c] += noise[key] * rng.standard_normal(y.shape[:2])
        return complete(self.dictionary, y, self.dt)

    def _given(self, n: int, make: Callable[..., Any], *arguments: Any) -> tuple[Array, Any, Array]:
        """y (n, n_samples, n_measured), fail_index or None, and theta (n, n_parameters)."""
        self.counts["asked"] += n
        with running(self.name, make):
            given = make(*arguments)
        self.counts["flown"] = self.counts["asked"]
        if not isinstance(given, tuple | list) or len(given) != 3:
            what = f"type {type(given).__name__}"
            if isinstance(given, tuple | list):
                what = f"{len(given)} values"
            raise OwnCodeError(
                f"{self.name} returned {what}: return three values, y, fail_index (None where "
                "limits tell) and theta"
            )
        measured, n_parameters = self.dictionary.measured, len(self.parameters.names)
        need_y = f"{len(measured)} channels {', '.join(measured)})"
        need_y = f"give ({n} flights, {self.n_samples or 'as many'} samples each, {need_y}"
        need_theta = f"give theta ({n} flights, {n_parameters} parameters)"
        y = np.ascontiguousarray(numbers(given[0], f"{self.name}: y", need_y))
        theta = numbers(given[2], f"{self.name}: theta", need_theta)
        n_samples = self.n_samples or (y.shape[1] if y.ndim == 3 else 0)
        if y.shape != (n, n_samples, len(measured)):
            raise OwnCodeError(f"{self.name} returned y of shape {y.shape}: {need_y}")
        if theta.shape != (n, n_parameters):
            raise OwnCodeError(f"{self.name} returned theta of shape {theta.shape}: {need_theta}")
        return y, given[1], theta

    def _failures(self, y: Array, fail_index: Any) -> tuple[Indices, Flags]:
        """(n,) first failing sample, and (n, n_samples, n_channels) whether a value up to it is
        not finite."""
        whole = complete(self.dictionary, y, self.dt)
        limits = None if isinstance(self.specification, str) else self.specification
        if limits is None and fail_index is None:
            keys = self.dictionary.keys
            shown = keys.index("Nz") if "Nz" in keys else 0
            high = np.quantile(np.nanmax(whole[..., shown], axis=1), 0.75)
            raise OwnCodeError(
                f"no limit tells which flights of {self.name} fail, and they have no fail_index: "
                f"limit any of {', '.join(keys)}, such as --limit {keys[shown]}=..{high:.3g}, in "
                f"{self.dictionary.channels[shown].unit}, which a quarter of these flights exceed"
            )
        if fail_index is not None:
            needed = f"give the first failing sample or -1 for each of {len(y)} flights, or None"
            if np.asarray(fail_index).dtype == bool:
                raise OwnCodeError(f"{self.name} returned true and false as fail_index: {needed}")
            fail_index = numbers(fail_index, f"{self.name}: fail_index", needed)
            if not np.array_equal(fail_index, np.round(fail_index)):
                raise OwnCodeError(f"{self.name} returned fractions in fail_index: {needed}")
        fails = labels(whole, fail_index, limits)[0]
        flown = np.arange(y.shape[1]) <= fails[:, np.newaxis]
        return fails, ~np.isfinite(whole) & flown[..., np.newaxis]

    def _check(self, unknown: Flags, theta: Array | None = None) -> None:
        if not unknown.any():
            return
        n, (f, k, c) = len(unknown), np.argwhere(unknown)[0].tolist()
        values = {} if theta is None else dict(zip(self.parameters.names, theta[f], strict=True))
        raise OwnCodeError(
            f"{self.name} returned no finite {self.dictionary.keys[c]} in "
            f"{int(unknown.any(axis=(1, 2)).sum())} of {n} flights, first in "
            f"{rollout_in_words(f, n, values)} at sample {k}, {k * self.dt:g} s: give finite "
            "numbers until a flight fails"
        )


@dataclass(frozen=True, eq=False)
class OwnTest:
    """A test that a user's simulator flies, and how much of it to simulate.

    pilot: values that its first flights reached, for errors; empty if unknown.
    """

    flown_by: OwnSimulator
    n_unsafe: Annotated[int, Bounds(least=2)] = 500
    n_obs: Annotated[int, Bounds(least=1)] = 50
    seed: Annotated[int, Bounds(least=0)] = 0
    max_rollouts: Annotated[int, Bounds(least=1)] = 50_000
    max_safe: Annotated[int, Bounds(least=1)] = 10_000
    pilot: str = ""

    groups: ClassVar[Grouping] = GROUPINGS["pooled"]
    most_at_once: ClassVar[int] = 256

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def judged_by(self) -> Specification:
        """Limits or label that decide which flights fail."""
        return self.flown_by.specification

    @property
    def for_more(self) -> str:
        return f"{self.pilot}give the parameters larger spreads, lower the limit"

    @property
    def for_fewer(self) -> str:
        return f"{self.pilot}give the parameters smaller spreads, raise the limit"

    def simulator(self) -> OwnSimulator:
        return self.flown_by

    def to_plain(self) -> dict[str, Any]:
        """Its provenance, without code, but with a model's own description."""
        names, nominal, spread, distribution = self.flown_by.parameters
        each = zip(names, nominal.tolist(), spread.tolist(), strict=True)
        sizes = ("n_unsafe", "n_obs", "seed", "max_rollouts", "max_safe")
        return {
            "simulator": self.flown_by.name,
            "parameters": {name: {"nominal": at, "spread": by} for name, at, by in each},
            "distribution": distribution,
            **getattr(self.flown_by.own, "about", {}),
            **{size: getattr(self, size) for size in sizes},
        }
