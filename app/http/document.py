"""The OpenAPI document: tags, names and an example of every body."""

import re
from typing import Any

TAGS = {
    "catalog": "Families, recipes, channels and formats.",
    "datasets": "Labelled simulated flights for training monitors.",
    "monitors": "Trained and calibrated monitors; immediate scoring of telemetry.",
    "limit sets": "Versioned limits that a flight puts in force.",
    "monitor sets": "Monitors by flight condition, of which a flight uses the one that applies.",
    "recordings": "Telemetry files: upload, mapping, scorings, markers, exports.",
    "archives": "Results of `forewarn score-archive`: summary, flights, samples.",
    "flights": "Flights in progress and ended: source, samples, alarms, markers.",
    "campaigns": "Build-ups: clear, fly and identify one point after another.",
    "jobs": "Long work: progress, results, cancelling.",
    "studies": "Comparisons of methods and of warning lead times.",
    "storage": "Disk space and retention.",
    "people": "Roles, tokens, sessions, and the log of changes.",
    "demonstration": "A small monitor, trained here, and a flight that exceeds its limit.",
    "health": "Liveness, readiness and metrics.",
}
"""Resources, in the order of the documentation."""


def describe_names(document: dict[str, Any]) -> None:
    """Name operations after functions and bodies after titles: short names in generated clients."""
    schemas = document["components"]["schemas"]
    for path, item in document["paths"].items():
        for method, operation in item.items():
            suffix = re.sub(r"\W", "_", path) + f"_{method}"
            operation["operationId"] = operation["operationId"].removesuffix(suffix)
            for content in operation.get("requestBody", {}).get("content", {}).values():
                if title := content["schema"].get("title", ""):
                    name = re.sub(r"\W", "", title.title())
                    if schemas.setdefault(name, content["schema"]) != content["schema"]:
                        raise AssertionError(f"two schemas are named {name}: rename one")
                    content["schema"] = {"$ref": f"#/components/schemas/{name}"}


def describe_examples(document: dict[str, Any]) -> None:
    """Give every request body an example: its own, or the first of its schema."""
    schemas = document["components"]["schemas"]
    for item in document["paths"].values():
        for operation in item.values():
            for media, content in operation.get("requestBody", {}).get("content", {}).items():
                if media == "application/json" and "example" not in content:
                    content["example"] = _example(content["schema"], schemas)


def _example(schema: dict[str, Any], schemas: dict[str, Any]) -> Any:
    for part in (schema, *schema.get("anyOf", ())):
        named = schemas[part["$ref"].rpartition("/")[2]] if "$ref" in part else part
        for example in named.get("examples", ()):
            return example
    raise AssertionError(f"a request body has no example: {str(schema)[:200]}")


def describe_arrays(part: Any) -> None:
    """Give arrays of fixed length the `items` that client generators require."""
    if isinstance(part, dict):
        prefix = part.get("prefixItems")
        if isinstance(prefix, list) and "items" not in part:
            part["items"] = prefix[0]
        part = list(part.values())
    if isinstance(part, list):
        for inner in part:
            describe_arrays(inner)
