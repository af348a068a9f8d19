"""A viser server that only this process can reach, without viser's public tunnel.

viser listens on a TCP port without authentication, serves its own page there, and opens a tunnel to
the internet for any client. Here the port is on 127.0.0.1 and every request needs a secret that
never leaves this process; routes/scene.py is the only access.
"""

import hmac
import http.client
import logging
import secrets
from functools import cache
from http import HTTPStatus
from types import SimpleNamespace
from typing import Any, Literal

import msgspec
import rich
import viser
import websockets.asyncio.server
import websockets.datastructures
import websockets.exceptions
from viser import _messages
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

HOST = "127.0.0.1"
SECRET_HEADER = "X-Forewarn-Scene"
LARGEST_MESSAGE = 16_384
"""Largest message of a watcher [bytes]; a camera pose has about 250."""
SUBPROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


QUIET = logging.getLogger("forewarn.scene")
"""Requests without the secret are refused silently; lower the level to see them."""
QUIET.setLevel(logging.CRITICAL)


class SceneServerError(RuntimeError):
    """The server could not be secured and was stopped."""


@cache
def secret() -> str:
    return secrets.token_urlsafe(32)


def open_server() -> viser.ViserServer:
    """Start a server on a free loopback port, with the secret and without the tunnel.

    Blocks for a few milliseconds. SceneServerError if it answers without the secret.
    """
    _guard()
    server = viser.ViserServer(host=HOST, port=0, label="Forewarn", verbose=False)
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)
    if (status := _status_for_a_stranger(server.get_port())) != HTTPStatus.FORBIDDEN:
        server.stop()
        raise SceneServerError(
            f"viser {viser.__version__} answered {status} instead of 403 to a request without the "
            "secret; the scene stays closed: install the viser version that this program requires"
        )
    return server


def address(server: viser.ViserServer) -> str:
    """Address for the proxy, which also needs `credentials`."""
    return f"ws://{HOST}:{server.get_port()}"


def credentials() -> dict[str, str]:
    return {SECRET_HEADER: secret()}


@cache
def _guard() -> None:
    """Require the secret for every viser server of this process, and silence viser's output.

    viser has settings for neither, so `websockets` is replaced, in its module only. Only viser
    prints through rich's global console.
    """
    library: Any = SimpleNamespace(
        asyncio=SimpleNamespace(
            server=SimpleNamespace(serve=_serve, ServerConnection=ServerConnection)
        ),
        datastructures=websockets.datastructures,
        exceptions=websockets.exceptions,
    )
    setattr(_infra, "websockets", library)  # noqa: B010 - type checkers forbid the plain form
    rich.get_console().quiet = True


def _serve(handler: Any, host: str, port: int, **options: Any) -> Any:
    options |= {"process_request": _refuse_strangers, "max_size": LARGEST_MESSAGE, "logger": QUIET}
    return websockets.asyncio.server.serve(handler, host, port, **options)


def _refuse_strangers(connection: ServerConnection, request: Request) -> Response | None:
    given = request.headers.get(SECRET_HEADER, "")
    if hmac.compare_digest(given.encode(), secret().encode()):
        return None
    return connection.respond(HTTPStatus.FORBIDDEN, "this port belongs to another program\n")


def _status_for_a_stranger(port: int) -> int:
    stranger = http.client.HTTPConnection(HOST, port, timeout=5.0)
    try:
        stranger.request("GET", "/")
        return stranger.getresponse().status
    finally:
        stranger.close()


class CameraMessage(msgspec.Struct, forbid_unknown_fields=True):
    """Where a watcher looks from, as viser names it: the one message that goes upstream."""

    type: Literal["ViewerCameraMessage"]
    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]


_decoder = msgspec.msgpack.Decoder(CameraMessage)


def admitted(message: bytes) -> bytes | None:
    """The message as it may go upstream, rewritten; None for all that is not a camera pose."""
    if len(message) > LARGEST_MESSAGE:
        return None
    try:
        return msgspec.msgpack.encode(_decoder.decode(message))
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError):
        return None
