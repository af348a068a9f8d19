"""JSON of plain data, dataclasses and numpy arrays; non-finite numbers become null."""

from typing import Annotated, Any

import msgspec
from pydantic import BeforeValidator, Strict


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, Strict(), BeforeValidator(_whole)]
"""An integer of a request; JSON may write it as 3 or 3.0."""


_encoder = msgspec.json.Encoder(enc_hook=lambda value: value.tolist())


class NotJson(ValueError):
    """Input that is not JSON."""


def encode(content: Any) -> bytes:
    """JSON text, each float with the fewest digits that restore it."""
    return _encoder.encode(content)


def decode(text: bytes | str) -> Any:
    """Plain data from JSON. NotJson, also if nested too deeply."""
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise NotJson(str(error)) from error
