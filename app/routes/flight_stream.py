"""The WebSocket to watch a flight: frames, alarms and states."""

from functools import partial

from fastapi import WebSocket
from starlette.status import (
    WS_1000_NORMAL_CLOSURE,
    WS_1008_POLICY_VIOLATION,
    WS_1013_TRY_AGAIN_LATER,
)

from app.flights.flights import Flights
from app.flights.frame_ticks import FrameTicks
from app.flights.watcher import Watcher
from app.http.connection import Connection, accept
from app.http.head_requests import Router
from app.messages import Credit, End, MessageError, decode

router = Router(prefix="/api/v1/flights", tags=["flights"])
NO_SUCH_FLIGHT = 4404
"""Close code of a WebSocket to a flight that is not in progress."""


@router.websocket("/{flight_id}/stream")
async def stream(websocket: WebSocket, flight_id: str) -> None:
    """Watch a flight: messages as in app.messages."""
    flights: Flights = websocket.app.state.flights
    connection = await accept(websocket)
    flight = flights.get(flight_id)
    if flight is None:
        await refuse(connection, NO_SUCH_FLIGHT, f"no flight {flight_id} is in progress")
        return
    watcher = flight.watch()
    screen = _Screen(connection, watcher, websocket.app.state.frame_ticks)
    try:
        await connection.run(screen.on_message, screen.show)
    finally:
        watcher.on_news = watcher.on_frames = None
        flight.leave(watcher)


class _Screen:
    """One connection of a watcher."""

    def __init__(self, connection: Connection, watcher: Watcher, ticks: FrameTicks) -> None:
        self._connection, self._watcher = connection, watcher
        watcher.on_news = self.show
        watcher.on_frames = partial(ticks.ask, self.show)
        self.show()

    def show(self) -> None:
        """Send waiting messages while the connection is writable."""
        connection, watcher = self._connection, self._watcher
        if connection.is_closing:
            return
        if connection.is_writable and (text := watcher.newest_message()) is not None:
            connection.send(text)
            return
        while connection.is_writable and (text := watcher.next_message()) is not None:
            connection.send(text)
        if not (watcher.ended and watcher.is_done):
            return
        if watcher.overrun:
            connection.close(WS_1013_TRY_AGAIN_LATER, "too slow for its alarms")
        else:
            connection.close(WS_1000_NORMAL_CLOSURE, "")

    def on_message(self, content: bytes | str) -> None:
        try:
            message = decode(content)
        except MessageError:
            dismiss(
                self._connection,
                WS_1008_POLICY_VIOLATION,
                "the message is neither credit nor resume",
            )
            return
        if isinstance(message, Credit):
            self._watcher.grant(message.n)
        else:
            self._watcher.resume(message.seq)


def dismiss(connection: Connection, code: int, reason: str) -> None:
    """Send the reason and close."""
    if not connection.is_closing:
        connection.send(End(reason=reason).encode())
        connection.close(code, reason)


async def refuse(connection: Connection, code: int, reason: str) -> None:
    """Send the reason and close a connection that serves no flight."""
    dismiss(connection, code, reason)
    await connection.run(lambda _: None)
