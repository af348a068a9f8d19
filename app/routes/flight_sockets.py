"""The WebSockets of a flight: to watch it, and to push the samples of a live source."""

import asyncio
from collections import deque
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, WebSocket
from pydantic.json_schema import models_json_schema
from starlette.status import (
    WS_1000_NORMAL_CLOSURE,
    WS_1008_POLICY_VIOLATION,
    WS_1013_TRY_AGAIN_LATER,
)

from app.assessment.batches import sequence_of
from app.flights.flights import Flights, TooManyFlights
from app.flights.sources.live import AcceptedBatch, LiveFlight, SequenceConflict
from app.flights.transport import NotPossible
from app.flights.watcher import FrameTicks, Watcher
from app.http.connection import Connection, accept
from app.messages import (
    DOWN,
    UP,
    UPLINK_DOWN,
    UPLINK_UP,
    Credit,
    End,
    MessageError,
    Refused,
    Stored,
    Welcome,
    decode,
)
from app.routes.flights import MOST_ID
from app.routes.live import sender_of
from app.store.store import NotFound
from app.telemetry.journal import JournalFull
from app.telemetry.recording import TelemetryError

router = APIRouter(prefix="/api/v1/flights", tags=["flights"])
NO_SUCH_FLIGHT = 4404
"""Close code of a WebSocket to a flight that is not in progress."""


@router.websocket("/{flight_id}/stream")
async def stream(
    websocket: WebSocket,
    flight_id: str,
    screen: Annotated[str, Query(max_length=MOST_ID)] = "",
) -> None:
    """Watch a flight: messages as in app.messages. screen: an id that the page made up."""
    flights: Flights = websocket.app.state.flights
    connection = await accept(websocket)
    flight = flights.get(flight_id)
    if flight is None:
        await refuse(connection, NO_SUCH_FLIGHT, f"no flight {flight_id} is in progress")
        return
    watcher = flight.watch(screen, websocket.scope["person"].name)
    display = _Screen(connection, watcher, websocket.app.state.frame_ticks)
    try:
        await connection.run(display.on_message, display.show)
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
        while connection.is_writable and (text := watcher.next_message()) is not None:
            connection.send(text)
        if not watcher.is_done:
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
                'the message is neither credit nor resume: send {"type": "credit", "n": 1}',
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


MOST_MALFORMED = 100
"""Malformed messages within MALFORMED_S at which the source is disconnected."""
MALFORMED_S = 1.0
Refusal = TelemetryError | SequenceConflict | JournalFull
MOST_REASON = 120
"""Longest close reason [characters]; a WebSocket allows 123 bytes."""
MOST_UNACKNOWLEDGED = 10_000
"""Batches of one source that may wait for the disk; beyond it reading pauses."""


@router.websocket("/{flight_id}/uplink")
async def uplink(websocket: WebSocket, flight_id: str) -> None:
    """Push batches into a live flight; each message is a body of `samples`."""
    flights: Flights = websocket.app.state.flights
    connection = await accept(websocket)
    try:
        flight = await flights.live(flight_id)
    except (NotFound, NotPossible, TooManyFlights) as error:
        await refuse(connection, NO_SUCH_FLIGHT, str(error))
        return
    now = flight.live
    welcome = Welcome(flight=flight_id, last_sequence=now.last_sequence, names=now.names)
    connection.send(welcome.encode())
    await connection.run(_Source(connection, flight, sender_of("WebSocket", websocket)).on_message)


class _Source:
    """One connection of a source."""

    def __init__(self, connection: Connection, flight: LiveFlight, sender: str) -> None:
        self._connection, self._flight, self._sender = connection, flight, sender
        self._waiting: deque[AcceptedBatch] = deque()
        self._newest: asyncio.Future[None] | None = None
        self._malformed: deque[float] = deque(maxlen=MOST_MALFORMED)

    def on_message(self, content: bytes | str) -> None:
        if self._connection.is_closing:
            return
        try:
            batch = self._flight.receive(content, self._sender)
        except (TelemetryError, SequenceConflict, JournalFull) as error:
            self._refuse(error, sequence_of(content))
        except NotPossible as error:
            dismiss(self._connection, NO_SUCH_FLIGHT, str(error)[:MOST_REASON])
        else:
            self._waiting.append(batch)
            if batch.stored is not self._newest:
                self._newest = batch.stored
                self._newest.add_done_callback(self._acknowledge)
            if len(self._waiting) > MOST_UNACKNOWLEDGED:
                self._connection.pause()

    def _acknowledge(self, _: asyncio.Future[None]) -> None:
        was_full = len(self._waiting) > MOST_UNACKNOWLEDGED
        stored = self._durable()
        if stored.count:
            self._connection.send(stored.encode())
        if was_full and len(self._waiting) <= MOST_UNACKNOWLEDGED:
            self._connection.resume()

    def _durable(self) -> Stored:
        """Remove the durable batches from the front of the queue."""
        done: list[AcceptedBatch] = []
        while self._waiting and self._waiting[0].stored.done():
            done.append(self._waiting.popleft())
        numbered = [
            (batch.sequence, batch.repeated) for batch in done if batch.sequence is not None
        ]
        return Stored(
            sequences=[sequence for sequence, _ in numbered],
            repeated=[sequence for sequence, is_repeated in numbered if is_repeated],
            count=len(done),
            unread=list(dict.fromkeys(name for batch in done for name in batch.unread)),
        )

    def _refuse(self, error: Refusal, sequence: int | None) -> None:
        """Send the reason; disconnect a source that floods with malformed messages."""
        reason = str(error)
        if not isinstance(error, JournalFull) and self._floods():
            text = f"{MOST_MALFORMED} malformed messages within {MALFORMED_S:g} s: {reason}"
            dismiss(self._connection, WS_1008_POLICY_VIOLATION, text[:MOST_REASON])
            return
        refused = Refused(sequence=sequence, status=_status(error), reason=reason)
        self._connection.send(refused.encode())

    def _floods(self) -> bool:
        """Count a malformed message. Returns whether there are too many."""
        now = asyncio.get_running_loop().time()
        self._malformed.append(now)
        is_full = len(self._malformed) == MOST_MALFORMED
        return is_full and now - self._malformed[0] < MALFORMED_S


def _status(error: Refusal) -> Literal[409, 422, 503]:
    if isinstance(error, JournalFull):
        return 503
    return 409 if isinstance(error, SequenceConflict) else 422


def describe_streams(document: dict[str, Any]) -> None:
    """Add the messages of the WebSockets to the OpenAPI document, which has no paths for them."""
    sent = {"stream": (DOWN, UP), "uplink": (UPLINK_DOWN, UPLINK_UP)}
    kinds: list[Any] = [
        (kind, "validation") for each in sent.values() for kind in (*each[0], *each[1])
    ]
    _, schemas = models_json_schema(kinds, ref_template="#/components/schemas/{model}")
    components = document["components"]
    components["schemas"] = schemas["$defs"] | components["schemas"]
    texts = (
        f"WebSocket `{router.prefix}/{{flight_id}}/{name}`: the server sends "
        f"{', '.join(kind.__name__ for kind in down)}; it accepts "
        f"{' and '.join(kind.__name__ for kind in up)}."
        for name, (down, up) in sent.items()
    )
    document["info"]["description"] += f"\n\n{' '.join(texts)} Each is a JSON text by its schema."
