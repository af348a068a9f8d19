"""A server in its own process, to be killed or starved; forked from one with the imports done."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple

import httpx2

from app.serving import serve
from app.settings import Settings
from tests.support.forked_processes import PROCESSES
from tests.support.patience import PATIENCE, until


class Running(NamedTuple):
    """A server under way."""

    process: BaseProcess
    client: httpx2.Client


def _serve(settings: Settings, opened: Connection) -> None:
    async def say(_: object, address: str) -> None:
        opened.send(address)

    serve(settings, say)


@contextmanager
def reserved_port() -> Iterator[int]:
    """A port for a server that is started again: meanwhile the system gives it to nobody else.

    A socket that does not listen leaves it to one that does, where both may share the address.
    """
    with socket.socket() as held:
        held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        held.bind(("127.0.0.1", 0))
        yield held.getsockname()[1]


@contextmanager
def running(data_dir: Path, port: int = 0, max_jobs: int = 0, **others: Any) -> Iterator[Running]:
    """A server of this directory; killed at the end, if it still runs."""
    settings = Settings(data_dir=data_dir, port=port, max_jobs=max_jobs, **others)
    with _started(settings) as (process, receiver):
        assert receiver.poll(PATIENCE), "the server did not start"
        with _asking(receiver.recv()) as client:
            yield Running(process, client)


@contextmanager
def sharing(data_dir: Path, port: int, **others: Any) -> Iterator[Running]:
    """A server that shares its directory and database, as soon as it or the owner answers."""
    address = f"http://127.0.0.1:{port}"
    settings = Settings(data_dir=data_dir, port=port, max_jobs=0, shared=address, **others)
    with _started(settings) as (process, _), _asking(address) as client:
        until(lambda: answers(client))
        yield Running(process, client)


def answers(client: httpx2.Client) -> bool:
    """Whether a server answers, itself or through another."""
    try:
        return client.get("/healthz").is_success
    except httpx2.TransportError:
        return False


def _asking(address: str) -> httpx2.Client:
    return httpx2.Client(base_url=address, timeout=PATIENCE, trust_env=False)


@contextmanager
def _started(settings: Settings) -> Iterator[tuple[BaseProcess, Connection]]:
    receiver, sender = PROCESSES.Pipe(duplex=False)
    process = PROCESSES.Process(target=_serve, args=(settings, sender))
    process.start()
    sender.close()
    try:
        yield process, receiver
    finally:
        process.kill()
        process.join()
