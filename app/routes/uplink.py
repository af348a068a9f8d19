"""A live source over a WebSocket: batches up, what became of them down."""

import asyncio
from collections import deque
from typing import Literal

from fastapi import WebSocket
from starlette.status import WS_1008_POLICY_VIOLATION

from app.flights.flights import Flights, TooManyFlights
from app.flights.sources.live import AcceptedBatch, LiveFlight, SequenceConflict
from app.flights.transport import NotPossible
from app.http.connection import Connection, accept
from app.http.head_requests import Router
from app.live.batches import sequence_of
from app.live.journal import JournalFull
from app.live.messages import Refused, Stored, Welcome
from app.routes.flight_stream import NO_SUCH_FLIGHT, dismiss, refuse
from app.store.store import NotFound
from app.telemetry.recording import TelemetryError

router = Router(prefix="/api/v1/flights", tags=["flights"])
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
    connection = await accept(websocket)
    try:
        flight = await flights.live(flight_id)
    except (NotFound, NotPossible, TooManyFlights) as error:
        await refuse(connection, NO_SUCH_FLIGHT, str(error))
        return
    now = flight.live
    welcome = Welcome(flight=flight_id, last_sequence=now.last_sequence, names=now.names)
    connection.send(welcome.encode())
    await connection.run(_Source(connection, flight).take)


class _Source:
    """One connection of a source."""

    def __init__(self, connection: Connection, flight: LiveFlight) -> None:
        self._connection, self._flight = connection, flight
        self._waiting: deque[AcceptedBatch] = deque()
        self._newest: asyncio.Future[None] | None = None
        self._malformed: deque[float] = deque(maxlen=MOST_MALFORMED)

    def take(self, content: bytes | str) -> None:
        """Take a batch, unless the source is being closed."""
        if self._connection.is_closing:
            return
        try:
            taken = self._flight.receive(content, "websocket")
        except (TelemetryError, SequenceConflict, JournalFull) as error:
            self._refuse(error, sequence_of(content))
        except NotPossible as error:
            dismiss(self._connection, NO_SUCH_FLIGHT, str(error)[:MOST_REASON])
        else:
            self._waiting.append(taken)
            if taken.stored is not self._newest:
                self._newest = taken.stored
                self._newest.add_done_callback(self._acknowledge)
            if len(self._waiting) > MOST_UNACKNOWLEDGED:
                self._connection.pause()

    def _acknowledge(self, _: asyncio.Future[None]) -> None:
        """Say what is durable, as soon as it is."""
        was_full = len(self._waiting) > MOST_UNACKNOWLEDGED
        stored = self._durable()
        if stored.count:
            self._connection.send(stored.encode())
        if was_full and len(self._waiting) <= MOST_UNACKNOWLEDGED:
            self._connection.resume()

    def _durable(self) -> Stored:
        """Take what is durable from the front of what waits."""
        done: list[AcceptedBatch] = []
        while self._waiting and self._waiting[0].stored.done():
            done.append(self._waiting.popleft())
        numbered = [(one.sequence, one.repeated) for one in done if one.sequence is not None]
        return Stored(
            sequences=[sequence for sequence, _ in numbered],
            repeated=[sequence for sequence, is_repeated in numbered if is_repeated],
            count=len(done),
            unread=list(dict.fromkeys(name for one in done for name in one.unread)),
        )

    def _refuse(self, error: Refusal, sequence: int | None) -> None:
        """Say why; a source that floods with what is no batch is closed."""
        reason = str(error)
        if not isinstance(error, JournalFull) and self._floods():
            text = f"{MOST_MALFORMED} messages within {MALFORMED_S:g} s were no batch: {reason}"
            dismiss(self._connection, WS_1008_POLICY_VIOLATION, text[:MOST_REASON])
            return
        refused = Refused(sequence=sequence, status=_status(error), reason=reason)
        self._connection.send(refused.encode())

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
