"""Where writers of Parquet files leave the units of columns: with the field, or with the table."""

import json
from collections.abc import Mapping
from typing import Any

import pyarrow as pa

KEYS = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")
DESCRIPTIONS = ("description", "long_name", "label", "comment")


def unit_of(field: pa.Field) -> str:
    """The unit in a field's own metadata, "" for none."""
    return _said(field, KEYS)


def description_of(field: pa.Field) -> str:
    """What a field's own metadata say of it, "" for nothing."""
    return _said(field, DESCRIPTIONS)


def units_of_table(schema: pa.Schema) -> dict[str, str]:
    """Units by name of column that the table says of all, as pandas' attrs do.

    Either {"units": {name: unit}} or {name: {"unit": unit}} or {name: unit} under a key `units`.
    """
    attributes = _attributes(schema)
    found: dict[str, str] = {}
    for name, value in attributes.items():
        if name in KEYS and isinstance(value, Mapping):
            found |= {str(k): v for k, v in value.items() if isinstance(v, str)}
        elif isinstance(value, Mapping):
            units = [value[key] for key in KEYS if isinstance(value.get(key), str)]
            found |= {name: units[0]} if units else {}
    return found


def index_of_table(schema: pa.Schema) -> tuple[str, ...]:
    """Names of the columns that pandas kept as its index."""
    index = _json(schema, b"pandas").get("index_columns")
    return tuple(name for name in index if isinstance(name, str)) if isinstance(index, list) else ()


def _said(field: pa.Field, keys: tuple[str, ...]) -> str:
    metadata = field.metadata or {}
    values = (metadata.get(key.encode(), b"") for key in keys)
    return next((value.decode("utf-8", "replace").strip() for value in values if value), "")


def _attributes(schema: pa.Schema) -> dict[str, Any]:
    inner = _json(schema, b"pandas").get("attributes")
    return (inner if isinstance(inner, dict) else {}) | _json(schema, b"PANDAS_ATTRS")


def _json(schema: pa.Schema, key: bytes) -> dict[str, Any]:
    """A JSON object in the metadata of a table; empty where there is none."""
    try:
        plain = json.loads((schema.metadata or {}).get(key, b"{}"))
    except (ValueError, RecursionError):
        return {}
    return plain if isinstance(plain, dict) else {}
