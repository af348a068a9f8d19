"""Formulas of computed channels, such as a load that is not measured or a value that lasts.

    0.7*Nz*mass + abs([pitch rate])    table(alpha, 0, 1.2, 0.3, 0.4)    lasting(Nz, 0.2)

A formula has numbers, channel keys (in brackets if they are not one word), + - * / **, parentheses
and functions. Values are in the channels' units, the result is in the computed channel's.
"""

import operator
import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from math import inf, isfinite, isnan, nan
from typing import NamedTuple

import numpy as np

from core.recipe import instead_of
from core.types import Array

MOST_CHARACTERS = 2000
DEEPEST = 40
"""Most parentheses, signs and powers inside one another."""
LONGEST_S = 10.0
"""Longest time of `lasting`, and the most that a sample's time is behind a later one [s]."""
ABOUT = 40
"""Characters on either side of an error that its message shows."""
NEAR_S = 1e-6
"""Times that differ by less are equal [s]."""


class FormulaError(ValueError):
    """A formula that cannot be read; the message gives the place."""


class Call(NamedTuple):
    """Replace the last n values by a function of them."""

    function: Callable[..., Array]
    n: int


class Lasting(NamedTuple):
    """Replace the last value by the smallest of the last seconds."""

    seconds: float


Step = np.float64 | int | Call | Lasting
"""One step of a computation on a stack: a constant, the position of a channel, or a change."""
Smallest = Callable[[int, Array, float], Array]
"""Given the place of a `lasting` in its formula, values and seconds: the smallest values."""

SIGNS: dict[str, Call] = {
    "+": Call(operator.add, 2),
    "-": Call(operator.sub, 2),
    "*": Call(operator.mul, 2),
    "/": Call(operator.truediv, 2),
    "**": Call(operator.pow, 2),
}
MINUS = Call(np.negative, 1)
FUNCTIONS: dict[str, Call] = {
    "abs": Call(np.abs, 1),
    "sqrt": Call(np.sqrt, 1),
    "sin": Call(np.sin, 1),
    "cos": Call(np.cos, 1),
    "min": Call(np.minimum, 2),
    "max": Call(np.maximum, 2),
}
"""Functions of one value, and of two or more."""
TABLE, LASTING = "table", "lasting"


@dataclass(frozen=True)
class Formula:
    """A formula as steps on a stack."""

    steps: tuple[Step, ...]

    @cached_property
    def inputs(self) -> frozenset[int]:
        """Positions of the channels that it reads."""
        return frozenset(step for step in self.steps if isinstance(step, int))

    def values(self, columns: Sequence[Array] | Array, smallest: Smallest) -> Array:
        """NaN where an input is NaN or the result is not finite.

        columns: (n_channels, ...) values of each channel.
        """
        stack: list[Array] = []
        with np.errstate(all="ignore"):
            for place, step in enumerate(self.steps):
                if isinstance(step, Call):
                    arguments = stack[-step.n :]
                    del stack[-step.n :]
                    stack.append(step.function(*arguments))
                elif isinstance(step, Lasting):
                    if np.ndim(stack[-1]):
                        stack[-1] = smallest(place, stack[-1], step.seconds)
                else:
                    stack.append(columns[step] if isinstance(step, int) else np.asarray(step))
        (values,) = stack
        known = np.isfinite(values)
        for c in self.inputs:
            known = known & ~np.isnan(columns[c])
        return np.where(known, values, nan)


def smallest_of_times(t: Array) -> Smallest:
    """Of samples along the last axis at ascending times (n,) [s]; missing ones do not count."""

    def smallest(_: int, x: Array, seconds: float) -> Array:
        first = np.searchsorted(t, t - seconds - NEAR_S)
        width = np.arange(len(t)) - first + 1
        out, low, span = np.empty_like(x), x, 1
        while span <= width.max(initial=0):
            # low: the smallest of the last `span` samples; two of them cover up to twice as many
            k = np.flatnonzero((span <= width) & (width < 2 * span))
            out[..., k] = np.fmin(low[..., k], low[..., first[k] + span - 1])
            longer = np.fmin(low[..., span:], low[..., :-span])
            low = np.concatenate([low[..., :span], longer], axis=-1)
            span *= 2
        return np.where(np.isnan(x), nan, out)

    return smallest


@dataclass
class LastingWindow:
    """The samples of a stream that `lasting` may still need, by time [s]."""

    t: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)

    def smallest(self, t: float, x: float, seconds: float) -> float:
        """The smallest known value of the seconds up to t, x among them.

        Samples may be late. A time further back begins again: the clock was set back.
        """
        if isnan(x):
            return nan
        if self.t and t < self.t[-1] - LONGEST_S:
            self.t.clear()
            self.x.clear()
        k = bisect_right(self.t, t)
        self.t.insert(k, t)
        self.x.insert(k, x)
        low = min(self.x[bisect_left(self.t, t - seconds - NEAR_S) : k + 1])
        old = bisect_left(self.t, self.t[-1] - seconds - NEAR_S)
        del self.t[:old], self.x[:old]
        return low


# --- reading --------------------------------------------------------------------------------------


class _Token(NamedTuple):
    kind: str
    text: str
    start: int


_TOKEN = re.compile(
    r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|(?P<name>[^\W\d]\w*)|\[(?P<key>[^\[\]]*)\]"
    r"|(?P<sign>\*\*|->|[<>]=?|[-+*/(),])|(?P<space>\s+)|(?P<other>.)"
)
_END = "the end"


