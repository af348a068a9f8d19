"""Simulators in Python: a plain function of one flight, and how the code of others is called."""

import linecache
import traceback
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from core.bounds import quoted
from core.channels import Dictionary
from core.recipe import instead_of
from core.simulation.simulator import Distribution, Parameters
from core.types import Array, Indices, real_numbers

STANDARD, PACKAGES = Path(traceback.__file__).parent, "site-packages"
MOST_DRAWS = 20
"""Draws after which an aircraft that cannot be flown is refused."""
OURS = tuple(Path(__file__).parents[2] / name for name in ("core", "app"))


class OwnCodeError(ValueError):
    """The code of a simulator failed, or returned what cannot be used."""


class ImpossibleError(ValueError):
    """Flights with these parameters are impossible, such as of an aircraft without trim."""


@contextmanager
def running(name: str, called: object = None) -> Iterator[None]:
    """Raise errors of the user's code as OwnCodeError, with the line of that code.

    called: the function, of which the first line is named where calling it fails.
    """
    try:
        yield
    except OwnCodeError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        theirs = [frame for frame in frames if not _is_ours(frame.filename)]
        written = [frame for frame in theirs if PACKAGES not in frame.filename]
        file, line = next(
            ((frame.filename, frame.lineno) for frame in reversed(written or theirs)),
            _defined(called),
        )
        if isinstance(error, SyntaxError):
            file, line = error.filename or "", error.lineno
        text = linecache.getline(file, line or 0).strip()
        place = f" in {Path(file).name}, line {line}, {text!r}," if file else ""
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        raise OwnCodeError(f"{name} failed{place} with {what}: correct it") from error


def _defined(called: object) -> tuple[str, int | None]:
    """File and first line of a function; an empty file if unknown."""
    code = getattr(called, "__code__", None)
    return ("", None) if code is None else (code.co_filename, code.co_firstlineno)


def numbers(given: Any, what: str, needed: str) -> Array:
    """Returned by the user's code as an array. OwnCodeError with the element that is no number."""
    try:
        return np.array(real_numbers(given, what))
    except ValueError:
        raise OwnCodeError(f"{_no_array(given, what)}: {needed}") from None


def _no_array(given: Any, what: str) -> str:
    """Where what was given is no array of numbers."""
    parts = given if isinstance(given, list | tuple) or np.ndim(given) else ()
    first: tuple[int, ...] | None = None
    for k, part in enumerate(parts):
        try:
            shape = real_numbers(part, what).shape
        except ValueError:
            return _no_array(part, f"{what}[{k}]")
        first = shape if first is None else first
        if shape != first:
            return f"{what}[{k}] has shape {shape}, the first one {first}"
    return f"{what} is {_short(given)}"


def _short(given: Any) -> str:
    """What was given, in a few words."""
    if isinstance(given, np.ndarray) and given.dtype == object:
        return "an array of objects"
    if np.ndim(given):
        return f"of shape {np.shape(given)}"
    return f"{given!r}"[:60] + ("" if given is None else f" of type {type(given).__name__}")


