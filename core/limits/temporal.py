"""Requirements in signal temporal logic: what must hold of a whole flight, not of a sample.

    always (abs(beta) > 0.1 implies eventually[0:2] abs(beta) < 0.05)
    alpha < 0.3 until[0:5] Nz > 2

A comparison has formulas of `core.formulas` on both sides, in the units of the channels; times are
seconds. Words, from the loosest: implies, or, and, until and since, not. always, eventually and
until look ahead; historically, once and since look back. Sources: Maler and Nickovic, "Monitoring
Temporal Properties of Continuous Signals", 2004; Donze and Maler, "Robust Satisfaction of Temporal
Logic over Real-Valued Signals", 2010.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, inf
from typing import Literal

import numpy as np
from scipy.ndimage import minimum_filter1d

from core.formulas import (
    DEEPEST,
    LONGEST_S,
    MINUS,
    NEAR_S,
    SIGNS,
    Formula,
    FormulaError,
    FormulaParser,
    smallest_of_times,
)
from core.types import Array, Indices

Kind = Literal["holds", "not", "and", "always", "until", "historically", "since"]
COMPARED = "<", "<=", ">", ">="
TIMES = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*[:,]\s*(\d+\.?\d*|\.\d+)\s*")
"""An interval of times, between brackets."""
BACK: tuple[Kind, ...] = ("historically", "since")
UNARY: dict[str, tuple[Kind, bool]] = {
    "always": ("always", False),
    "eventually": ("always", True),
    "historically": ("historically", False),
    "once": ("historically", True),
}
"""Word: its operator, and whether that is of the negation."""


@dataclass(frozen=True)
class Node:
    """A part of a requirement.

    first, last: times that it is about, from or before the sample [s].   formula: of a comparison,
    positive where it holds.   text: the same as a formula.
    """

    kind: Kind
    parts: tuple["Node", ...] = ()
    first: float = 0.0
    last: float = inf
    formula: Formula | None = None
    text: str = ""

    @property
    def is_of_start(self) -> bool:
        """Whether a comparison in it is judged at the beginning of a flight alone."""
        return self.kind == "holds" or (
            self.kind in ("not", "and") and any(part.is_of_start for part in self.parts)
        )

    def can_be(self, holds: bool, seconds: float) -> bool:
        """Whether so many more seconds [s] of a flight can decide that it holds, or not."""
        if self.kind == "holds" or self.kind in BACK:
            return seconds >= 0.0
        if self.kind == "not":
            return self.parts[0].can_be(not holds, seconds)
        if self.kind == "and":
            return (all if holds else any)(part.can_be(holds, seconds) for part in self.parts)
        if self.kind == "always":
            return self.parts[0].can_be(holds, seconds - (self.last if holds else self.first))
        held, reached = self.parts
        if holds:
            return reached.can_be(True, seconds - self.first)
        return held.can_be(False, seconds) or reached.can_be(False, seconds - self.last)

    @property
    def negated(self) -> "Node":
        return self.parts[0] if self.kind == "not" else Node("not", (self,))

    def either(self, other: "Node") -> "Node":
        return Node("and", (self.negated, other.negated)).negated


@dataclass(frozen=True)
class Requirement:
    """A requirement on flights. text: as it was written."""

    text: str
    node: Node

    @classmethod
    def parse(cls, text: str, keys: Sequence[str]) -> "Requirement":
        """keys: of the channels.   FormulaError."""
        node = _Parser(text, keys).requirement()
        if node.is_of_start:
            raise FormulaError(
                f"{text!r}: a comparison is outside of always, eventually and until, so only the "
                "beginning of a flight would be judged: write always (...)"
            )
        return cls(text.strip(), node)

    @cached_property
    def formula(self) -> str | None:
        """A formula of its robustness that needs no later sample; None if there is none.

        It exists for `always`, without times, of words that look back by times from 0.
        """
        node = self.node
        is_always = node.kind == "always" and (node.first, node.last) == (0.0, inf)
        return _formula(node.parts[0]) if is_always else None

    def check_can_fail(self, n_samples: int, dt: float) -> None:
        """FormulaError if no flight of so many samples, one each dt [s], can violate it."""
        if not self.node.can_be(False, (n_samples - 1 + NEAR_S) * dt):
            raise FormulaError(
                f"{self.text!r}: flights of {(n_samples - 1) * dt:g} s end before its times do, so "
                "none can violate it: give shorter times, as in eventually[0:2], or longer flights"
            )

    def robustness(self, y: Array, dt: float) -> tuple[Array, Array]:
        """Least and largest robustness at each sample, whatever follows the flight; both (n, k).

        It is negative where the requirement is violated. y: (n, k, n_channels), NaN where
        unknown.   dt: [s].   FormulaError if no sample lies within the times of an operator.
        """
        low, high = _Flights(y, dt).bounds(self.node)
        return low, high

    def first_violation(self, y: Array, dt: float) -> Indices:
        """(n,) first sample up to which a flight violates it, whatever follows; k if none does.

        A robustness of 0 violates. Arguments as of `robustness`.
        """
        n, n_samples = y.shape[:2]
        violated = np.full(n, n_samples)
        fails = np.flatnonzero(self.robustness(y, dt)[1][:, 0] <= 0.0)
        flights = _Flights(y[fails], dt)
        known, before = np.full(len(fails), n_samples - 1), np.full(len(fails), -1)
        while (known - before > 1).any():
            middle = (known + before) // 2
            flights.known = middle
            does = flights.bounds(self.node)[1][:, 0] <= 0.0
            known, before = np.where(does, middle, known), np.where(does, before, middle)
        violated[fails] = known
        return violated


class _Flights:
    """Flights whose samples are known up to one, all of them at first.

    Robustness is an array (2, n, k), the least and the largest that later samples leave possible.
    """

    def __init__(self, y: Array, dt: float) -> None:
        self._columns, self._dt = np.ascontiguousarray(np.moveaxis(y, -1, 0)), dt
        self._samples = np.arange(y.shape[1])
        self._smallest = smallest_of_times(self._samples * dt)
        self.known = np.full(len(y), y.shape[1] - 1)

    def bounds(self, node: Node) -> Array:
        parts = [self.bounds(part) for part in node.parts]
        if node.formula is not None:
            values = node.formula.values(self._columns, self._smallest)
            values = np.broadcast_to(values, self._columns.shape[1:])
            is_known = np.isfinite(values) & (self._samples <= self.known[:, np.newaxis])
            return np.stack([np.where(is_known, values, -inf), np.where(is_known, values, inf)])
        if node.kind == "not":
            return -parts[0][::-1]
        if node.kind == "and":
            return np.minimum(*parts)
        first, last = self._window(node)
        if node.kind in BACK:
            # before a flight begins nothing is unknown: `historically` holds, `since` does not
            back = [part[..., ::-1] for part in parts]
            there = inf if node.kind == "historically" else -inf
            return _ahead(back, first, last, (there, there))[..., ::-1]
        return _ahead(parts, first, last, (-inf, inf))

    def _window(self, node: Node) -> tuple[int, int]:
        """First and last sample of an operator, from the one at which it is evaluated."""
        first, last = ceil(node.first / self._dt - NEAR_S), node.last / self._dt + NEAR_S
        if first > last:
            raise FormulaError(
                f"[{node.first:g}:{node.last:g}] contains no sample of flights sampled each "
                f"{self._dt:g} s: give times that do"
            )
        longest = len(self._samples)
        return min(first, longest), floor(min(last, longest))


def _ahead(parts: Sequence[Array], first: int, last: int, beyond: tuple[float, float]) -> Array:
    """always of one part, or until of two, over samples first to last from each one.

    beyond: least and largest robustness after the last sample.
    """
    n = parts[0].shape[-1]
    after = np.empty((2, *parts[0].shape[1:-1], last))
    after[0], after[1] = beyond
    padded = [np.concatenate([part, after], axis=-1) for part in parts]
    if len(padded) == 1:
        size = last - first + 1
        ahead = padded[0][..., first:]
        return minimum_filter1d(ahead, size, axis=-1, origin=-(size // 2))[..., :n]
    held, reached = padded
    until, so_far = np.full_like(parts[0], -inf), np.full_like(parts[0], inf)
    for k in range(last + 1):
        if k >= first:
            until = np.maximum(until, np.minimum(reached[..., k : k + n], so_far))
        so_far = np.minimum(so_far, held[..., k : k + n])
    return until


def _formula(node: Node) -> str | None:
    """Robustness as a formula that needs no later sample; None if it needs one."""
    if node.kind == "holds":
        return node.text
    parts = [text for part in node.parts if (text := _formula(part)) is not None]
    if len(parts) < len(node.parts):
        return None
    if node.kind == "not":
        return f"-({parts[0]})"
    if node.kind == "and":
        return f"min({parts[0]}, {parts[1]})"
    if node.kind == "historically" and node.first == 0.0 < node.last <= LONGEST_S:
        return f"lasting({parts[0]}, {node.last:g})"
    return None


class _Parser(FormulaParser):
    def requirement(self) -> Node:
        node = self.implication()
        if self.at < len(self.tokens) - 1:
            raise self.error("and, or, implies, until or since is needed")
        return node

    def word(self, *words: str) -> str:
        """The next word or sign, if it is one of these."""
        token = self.next
        if token.kind not in ("name", "sign") or token.text not in words:
            return ""
        self.at += 1
        return token.text

    def implication(self) -> Node:
        node = self.disjunction()
        return node.negated.either(self.implication()) if self.word("implies", "->") else node

    def disjunction(self) -> Node:
        node = self.conjunction()
        while self.word("or"):
            node = node.either(self.conjunction())
        return node

    def conjunction(self) -> Node:
        node = self.binary()
        while self.word("and"):
            node = Node("and", (node, self.binary()))
        return node

    def binary(self) -> Node:
        node = self.unary()
        while word := self.word("until", "since"):
            kind: Kind = "until" if word == "until" else "since"
            times = self.times(word)
            node = Node(kind, (node, self.unary()), *times)
        return node

    def unary(self) -> Node:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.error(f"nested too deeply: use at most {DEEPEST} levels")
        if self.word("not"):
            node = self.unary().negated
        elif word := self.word(*UNARY):
            kind, of_negation = UNARY[word]
            times = self.times(word)
            part = self.unary()
            node = Node(kind, (part.negated if of_negation else part,), *times)
            node = node.negated if of_negation else node
        else:
            node = self.comparison()
        self.depth -= 1
        return node

    def times(self, word: str) -> tuple[float, float]:
        """The times after a word, from 0 on without any."""
        match = TIMES.fullmatch(self.next.text) if self.next.kind == "key" else None
        if match is None:
            if word in ("eventually", "until"):
                raise self.error(f"{word} without times is never violated: write {word}[0:5]")
            return 0.0, inf
        first, last = map(float, match.groups())
        if first > last:
            raise self.error(f"the first time is after the last: write {word}[{last:g}:{first:g}]")
        self.at += 1
        return first, last

    def comparison(self) -> Node:
        """A comparison, or a requirement in parentheses, which may begin like one."""
        start, depth = self.at, self.depth
        try:
            return self.compared()
        except FormulaError as error:
            reached = self.at
            if self.tokens[start].text != "(":
                raise
            self.at, self.depth = start + 1, depth
            try:
                node = self.implication()
                self.require(")")
            except FormulaError:
                if self.at < reached:
                    raise error from None
                raise
            return node

    def compared(self) -> Node:
        self.steps = []
        left = self.side()
        sign = self.word(*COMPARED)
        if not sign:
            raise self.error("<, <=, > or >= is needed")
        right = self.side()
        self.steps.append(SIGNS["-"])
        text = f"({left}) - ({right})"
        if sign.startswith("<"):
            self.steps.append(MINUS)
            text = f"({right}) - ({left})"
        return Node("holds", formula=Formula(tuple(self.steps)), text=text)

    def side(self) -> str:
        """A formula; its text."""
        start = self.next.start
        self.sum()
        return self.text[start : self.next.start].strip()
