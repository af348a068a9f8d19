"""The end of a WebSocket's connection."""

import asyncio
from typing import Any
from unittest.mock import Mock

import pytest

from app.http.connection import Connection


class SlowToEnd:
    """A WebSocket whose cancelled `receive` takes a moment to end."""

    async def receive(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)
            await asyncio.sleep(0)


def test_a_connection_cancelled_twice_raises_the_last_cancellation() -> None:
    """anyio cancels repeatedly and treats a foreign cancellation as an error."""

    async def cancel_twice() -> None:
        websocket: Any = SlowToEnd()
        running = asyncio.ensure_future(Connection(websocket, Mock()).run(print))
        await asyncio.sleep(0.01)
        running.cancel("once")
        await asyncio.sleep(0)
        running.cancel("again")
        with pytest.raises(asyncio.CancelledError) as raised:
            await running
        assert raised.value.args == ("again",)

    asyncio.run(cancel_twice())
