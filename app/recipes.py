"""Recipes as people write them, in files, options and requests: checked value by value."""

import json
from collections.abc import Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from core import recipe
from core.recipe import RecipeError, family_of, to_plain

__all__ = ["RecipeError", "family_of", "from_plain", "read_plain", "set_path", "to_plain"]


def from_plain(default: Any, plain: Any, where: str = "recipe") -> Any:
    """Return `default` with what `plain` says put in place, every value of the type it must have.

    RecipeError says which part is wrong and what would be right.
    """
    return recipe.from_plain(default, plain, where, _checked)


def _checked(default: Any, values: Mapping[str, Any], where: str) -> Any:
    try:
        return TypeAdapter(type(default)).validate_python(values)
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
