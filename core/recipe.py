"""Recipes as plain data and back, the same way for files, options and requests."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, fields, is_dataclass
from difflib import SequenceMatcher
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

M = TypeVar("M")


class Family(NamedTuple):
    """Recipe parts of one base class; `kind` distinguishes them in plain data.

    members: those to choose from.   made: others, by their `kind` in stored recipes.
    """

    name: str
    base: type
    members: dict[str, Any]
    made: Mapping[str, Any] = MappingProxyType({})

    @property
    def known(self) -> dict[str, Any]:
        return {**self.members, **self.made}


CLOSE = 0.6
"""Similarity from which a word counts as mistyped."""
HEAD = 0.95
"""Weight of a match with only the beginning of a longer word."""

FAMILIES: dict[str, Family] = {}
"""Families by name, of the modules imported so far."""


class RecipeError(ValueError):
    """A recipe with an unknown name or a value that is not allowed."""


def family(
    name: str, base: type[M], members: dict[str, M], made: Mapping[str, M] | None = None
) -> dict[str, M]:
    """Register a family and return its members; plain recipes name them by `kind`.

    made: parts that are not for choosing, such as combinations of finished parts.
    """
    FAMILIES[name] = Family(name, base, members, made or {})
    return members


def family_of(member: Any) -> Family | None:
    """The family of a recipe's part; None if it has none."""
    return next((known for known in FAMILIES.values() if isinstance(member, known.base)), None)


def later(default: Any) -> Any:
    """A field that older recipes lack: plain data leave its default out, so digests stay."""
    return field(default=default, metadata={"later": True})


def to_plain(recipe: Any) -> Any:
    """A recipe as plain data; a family's member names itself by `kind`."""
    if isinstance(recipe, tuple | list):
        return [to_plain(value) for value in recipe]
    if isinstance(recipe, dict):
        return {key: to_plain(value) for key, value in recipe.items()}
    if not is_dataclass(recipe):
        return recipe
    plain = {
        each.name: to_plain(getattr(recipe, each.name))
        for each in fields(recipe)
        if not (each.metadata.get("later") and getattr(recipe, each.name) == each.default)
    }
    of = family_of(recipe)
    return plain if of is None else {"kind": _kind(recipe, of.known)} | plain


def _kind(member: Any, members: Mapping[str, Any]) -> str:
    """Name of the entry most similar to a member."""
    same = {name: entry for name, entry in members.items() if type(entry) is type(member)}

    def agreement(name: str) -> int:
        return sum(
            getattr(member, each.name) == getattr(same[name], each.name) for each in fields(member)
        )

    return max(same, key=agreement)


def _build(default: Any, values: Mapping[str, Any], where: str) -> Any:
    """Build an object of the default's class; RecipeError for refused values."""
    try:
        return type(default)(**values)
    except (TypeError, ValueError) as error:
        raise RecipeError(f"{where}: {error}") from error


def from_plain(
    default: Any,
    plain: Any,
    where: str = "recipe",
    build: Callable[[Any, Mapping[str, Any], str], Any] = _build,
    names: Mapping[str, str] = MappingProxyType({}),
) -> Any:
    """`default` with the values of `plain`.

    A family's part may change its `kind`; parameters that are not given keep their default.
    build: makes an object from (default, values, where); one for input from people checks types.
    names: other names of fields, in `plain` and in errors.
    RecipeError names the wrong part and the possible values.
    """
    if not isinstance(plain, dict):
        raise RecipeError(f"{where} is {plain!r}: it must be an object of parameters")
    given: dict[str, Any] = dict(plain)
    of = family_of(default)
    if of is not None and (kind := given.pop("kind", None)) is not None:
        if not (isinstance(kind, str) and kind in of.known):
            raise RecipeError(f"{where} {kind!r} is unknown: {instead_of(str(kind), of.members)}")
        default = of.known[kind]
    known: dict[str, Any] = {each.name: getattr(default, each.name) for each in fields(default)}
    fields_by_name: dict[str, str] = {names.get(each, each): each for each in known}
    values: dict[str, Any] = {}
    for key, value in given.items():
        field = fields_by_name.get(key, key)
        name = names.get(field, field)
        if field not in known:
            raise RecipeError(f"{where} has no {key!r}: {instead_of(str(key), fields_by_name)}")
        if field in values:
            raise RecipeError(
                f"{where} gives {name} and {field}, two names of one parameter: omit one"
            )
        if is_dataclass(known[field]) and not is_dataclass(value):
            value = from_plain(known[field], value, f"{where}.{name}", build, names)
        elif isinstance(known[field], tuple) and isinstance(value, list):
            value = tuple(value)
        values[field] = value
    return build(default, known | values, where)


def instead_of(word: str, known: Iterable[str]) -> str:
    """`did you mean train?`, or a list of all known words."""
    known = tuple(known)
    closest = max(known, key=lambda each: _similarity(word, each), default="") if word else ""
    if closest and _similarity(word, closest) >= CLOSE:
        return f"did you mean {closest}?"
    return f"choose {', '.join(known)}" if known else "omit it"


def _similarity(word: str, known: str) -> float:
    """Share of letters in common, 0 to 1; with only the beginning if `known` is longer."""
    given, whole = word.lower(), known.lower()
    head = whole[: len(given)]
    return max(
        SequenceMatcher(None, given, whole).ratio(),
        HEAD * SequenceMatcher(None, given, head).ratio(),
    )
