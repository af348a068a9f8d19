"""The catalog: every family with its members, the JSON schema of their parameters, and defaults.

The page draws its forms from it, and the OpenAPI document takes the recipes' schemas from it.
"""

import re
from copy import deepcopy
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from inspect import cleandoc
from types import GenericAlias
from typing import Any

from pydantic import ConfigDict, TypeAdapter

from app.recipes import family_of, to_plain
from app.telemetry_catalog import telemetry_catalog
from core import __version__
from core.channels import CHANNELS
from core.collection import DatasetRecipe
from core.monitor import MonitorRecipe
from core.recipe import FAMILIES, Family
from core.specification import SPECIFICATIONS, Limits
from core.study import StudyRecipe

LABELS = {
    "aircraft": "Aircraft",
    "control_law": "Control law",
    "maneuver": "Manoeuvre",
    "specification": "Limits",
    "predictor": "Predictor",
    "score": "Score",
}
RECIPES: dict[str, Any] = {
    "dataset": DatasetRecipe(),
    "monitor": MonitorRecipe(),
    "study": StudyRecipe(),
}
DOCSTRINGS = ConfigDict(use_attribute_docstrings=True)
UNIT = re.compile(r"\[([^\[\]]*[A-Za-z/%][^\[\]]*)\]")
SUFFIXES = {"_deg_s": "deg/s", "_rad_s": "rad/s", "_deg": "deg", "_hz": "Hz", "_s": "s"}
N_TEST = 2000
LARGEST_N_TEST = 100_000


@cache
def catalog() -> dict[str, Any]:
    """Return the whole catalog as plain data."""
    known = FAMILIES | {"specification": Family("specification", Limits, SPECIFICATIONS)}
    families = {
        name: {
            "label": label,
            "description": first_line(known[name].base),
            "entries": {kind: _entry(kind, member) for kind, member in known[name].members.items()},
        }
        for name, label in LABELS.items()
    }
    return {
        "version": __version__,
        "channels": [asdict(channel) for channel in CHANNELS],
        "families": families,
        "recipes": {
            name: {"schema": schema_of(recipe), "default": to_plain(recipe)}
            for name, recipe in RECIPES.items()
        },
        "telemetry": telemetry_catalog(),
    }


def _entry(kind: str, member: Any) -> dict[str, Any]:
    return {
        "kind": kind,
        "label": getattr(member, "title", None) or kind.replace("_", " "),
        "description": getattr(member, "description", None) or first_line(type(member)),
        "schema": schema_of(member),
        "default": {key: value for key, value in to_plain(member).items() if key != "kind"},
    }


def schema_of(member: Any) -> dict[str, Any]:
    """JSON schema of a recipe's or a family member's parameters, `member` giving the defaults.

    Every property has title, description, `x-unit` and default; no `$ref`. A property that is of a
    family has `x-family` and takes a `kind` with that kind's parameters.
    """
    return _with_notes(_inlined(TypeAdapter(type(member)).json_schema()), member)


def _with_notes(schema: dict[str, Any], member: Any) -> dict[str, Any]:
    """Add descriptions, units and defaults to an object's properties; no others are allowed."""
    described = descriptions(type(member))
    properties = {}
    for field in fields(member):
        value = getattr(member, field.name)
        words = described.get(field.name, "")
        entry = _property(schema["properties"][field.name], value)
        entry |= {"title": field.name, "default": to_plain(value)}
        entry["description"] = words or entry.get("description", "")
        if unit := unit_of(field.name, "" if isinstance(value, tuple) else words):
            entry["x-unit"] = unit
        properties[field.name] = entry
    return {
        "type": "object",
        "title": type(member).__name__,
        "description": first_line(type(member)),
        "properties": properties,
        "additionalProperties": False,
    }