def parse(text: str, keys: Sequence[str]) -> Formula:
    """Read a formula over channels.   keys: of the channels it may read.

    Raises FormulaError with the place and what is needed.
    """
    return FormulaParser(text, keys).read()


def spelled(key: str) -> str:
    """A channel's key as a formula names it."""
    match = _TOKEN.fullmatch(key)
    return key if match and match.lastgroup == "name" else f"[{key}]"


def _tokens(text: str) -> Iterator[_Token]:
    for match in _TOKEN.finditer(text):
        kind = match.lastgroup or ""
        if kind != "space":
            yield _Token(kind, match[kind], match.start())
    yield _Token(_END, _END, len(text))


class FormulaParser:
    """Recursive descent; the operators bind as in Python."""

    def __init__(self, text: str, keys: Sequence[str]) -> None:
        if len(text) > MOST_CHARACTERS:
            raise FormulaError(
                f"a formula has {len(text)} characters: write it with at most {MOST_CHARACTERS}"
            )
        self.text, self.keys = text, keys
        self.tokens = list(_tokens(text))
        self.at = self.depth = 0
        self.steps: list[Step] = []

    @property
    def next(self) -> _Token:
        return self.tokens[self.at]

    def read(self) -> Formula:
        self.sum()
        if self.next.kind != _END:
            raise self.error("an operator such as + or * is needed")
        return Formula(tuple(self.steps))

    def error(self, needed: str, token: _Token | None = None) -> FormulaError:
        token = token or self.next
        given = f"{token.text!r} at character {token.start + 1}"
        if token.kind == _END:
            given = "it ends too early"
        about = self.text[max(token.start - ABOUT, 0) : token.start + ABOUT]
        return FormulaError(f"formula {about!r}: {given}: {needed}")

    def accept(self, *signs: str) -> str:
        """The next sign, if it is one of these."""
        token = self.next
        if token.kind != "sign" or token.text not in signs:
            return ""
        self.at += 1
        return token.text

    def require(self, sign: str) -> None:
        if not self.accept(sign):
            raise self.error(f"{sign} is needed")

    def sum(self) -> None:
        self.product()
        while sign := self.accept("+", "-"):
            self.product()
            self.steps.append(SIGNS[sign])

    def product(self) -> None:
        self.signed()
        while sign := self.accept("*", "/"):
            self.signed()
            self.steps.append(SIGNS[sign])

    def signed(self) -> None:
        """A power with signs before it. All that nests passes here."""
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.error(f"nested too deeply: use at most {DEEPEST} levels")
        if sign := self.accept("+", "-"):
            self.signed()
            if sign == "-":
                self.steps.append(MINUS)
        else:
            self.atom()
            if self.accept("**"):
                self.signed()
                self.steps.append(SIGNS["**"])
        self.depth -= 1

    def atom(self) -> None:
        token = self.next
        if token.kind == "number":
            self.steps.append(self.number())
        elif token.kind in ("name", "key"):
            self.at += 1
            if token.kind == "name" and self.accept("("):
                self.call(token)
            else:
                self.channel(token)
        elif self.accept("("):
            self.sum()
            self.require(")")
        else:
            raise self.error("a number, a channel, a function or ( is needed")

    def channel(self, token: _Token) -> None:
        if token.text not in self.keys:
            known = instead_of(token.text, self.keys) if self.keys else "there is none"
            raise self.error(f"not a channel before this one: {known}", token)
        self.steps.append(self.keys.index(token.text))

    def call(self, name: _Token) -> None:
        """A function's arguments, after its parenthesis."""
        if name.text not in (*FUNCTIONS, TABLE, LASTING):
            known = instead_of(name.text, (*FUNCTIONS, TABLE, LASTING))
            raise self.error(f"not a function: {known}", name)
        self.sum()
        if name.text == LASTING:
            self.require(",")
            at = self.next
            seconds = self.number()
            if not 0 < seconds <= LONGEST_S:
                raise self.error(f"give more than 0 and at most {LONGEST_S:g} seconds", at)
            self.steps.append(Lasting(float(seconds)))
        elif name.text == TABLE:
            self.steps.append(self.points(name))
        else:
            function = FUNCTIONS[name.text]
            if function.n == 2 and self.next.text != ",":
                raise self.error(f"{name.text} needs two or more values")
            while function.n == 2 and self.accept(","):
                self.sum()
                self.steps.append(function)
            if function.n == 1:
                self.steps.append(function)
        self.require(")")

    def points(self, name: _Token) -> Call:
        """Interpolation between points x1, y1, x2, y2 ...; the end values hold beyond them."""
        numbers = []
        while self.accept(","):
            numbers.append(self.number())
        x, y = numbers[::2], numbers[1::2]
        if len(y) < 2 or len(x) != len(y) or (np.diff(x) <= 0).any():
            raise self.error(
                "give two or more points x1, y1, x2, y2 with ascending x after the value", name
            )
        return Call(partial(np.interp, xp=np.array(x), fp=np.array(y)), 1)

    def number(self) -> np.float64:
        sign = self.accept("+", "-")
        token = self.next
        value = float(token.text) if token.kind == "number" else inf
        if not isfinite(value):
            raise self.error("a finite number is needed")
        self.at += 1
        return np.float64(-value if sign == "-" else value)
