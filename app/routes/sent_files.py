"""A file as people send it: in a form, or as the body itself under any content type."""

import re
from collections.abc import AsyncIterator
from typing import Any, NamedTuple

from fastapi import Request

from app.http.problems import Problem
from app.routes.dependencies import content_type

FORM, OCTETS = "multipart/form-data", "application/octet-stream"
BOUNDARY = re.compile(r'boundary=(?:"([^"]{1,70})"|([^\s;"]{1,70}))', re.IGNORECASE)
FILE_NAME = re.compile(rb'filename="((?:[^"\\]|\\.)*)"', re.IGNORECASE)
END = b"--"
"""Stands behind the last boundary."""
LARGEST_HEAD = 16_384
"""Bytes of the headers of one field of a form."""
_BINARY = {"type": "string", "format": "binary"}
CONTENT: dict[str, Any] = {
    FORM: {
        "schema": {
            "title": "File in a form",
            "type": "object",
            "properties": {"file": _BINARY},
            "required": ["file"],
        },
        "example": {"file": "t_s,beta_rad\n0.0,0.01\n"},
    },
    OCTETS: {
        "schema": _BINARY | {"description": "the file; any other type will do"},
        "example": "t_s,beta_rad\n0.0,0.01\n",
    },
}
"""OpenAPI's description of a file that is sent."""


class SentFile(NamedTuple):
    """A file that comes. name: what its sender calls it, "" where that is not said."""

    name: str
    content: AsyncIterator[bytes]


async def sent_file(request: Request) -> SentFile:
    """Return the body, or the first file of a form; Problem 415 where packed, 422 for none."""
    if packed := request.headers.get("content-encoding"):
        raise Problem(415, f"the body is {packed}: send the file itself, unpacked")
    if content_type(request) != FORM:
        return SentFile("", request.stream())
    boundary = BOUNDARY.search(request.headers.get("content-type", ""))
    if boundary is None:
        raise Problem(422, f"{FORM} names no boundary: send it as curl -F file=@FILE does")
    return await _Form(request.stream(), (boundary[1] or boundary[2]).encode()).file()


class _Form:
    """A multipart body, read as it comes."""

    def __init__(self, stream: AsyncIterator[bytes], boundary: bytes) -> None:
        self._stream, self._mark = stream, b"\r\n--" + boundary
        self._held = bytearray(b"\r\n")

    async def file(self) -> SentFile:
        """The first field that has a file's name."""
        while True:
            async for _ in self._until(self._mark):
                pass  # what stands before the first field, or in one that is no file
            head = await self._head()
            if name := FILE_NAME.search(head):
                text = re.sub(rb"\\(.)", rb"\1", name[1]).decode("utf-8", "replace")
                return SentFile(text, self._until(self._mark))

    async def _head(self) -> bytes:
        """The headers of the field that begins; Problem 422 where the form ends instead."""
        while len(self._held) < len(END):
            await self._more()
        if self._held.startswith(END):
            raise Problem(422, "the form holds no file: send it as curl -F file=@FILE does")
        head = bytearray()
        async for part in self._until(b"\r\n\r\n"):
            head += part
            if len(head) > LARGEST_HEAD:
                raise Problem(422, "the form's headers are too long: send it as curl -F does")
        return bytes(head)

    async def _until(self, mark: bytes) -> AsyncIterator[bytes]:
        """What comes before a mark, which is taken away; Problem 422 where it never comes."""
        while (at := self._held.find(mark)) < 0:
            sure = len(self._held) - len(mark) + 1
            if sure > 0:
                yield bytes(self._held[:sure])
                del self._held[:sure]
            await self._more()
        yield bytes(self._held[:at])
        del self._held[: at + len(mark)]

    async def _more(self) -> None:
        async for chunk in self._stream:
            if chunk:
                self._held += chunk
                return
        raise Problem(422, "the form ends before its file does: send it again")
