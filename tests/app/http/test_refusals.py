"""A flooding address is read slowly, and others as before."""

import asyncio
import socket
from pathlib import Path
from typing import Any

import pytest
from fastapi import WebSocket
from fastapi.routing import APIWebSocketRoute
from websockets.sync.client import connect

from app.http import bounded_protocol, refusals
from app.http.bounded_protocol import CHUNK_BYTES, BoundedHttp
from app.http.refusals import MOST, MOST_ADDRESSES, WITHIN_S, Refusals
from tests.app.http.test_bounded_protocol import GET, HOST, SOON, connected, read_ok, rest
from tests.support.api import served
from tests.support.patience import PATIENCE

FEW = 10
WRONG = b"GET /api/v1/flights/none HTTP/1.1\r\n" + HOST + b"\r\n"


def refuse_few(connection: socket.socket) -> None:
    """Send FEW wrong requests, and read their answers."""
    connection.sendall(FEW * WRONG)
    answers = b""
    while answers.count(b"HTTP/1.1 404 ") < FEW:
        answers += connection.recv(65536)


def test_an_address_floods_with_many_refusals_within_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr(refusals.time, "monotonic", lambda: now[0])
    refused = Refusals()
    for _ in range(MOST - 1):
        refused.note("a")
    assert not refused.is_flooding("a")
    refused.note("a")
    assert refused.is_flooding("a")
    assert not refused.is_flooding("b")
    now[0] = WITHIN_S
    assert not refused.is_flooding("a")
    for k in range(MOST_ADDRESSES):
        refused.note(str(k))
    assert len(refused._times) == MOST_ADDRESSES


def test_a_flooding_connection_waits_and_a_valid_one_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounded_protocol, "HELD_S", 3600.0)
    monkeypatch.setattr(refusals, "WITHIN_S", 3600.0)
    monkeypatch.setattr(refusals, "MOST", FEW)
    monkeypatch.setattr(BoundedHttp, "_n_held", 0)
    with (
        served(tmp_path) as (address, _),
        connected(address) as flooding,
        connected(address) as other,
    ):
        other.sendall(GET + b"\r\n")
        read_ok(other, 1)
        refuse_few(flooding)
        flooding.sendall(WRONG)
        with connected(address) as new:
            new.sendall(GET + b"\r\n")
            while BoundedHttp._n_held == 0:
                other.sendall(GET + b"\r\n")
                read_ok(other, 1)
            for _ in range(FEW):
                other.sendall(GET + b"\r\n")
                read_ok(other, 1)
            new.setblocking(False)
            with pytest.raises(BlockingIOError):
                new.recv(65536)
        flooding.setblocking(False)
        with pytest.raises(BlockingIOError):
            flooding.recv(65536)


def test_a_connection_on_hold_is_read_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounded_protocol, "HELD_S", 0.01)
    monkeypatch.setattr(refusals, "MOST", FEW)
    with served(tmp_path) as (address, _), connected(address) as flooding:
        flooding.sendall((FEW + 2) * WRONG + GET + b"Connection: close\r\n\r\n")
        answers = rest(flooding)
    assert answers.count(b"HTTP/1.1 404 ") == FEW + 2
    assert answers.count(b"HTTP/1.1 200 ") == 1


def test_a_websocket_after_a_hold_outlives_the_header_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounded_protocol, "HELD_S", 0.05)
    monkeypatch.setattr(refusals, "WITHIN_S", 3600.0)
    monkeypatch.setattr(refusals, "MOST", FEW)

    async def echo(websocket: WebSocket) -> None:
        await websocket.accept()
        await asyncio.sleep(3 * SOON)
        await websocket.send_text(await websocket.receive_text())

    with served(tmp_path, header_seconds=SOON) as (address, server):
        server.app.router.routes[:0] = [APIWebSocketRoute("/echo", echo)]
        with connected(address) as flooding:
            refuse_few(flooding)
        with connect(address.replace("http", "ws") + "/echo") as watcher:
            watcher.send("still here")
            assert watcher.recv(PATIENCE) == "still here"


def test_pipelined_requests_are_parsed_only_a_little_ahead(tmp_path: Path) -> None:
    n = 3 * CHUNK_BYTES // len(GET)
    most = 0
    with served(tmp_path) as (address, server), connected(address) as eager:
        eager.sendall(n * (GET + b"\r\n") + GET + b"Connection: close\r\n\r\n")
        answers = b""
        while some := eager.recv(4096):
            answers += some
            connections: list[Any] = [*server.server_state.connections]
            ahead = [len(connection.pipeline) for connection in connections]
            most = max(most, *ahead, 0)
    assert answers.count(b"HTTP/1.1 200 ") == n + 1
    assert most <= CHUNK_BYTES // len(GET) + 1
