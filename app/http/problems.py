"""Errors as problem+json (RFC 9457): given, needed, what to do; never a stack trace."""

import logging
import secrets
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from fastapi.routing import iter_route_contexts
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import compile_path

from app.recipes.input_errors import InputError, input_errors
from app.recipes.recipes import RecipeError
from app.recordings.files import NoSpace
from app.recordings.upload import Stalled
from app.recordings.workers import Busy
from app.scene.own_airframe import AirframeError
from app.telemetry.recording import TelemetryError
from core.monitor.file.portable import MonitorFileError
from core.planned_test.collection import CollectionError

MEDIA_TYPE = "application/problem+json"
LOG = logging.getLogger("forewarn")

SCHEMA: dict[str, Any] = {
    "title": "Problem",
    "description": "An error as in RFC 9457.",
    "type": "object",
    "properties": {
        "type": {"type": "string", "description": "kind of problem", "default": "about:blank"},
        "title": {"type": "string", "description": "the status in words"},
        "status": {"type": "integer", "description": "HTTP status"},
        "detail": {
            "type": "string",
            "description": "what was given, what is needed, what to do",
            "examples": ["n_unsafe=1 was given: it must be at least 2"],
        },
    },
    "required": ["type", "title", "status", "detail"],
}
REFERENCE = {"$ref": "#/components/schemas/Problem"}

DESCRIPTIONS = {
    401: "the token is missing or wrong",
    403: "the request comes from another site, or your role does not allow it",
    404: "no such resource",
    408: "the body stopped arriving",
    409: "the resource is in use, or its state does not allow this",
    410: "created with this key and deleted since",
    413: "the body is too large",
    415: "unsupported media type",
    422: "invalid input; `detail` names what is needed",
    429: "too many in progress; try again later",
    503: "the server is not ready",
    507: "no disk space left",
}


class Problem(Exception):
    """An error answer; `extra` members are added to the document."""

    def __init__(self, status: int, detail: str, kind: str = "about:blank", **extra: Any) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.kind = kind
        self.extra = extra


def problem_responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI responses for the problems of a route, besides those that many have."""
    content = {MEDIA_TYPE: {"schema": REFERENCE}}
    return {
        status: {"description": DESCRIPTIONS[status], "content": content} for status in statuses
    }


def describe_problems(document: dict[str, Any]) -> None:
    """Add the problem schema, in place of FastAPI's own for 422, and the problems of all routes."""
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    schemas["Problem"] = SCHEMA
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    for path, item in document["paths"].items():
        for operation in item.values():
            statuses = [503] if path.startswith("/api/") or path == "/readyz" else []
            statuses += [404, 413, 415, 422] if "requestBody" in operation else []
            statuses += [404] if "{" in path else []
            statuses += [422] if "parameters" in operation else []
            common = {str(key): answer for key, answer in problem_responses(*statuses).items()}
            answers = operation["responses"] | common
            operation["responses"] = dict(sorted(answers.items()))


def problem_response(problem: Problem, headers: dict[str, str] | None = None) -> Response:
    """The document as a response; a 408 also closes the connection."""
    if problem.status == HTTPStatus.REQUEST_TIMEOUT:
        headers = {"Connection": "close"} | (headers or {})
    document = {
        "type": problem.kind,
        "title": HTTPStatus(problem.status).phrase,
        "status": problem.status,
        "detail": problem.detail,
    }
    return JSONResponse(document | problem.extra, problem.status, headers, MEDIA_TYPE)


ErrorAnswers = dict[type[Exception], tuple[int, str]]
"""Status and kind of the problem that answers an error."""


def install_problems(app: FastAPI, answers: ErrorAnswers) -> None:
    """Answer every error with a problem document: those of all routes, and `answers`."""
    from app.store.store import Damaged, InUse, KeptPermanently, NotFound, StoreError

    def answer(status: int, kind: str):
        async def handler(request: Request, error: Exception) -> Response:
            text = str(error.args[0]) if error.args else str(error)
            return problem_response(Problem(status, text, f"urn:forewarn:{kind}"))

        return handler

    handlers: ErrorAnswers = {
        NotFound: (404, "not-found"),
        InUse: (409, "in-use"),
        KeptPermanently: (409, "kept"),
        Damaged: (500, "damaged"),
        StoreError: (503, "store"),
        RecipeError: (422, "recipe"),
        CollectionError: (422, "recipe"),
        TelemetryError: (422, "telemetry"),
        MonitorFileError: (422, "monitor-file"),
        AirframeError: (422, "airframe"),
        Busy: (429, "busy"),
        NoSpace: (507, "space"),
        Stalled: (408, "stalled"),
        ClientDisconnect: (408, "stalled"),  # the client has left
    }
    for error, (status, kind) in (handlers | answers).items():
        app.add_exception_handler(error, answer(status, kind))
    app.add_exception_handler(Problem, _problem)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(RequestValidationError, _validation)
    app.add_exception_handler(Exception, _internal)


def content_type(request: Request) -> str:
    """Media type of the body, without parameters; empty where none is given."""
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


def wrong_type(request: Request) -> Problem:
    kind = content_type(request) or "none"
    return Problem(415, f"the body has content type {kind}: send application/json")


async def _problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, Problem)
    return problem_response(error)


async def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    detail = error.detail
    if (
        error.status_code == 400 and "parsing the body" in detail
    ):  # FastAPI's message for invalid UTF-8
        return problem_response(Problem(422, "the body is not JSON", "urn:forewarn:request"))
    if detail == HTTPStatus(error.status_code).phrase:
        detail = f"{detail}: {request.method} {request.url.path}"
    headers = dict(error.headers or {})
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(_allowed(request)) or headers.get("Allow", "")
    return problem_response(Problem(error.status_code, detail), headers)


def _allowed(request: Request) -> list[str]:
    """Methods of all routes at this path; the router names those of one route only."""
    routes = [
        context.methods or ()
        for context in iter_route_contexts(request.app.routes)
        if context.path and compile_path(context.path)[0].match(request.url.path)
    ]
    return sorted({method for methods in routes for method in methods})


async def _validation(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    if isinstance(error.body, bytes):  # not read as JSON
        return problem_response(wrong_type(request))
    inputs = {
        "body": error.body,
        "query": dict(request.query_params),
        "path": request.path_params,
        "header": dict(request.headers),
    }
    faults = input_errors(error.errors(), inputs)[:20]
    errors = [{"where": place, "reason": reason} for place, reason in faults]
    sentences = (
        InputError(place.partition(".")[2] or place, reason) for place, reason in faults[:3]
    )
    detail = "; ".join(map(str, sentences))
    return problem_response(Problem(422, detail, "urn:forewarn:request", errors=errors))


async def _internal(request: Request, error: Exception) -> Response:
    reference = secrets.token_hex(4)
    LOG.error("reference %s: %s %s", reference, request.method, request.url.path, exc_info=error)
    text = f"internal error: see reference {reference} in the server's log"
    return problem_response(Problem(500, text, "urn:forewarn:internal", reference=reference))
