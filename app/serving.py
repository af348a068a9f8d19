"""Serving: the listening socket, the server, and one owner per data directory and database."""

import asyncio
import gc
import logging
import os
import socket
import sys
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import Any

import uvicorn
from fastapi import FastAPI

from app.http.bounded_protocol import BoundedHttp
from app.http.direct_websocket import DirectWebSocket
from app.http.relay import Relay
from app.main import create_app, follower_of
from app.settings import Settings, SettingsError
from app.store.database import StoreError, address
from app.store.ownership import PROGRAM, FileHold, Taken, owned, published, published_by
from app.store.people import digest_of
from app.store.store import open_store

UNANSWERED_MS = 5_000
"""A connection is dropped if its peer does not answer for this time."""
LARGEST_MESSAGE = 262_144
PATIENCE = 3
"""[s] Time that open connections have when the server stops."""
GRACE = 1
"""[s] Requests still running after that time are cancelled this much later."""
BACKLOG = 128
THREAD_TURN_S = 0.001
"""Longest time that a computing thread delays the event loop [s]. The interpreter's default is five
times as long, and a sample would wait for it at each wake-up of the loop."""
PRIORITY = 1
"""Of real-time programs, the lowest."""
LIVE_THREADS = "journal", "recorder"
"""Beginnings of the names of the threads that write what is flown."""
LOOK_EVERY_S = 0.2
"""[s] How often a server that shares a database asks whether it is the owner's turn."""
NO_OWNER_S = 10.0
"""[s] Longest time between the lock of a database and its owner's address."""
LOG = logging.getLogger("forewarn")

Opened = Callable[[FastAPI], Awaitable[None]]


class Server(uvicorn.Server):
    """A server that calls `opened` when it accepts requests."""

    def __init__(self, app: FastAPI, opened: Opened | None = None) -> None:
        settings: Settings = app.state.settings
        http: Any = partial(BoundedHttp, settings)
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
        """Raise the error of a failed start, which uvicorn would only log."""
        log = logging.getLogger("uvicorn.error")
        log.disabled = True
        try:
            await super().startup(sockets)
        except SystemExit:
            if failure := getattr(self.app.state, "failure", None):
                raise failure from None
            raise
        finally:
            log.disabled = False
        if self.started and self.app.state.settings.real_time:
            self._first = asyncio.create_task(keep_live_threads_first())
        if self.started and self.opened is not None:
            await self.opened(self.app)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop. Clients that have not read their answer after PATIENCE are dropped."""
        self.app.state.changes.close()
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
    """A listening socket. SettingsError if the address is not available."""
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
            f"{settings.host}:{settings.port} is not available "
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

    listening: a socket from `listen`; it is closed at the end.
    A server that shares its database relays to its owner until it is the owner itself.
    SettingsError if the address or the data directory is in use or real-time scheduling is not
    allowed, StoreError if the database cannot be used: before anything listens.
    """
    with ExitStack() as held, suppress(KeyboardInterrupt):  # then all has stopped cleanly
        if settings.real_time:
            go_first()
        follower = follower_of(settings)
        if settings.shared is None:
            held.enter_context(alone(settings))
        else:
            listening = listening or listen(settings)
            held.callback(listening.close)
            with asyncio.Runner(loop_factory=_loop_factory()) as runner:
                held.callback(follower.end)
                held.push(runner.run(until_owner(settings, listening, follower.start)))
        held.enter_context(shared(settings))
        open_store(settings.url).close()
        listening = listening or listen(settings)
        held.callback(listening.close)
        url = address_of(listening, settings)
        server = Server(create_app(settings, follower), lambda app: opened(app, url))
        gc.collect()
        gc.freeze()  # no sample waits for a collection of what is loaded
        sys.setswitchinterval(THREAD_TURN_S)
        with asyncio.Runner(loop_factory=_loop_factory()) as runner:
            runner.run(server.serve(sockets=[listening]))


