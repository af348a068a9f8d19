"""JSON of plain data, dataclasses and numpy arrays; what is not finite becomes null."""

from typing import Annotated, Any

import msgspec
from pydantic import BeforeValidator, Strict


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, Strict(), BeforeValidator(_whole)]
"""An integer of a request, as JSON may write it: 3 or 3.0."""


_encoder = msgspec.json.Encoder(enc_hook=lambda value: value.tolist())


class NotJson(ValueError):
    """What was sent is not JSON; says where."""


def encode(content: Any) -> bytes:
    """Return content as JSON, each float by the fewest digits that mean it."""
    return _encoder.encode(content)


def decode(text: bytes | str) -> Any:
    """Return what JSON says, as plain data; NotJson where it is none, or too deep."""
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise NotJson(str(error)) from error