def _is_ours(file: str) -> bool:
    """Whether a file is of this program or of the standard library."""
    if file.startswith("<") or any(Path(file).is_relative_to(place) for place in OURS):
        return True
    return Path(file).is_relative_to(STANDARD) and PACKAGES not in file


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightByFlight(ABC):
    """A simulator that flies one flight after the other, from drawn parameters and inputs.

    channels: a dictionary, or keys of the built-in ones.   dt: sample interval [s].
    parameters: nominal value and spread of each, by name.
    inputs: of each flight, the same ones or from a generator of random numbers.
    noise: of the sensors, 1 sigma by channel; limits are judged without it.
    distribution: of the parameters; the spread is a standard deviation or a half width.
    """

    channels: Dictionary | Sequence[str]
    dt: float
    parameters: Mapping[str, tuple[float, float]]
    inputs: npt.ArrayLike | Callable[[np.random.Generator], npt.ArrayLike]
    noise: Mapping[str, float] = field(default_factory=dict)
    distribution: Distribution = "normal"
    counts: Counter[str] = field(default_factory=Counter, init=False, repr=False)

    @property
    @abstractmethod
    def name(self) -> str:
        """For messages."""

    @abstractmethod
    def flown(self, theta: Array, inputs: list[Array]) -> tuple[Array, dict[int, str]]:
        """Outputs (n, n_samples, n_channels) of theta (n, n_parameters), inputs of each flight,
        and why some, by number, cannot be flown; their outputs are undefined."""

    @property
    def measured(self) -> tuple[str, ...]:
        """Keys of the channels that a flight returns."""
        if isinstance(self.channels, Dictionary):
            return self.channels.measured
        return tuple(self.channels)

    def rollouts(self, n: int, rng: np.random.Generator) -> tuple[Array, None, Array]:
        theta = parameters_of(self).sample(n, rng)
        y, theta, n_redrawn = self.drawn_again(theta, self._inputs(n, rng))
        self.counts["drawn"] += n
        self.counts["redrawn"] += n_redrawn
        return y, None, theta

    def fly(self, theta: Array, rng: np.random.Generator) -> tuple[Array, None, Array]:
        y, impossible = self.flown(theta, self._inputs(len(theta), rng))
        if impossible:
            k = min(impossible)
            raise self._refused(theta, k, impossible[k])
        return y, None, theta

    @property
    def redrawn(self) -> str:
        """How many rollouts had to be drawn again, in words; empty for none."""
        if not (n := self.counts["redrawn"]):
            return ""
        return (
            f"{n} of {n + self.counts['drawn']} rollouts could not be flown, such as aircraft "
            "without trim, and were drawn again: the promise is for those that can"
        )

    def drawn_again(self, theta: Array, inputs: list[Array]) -> tuple[Array, Array, int]:
        """Outputs and theta of flights, of which impossible ones are drawn again, and how often.

        The next draw depends on theta alone, so `rollouts` and `stopping` agree.
        """
        y, impossible = self.flown(theta, inputs)
        theta, parameters, n = theta.copy(), parameters_of(self), 0
        for _ in range(MOST_DRAWS):
            if not impossible:
                return y, theta, n
            which = sorted(impossible)
            n += len(which)
            for k in which:
                seed = np.random.SeedSequence(theta[k].view(np.uint32).tolist())
                theta[k] = parameters.sample(1, np.random.default_rng(seed))[0]
            again, still = self.flown(theta[which], [inputs[k] for k in which])
            if len(again):
                y[which] = again
            impossible = {which[k]: reason for k, reason in still.items()}
        first = min(impossible)
        raise self._refused(theta, first, f"drawn {MOST_DRAWS} times, {impossible[first]}")

    def _refused(self, theta: Array, k: int, reason: str) -> OwnCodeError:
        values = dict(zip(self.parameters, theta[k].tolist(), strict=True))
        return OwnCodeError(f"{self.name}, {rollout_in_words(k, len(theta), values)}, {reason}")

    def stopping(self, n: int, rng: np.random.Generator) -> Callable[[Indices, Indices], Array]:
        theta = parameters_of(self).sample(n, rng)
        drawn = self._inputs(n, rng)

        def stopped(which: Indices, neutral_from: Indices) -> Array:
            inputs = [drawn[k].copy() for k in which]
            for some, k in zip(inputs, neutral_from, strict=True):
                some[k:] = some[0]
            return self.drawn_again(theta[which], inputs)[0]

        return stopped

    def _inputs(self, n: int, rng: np.random.Generator) -> list[Array]:
        """(n_samples, n_inputs) of each flight, which begins with neutral controls."""
        drawn: list[Array] = []
        needed = "give finite numbers (samples,) or (samples, controls), alike for all rollouts"
        for k in range(n):
            given, what = self.inputs, f"{self.name}: inputs of rollout {k + 1}"
            if callable(given):
                with running(what, given):
                    given = given(rng)
            each = numbers(given, what, needed)
            each = each[:, np.newaxis] if each.ndim == 1 else each
            if each.ndim != 2 or len(each) < 2 or not np.isfinite(each).all():
                missing = "" if np.isfinite(each).all() else " with missing or infinite values"
                raise OwnCodeError(f"{what} is {_short(given)}{missing}: {needed}")
            if drawn and each.shape != drawn[0].shape:
                raise OwnCodeError(
                    f"{what} is of shape {each.shape}, that of rollout 1 {drawn[0].shape}: {needed}"
                )
            drawn.append(each)
        return drawn


