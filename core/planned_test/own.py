"""Simulators of others: a Python object, or a plain function of one flight, as a planned test."""

import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_args

import numpy as np
import numpy.typing as npt

from core.bounds import Bounds, check_bounds
from core.channels import Dictionary
from core.computed import complete
from core.limits.limits import IntervalLimits, Limits, Specification, envelope_of
from core.monitor.group import GROUPINGS, Grouping
from core.rollouts import LABEL, dictionary_of, labels, unlike
from core.seeds import Branch, stream
from core.simulation.simulator import Distribution, Parameters, Rollouts, Stopped
from core.types import Array, Flags, Indices

STANDARD, PACKAGES = Path(traceback.__file__).parent, "site-packages"
OURS = tuple(Path(__file__).parents[2] / name for name in ("core", "app"))


class OwnCodeError(ValueError):
    """The code of a simulator failed, or returned what cannot be used."""


@contextmanager
def running(name: str) -> Iterator[None]:
    """Raise errors of somebody's code as OwnCodeError, with the line of that code."""
    try:
        yield
    except OwnCodeError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        theirs = [frame for frame in frames if not _is_ours(frame.filename)]
        written = [frame for frame in theirs if PACKAGES not in frame.filename]
        frame = (written or theirs or frames)[-1]
        place, line = f"{Path(frame.filename).name}, line {frame.lineno}", frame.line
        if isinstance(error, SyntaxError):
            place, line = f"{Path(error.filename or '').name}, line {error.lineno}", error.text
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        raise OwnCodeError(
            f"{name} failed in {place}, {(line or '').strip()!r}, with {what}: correct it"
        ) from error


def _is_ours(file: str) -> bool:
    """Whether a file is of this program or of the standard library."""
    if file.startswith("<") or any(Path(file).is_relative_to(place) for place in OURS):
        return True
    return Path(file).is_relative_to(STANDARD) and PACKAGES not in file


@dataclass(frozen=True, eq=False)
class FunctionSimulator:
    """A plain function of one flight as a simulator; `simulator` declares it.

    function: (theta, inputs, t) -> outputs: theta by name, inputs (n_samples, n_inputs), t
    (n_samples,) [s]; outputs (n_samples, n_channels) in SI units, N_y and N_z in g.
    channels: a dictionary, or keys of the built-in ones.   dt: sample interval [s].
    parameters: nominal value and spread of each, by name.
    inputs: of each flight, the same ones or from a generator of random numbers.
    noise: of the sensors, 1 sigma by channel; limits are judged without it.
    distribution: of the parameters; the spread is a standard deviation or a half width.
    """

    function: Callable[[dict[str, float], Array, Array], npt.ArrayLike]
    channels: Dictionary | Sequence[str]
    dt: float
    parameters: Mapping[str, tuple[float, float]]
    inputs: npt.ArrayLike | Callable[[np.random.Generator], npt.ArrayLike]
    noise: Mapping[str, float] = field(default_factory=dict)
    distribution: Distribution = "normal"

    def rollouts(self, n: int, rng: np.random.Generator) -> tuple[Array, None, Array]:
        theta = parameters_of(self).sample(n, rng)
        return self._flown(theta, self._inputs(n, rng)), None, theta

    def fly(self, theta: Array, rng: np.random.Generator) -> tuple[Array, None, Array]:
        return self._flown(theta, self._inputs(len(theta), rng)), None, theta

    def stopping(self, n: int, rng: np.random.Generator) -> Callable[[Indices, Indices], Array]:
        theta = parameters_of(self).sample(n, rng)
        drawn = self._inputs(n, rng)

        def stopped(which: Indices, neutral_from: Indices) -> Array:
            inputs = [drawn[k].copy() for k in which]
            for some, k in zip(inputs, neutral_from, strict=True):
                some[k:] = some[0]
            return self._flown(theta[which], inputs)

        return stopped

    def _inputs(self, n: int, rng: np.random.Generator) -> list[Array]:
        """(n_samples, n_inputs) of each flight, which begins with neutral controls."""
        given = (self.inputs(rng) if callable(self.inputs) else self.inputs for _ in range(n))
        inputs = [np.array(each, np.float64) for each in given]
        return [each[:, np.newaxis] if each.ndim == 1 else each for each in inputs]

    def _flown(self, theta: Array, inputs: list[Array]) -> Array:
        flights, names = [], list(self.parameters)
        for values, each in zip(theta.tolist(), inputs, strict=True):
            t = np.arange(len(each), dtype=np.float64) * self.dt
            y = np.array(self.function(dict(zip(names, values, strict=True)), each, t), np.float64)
            if y.ndim != 2 or len(y) != len(t):
                raise OwnCodeError(
                    f"the function returned outputs of shape {y.shape}: give ({len(t)} samples, "
                    "channels), a row for each sample of t"
                )
            flights.append(y)
        return np.array(flights) if flights else np.empty((0, 0, 0))


