"""The end of a WebSocket's connection."""

import asyncio
from typing import Any
from unittest.mock import Mock

import pytest

from app.http.connection import Connection


async def silent() -> Any:
    """A client that sends nothing, whose reader takes a moment to end."""
    try:
        await asyncio.Event().wait()
    finally:
        await asyncio.sleep(0)
        await asyncio.sleep(0)


def test_a_connection_cancelled_twice_raises_its_own_cancellation() -> None:
    """anyio cancels repeatedly and treats a foreign cancellation as an error."""

    async def cancel_twice() -> None:
        running = asyncio.ensure_future(Connection(Mock(receive=silent)).run(print))
        await asyncio.sleep(0.01)
        running.cancel("anyio")
        await asyncio.sleep(0)
        running.cancel("anyio")
        with pytest.raises(asyncio.CancelledError) as raised:
            await running
        assert raised.value.args == ("anyio",)

    asyncio.run(cancel_twice())


@pytest.mark.parametrize("fails", ["on_message", "on_writable"])
def test_an_error_of_a_handler_ends_the_connection(fails: str) -> None:
    """Neither a reader nor a writer goes on alone."""
    messages = [{"type": "websocket.receive", "text": "credit"}]

    async def receive() -> Any:
        return messages.pop() if messages else await silent()

    async def send(message: Any) -> None: ...

    def fail(*_: Any) -> None:
        raise ZeroDivisionError

    async def run() -> None:
        connection = Connection(Mock(receive=receive, send=send))
        connection.send("hello")
        handlers = {"on_message": print, "on_writable": print} | {fails: fail}
        with pytest.raises(ExceptionGroup) as raised:
            await connection.run(**handlers)
        assert raised.group_contains(ZeroDivisionError)

    asyncio.run(asyncio.wait_for(run(), 30))
