"""OpenAPI links: where to go on from an answer that made something, or that queued a job."""

import re
from collections.abc import Iterator
from typing import Any

JOBS = "/api/v1/jobs"
HAS_JOB = "202"
HAS_RESOURCE = "201"
ALREADY_THERE = "200"


def describe_links(document: dict[str, Any]) -> None:
    """Add to each POST that creates the operations on what it made, by the `id` of its answer."""
    paths = document["paths"]
    for path, item in paths.items():
        answers = item.get("post", {}).get("responses", {})
        if HAS_JOB in answers and not path.startswith(f"{JOBS}/"):
            answers[HAS_JOB]["links"] = dict(_links(paths, JOBS))
        if HAS_RESOURCE in answers:
            for status in {HAS_RESOURCE, ALREADY_THERE} & set(answers):
                answers[status]["links"] = dict(_links(paths, path))


def _links(paths: dict[str, Any], collection: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each operation on a member of a collection that needs no other id."""
    asked = {name: f"$request.path.{name}" for name in re.findall(r"{(\w+)}", collection)}
    member = re.compile(re.escape(collection) + r"/{(\w+)}[^{}]*")
    for path, item in paths.items():
        if found := member.fullmatch(path):
            parameters = asked | {found[1]: "$response.body#/id"}
            for operation in item.values():
                called = operation["operationId"]
                yield called, {"operationId": called, "parameters": parameters}
