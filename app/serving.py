"""Serving: the listening socket, the server around the application, one server a data directory."""

import asyncio
import gc
import socket
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI
from filelock import FileLock, Timeout

from app.http.bounded_protocol import BoundedHttp
from app.http.direct_websocket import DirectWebSocket
from app.http.refusals import Refusals
from app.main import create_app
from app.settings import Settings, SettingsError
from app.store.database import address, file_of
from app.store.store import open_store

UNANSWERED_MS = 5_000
"""A connection whose peer answers nothing for so long is given up."""
LARGEST_MESSAGE = 262_144
PATIENCE = 3
"""[s] Connections that still run when the server stops are given so long."""
GRACE = 1
"""[s] What a request then still does is cancelled so much later."""
BACKLOG = 128
COLLECTED = 20_000, 50, 10
"""Objects made before cycles among them are looked for: samples make few, and none waits."""
THREAD_TURN_S = 0.001
"""What a thread that computes may keep the event loop waiting [s]; the interpreter's own is five
times as long, and a sample waits for it again at each wake-up of the loop."""

Opened = Callable[[FastAPI], Awaitable[None]]


class Server(uvicorn.Server):
    """A server that says when it takes requests."""

    def __init__(self, app: FastAPI, opened: Opened | None = None) -> None:
        settings: Settings = app.state.settings
        http: Any = partial(BoundedHttp, settings, Refusals())
        super().__init__(
            uvicorn.Config(
                app,
                access_log=False,
                log_level="warning",
                server_header=False,
                proxy_headers=False,
                http=http,
                timeout_keep_alive=settings.idle_seconds,  # pyright: ignore[reportArgumentType]
                ws=DirectWebSocket,
                ws_max_size=LARGEST_MESSAGE,
                ws_per_message_deflate=False,
                timeout_graceful_shutdown=PATIENCE + GRACE,
            )
        )
        self.app = app
        self.opened = opened

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then say so."""
        await super().startup(sockets)
        if self.started and self.opened is not None:
            await self.opened(self.app)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop. Who has not taken his answer after PATIENCE is dropped."""
        dropping = asyncio.get_running_loop().call_later(PATIENCE, self._drop_connections)
        await super().shutdown(sockets)
        dropping.cancel()
        self._drop_connections()
        await asyncio.sleep(0)  # a transport closes on the loop's next turn

    def _drop_connections(self) -> None:
        for connection in list(self.server_state.connections):
            if connection.transport is not None:
                connection.transport.abort()


def listen(settings: Settings) -> socket.socket:
    """Return a listening socket; SettingsError where the address cannot be had."""
    listening = None
    try:
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNANSWERED_MS)
        listening.bind((settings.host, settings.port))
        listening.listen(BACKLOG)
    except OSError as error:
        if listening is not None:
            listening.close()
        raise SettingsError(
            f"{settings.host}:{settings.port} cannot be listened on "
            f"({error.strerror or error}): choose another port with --port"
        ) from error
    listening.setblocking(False)
    return listening


def address_of(listening: socket.socket, settings: Settings) -> str:
    """The address to open in a browser."""
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    if settings.host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    return f"http://{host}:{listening.getsockname()[1]}"


def serve(
    settings: Settings,
    opened: Callable[[FastAPI, str], Awaitable[None]],
    listening: socket.socket | None = None,
) -> None:
    """Serve until interrupted; `opened` is called with the application and its address.

    listening: the socket of `listen`, where it was taken before; it is closed in the end.

    SettingsError where the address or the data directory is taken, StoreError where the database
    cannot be used: said before anything listens.
    """
    with alone(settings):
        open_store(settings.url).close()
        listening = listening or listen(settings)
        here = address_of(listening, settings)
        server = Server(create_app(settings), lambda app: opened(app, here))
        gc.collect()
        gc.freeze()  # what is loaded stays: a sample never waits until all of it was looked through
        gc.set_threshold(*COLLECTED)
        sys.setswitchinterval(THREAD_TURN_S)
        try:
            with asyncio.Runner(loop_factory=_loop_factory()) as runner:
                runner.run(server.serve(sockets=[listening]))
        except KeyboardInterrupt:  # the server has stopped in good order by then
            return
        finally:
            listening.close()


@contextmanager
def alone(settings: Settings) -> Iterator[None]:
    """Hold the data directory and an SQLite database for this process alone.

    The directory is made where it is missing. SettingsError where another process serves either, or
    they cannot be written.
    """
    database = file_of(address(settings.url))
    with _locked(settings.data_dir, settings.data_dir / "forewarn.lock", "--data-dir"):
        if database is None:
            yield
            return
        lock = database.with_name(f"{database.name}.lock")
        with _locked(database, lock, "--database-url"):
            yield


@contextmanager
def _locked(what: Path, path: Path, option: str) -> Iterator[None]:
    """Hold a lock file. what: that it is of.   option: chooses another."""
    lock = FileLock(path, timeout=0, mode=0o600)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise SettingsError(
            f"another forewarn serves {what}: stop it, or choose another with {option}"
        ) from None
    except OSError as error:
        raise SettingsError(
            f"{what} cannot be written ({error.strerror}): choose another with {option}"
        ) from error
    try:
        yield
    finally:
        lock.release()


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """uvloop's where it is installed."""
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop
