"""Uploaded files: in a form, or as the body with any content type."""

import re
from collections.abc import AsyncIterator
from typing import Any

from fastapi import Request

from app.http.problems import Problem, content_type
from app.recordings.upload import SentField

FORM, OCTETS = "multipart/form-data", "application/octet-stream"
BOUNDARY = re.compile(r'boundary=(?:"([^"]{1,70})"|([^\s;"]{1,70}))', re.IGNORECASE)
FILE_NAME = re.compile(rb'filename="((?:[^"\\]|\\.)*)"', re.IGNORECASE)
FIELD_NAME = re.compile(rb'[;\s]name="((?:[^"\\]|\\.)*)"', re.IGNORECASE)
END = b"--"
"""Follows the last boundary."""
LARGEST_HEAD = 16_384
"""Longest headers of one field of a form [bytes]."""
BINARY: dict[str, Any] = {"type": "string", "format": "binary"}
CONTENT: dict[str, Any] = {
    FORM: {
        "schema": {
            "title": "File in a form",
            "type": "object",
            "properties": {"file": BINARY},
            "required": ["file"],
        },
        "example": {"file": "t_s,beta_rad\n0.0,0.01\n"},
    },
    OCTETS: {
        "schema": BINARY | {"description": "the file; any other content type is accepted too"},
        "example": "t_s,beta_rad\n0.0,0.01\n",
    },
}
"""OpenAPI description of an uploaded file."""


async def sent_file(request: Request) -> SentField:
    """The body, or the first file of a form. Problem 415 if compressed, 422 without a file."""
    async for field in sent_fields(request):
        if field.file_name or content_type(request) != FORM:
            return field
    raise Problem(422, "the form has no file: send it as curl -F file=@FILE does")


async def sent_fields(request: Request) -> AsyncIterator[SentField]:
    """The fields of a form in order, each valid until the next; or the body as the only one.

    Problem 415 if compressed, 422 for an invalid form.
    """
    if packed := request.headers.get("content-encoding"):
        raise Problem(415, f"the body is compressed ({packed}): send the file uncompressed")
    if content_type(request) != FORM:
        yield SentField("file", "", request.stream())
        return
    boundary = BOUNDARY.search(request.headers.get("content-type", ""))
    if boundary is None:
        raise Problem(422, f"{FORM} has no boundary: send it as curl -F file=@FILE does")
    async for field in _Form(request.stream(), (boundary[1] or boundary[2]).encode()).fields():
        yield field


class _Form:
    """A multipart body, read chunk by chunk."""

    def __init__(self, stream: AsyncIterator[bytes], boundary: bytes) -> None:
        self._stream, self._mark = stream, b"\r\n--" + boundary
        self._buffer = bytearray(b"\r\n")

    async def fields(self) -> AsyncIterator[SentField]:
        content = self._until(self._mark)
        while True:
            async for _ in content:
                pass  # skip the preamble, and what is left of the last field
            head = await self._head()
            if head is None:
                return
            content = self._until(self._mark)
            yield SentField(_named(FIELD_NAME, head), _named(FILE_NAME, head), content)

    async def _head(self) -> bytes | None:
        """The headers of the next field; None at the end of the form."""
        while len(self._buffer) < len(END):
            await self._more()
        if self._buffer.startswith(END):
            return None
        head = bytearray()
        async for part in self._until(b"\r\n\r\n"):
            head += part
            if len(head) > LARGEST_HEAD:
                raise Problem(422, "the form's headers are too long: send it as curl -F does")
        return bytes(head)

    async def _until(self, mark: bytes) -> AsyncIterator[bytes]:
        """The bytes before a mark, which is consumed; Problem 422 if the mark is missing."""
        while (at := self._buffer.find(mark)) < 0:
            safe = len(self._buffer) - len(mark) + 1
            if safe > 0:
                yield bytes(self._buffer[:safe])
                del self._buffer[:safe]
            await self._more()
        yield bytes(self._buffer[:at])
        del self._buffer[: at + len(mark)]

    async def _more(self) -> None:
        async for chunk in self._stream:
            if chunk:
                self._buffer += chunk
                return
        raise Problem(422, "the form ends before the file: send it again")


def _named(name: re.Pattern[bytes], head: bytes) -> str:
    """A name in the headers of a field; "" if it has none."""
    match = name.search(head)
    return re.sub(rb"\\(.)", rb"\1", match[1]).decode("utf-8", "replace") if match else ""
