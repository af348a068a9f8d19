"""A flight as it is watched: frames, alarms and states over a WebSocket."""

from collections.abc import Awaitable, Callable

import anyio
from fastapi import APIRouter, WebSocket
from starlette.status import (
    WS_1000_NORMAL_CLOSURE,
    WS_1008_POLICY_VIOLATION,
    WS_1013_TRY_AGAIN_LATER,
)
from starlette.websockets import WebSocketDisconnect

from app.flights.flights import Flights
from app.flights.watcher import Watcher
from app.messages import Credit, End, MessageError, decode

router = APIRouter(prefix="/api/v1/flights", tags=["flights"])
NO_SUCH_FLIGHT = 4404
"""Close code of a WebSocket to a flight that is not under way."""


@router.websocket("/{flight_id}/stream")
async def stream(websocket: WebSocket, flight_id: str) -> None:
    """Watch a flight: messages as in app.messages."""
    flights: Flights = websocket.app.state.flights
    await websocket.accept()
    flight = flights.get(flight_id)
    if flight is None:
        await close(websocket, NO_SUCH_FLIGHT, f"no flight {flight_id} is under way")
        return
    watcher = flight.watch()
    try:
        await _watch(websocket, watcher)
    finally:
        flight.leave(watcher)


async def _watch(websocket: WebSocket, watcher: Watcher) -> None:
    """Send and receive until either side ends; a handler must read to see pings and the end."""
    async with anyio.create_task_group() as both:

        async def until_end(pump: Callable[[WebSocket, Watcher], Awaitable[None]]) -> None:
            await pump(websocket, watcher)
            both.cancel_scope.cancel()

        both.start_soon(until_end, _receive)
        both.start_soon(until_end, _send)


async def _send(websocket: WebSocket, watcher: Watcher) -> None:
    try:
        while (text := await watcher.next_message()) is not None:
            await websocket.send({"type": "websocket.send", "text": text})
        code = WS_1013_TRY_AGAIN_LATER if watcher.overrun else WS_1000_NORMAL_CLOSURE
        await websocket.close(code, "too slow for its alarms" if watcher.overrun else "")
    except (WebSocketDisconnect, RuntimeError):
        pass


async def _receive(websocket: WebSocket, watcher: Watcher) -> None:
    try:
        while True:
            message = decode(await websocket.receive_text())
            if isinstance(message, Credit):
                watcher.grant(message.n)
            else:
                watcher.resume(message.seq)
    except (WebSocketDisconnect, RuntimeError):
        pass
    except (MessageError, KeyError):
        await close(websocket, WS_1008_POLICY_VIOLATION, "what was sent is no credit or resume")


async def close(websocket: WebSocket, code: int, reason: str) -> None:
    """Say why and close; nothing where the other side is gone."""
    try:
        await websocket.send({"type": "websocket.send", "text": End(reason=reason).encode()})
        await websocket.close(code, reason)
    except (WebSocketDisconnect, RuntimeError):
        pass
