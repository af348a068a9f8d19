"""Stored flights: what they are, and their assessments in chunks of samples."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sqlalchemy import Connection, Select, bindparam, case, delete, func, insert, select, update

from app.store.answers import note_deleted, was_deleted
from app.store.arrays import from_blob, to_blob
from app.store.assessments import (
    SAMPLE,
    StoredAssessments,
    StoredDisplay,
    display_columns,
    display_of,
    joined,
    pack,
    reasons_of,
    runs_of,
)
from app.store.repository import Entry, Repository, check_not_kept, columns, complete, fetch
from app.store.tables import (
    assessment_chunks,
    display_monitors,
    flights,
    monitors,
    new_id,
    now,
    recordings,
)

INTERRUPTED = "interrupted"
CHUNK = 1000
"""Most samples in one blob."""


class UnderWay(RuntimeError):
    """A flight whose record is not complete yet."""


@dataclass(frozen=True)
class FlightInfo(Entry):
    """A run of a source through a monitor."""

    id: str
    source: dict[str, Any]
    monitor_id: str
    epsilon: float
    """accepted miss rate"""
    status: str
    """`running`, `interrupted`, or the word it was ended with"""
    created: str
    """UTC, ISO 8601"""
    ended: str | None
    """UTC, ISO 8601"""
    exceeded_t: float | None
    """first exceedance that it had come to when it ended [s], passed by a seek or flown"""
    exceedances: list[dict[str, Any]] | None
    """those that it had come to, of each channel; null where that was not kept: interrupted"""
    limits_held: list[dict[str, Any]] | None
    """limits from when on; empty for the monitor's own, null where that was not kept"""
    keep: bool
    """whether it is kept for ever"""
    recording_id: str | None
    """recording that its journal became, there still or deleted since; null: none so far"""
    recording: str | None
    """id of that recording; null where there is none"""
    head: int | None
    """newest sample number stored; null before the first"""
    lost: int | None
    """samples before that one that were never stored; null where more may be: interrupted"""


_OF_FLIGHT = assessment_chunks.c.flight_id == flights.c.id
_HEAD = select(func.max(assessment_chunks.c.last_seq)).where(_OF_FLIGHT).scalar_subquery()
_HEAD_OF = select(_HEAD.label("head")).select_from(flights).where(flights.c.id == bindparam("id"))
"""Made once: it is asked with each batch that a flight under way writes."""


