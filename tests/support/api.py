"""The application in process, for tests of the API."""

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
from starlette.testclient import TestClient

from app.main import create_app
from app.serving import Server, address_of, listen
from app.settings import Settings
from tests.support.direct_sockets import DirectSockets
from tests.support.patience import PATIENCE

ADDRESS = "http://127.0.0.1:8000"


@contextmanager
def api(data_dir: Path, **settings: Any) -> Iterator[TestClient]:
    """The application with its lifespan, answering errors as it would over a socket."""
    app = create_app(Settings(data_dir=data_dir, **settings))
    app.add_middleware(DirectSockets)
    with TestClient(app, base_url=ADDRESS, raise_server_exceptions=False) as client:
        yield client


@cache
def document() -> dict[str, Any]:
    """The API's OpenAPI document, the same whatever the settings; making it takes half a second."""
    return create_app(Settings(data_dir=Path("unused"))).openapi()


@contextmanager
def served(data_dir: Path, **limits: Any) -> Iterator[tuple[str, Server]]:
    """A server in a thread, on a socket; its address."""
    settings = Settings(data_dir=data_dir, port=0, **limits)
    listening, started = listen(settings), threading.Event()

    async def opened(_: object) -> None:
        started.set()

    server = Server(create_app(settings), opened)
    thread = threading.Thread(target=server.run, args=([listening],))
    thread.start()
    try:
        assert started.wait(PATIENCE)
        yield address_of(listening, settings), server
    finally:
        server.should_exit = True
        thread.join(PATIENCE)
        listening.close()
    assert not thread.is_alive()


@contextmanager
def command(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A `forewarn` of its own; the process and the address it printed."""
    call = [sys.executable, "-c", "from app.cli import main; raise SystemExit(main())", *arguments]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = next((line for line in process.stdout if "http" in line), "")
            address = re.search(r"http://[^/\s]+", line)
            assert address, line
            yield process, address[0]
        finally:
            process.kill()


def store_of(client: TestClient) -> Any:
    return client.app.state.store  # pyright: ignore


def problem(response: Any, status: int) -> str:
    """Check that a response is a problem document; return its detail."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    document = response.json()
    assert document["status"] == status
    assert document["title"]
    assert "Traceback" not in response.text
    return document["detail"]


def events(client: TestClient, location: str) -> list[dict[str, Any]]:
    """Every event of a job, to its end."""
    with client.stream("GET", f"{location}/events") as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        lines = [line.removeprefix("data: ") for line in stream.iter_lines() if "data: " in line]
    return [msgspec.json.decode(line) for line in lines]


def finished(client: TestClient, response: Any) -> dict[str, Any]:
    """Follow a 202 to the end of its job; return the job."""
    assert response.status_code == 202, response.text
    return events(client, response.headers["location"])[-1]
