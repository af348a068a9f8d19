"""Recipes as plain data: what files and options say, and back."""

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from core.monitor.predictor import PREDICTORS, Predictor
from core.monitor.score import SCORES, Score
from core.simulation.aircraft import AIRCRAFT, Aircraft
from core.simulation.control_law import CONTROL_LAWS, ControlLaw
from core.simulation.maneuver import MANEUVERS, Maneuver

FAMILIES: dict[type, dict[str, Any]] = {
    Aircraft: AIRCRAFT,
    ControlLaw: CONTROL_LAWS,
    Maneuver: MANEUVERS,
    Predictor: PREDICTORS,
    Score: SCORES,
}
"""Families whose members are told apart by `kind` in plain data."""


class RecipeError(ValueError):
    """A recipe that names something unknown or holds a value that is not allowed."""


def family_of(member: Any) -> dict[str, Any] | None:
    """Return the family a recipe's part belongs to; None for a part that is not of one."""
    return next((family for base, family in FAMILIES.items() if isinstance(member, base)), None)


def to_plain(recipe: Any) -> Any:
    """Return a recipe as JSON's types; a family's member names itself by `kind`."""
    if isinstance(recipe, tuple | list):
        return [to_plain(value) for value in recipe]
    if isinstance(recipe, dict):
        return {key: to_plain(value) for key, value in recipe.items()}
    if not is_dataclass(recipe):
        return recipe
    plain = {field.name: to_plain(getattr(recipe, field.name)) for field in fields(recipe)}
    family = family_of(recipe)
    return plain if family is None else {"kind": _kind(recipe, family)} | plain


def _kind(member: Any, family: dict[str, Any]) -> str:
    """Name of the entry that the member was most likely made from."""
    same = {name: entry for name, entry in family.items() if type(entry) is type(member)}

    def agreement(name: str) -> int:
        return sum(
            getattr(member, field.name) == getattr(same[name], field.name)
            for field in fields(member)
        )

    return max(same, key=agreement)


def from_plain(default: Any, plain: Any, where: str = "recipe") -> Any:
    """Return `default` with what `plain` says put in place.

    A family's part may change its `kind`; whatever is not said keeps its default.
    RecipeError says which part is wrong and what would be right.
    """
    if not isinstance(plain, dict):
        raise RecipeError(f"{where} is {plain!r}: it must be an object of parameters")
    plain = dict(plain)
    family = family_of(default)
    if family is not None:
        kind = plain.pop("kind", None)
        if kind is not None and not (isinstance(kind, str) and kind in family):
            raise RecipeError(f"{where} {kind!r} is unknown: choose {', '.join(family)}")
        default = family[kind] if kind is not None else default
    known = {field.name: getattr(default, field.name) for field in fields(default)}
    for key in plain:
        if key not in known:
            raise RecipeError(f"{where} has no {key!r}: choose {', '.join(known)}")
        if is_dataclass(known[key]) and not is_dataclass(plain[key]):
            plain[key] = from_plain(known[key], plain[key], f"{where}.{key}")
    try:
        return TypeAdapter(type(default)).validate_python(known | plain)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join([where, *(str(part) for part in first["loc"])])
        reason = first["msg"].removeprefix("Value error, ")
        given = "" if is_dataclass(default) and not first["loc"] else f" is {first['input']!r}"
        raise RecipeError(f"{place}{given}: {reason}") from error


def read_plain(path: Path) -> Any:
    """Read a JSON file; RecipeError says where it is not JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecipeError(f"{path} cannot be read ({error.strerror}): give a JSON file") from error
    except ValueError as error:
        raise RecipeError(f"{path} is not JSON ({error}): correct it there") from error


def set_path(plain: dict[str, Any], dotted: str, value: Any) -> None:
    """Put a value at `a.b.c` of nested objects, making them where they are missing."""
    *parents, last = dotted.split(".")
    for parent in parents:
        plain = plain.setdefault(parent, {})
        if not isinstance(plain, dict):
            raise RecipeError(f"{dotted} cannot be set: {parent} holds a value, not parameters")
    plain[last] = value
