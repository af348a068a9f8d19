"""The stream of a flight in another program."""

import asyncio
import json
from collections.abc import Iterator
from contextlib import aclosing

import pytest

from app.client import LiveClient
from app.client.flight_stream import FlightStream
from core.channels import KEYS
from tests.support.live_server import LiveServer, live_server

DT = 0.05


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


def push_slowly(client: LiveClient, n: int) -> None:
    """More messages than a watcher has credit for, and more samples than are kept without any."""
    for k in range(0, n, 20):
        push(client, k, 20)


async def samples(stream: FlightStream, n: int) -> list[int]:
    """Numbers of the next n samples that one connection gives."""
    seen: list[int] = []
    async with aclosing(stream.messages()) as messages:
        async for message in messages:
            if len(seen) >= n:
                break
            if message["type"] == "frames":
                seen += [json.loads(frame)["seq"] for frame in message["frames"]]
                assert message["seq"] == seen[-1]
    return seen


def push(client: LiveClient, first: int, n: int) -> None:
    for k in range(first, first + n):
        client.send(dict.fromkeys(KEYS, 1e-4 * (k % 7)), t=DT * k)
    assert client.flush()


def test_another_connection_continues_after_the_last(server: LiveServer):
    async def seen() -> list[int]:
        stream = client.stream()
        first = asyncio.create_task(samples(stream, 10))
        while stream.newest is None:
            await asyncio.sleep(0.01)  # until the connection has begun
        await asyncio.to_thread(push, client, 20, 100)
        seen = await first
        await asyncio.to_thread(push, client, 120, 900)
        while seen[-1] < 1019:
            seen += await samples(stream, 1)
        return seen

    with LiveClient(server.url) as client:
        client.start(server.monitor_id, trim="none")
        push(client, 0, 20)
        assert asyncio.run(seen()) == [*range(20, 1020)]


def test_a_reader_that_was_too_slow_gets_what_was_skipped(server: LiveServer):
    async def seen() -> list[int]:
        seen: list[int] = []
        async with aclosing(client.stream().messages()) as messages:
            async for message in messages:
                if message["type"] == "hello":
                    await asyncio.to_thread(push_slowly, client, 1000)
                elif message["type"] == "frames":
                    seen += [json.loads(frame)["seq"] for frame in message["frames"]]
                if seen and seen[-1] == 999:
                    break
        return seen

    with LiveClient(server.url) as client:
        client.start(server.monitor_id, trim="none")
        assert asyncio.run(seen()) == [*range(1000)]


def test_a_flight_that_ends_ends_its_stream(server: LiveServer):
    async def last() -> str:
        kinds = []
        async with aclosing(client.stream().messages()) as messages:
            async for message in messages:
                kinds.append(message["type"])
                if message["type"] == "hello":
                    await asyncio.to_thread(client.end)
        assert kinds[0] == "hello"
        return kinds[-1]

    client = LiveClient(server.url)
    client.start(server.monitor_id)
    assert asyncio.run(last()) == "end"
    client.close()


def test_a_server_that_is_gone_is_an_error():
    stream = FlightStream("http://127.0.0.1:9", {}, "flight")
    with pytest.raises(ConnectionError, match="does not answer"):
        asyncio.run(samples(stream, 1))