def simulator(
    **declared: Any,
) -> Callable[[Callable[[dict[str, float], Array, Array], npt.ArrayLike]], FunctionSimulator]:
    """Declare a plain function as a simulator.   declared: fields of `FunctionSimulator`."""
    return lambda function: FunctionSimulator(function, **declared)


def parameters_of(own: Any) -> Parameters:
    """The parameters that a simulator declares: nominal value and spread of each, by name."""
    given: Any = own.parameters
    distribution: Any = getattr(own, "distribution", "normal")
    if isinstance(given, Parameters):
        return given
    try:
        pairs = np.array([given[name] for name in given], np.float64).reshape(len(given), 2)
    except (TypeError, ValueError, KeyError, IndexError):
        pairs = np.full((1, 2), np.nan)
    if not (np.isfinite(pairs).all() and (pairs[:, 1] >= 0).all()):
        raise OwnCodeError(f"parameters is {given!r}: give {{name: (nominal value, spread)}}")
    if distribution not in get_args(Distribution):
        raise OwnCodeError(f"distribution is {distribution!r}: give normal or uniform")
    return Parameters(tuple(map(str, given)), pairs[:, 0].copy(), pairs[:, 1].copy(), distribution)


@dataclass(frozen=True, eq=False)
class OwnSimulator:
    """Somebody's simulator: what it returns is checked, and judged by limits.

    own: has dictionary or channels, parameters, dt and rollouts(n, rng) -> (y, fail_index, theta),
    see `Dataset.from_rollouts`; fail_index may be None. It may have fly(theta, rng), which returns
    the same, stopping(n, rng), see `Stops`, or one whose function returns y, and noise, which is
    added here. This has `fly` and `stopping` only if it has.
    name: for messages and provenance.   dictionary: its channels, and computed ones.
    n_samples: of each flight; 0 if unknown as yet.
    """

    own: Any
    name: str
    dictionary: Dictionary
    parameters: Parameters
    dt: float
    specification: Specification = LABEL
    n_samples: int = 0

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
            remedy = "give an object with dictionary, parameters, dt and rollouts(n, rng)"
            if callable(own) and not isinstance(own, type):
                remedy = "declare it by @simulator(channels=, dt=, parameters=, inputs=)"
            raise OwnCodeError(f"{name} is a {type(own).__name__}, not a simulator: {remedy}")
        if not isinstance(channels, Dictionary):
            channels = dictionary_of(channels)
        for key, sigma in getattr(own, "noise", {}).items():
            channels.index(key)
            if not 0 <= sigma < np.inf:
                raise OwnCodeError(f"{name} has noise={sigma} in {key}: give its sigma, 0 or more")
        with running(name):
            made = cls(own, name, channels, parameters_of(own), float(own.dt))
        if not 0 < made.dt < np.inf:
            raise OwnCodeError(f"{name} has dt={made.dt}: give its sample interval in seconds")
        return made

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
        self._check(unknown)
        return Rollouts(self._measured(y, rng), fails, theta)

    def outputs(self, n: int, seed: int) -> Array:
        """(n, n_samples, n_measured) of n flights, to see them before limits are set. OwnCodeError.

        Refuses flights that are alike, or differ at the same seed.
        """
        y, again = (
            self._given(n, self.own.rollouts, n, stream(seed, Branch.PILOT_RUN))[0]
            for _ in range(2)
        )
        if not np.array_equal(y, again, equal_nan=True):
            raise OwnCodeError(
                f"{self.name} returned other flights at the same seed: draw all random numbers "
                "from the generator that it is given"
            )
        self._check(~np.isfinite(y[:, :1]))
        self.check_unlike(y)
        return y

    def check_unlike(self, y: Array) -> None:
        """OwnCodeError if flights repeat others: those that train and those that test would too."""
        if n := int((~unlike(y)).sum()):
            raise OwnCodeError(
                f"{self.name} returned {n} flights of {len(y)} that repeat another one: give its "
                "parameters spreads, and draw every flight from the generator that it is given"
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

        def stopped(which: Indices, neutral_from: Indices) -> Indices:
            if not len(which):
                return which
            with running(self.name):
                again = np.array(repeat(which, neutral_from))
            if again.shape == which.shape:
                return again
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
        with running(self.name):
            given = make(*arguments)
        try:
            y, fail_index, theta = given
            y, theta = np.array(y, np.float64), np.array(theta, np.float64)
        except (TypeError, ValueError) as error:
            raise OwnCodeError(
                f"{self.name} returned {type(given).__name__} ({error}): return y, fail_index "
                "(None where limits tell) and theta"
            ) from error
        measured, n_parameters = self.dictionary.measured, len(self.parameters.names)
        n_samples = self.n_samples or (y.shape[1] if y.ndim == 3 else 0)
        if y.shape != (n, n_samples, len(measured)) or theta.shape != (n, n_parameters):
            raise OwnCodeError(
                f"{self.name} returned y of shape {y.shape} and theta of shape {theta.shape}: give "
                f"({n} flights, {n_samples or 'some'} samples, {len(measured)} channels "
                f"{', '.join(measured)}) and ({n} flights, {n_parameters} parameters)"
            )
        return y, fail_index, theta

    def _failures(self, y: Array, fail_index: Any) -> tuple[Indices, Flags]:
        """(n,) first failing sample, and (n, n_samples, n_channels) whether a value up to it is
        not finite."""
        whole = complete(self.dictionary, y, self.dt)
        limits = None if isinstance(self.specification, str) else self.specification
        fails = labels(whole, fail_index, limits)[0]
        flown = np.arange(y.shape[1]) <= fails[:, np.newaxis]
        return fails, ~np.isfinite(whole) & flown[..., np.newaxis]

    def _check(self, unknown: Flags) -> None:
        if unknown.any():
            n = int(unknown.any(axis=(1, 2)).sum())
            _, k, c = np.argwhere(unknown)[0].tolist()
            raise OwnCodeError(
                f"{self.name} returned no finite {self.dictionary.keys[c]} in {n} of "
                f"{len(unknown)} flights, first at {k * self.dt:g} s: give finite numbers until a "
                "flight fails"
            )


@dataclass(frozen=True, eq=False)
class OwnTest:
    """A test that somebody's simulator flies, and how much of it to simulate."""

    flown_by: OwnSimulator
    n_unsafe: Annotated[int, Bounds(least=2)] = 500
    n_obs: Annotated[int, Bounds(least=1)] = 50
    seed: Annotated[int, Bounds(least=0)] = 0
    max_rollouts: Annotated[int, Bounds(least=1)] = 50_000
    max_safe: Annotated[int, Bounds(least=1)] = 10_000

    groups: ClassVar[Grouping] = GROUPINGS["pooled"]
    most_at_once: ClassVar[int] = 256
    remedy: ClassVar[str] = "give the parameters larger spreads, lower the limit"

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def specification(self) -> Specification:
        return self.flown_by.specification

    def simulator(self) -> OwnSimulator:
        return self.flown_by

    def to_plain(self) -> dict[str, Any]:
        """Its provenance; the simulator's code is not part of it."""
        names, nominal, spread, distribution = self.flown_by.parameters
        each = zip(names, nominal.tolist(), spread.tolist(), strict=True)
        sizes = ("n_unsafe", "n_obs", "seed", "max_rollouts", "max_safe")
        return {
            "simulator": self.flown_by.name,
            "parameters": {name: {"nominal": at, "spread": by} for name, at, by in each},
            "distribution": distribution,
            **{size: getattr(self, size) for size in sizes},
        }
