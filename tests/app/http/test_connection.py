"""A WebSocket's connection ends in order."""

import asyncio
from typing import Any
from unittest.mock import Mock

import pytest

from app.http.connection import Connection


class Waiting(Connection):
    """Two pumps, one of which takes a moment to end."""

    @property
    def has_room(self) -> bool:
        return True

    def send(self, text: str) -> None: ...

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def _pumps(self, take: Any, on_room: Any) -> list[Any]:
        return [self._slow_to_end(), asyncio.Event().wait()]

    async def _slow_to_end(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)
            await asyncio.sleep(0)


def test_a_connection_that_is_cancelled_while_it_ends_says_who_cancelled_it() -> None:
    """As anyio does again and again, which takes another's cancellation for an error."""

    async def cancel_twice() -> None:
        running = asyncio.ensure_future(Waiting(Mock()).run(print))
        await asyncio.sleep(0.01)
        running.cancel("once")
        await asyncio.sleep(0)
        running.cancel("again")
        with pytest.raises(asyncio.CancelledError) as raised:
            await running
        assert raised.value.args == ("again",)

    asyncio.run(cancel_twice())
