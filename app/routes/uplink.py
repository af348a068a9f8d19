"""A live source over a WebSocket: batches up, what became of them down."""

import asyncio
from collections import deque
from typing import Literal

import anyio
from fastapi import APIRouter, WebSocket
from starlette.status import WS_1008_POLICY_VIOLATION
from starlette.websockets import WebSocketDisconnect

from app.flights.flights import Flights, TooManyFlights
from app.flights.live import LiveFlight, SequenceConflict, TakenBatch
from app.flights.transport import NotPossible
from app.live.batches import sequence_of
from app.live.journal import JournalFull
from app.live.messages import Refused, Stored, Welcome
from app.messages import Message
from app.routes.flight_stream import NO_SUCH_FLIGHT, close
from app.store.store import NotFound
from app.telemetry.recording import TelemetryError

router = APIRouter(prefix="/api/v1/flights", tags=["flights"])
ACKNOWLEDGED_S = 0.02
"""Batches that are durable within so long are acknowledged together."""
MOST_MALFORMED = 100
"""Messages that are no batch, within MALFORMED_S, after which the source is closed."""
MALFORMED_S = 1.0
Refusal = TelemetryError | SequenceConflict | JournalFull
MOST_REASON = 120
"""Characters of a close reason, of which a WebSocket takes 123 bytes."""
MOST_UNACKNOWLEDGED = 10_000
"""Batches of one source that may wait for the disk; it is not read further meanwhile."""


@router.websocket("/{flight_id}/uplink")
async def uplink(websocket: WebSocket, flight_id: str) -> None:
    """Push batches into a live flight: each message as the body of `samples`."""
    flights: Flights = websocket.app.state.flights
    await websocket.accept()
    try:
        flight = await flights.live(flight_id)
    except (NotFound, NotPossible, TooManyFlights) as error:
        await close(websocket, NO_SUCH_FLIGHT, str(error))
        return
    now = flight.live
    welcome = Welcome(flight=flight_id, last_sequence=now.last_sequence, names=now.names)
    await _say(websocket, welcome)
    source = _Source(websocket, flight)
    async with anyio.create_task_group() as both:
        both.start_soon(source.acknowledge)
        await source.receive()
        both.cancel_scope.cancel()


class _Source:
    """One connection of a source."""

    def __init__(self, websocket: WebSocket, flight: LiveFlight) -> None:
        self._websocket, self._flight = websocket, flight
        self._waiting: deque[TakenBatch] = deque()
        self._come = asyncio.Event()
        self._room = asyncio.Event()
        self._is_gone = False
        self._malformed: deque[float] = deque(maxlen=MOST_MALFORMED)

    async def receive(self) -> None:
        """Take batches until the source leaves, or floods with what is none."""
        while True:
            try:
                message = await self._websocket.receive()
            except RuntimeError:
                return
            if message["type"] == "websocket.disconnect":
                return
            content = message.get("text") or message.get("bytes") or b""
            try:
                self._waiting.append(self._flight.receive(content, "websocket"))
                self._come.set()
            except (TelemetryError, SequenceConflict, JournalFull) as error:
                if not await self._refuse(error, sequence_of(content)):
                    return
            except NotPossible as error:
                await close(self._websocket, NO_SUCH_FLIGHT, str(error))
                return
            while len(self._waiting) > MOST_UNACKNOWLEDGED and not self._is_gone:
                self._room.clear()
                await self._room.wait()

    async def acknowledge(self) -> None:
        """Say what is durable, as soon as it is."""
        try:
            while True:
                await self._come.wait()
                await asyncio.sleep(ACKNOWLEDGED_S)
                self._come.clear()
                while self._waiting:
                    await asyncio.shield(self._waiting[0].stored)
                    await _say(self._websocket, self._durable())
                    self._room.set()
        except (WebSocketDisconnect, RuntimeError):
            self._is_gone = True
            self._room.set()

    def _durable(self) -> Stored:
        """Take what is durable from the front of what waits."""
        done: list[TakenBatch] = []
        while self._waiting and self._waiting[0].stored.done():
            done.append(self._waiting.popleft())
        numbered = [(one.sequence, one.repeated) for one in done if one.sequence is not None]
        return Stored(
            sequences=[sequence for sequence, _ in numbered],
            repeated=[sequence for sequence, is_repeated in numbered if is_repeated],
            count=len(done),
        )

    async def _refuse(self, error: Refusal, sequence: int | None) -> bool:
        """Say why; whether the source may go on."""
        reason = str(error)
        if not isinstance(error, JournalFull) and self._floods():
            text = f"{MOST_MALFORMED} messages within {MALFORMED_S:g} s were no batch: {reason}"
            await close(self._websocket, WS_1008_POLICY_VIOLATION, text[:MOST_REASON])
            return False
        try:
            refused = Refused(sequence=sequence, status=_status(error), reason=reason)
            await _say(self._websocket, refused)
        except (WebSocketDisconnect, RuntimeError):
            return False
        return True

    def _floods(self) -> bool:
        """Note one more that is no batch; whether they are too many."""
        now = asyncio.get_running_loop().time()
        self._malformed.append(now)
        is_full = len(self._malformed) == MOST_MALFORMED
        return is_full and now - self._malformed[0] < MALFORMED_S


def _status(error: Refusal) -> Literal[409, 422, 503]:
    """As over REST."""
    if isinstance(error, JournalFull):
        return 503
    return 409 if isinstance(error, SequenceConflict) else 422


async def _say(websocket: WebSocket, message: Message) -> None:
    await websocket.send({"type": "websocket.send", "text": message.encode()})