@dataclass(frozen=True, eq=False)
class FunctionSimulator(FlightByFlight):
    """A plain function of one flight as a simulator; `simulator` declares it.

    function: (theta, inputs, t) -> outputs: theta by name, inputs (n_samples, n_inputs), t
    (n_samples,) [s]; outputs (n_samples, n_channels) in SI units, N_y and N_z in g.
    """

    function: Callable[[dict[str, float], Array, Array], npt.ArrayLike]

    @property
    def name(self) -> str:
        """Of its function, with the file and line where it begins."""
        file, line = _defined(self.function)
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return f"{name} ({Path(file).name}, line {line})" if file else name

    def flown(self, theta: Array, inputs: list[Array]) -> tuple[Array, dict[int, str]]:
        flights, names = [], list(self.parameters)
        keys = self.measured
        for k, (values, each) in enumerate(zip(theta.tolist(), inputs, strict=True)):
            t = np.arange(len(each), dtype=np.float64) * self.dt
            given = _Theta(zip(names, values, strict=True))
            where = f"{self.name}, {rollout_in_words(k, len(theta), given)}"
            with running(f"{where},", self.function):
                outputs = self.function(given, each, t)
            needed = (
                f"return ({len(t)} samples, {len(keys)} channels {', '.join(keys)}), a row for "
                "each time in t"
            )
            y = numbers(outputs, f"{where}: outputs", needed)
            if y.shape != (len(t), len(keys)):
                raise OwnCodeError(f"{where}: outputs is {_short(outputs)}: {needed}")
            flights.append(y)
            self.counts["flown"] += 1
        return np.array(flights) if flights else np.empty((0, 0, 0)), {}


class _Theta(dict[str, float]):
    """Parameters by name."""

    def __missing__(self, name: str) -> float:
        raise KeyError(f"no parameter {name}: {instead_of(name, self)}")


def rollout_in_words(k: int, n: int, theta: Mapping[str, float]) -> str:
    """`rollout 7 of 100 (gain=1.2)`.   k: its number from 0."""
    values = ", ".join(f"{name}={value:.4g}" for name, value in theta.items())
    return f"rollout {k + 1} of {n}{f' ({values})' if values else ''}"


def simulator(
    **declared: Any,
) -> Callable[[Callable[[dict[str, float], Array, Array], npt.ArrayLike]], FunctionSimulator]:
    """Declare a plain function as a simulator.   declared: fields of `FlightByFlight`."""
    return lambda function: FunctionSimulator(function, **declared)


def parameters_of(own: Any) -> Parameters:
    """The parameters that a simulator declares: nominal value and spread of each, by name."""
    given: Any = own.parameters
    distribution: Any = getattr(own, "distribution", "normal")
    if isinstance(given, Parameters):
        return given
    needed = "nominal value, spread of 0 or more"
    if not isinstance(given, Mapping):
        raise OwnCodeError(f"parameters is {quoted(given)}: give {{name: ({needed})}}")
    pairs = np.empty((len(given), 2))
    for k, (name, pair) in enumerate(given.items()):
        try:
            pairs[k] = pair
        except (TypeError, ValueError):
            pairs[k] = np.nan
        if np.shape(pair) != (2,) or not np.isfinite(pairs[k]).all() or pairs[k, 1] < 0:
            raise OwnCodeError(f"parameter {name!r} is {quoted(pair)}: give ({needed})")
    if distribution not in get_args(Distribution):
        raise OwnCodeError(f"distribution is {distribution!r}: give normal or uniform")
    return Parameters(tuple(map(str, given)), pairs[:, 0].copy(), pairs[:, 1].copy(), distribution)
