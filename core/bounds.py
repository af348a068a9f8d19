"""Bounds of parameters as annotations of their types, and how an error quotes a value."""

from dataclasses import dataclass
from functools import cache
from math import isfinite
from reprlib import Repr
from typing import Any, Literal, get_args, get_origin, get_type_hints

MOST_SIGNS = 80
_short = Repr()
_short.maxstring = _short.maxother = _short.maxlong = MOST_SIGNS


@dataclass(frozen=True)
class Bounds:
    """A finite number: at least `least` or larger than `above`, and smaller than `below`.

    words: error message for other numbers; made from the bounds unless given.
    """

    least: float | None = None
    above: float | None = None
    below: float | None = None
    words: str = ""

    def hold(self, value: float) -> bool:
        return (
            isfinite(value)
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
        )

    @property
    def as_schema(self) -> dict[str, float]:
        """JSON schema keywords. They cannot express "finite"."""
        keywords = ("minimum", self.least), ("exclusiveMinimum", self.above)
        pairs = (*keywords, ("exclusiveMaximum", self.below))
        return {name: bound for name, bound in pairs if bound is not None}

    def __str__(self) -> str:
        if self.words:
            return self.words
        return (
            f"it must be at least {self.least:g}" if self.above is None else "it must be positive"
        )


NOT_NEGATIVE = Bounds(least=0, words="it must be a finite number, 0 or more")


@cache
def bounds_of(kind: type) -> dict[str, Bounds]:
    """Bounds of a dataclass's parameters by name, including inherited ones."""
    written = get_type_hints(kind, include_extras=True)
    return {
        name: bounds
        for name, hint in written.items()
        for bounds in getattr(hint, "__metadata__", ())
        if isinstance(bounds, Bounds)
    }


@cache
def choices_of(kind: type) -> dict[str, tuple[Any, ...]]:
    """Allowed values of a dataclass's parameters by name, of those with a Literal type."""
    hints = get_type_hints(kind)
    return {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Literal}


def check_bounds(recipe: Any, what: str = "") -> None:
    """ValueError for the first parameter that is no choice or out of its bounds; None is allowed.

    what: prefix of its name in the message.
    """
    for name, choices in choices_of(type(recipe)).items():
        if (value := getattr(recipe, name)) not in choices:
            known = (" or " if len(choices) == 2 else ", ").join(map(str, choices))
            raise ValueError(f"{what}{name}={value!r} was given: choose {known}")
    for name, bounds in bounds_of(type(recipe)).items():
        value = getattr(recipe, name)
        if value is not None and not bounds.hold(value):
            raise ValueError(f"{what}{name}={value} was given: {bounds}")


def quoted(value: Any) -> str:
    """The repr of a value; a long one shortened to its beginning and end."""
    return _short.repr(value)
