"""Export of the audit log."""

import csv
import io
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, fields
from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import Query, Request, Response
from fastapi.responses import StreamingResponse

from app import json_codec
from app.access.audit import Audit
from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.routes.dependencies import StoreDep
from app.store.audit import AuditEntry
from app.store.store import StoreError
from app.store.tables import time_text

router = Router(prefix="/api/v1", tags=["people"])
JSON_LINES, CSV = "application/x-ndjson", "text/csv"


def utc(text: str) -> str:
    """A day or time as stored; without a zone it is UTC. ValueError."""
    try:
        time = datetime.fromisoformat(text)
        time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except (ValueError, OverflowError):
        raise ValueError(
            f"{text!r} is not a time: give 2026-05-04 or 2026-05-04T12:31:05 (UTC)"
        ) from None
    return time_text(time)


def as_csv(entries: Iterable[AuditEntry]) -> Iterator[str]:
    file = io.StringIO()
    writer = csv.DictWriter(file, [each.name for each in fields(AuditEntry)], lineterminator="\n")
    writer.writeheader()
    for entry in entries:
        writer.writerow(asdict(entry))
        yield file.getvalue()
        file.seek(0)
        file.truncate()
    yield file.getvalue()


def as_json_lines(entries: Iterable[AuditEntry]) -> Iterator[str]:
    for entry in entries:
        yield json_codec.encode(asdict(entry)).decode() + "\n"


@router.get(
    "/audit",
    response_class=Response,
    responses={
        200: {
            "content": {
                JSON_LINES: {"schema": {"type": "string"}},
                CSV: {"schema": {"type": "string"}},
            }
        },
        **problem_responses(422),
    },
)
async def export_audit(
    request: Request,
    store: StoreDep,
    since: Annotated[str | None, Query(description="first day or time in ISO 8601, UTC")] = None,
    until: Annotated[str | None, Query(description="entries before this day or time")] = None,
    who: Annotated[str | None, Query(description="name of a person")] = None,
    kind: Annotated[
        Literal["jsonl", "csv"], Query(alias="format", description="JSON lines or CSV")
    ] = "jsonl",
) -> Response:
    """The audit log, oldest first: changes, logins, and requests that a role did not allow.

    For samples of a live flight it holds only the first push of each person.
    """
    try:
        first, last = (None if text is None else utc(text) for text in (since, until))
    except ValueError as error:
        raise Problem(422, str(error), "urn:forewarn:request") from error
    log: Audit = request.app.state.audit
    with suppress(StoreError):  # the stored entries can still be read
        await log.flush(store)
    entries = store.audit.read(first, last, who)
    if kind == "csv":
        return StreamingResponse(as_csv(entries), media_type=CSV)
    return StreamingResponse(as_json_lines(entries), media_type=JSON_LINES)
