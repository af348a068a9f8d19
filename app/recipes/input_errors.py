"""Errors of input in words: which value, what was given, what is needed.

pydantic finds them, but its own messages name its types, and union members as if they were fields.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, cast

NEEDED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a smaller whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "text",
    "string_unicode": "text",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "an object",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "dataclass_type": "an object",
    "none_required": "null",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "string_too_short": "text of {min_length} characters or more",
    "string_too_long": "text of {max_length} characters or less",
    "string_pattern_mismatch": "text that matches {pattern}",
    "too_short": "{min_length} or more of them",
    "too_long": "{max_length} or less of them",
    "literal_error": "{expected}",
    "enum": "{expected}",
    "union_tag_invalid": "one whose {discriminator} is {expected_tags}",
    "union_tag_not_found": "an object with its {discriminator}",
}
"""By the type of pydantic's error, formatted with its context."""
TAGS = ("kind", "type")
"""Fields that tell members of a union apart."""
RAISED, MISSING, UNKNOWN = "value_error", "missing", "extra_forbidden"
LONGEST = 60
"""Most letters of a quoted value."""


class InputError(NamedTuple):
    """An invalid value.   place: its path, empty for the whole input."""

    place: str
    reason: str

    def __str__(self) -> str:
        return f"{self.place or 'the input'} {self.reason}"


def input_errors(errors: Iterable[Mapping[str, Any]], whole: Any) -> list[InputError]:
    """One error per invalid value. errors: as pydantic lists them.   whole: the input."""
    by_place: dict[tuple[str | int, ...], list[Mapping[str, Any]]] = {}
    for error in errors:
        by_place.setdefault(_place(error, whole), []).append(error)
    return [
        InputError(".".join(map(str, place)), _reason(of_place))
        for place, of_place in by_place.items()
    ]


def _place(error: Mapping[str, Any], whole: Any) -> tuple[str | int, ...]:
    """Path of a value in the input, without the members of unions that pydantic adds."""
    place: list[str | int] = []
    value: Any = whole
    is_tagged, is_found = False, True
    path: tuple[str | int, ...] = error["loc"]
    for k, part in enumerate(path, start=1):
        if isinstance(value, Mapping):
            if not is_tagged and k < len(path) and part in map(value.get, TAGS):
                is_tagged = True
                continue
            is_found = part in value
        else:
            is_found = isinstance(value, list | tuple) and part in range(len(value))
        if is_found:
            value, is_tagged = cast("Any", value)[part], False
            place.append(part)
    if error["type"] == MISSING and not is_found:
        place.append(path[-1])
    return tuple(place)


def _reason(errors: list[Mapping[str, Any]]) -> str:
    """The error of one value, from the errors of each member of its union."""
    kinds = {error["type"] for error in errors}
    if MISSING in kinds:
        return "is missing: give it"
    if UNKNOWN in kinds:
        return "is unknown: leave it out, or correct its name"
    tag = errors[0].get("ctx", {}).get("tag")
    is_given = f"is of kind {tag!r}" if tag else f"is {given(errors[0]['input'])}"
    if raised := [error for error in errors if error["type"] == RAISED]:
        return f"{is_given}: {raised[0]['msg'].removeprefix('Value error, ')}"
    return f"{is_given}: give {', or '.join(dict.fromkeys(map(_needed, errors)))}"


def _needed(error: Mapping[str, Any]) -> str:
    context = error.get("ctx", {})
    if words := NEEDED.get(error["type"]):
        return words.format(**context)
    words = error["msg"].removeprefix("Input should be ")
    return words[:1].lower() + words[1:]


def given(value: Any) -> str:
    """A given value as in JSON, shortened if long."""
    if isinstance(value, Mapping):
        return "an object"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