def go_first(thread: int = 0) -> None:
    """Run a thread, by default this one, before other programs; what it starts does not.

    thread: number that the system gives it.   SettingsError where the system does not allow it.
    """
    try:
        policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(thread, policy, os.sched_param(PRIORITY))
    except ProcessLookupError:  # it has ended
        return
    except (AttributeError, OSError) as error:
        raise SettingsError(
            f"real-time scheduling is not allowed here ({error}): allow it, on Linux by systemd's "
            "LimitRTPRIO=1 or the capability SYS_NICE, or start without --real-time"
        ) from error


async def keep_live_threads_first() -> None:
    """Run the threads that write samples before other programs, too; never returns.

    The event loop would wait for one that is stopped while it holds the interpreter.
    """
    first: set[int] = set()
    while True:
        for thread in threading.enumerate():
            number = thread.native_id
            if number is not None and number not in first and thread.name.startswith(LIVE_THREADS):
                go_first(number)
                first.add(number)
        await asyncio.sleep(LOOK_EVERY_S)


@contextmanager
def alone(settings: Settings) -> Iterator[None]:
    """Lock the data directory and the database for this process.

    Creates the directory if needed. SettingsError if another process serves either, or if they are
    not writable.
    """
    directory = FileHold(settings.data_dir, settings.data_dir / "forewarn.lock", "--data-dir")
    with ExitStack() as held:
        try:
            directory.take()
            held.callback(directory.release)
            held.enter_context(owned(address(settings.url), first=True))
        except StoreError as error:
            raise SettingsError(str(error)) from error
        yield


# --- several servers that share a database ----------------------------------------------------


def owner_of(settings: Settings) -> str:
    """Address of the owner; empty if no server owns the database, or it is not shared.

    SettingsError if this server would admit other people than the owner.
    """
    owner, about = published_by(settings.data_dir), about_access(settings)
    address = owner.get("address", "")
    if address in ("", settings.shared):  # left by this one, when it was killed
        return ""
    if different := [name for name, value in about.items() if owner.get(name) != value]:
        raise SettingsError(
            f"{address}, which owns the database, has another {' and '.join(different)} than this "
            "server: start all that share it with the same"
        )
    return address


def about_access(settings: Settings) -> dict[str, Any]:
    """What is the same in all servers of a database, as a take-over must change nothing."""
    token = None if settings.token is None else digest_of(settings.token)
    return {"token": token, "version": PROGRAM, "allowed hosts": [*settings.allowed_hosts]}


@contextmanager
def shared(settings: Settings) -> Iterator[None]:
    """Tell the servers that share the database how to reach this one, its owner."""
    about = {"address": settings.shared} | about_access(settings)
    with published(settings.data_dir, None if settings.shared is None else about):
        yield


async def until_owner(
    settings: Settings, listening: socket.socket, stands_by: Callable[[], object]
) -> ExitStack:
    """Relay connections to the owner of the database until it has ended; what this one holds then.

    stands_by: called when there is an owner.
    SettingsError if the owner does not share, or admits other people.
    """
    owner, last, held, unknown_s = "", "", ExitStack(), 0.0
    relaying = asyncio.create_task(Relay(listening, lambda: owner).run())
    try:
        while True:
            try:
                await asyncio.to_thread(held.enter_context, alone(settings))
            except SettingsError as error:
                if not isinstance(error.__cause__, Taken):
                    raise
                now = owner_of(settings)
                unknown_s = 0.0 if now else unknown_s + LOOK_EVERY_S
                if unknown_s > NO_OWNER_S:
                    raise
            else:
                if last:
                    LOG.warning("%s has ended: %s owns the database now", last, settings.shared)
                return held
            if now not in ("", last):
                LOG.warning("%s is on standby: %s owns the database", settings.shared, now)
                sys.setswitchinterval(THREAD_TURN_S)
                stands_by()
            owner, last = now, now or last
            await asyncio.sleep(LOOK_EVERY_S)
    finally:
        relaying.cancel()
        await asyncio.wait([relaying])


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop
