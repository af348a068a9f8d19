"""Limits of a connection: a real server and real sockets, with times of a fraction of a second."""

import asyncio
import json
import socket
import struct
import threading
import time
from contextlib import contextmanager

import httpx2
import pytest
from fastapi import Request, WebSocket
from fastapi.routing import APIRoute, APIWebSocketRoute
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.http.bounded_protocol import SLOWEST_BODY
from app.recordings import upload as upload_module
from tests.support.api import served
from tests.support.patience import PATIENCE, until
from tests.support.recorded import OCTETS, RECORDINGS, csv_of

SOON = 0.2
"""[s] The limit under test; the others are too long to matter."""
HOST = b"Host: 127.0.0.1\r\n"
GET = b"GET /healthz HTTP/1.1\r\n" + HOST


@contextmanager
def connected(address):
    host, port = address.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), PATIENCE) as connection:
        yield connection


def rest(connection):
    """All bytes until the server closes; TimeoutError if it never does."""
    content = b""
    try:
        while some := connection.recv(65536):
            content += some
    except ConnectionError:
        pass
    return content


def read_ok(connection, n):
    """Read n whole answers of /healthz, in pieces of any size."""
    answers = b""
    while answers.count(b'{"status":"ok"}') < n:
        answers += connection.recv(65536)
    assert answers.count(b"HTTP/1.1 200 ") == n


def refusal(connection, status):
    """The problem document with which the server closes."""
    head, _, body = rest(connection).rpartition(b"\r\n\r\n")
    last = head[head.rfind(b"HTTP/1.1") :]
    assert last.startswith(f"HTTP/1.1 {status} ".encode()), head
    assert b"connection: close" in last.lower()
    assert json.loads(body)["status"] == status
    return json.loads(body)["detail"]


@pytest.fixture(scope="module")
def bounded(tmp_path_factory):
    """A server whose headers are small."""
    with served(tmp_path_factory.mktemp("data"), max_header_bytes=2048) as (address, _):
        yield address


def header_of(size):
    """A request whose header has `size` bytes."""
    start = GET + b"Filler: "
    return start + b"x" * (size - len(start) - 4) + b"\r\n\r\n"


@pytest.mark.parametrize("step", [1, 100, 10_000])
def test_a_header_is_read_up_to_the_limit(bounded, step):
    for size in (2048, 2049, 100_000):
        content = header_of(size)[:4096]
        with connected(bounded) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for first in range(0, min(len(content), 2049), step):
                connection.sendall(content[first : first + step])
            if size == 2048:
                assert connection.recv(65536).startswith(b"HTTP/1.1 200 ")
            else:
                assert "2048 bytes" in refusal(connection, 431)


def test_header_lines_and_the_address_count_as_header(bounded):
    for content in (GET + b"A: b\r\n" * 1000, b"GET /" + b"x" * 4000, b"\r\n" * 3000):
        with connected(bounded) as connection:
            connection.sendall(content[:2049])
            refusal(connection, 431)


def test_a_trailer_has_the_limit_of_a_header(bounded):
    post = b"POST /api/v1/datasets HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\n"
    for tail in (b"1\r\nx\r\n0\r\nFiller: ", b"1;"):
        with connected(bounded) as connection:
            connection.sendall(post + tail + b"x" * 4096)
            refusal(connection, 431)


def test_each_request_of_a_connection_has_its_own_header_limit(bounded):
    with connected(bounded) as connection:
        for _ in range(5):
            connection.sendall(header_of(2000))
            read_ok(connection, 1)
        connection.sendall(header_of(1500) * 3)  # at once
        read_ok(connection, 3)
        connection.sendall(header_of(4000)[:2049])
        refusal(connection, 431)


def test_a_large_body_does_not_count_as_header(bounded):
    body = {"name": "x" * 1_000_000}
    answer = httpx2.post(f"{bounded}/api/v1/datasets", json=body)
    assert answer.status_code == 422
    assert httpx2.post(f"{bounded}/api/v1/datasets", content=iter([b"[" * 9000] * 99)).is_error


def test_half_open_connections_are_closed(tmp_path):
    with served(tmp_path, header_seconds=SOON) as (address, _):
        host, port = address.removeprefix("http://").split(":")
        half = [socket.create_connection((host, int(port)), PATIENCE) for _ in range(100)]
        for number, connection in enumerate(half):
            connection.sendall((b"", GET, b"\r\n", b"G")[number % 4])
        for connection in half:
            assert f"within {SOON} s" in refusal(connection, 408)
            connection.close()
        assert httpx2.get(f"{address}/healthz").status_code == 200


@pytest.mark.parametrize("drop", [b"x", b"A: b\r\n", b"\r\n"])
def test_a_header_that_trickles_is_closed(tmp_path, drop):
    with served(tmp_path, header_seconds=SOON) as (address, _), connected(address) as connection:
        assert trickled(connection, GET if drop != b"\r\n" else b"", drop)


@pytest.mark.parametrize("drop", [b"", b"\r\n", b"G"])
def test_an_idle_connection_is_closed_whatever_trickles_between_requests(tmp_path, drop):
    limits = {"idle_seconds": SOON, "header_seconds": SOON}
    with served(tmp_path, **limits) as (address, _), connected(address) as connection:
        connection.sendall(GET + b"\r\n")
        assert connection.recv(65536).startswith(b"HTTP/1.1 200 ")
        assert trickled(connection, b"", drop)


def trickled(connection, start, drop):
    """Send drops until the server closes; True where it did."""
    connection.settimeout(SOON / 10)
    end = time.monotonic() + PATIENCE
    try:
        connection.sendall(start)
        while time.monotonic() < end:
            connection.sendall(drop)
            try:
                if not connection.recv(65536):
                    return True
            except TimeoutError:
                continue
    except ConnectionError:
        return True
    return False


POSTS = {
    "upload": f"POST {RECORDINGS}?name=a.csv HTTP/1.1\r\nContent-Type: {OCTETS['content-type']}",
    "json": "POST /api/v1/datasets HTTP/1.1\r\nContent-Type: application/json",
    "unknown": "PUT /api/v1/nothing HTTP/1.1\r\nContent-Type: application/json",
}


@pytest.mark.parametrize("drop", [b"", b"x"])
@pytest.mark.parametrize("post", POSTS)
def test_a_body_that_stalls_or_trickles_is_refused(tmp_path, caplog, post, drop):
    start = POSTS[post].encode() + b"\r\n" + HOST + b"Content-Length: 1000000\r\n\r\n"
    with served(tmp_path, body_seconds=SOON) as (address, server):
        with connected(address) as connection:
            assert trickled(connection, start, drop)
        until(lambda: not server.app.state.recordings.under_way)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_the_refusal_of_a_slow_body_names_the_rate_and_the_time(tmp_path):
    start = POSTS["json"].encode() + b"\r\n" + HOST + b"Content-Length: 9\r\n\r\nx"
    with served(tmp_path, body_seconds=SOON) as (address, _), connected(address) as connection:
        connection.sendall(start)
        assert f"{SLOWEST_BODY} bytes/s for {SOON} s" in refusal(connection, 408)


def test_a_slow_server_refuses_no_upload(tmp_path, monkeypatch, flights):
    """The disk may take longer than a body may stall."""
    content, real = csv_of(flights[0]) * 300, upload_module.run_to_end
    assert len(content) > 2 * upload_module.BLOCK_BYTES
    delays = []

    async def slow(*arguments):
        if len(arguments) > 1 and not delays:
            delays.append(await asyncio.sleep(4 * SOON))
        return await real(*arguments)

    monkeypatch.setattr(upload_module, "run_to_end", slow)
    with served(tmp_path, body_seconds=SOON) as (address, _):
        answer = httpx2.post(
            f"{address}{RECORDINGS}", params={"name": "a.csv"}, content=content, headers=OCTETS,
            timeout=PATIENCE,
        )  # fmt: skip
    assert delays
    assert answer.status_code != 408


def test_a_slow_answer_and_a_silent_websocket_are_not_bounded(tmp_path):
    limits = {"header_seconds": SOON, "body_seconds": SOON, "idle_seconds": SOON}

    async def slow():
        await asyncio.sleep(3 * SOON)
        return {}

    async def silent(websocket: WebSocket):
        await websocket.accept()
        await websocket.send_text(await websocket.receive_text())

    with served(tmp_path, **limits) as (address, server):
        routes = server.app.router.routes
        routes[:0] = [APIRoute("/slow", slow), APIWebSocketRoute("/silent", silent)]
        with connect(address.replace("http", "ws") + "/silent") as watcher:
            assert httpx2.get(f"{address}/slow", timeout=PATIENCE).status_code == 200
            watcher.send("still here")
            assert watcher.recv(PATIENCE) == "still here"


def test_invalid_utf8_closes_a_websocket(tmp_path):
    async def silent(websocket: WebSocket):
        await websocket.accept()
        await websocket.receive()

    with served(tmp_path) as (address, server):
        server.app.router.routes[:0] = [APIWebSocketRoute("/silent", silent)]
        with connect(address.replace("http", "ws") + "/silent") as watcher:
            watcher.send(b"\xff", text=True)
            with pytest.raises(ConnectionClosed):
                watcher.recv(PATIENCE)
            assert watcher.close_code == 1007


def test_an_answer_ends_when_its_client_leaves_with_requests_pipelined(tmp_path, caplog):
    started, disconnected = threading.Event(), threading.Event()

    async def slow(request: Request) -> str:
        while (await request.receive())["type"] != "http.disconnect":
            started.set()
        disconnected.set()
        return ""

    with served(tmp_path) as (address, server):
        server.app.router.routes[:0] = [APIRoute("/slow", slow)]
        with connected(address) as connection:
            connection.sendall(3 * (b"GET /slow HTTP/1.1\r\n" + HOST + b"\r\n"))
            assert started.wait(PATIENCE)
            reset = struct.pack("ii", 1, 0)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset)
        assert disconnected.wait(PATIENCE)
    assert caplog.records == []