class FlightRepository(Repository):
    """Flights by id."""

    def add(
        self,
        source: dict[str, Any],
        monitor_id: str,
        epsilon: float,
        display: Sequence[tuple[str, float]] = (),
    ) -> str:
        """Store a flight that runs from now on; return its id. NotFound for a monitor.

        display: id and epsilon of each monitor that is flown for display.
        """
        flight_id = new_id()
        row = {"id": flight_id, "source": source, "monitor_id": monitor_id, "epsilon": epsilon}
        with self._writing() as connection:
            for used in (monitor_id, *(shown for shown, _ in display)):
                query = select(monitors.c.id).where(complete(monitors, used))
                fetch(connection, query, "monitor", used)
            connection.execute(insert(flights).values(**row, status="running", created=now()))
            for position, (shown, at) in enumerate(display):
                row = {"flight_id": flight_id, "position": position}
                row |= {"monitor_id": shown, "epsilon": at}
                connection.execute(insert(display_monitors).values(**row))
        return flight_id

    def display(self, flight_ids: Iterable[str]) -> dict[str, list[tuple[str, float]]]:
        """Id and epsilon of the monitors that flights are shown by, of those that have any."""
        own, wanted = display_monitors.c, set(flight_ids)
        query = select(own.flight_id, own.monitor_id, own.epsilon).order_by(own.position)
        found: dict[str, list[tuple[str, float]]] = {}
        with self._reading() as connection:
            for flight_id, monitor_id, epsilon in connection.execute(query):
                if flight_id in wanted:
                    found.setdefault(flight_id, []).append((monitor_id, epsilon))
        return found

    def end(
        self,
        flight_id: str,
        status: str = "ended",
        exceeded_t: float | None = None,
        exceedances: list[dict[str, Any]] | None = None,
        limits_held: list[dict[str, Any]] | None = None,
    ) -> FlightInfo:
        """Note that a flight is over and how; one that has ended stays as it ended. NotFound.

        exceeded_t: first exceedance that it had come to [s].   exceedances: of its channels, plain.
        limits_held: which limits held from when on, plain.
        """
        if not status or status == "running":
            raise ValueError(f"a flight cannot end as {status!r}: say how it ended, in one word")
        running = (flights.c.id == flight_id) & (flights.c.status == "running")
        with self._writing() as connection:
            over = {"status": status, "ended": now(), "exceeded_t": exceeded_t}
            over |= {"exceedances": exceedances, "limits_held": limits_held}
            connection.execute(update(flights).where(running).values(**over))
            return fetch_flight(connection, flight_id)

    def resume(self, flight_id: str, head: int) -> None:
        """Note that an interrupted flight goes on after sample head; nothing for any other.

        What is stored beyond was never acknowledged: it is taken out, and comes again.
        """
        interrupted = (flights.c.id == flight_id) & (flights.c.status == INTERRUPTED)
        with self._writing() as connection:
            running = {"status": "running", "ended": None}
            if connection.execute(update(flights).where(interrupted).values(**running)).rowcount:
                _cut(connection, flight_id, head)

    def info(self, flight_id: str) -> FlightInfo:
        """What a flight is; NotFound."""
        with self._reading() as connection:
            return fetch_flight(connection, flight_id)

    def all(self) -> list[FlightInfo]:
        """All flights, newest first."""
        query = _flights().order_by(flights.c.created.desc())
        with self._reading() as connection:
            return [FlightInfo(**row._mapping) for row in connection.execute(query)]

    def delete(self, flight_id: str) -> None:
        """Delete a flight that is over, its assessments, alarms and markers.

        NotFound; UnderWay; KeptForEver.

        One that was deleted within a day may be deleted again.
        """
        with self._deleting() as connection:
            if was_deleted(connection, "flights", flight_id):
                return
            note_deleted(connection, "flights", flight_id)
            if fetch_flight(connection, flight_id).status == "running":
                raise UnderWay(f"flight {flight_id} is under way: end it, then delete its record")
            check_not_kept(connection, flights, "flight", flight_id)
            connection.execute(delete(flights).where(flights.c.id == flight_id))

    def append(
        self,
        flight_id: str,
        first_seq: int,
        t: npt.ArrayLike,
        y: npt.ArrayLike,
        p_value: npt.ArrayLike,
        alert: npt.ArrayLike,
        state: npt.ArrayLike,
        y_hat: npt.ArrayLike | None = None,
        reasons: Sequence[str] | None = None,
        display: Sequence[StoredDisplay] = (),
    ) -> None:
        """Store the next samples of a flight, numbered from first_seq.

        t: (n,) [s].   y: (n, 6).   p_value: (n,), NaN where there is none.   alert: (n,) bool.
        state: (n,) codes into STATES.   y_hat: (n, 6), None or NaN where there is no forecast.
        reasons: (n,) why a sample was not assessed; None: what its state says.
        display: of each monitor that is flown for display.
        NotFound; ValueError for other shapes and for samples that are already stored.
        """
        samples = pack(t, y, p_value, alert, state, y_hat)
        chunks = [
            {
                "flight_id": flight_id,
                "first_seq": first_seq + i,
                "last_seq": first_seq + min(i + CHUNK, len(samples)) - 1,
                "content": to_blob(samples[i : i + CHUNK]),
                "reasons": runs_of(samples["state"][i : i + CHUNK], (reasons or ())[i : i + CHUNK]),
                **display_columns([one.part(slice(i, i + CHUNK)) for one in display]),
            }
            for i in range(0, len(samples), CHUNK)
        ]
        if not chunks:
            return
        with self._writing() as connection:
            head = head_of(connection, flight_id)
            if head is not None and first_seq <= head:
                raise ValueError(
                    f"flight {flight_id} is stored up to sample {head}: the next one cannot be "
                    f"{first_seq}"
                )
            connection.execute(insert(assessment_chunks), chunks)

    def assessments(
        self, flight_id: str, first_seq: int = 0, last_seq: int | None = None
    ) -> StoredAssessments:
        """Return the stored samples first_seq to last_seq, both included. NotFound."""
        chunk = assessment_chunks.c
        shown = chunk.display, chunk.display_reasons
        query = select(chunk.first_seq, chunk.content, chunk.reasons, *shown).where(
            chunk.flight_id == flight_id, chunk.last_seq >= first_seq
        )
        if last_seq is not None:
            query = query.where(chunk.first_seq <= last_seq)
        with self._reading() as connection:
            fetch_flight(connection, flight_id)
            rows = connection.execute(query.order_by(chunk.first_seq)).all()
        parts = [from_blob(row.content) for row in rows]
        samples = np.concatenate([np.empty(0, SAMPLE), *parts])
        reasons = [
            text
            for row, part in zip(rows, parts, strict=True)
            for text in reasons_of(part["state"], row.reasons or ())
        ]
        numbers = [np.arange(len(p)) + row.first_seq for row, p in zip(rows, parts, strict=True)]
        seq = np.concatenate([np.empty(0, np.int64), *numbers])
        wanted = slice(
            np.searchsorted(seq, first_seq),
            None if last_seq is None else np.searchsorted(seq, last_seq, "right"),
        )
        display = joined([display_of(row.display, row.display_reasons) for row in rows])
        return StoredAssessments(
            seq=seq[wanted],
            reasons=tuple(reasons[wanted]),
            display=tuple(one.part(wanted) for one in display),
            **{name: np.ascontiguousarray(samples[name][wanted]) for name in SAMPLE.names or ()},
        )

    def last_states(self, flight_ids: Iterable[str]) -> dict[str, tuple[int, str]]:
        """Code of the state of the newest stored sample of each flight that has one, and why."""
        chunk, wanted = assessment_chunks.c, set(flight_ids)
        newest = select(chunk.flight_id, func.max(chunk.last_seq).label("head"))
        head = newest.group_by(chunk.flight_id).subquery()
        query = select(chunk.flight_id, chunk.content, chunk.reasons).join(
            head, (head.c.flight_id == chunk.flight_id) & (head.c.head == chunk.last_seq)
        )
        with self._reading() as connection:
            rows = [row for row in connection.execute(query) if row.flight_id in wanted]
        found = {}
        for flight_id, content, runs in rows:
            states = from_blob(content)["state"]
            found[flight_id] = int(states[-1]), reasons_of(states, runs or ())[-1]
        return found

    def recover(self) -> None:
        """Note as interrupted what nobody flies any more: the process that flew it died."""
        running = flights.c.status == "running"
        interrupted = {"status": INTERRUPTED, "ended": now()}
        with self._deleting() as connection:
            connection.execute(update(flights).where(running).values(**interrupted))


