"""Options from the fields of a recipe: names, types, choices and help are those of the class."""

import argparse
import re
from collections.abc import Callable
from dataclasses import MISSING, fields
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from app.recipes.labels import descriptions, unit_of


def add_fields(
    parser: argparse.ArgumentParser,
    kind: type,
    *names: str,
    prefix: str = "",
    known: dict[str, Any] | None = None,
) -> None:
    """Add an option for each of the named fields of a recipe, or for all.

    prefix: before the name of the option.   known: names to choose from, by field.
    """
    for field in fields(kind):
        if names and field.name not in names:
            continue
        option = "--" + (prefix + field.name).removesuffix("_s").replace("_", "-")
        text = help_of(kind, field.name)
        if known and field.name in known:
            text = f"{text.partition(':')[0]}: {'; '.join(known[field.name])}; all if absent"
        elif not any(field.default is none for none in (None, False, MISSING)):
            text = f"{text}; {_plain(field.default)} if absent"
        parser.add_argument(
            option, dest=prefix + field.name, help=text, **settings_of(kind, field.name)
        )


def given_fields(
    options: argparse.Namespace, kind: type, *names: str, prefix: str = ""
) -> dict[str, Any]:
    """The fields of a recipe that the options give."""
    named = names or [field.name for field in fields(kind)]
    given = {name: getattr(options, prefix + name) for name in named}
    return {name: value for name, value in given.items() if value is not None}


def help_of(kind: type, name: str) -> str:
    """The docstring of a field as the help of its option, with its unit."""
    text = descriptions(kind).get(name, name.replace("_", " ")).rstrip(".")
    unit = unit_of(name, text)
    if unit and f"[{unit}]" not in text:
        text = re.sub("(?=[:;]|$)", f" [{unit}]", text, count=1)
    return text.replace("`", "").replace("%", "%%")


def settings_of(kind: type, name: str) -> dict[str, Any]:
    """Arguments of `add_argument` for a field: how to read it."""
    hint = get_type_hints(kind)[name]
    if hint is bool:
        return {"action": "store_true"}
    if get_origin(hint) is Literal:
        choices = get_args(hint)
        return {"choices": choices, "type": type(choices[0])}
    if get_origin(hint) is UnionType:
        hint = get_args(hint)[0]
    if get_origin(hint) is tuple:
        of_numbers = get_args(hint)[0] is float
        read: Callable[[str], Any] = numbers if of_numbers else names
        return {"type": read, "metavar": "SECONDS" if of_numbers else "NAMES"}
    return {"type": hint, "metavar": "NUMBER"}


def names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


def numbers(text: str) -> tuple[float, ...]:
    return tuple(float(number) for number in text.split(","))


def _plain(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(map(_plain, value))
    return f"{value:g}" if isinstance(value, float | int) else str(value).replace("%", "%%")