def descriptions(kind: type) -> dict[str, str]:
    """Attribute docstring of each parameter; a class's own go before its bases'."""
    described = {channel.key: f"{channel.label} {channel.symbol}" for channel in CHANNELS}
    for base in filter(is_dataclass, reversed(kind.__mro__)):
        listed: Any = GenericAlias(list, base)  # a dataclass itself takes no configuration
        schema = TypeAdapter(listed, config=DOCSTRINGS).json_schema()
        own = schema["$defs"][schema["items"]["$ref"].rpartition("/")[2]].get("properties", {})
        described |= {
            name: " ".join(entry["description"].split())
            for name, entry in own.items()
            if "description" in entry
        }
    return described


def unit_of(name: str, description: str) -> str:
    """Unit of a parameter: what its name ends in, its description has in brackets, its channel's.

    Empty for a count or a word.
    """
    for suffix, unit in SUFFIXES.items():
        if name.endswith(suffix):
            return unit
    if written := UNIT.search(description):
        return written[1]
    return next((channel.unit for channel in CHANNELS if channel.key == name), "")


def first_line(kind: type) -> str:
    """What a class is, in its docstring's first paragraph."""
    return " ".join(cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())


def _property(schema: dict[str, Any], value: Any) -> dict[str, Any]:
    family = family_of(value)
    if family is not None:
        return {
            "type": "object",
            "description": first_line(family.base),
            "x-family": family.name,
            "properties": {"kind": {"enum": list(family.members)}},
        }
    if is_dataclass(value):
        return _with_notes(schema, value)
    return dict(schema)


def _inlined(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema with every `$ref` replaced by what it refers to."""
    definitions = schema.get("$defs", {})

    def resolve(node: Any) -> Any:
        if isinstance(node, list):
            return [resolve(entry) for entry in node]
        if not isinstance(node, dict):
            return node
        if "$ref" in node:
            target = definitions[node["$ref"].rpartition("/")[2]]
            return resolve(target | {k: v for k, v in node.items() if k != "$ref"})
        return {key: resolve(entry) for key, entry in node.items() if key != "$defs"}

    return resolve(schema)


def dataset_request_schema() -> dict[str, Any]:
    """JSON schema of the body that asks for a dataset."""
    schema = schema_of(RECIPES["dataset"])
    schema["properties"] |= {"name": _NAME}
    return schema | {"title": "Dataset to simulate"}


def monitor_request_schema() -> dict[str, Any]:
    """JSON schema of the body that asks for a monitor."""
    schema = schema_of(RECIPES["monitor"])
    schema["properties"] |= {"name": _NAME, "dataset": _dataset_choice(), "n_test": _n_test(N_TEST)}
    return schema | {"title": "Monitor to train", "required": ["dataset"]}


def study_request_schema() -> dict[str, Any]:
    """JSON schema of the body that asks for the paper's study."""
    schema = schema_of(RECIPES["study"])
    schema["properties"] |= {"dataset": _dataset_choice()}
    schema["properties"]["n_test"] |= {"minimum": 1, "maximum": LARGEST_N_TEST}
    schema["properties"]["n_monitors"] |= {"minimum": 1, "maximum": 100}
    return schema | {"title": "Study to run", "required": ["dataset"]}


_NAME = {
    "title": "name",
    "description": "what people call it; made from the recipe if absent",
    "anyOf": [{"type": "string", "minLength": 1, "maxLength": 200}, {"type": "null"}],
}


def _dataset_choice() -> dict[str, Any]:
    return {
        "title": "dataset",
        "description": "id of a stored dataset, or the recipe of one to simulate",
        "anyOf": [{"type": "string", "minLength": 1}, deepcopy(schema_of(RECIPES["dataset"]))],
    }


def _n_test(default: int) -> dict[str, Any]:
    return {
        "title": "n_test",
        "description": "fresh flights of the evaluation",
        "type": "integer",
        "default": default,
        "minimum": 0,
        "maximum": LARGEST_N_TEST,
    }