def _cut(connection: Connection, flight_id: str, head: int) -> None:
    """Take out the samples after head."""
    chunk = assessment_chunks.c
    beyond = (chunk.flight_id == flight_id) & (chunk.last_seq > head)
    shown = chunk.display, chunk.display_reasons
    query = select(chunk.first_seq, chunk.content, chunk.reasons, *shown).where(beyond)
    rows = connection.execute(query.where(chunk.first_seq <= head)).all()
    connection.execute(delete(assessment_chunks).where(beyond))
    for first, content, runs, *display in rows:
        samples, wanted = from_blob(content), slice(head + 1 - first)
        texts, kept = reasons_of(samples["state"], runs or ())[wanted], samples[wanted]
        row = {"flight_id": flight_id, "first_seq": first, "last_seq": head}
        row |= {"content": to_blob(kept), "reasons": runs_of(kept["state"], texts)}
        row |= display_columns([one.part(wanted) for one in display_of(*display)])
        connection.execute(insert(assessment_chunks).values(**row))


def replays_of(connection: Connection, kind: str, identity: str) -> list[tuple[str, str]]:
    """Flights under way whose source is this recording or scoring, in words, with their ids."""
    running = select(flights.c.id, flights.c.source).where(flights.c.status == "running")
    return [
        ("running flight", row.id)
        for row in connection.execute(running.order_by(flights.c.created))
        if row.source.get(kind) == identity
    ]


def fetch_flight(connection: Connection, flight_id: str) -> FlightInfo:
    """What a flight is; NotFound."""
    query = _flights().where(flights.c.id == flight_id)
    return FlightInfo(**fetch(connection, query, "flight", flight_id)._mapping)


def head_of(connection: Connection, flight_id: str) -> int | None:
    """Newest sample of a flight that is stored; None before the first. NotFound."""
    return fetch(connection, _HEAD_OF.params(id=flight_id), "flight", flight_id).head


def _flights() -> Select:
    chunk, of_flight, head = assessment_chunks.c, _OF_FLIGHT, _HEAD
    n_stored = func.sum(chunk.last_seq - chunk.first_seq + 1)
    n_lost = func.max(chunk.last_seq) + 1 - n_stored
    lost = select(func.coalesce(n_lost, 0)).where(of_flight).scalar_subquery()
    known = case((flights.c.status != INTERRUPTED, lost))
    made = recordings.c.id == flights.c.recording_id
    recording = select(recordings.c.id).where(made, recordings.c.complete).scalar_subquery()
    return select(
        *columns(flights, FlightInfo),
        recording.label("recording"),
        head.label("head"),
        known.label("lost"),
    )
