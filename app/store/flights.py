"""Stored flights, with their assessments in chunks of samples."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
from sqlalchemy import (
    ColumnElement,
    Connection,
    Select,
    bindparam,
    case,
    delete,
    func,
    insert,
    select,
    update,
)

from app.store.answers import note_deleted, was_deleted
from app.store.assessments import (
    FIELDS,
    UNKNOWN,
    StoredAssessments,
    StoredDisplay,
    causes_of,
    chunk_of,
    chunk_row,
    joined,
    pack,
    sample_type,
)
from app.store.database import Damaged
from app.store.repository import (
    Entries,
    Entry,
    Page,
    Time,
    check_deletable,
    columns,
    fetch,
    require,
)
from app.store.tables import (
    assessment_chunks,
    display_monitors,
    flight_monitor_sets,
    flights,
    monitor_sets,
    monitors,
    new_id,
    now,
    recordings,
)
from core.channels import LATERAL
from core.conditions import ConditionKey
from core.monitor.assessment import CAUSES, REASONS, STATES, Cause, State, code_of
from core.types import Array

INTERRUPTED = "interrupted"
Progress = Literal["running", "ended", "failed", "interrupted"]
NewestState = tuple[int, str, Cause | None]
"""State code, reason and cause of a sample."""
DAMAGED: NewestState = (
    STATES.index(State.INVALID),
    "the stored samples are damaged: restore a backup",
    None,
)
"""Of a flight whose newest samples cannot be read."""
ROWS_AT_ONCE = 100
"""Chunks read at once by a check."""
CHUNK = 1000
"""Maximum number of samples per blob."""


class FlightInProgress(RuntimeError):
    """The record of a flight is not complete yet."""


@dataclass(frozen=True)
class FlightInfo(Entry):
    """A source assessed by a monitor."""

    id: str
    source: dict[str, Any]
    monitor_id: str
    epsilon: float
    """accepted miss rate"""
    status: str
    """`running`, `interrupted`, or the word given when it ended"""
    created: Time
    ended: Time | None
    exceeded_t: float | None
    """first exceedance up to the end [s], whether flown or skipped by a seek"""
    exceedances: list[dict[str, Any]] | None
    """exceedances up to the end, per channel; null for an interrupted flight"""
    limits_held: list[dict[str, Any]] | None
    """limits in force and since when; empty for the monitor's limits, null if not recorded"""
    summary: dict[str, Any] | None
    """its fields in a list, see app.flights.ended; null until it has ended"""
    keep: bool
    """whether it is kept permanently"""
    recording_id: str | None
    """recording made from its journal, even if deleted since; null if none was made"""
    journal_digest: str | None
    """SHA-256 of its journal, once that is complete; null if none is recorded"""
    end_reason: str | None
    """why it ended, and who ended it; null if none is recorded"""
    recording: str | None
    """id of that recording; null if it does not exist"""
    head: int | None
    """newest sample number stored; null before the first"""
    lost: int | None
    """earlier samples never stored; null if more may be missing because it was interrupted"""


@dataclass(frozen=True)
class FlightFilter:
    """Which flights to list; empty fields let all through.

    progress: stored states.   monitor: id of the alarm authority.   aircraft: of the recording
    that it replays, or by whose mapping it was read.   text: part of the flight's the monitor's
    or the monitor set's name, or its id.   since, until: of its start.
    """

    progress: tuple[Progress, ...] = ()
    monitor: str = ""
    aircraft: str = ""
    text: str = ""
    since: str | None = None
    until: str | None = None


_OF_FLIGHT = assessment_chunks.c.flight_id == flights.c.id
_NEWEST = select(assessment_chunks.c.last_seq).where(_OF_FLIGHT)
_HEAD = _NEWEST.order_by(assessment_chunks.c.first_seq.desc()).limit(1).scalar_subquery()
_HEAD_OF = select(_HEAD.label("head")).select_from(flights).where(flights.c.id == bindparam("id"))
"""Built once, because every batch of a flight in progress uses it."""


class FlightRepository(Entries[FlightInfo]):
    """Flights by id."""

    table, parts, entry = flights, assessment_chunks, FlightInfo

    def add(
        self,
        source: dict[str, Any],
        monitor_id: str,
        epsilon: float,
        display: Sequence[tuple[str, float]] = (),
        monitor_set: tuple[str, Mapping[ConditionKey, float]] | None = None,
    ) -> str:
        """Store a flight that starts now and return its id.

        display: id and epsilon of each display monitor.   monitor_set: id, and declared values of
        the flight condition; None for `monitor_id` throughout.
        """
        flight_id = new_id()
        row = {"id": flight_id, "source": source, "monitor_id": monitor_id, "epsilon": epsilon}
        with self._writing() as connection:
            for used_id in (monitor_id, *(display_id for display_id, _ in display)):
                require(connection, monitors, used_id)
            connection.execute(insert(flights).values(**row, status="running", created=now()))
            if monitor_set is not None:
                set_id, fixed = monitor_set
                require(connection, monitor_sets, set_id)
                row = {"flight_id": flight_id, "monitor_set_id": set_id, "fixed": dict(fixed)}
                connection.execute(insert(flight_monitor_sets).values(**row))
            for position, (display_id, display_epsilon) in enumerate(display):
                row = {"flight_id": flight_id, "position": position}
                row |= {"monitor_id": display_id, "epsilon": display_epsilon}
                connection.execute(insert(display_monitors).values(**row))
        self.on_change()
        return flight_id

    def display(self, flight_ids: Iterable[str]) -> dict[str, list[tuple[str, float]]]:
        """Id and epsilon of each flight's display monitors; flights without any are absent."""
        shown = display_monitors.c
        query = select(shown.flight_id, shown.monitor_id, shown.epsilon).order_by(shown.position)
        by_flight = self._by_flight(query, flight_ids)
        return {
            key: [(row["monitor_id"], row["epsilon"]) for row in rows]
            for key, rows in by_flight.items()
        }

    def end(
        self,
        flight_id: str,
        status: str = "ended",
        exceeded_t: float | None = None,
        exceedances: list[dict[str, Any]] | None = None,
        limits_held: list[dict[str, Any]] | None = None,
        journal_digest: str | None = None,
        end_reason: str | None = None,
    ) -> FlightInfo:
        """End a flight; one that has already ended is left unchanged.

        exceeded_t: first exceedance [s].   exceedances: per channel, plain data.
        limits_held: limits in force and since when, plain data.
        journal_digest: SHA-256 of its complete journal.   end_reason: why, and by whom.
        """
        if not status or status == "running":
            raise ValueError(f"a flight cannot end as {status!r}: give one word for how it ended")
        running = (flights.c.id == flight_id) & (flights.c.status == "running")
        with self._writing() as connection:
            ending = {"status": status, "ended": now(), "exceeded_t": exceeded_t}
            ending |= {"exceedances": exceedances, "limits_held": limits_held}
            ending |= {"journal_digest": journal_digest, "end_reason": end_reason}
            connection.execute(update(flights).where(running).values(**ending))
            over = self._fetch(connection, flight_id)
        self.on_change()
        return over

    def without_summary(self) -> list[str]:
        """Ids of the ended flights without a summary of this version, newest first."""
        whole = flights.c.summary["is_assessed"].as_string().is_not(None)
        lacking = (flights.c.status != "running") & ~whole
        query = select(flights.c.id).where(lacking).order_by(flights.c.created.desc())
        with self._reading() as connection:
            return list(connection.execute(query).scalars())

    def unfinished(self) -> list[FlightInfo]:
        """Running flights, and interrupted ones that are no recordings yet, newest first."""
        is_open = flights.c.status.in_(("running", INTERRUPTED)) & flights.c.recording_id.is_(None)
        with self._reading() as connection:
            rows = connection.execute(self._newest_first(is_open))
            return [self._entry(row) for row in rows]

    def listed(self, limit: int, after: str, wanted: FlightFilter) -> Page[FlightInfo]:
        """Flights that a filter lets through, newest first; arguments as in `page`."""
        return self.page(limit, after, *_conditions(wanted))

    def summarize(self, summaries: Mapping[str, dict[str, Any]]) -> None:
        """Note by id what lists show of ended flights; those in progress are left unchanged."""
        over = (flights.c.id == bindparam("flight")) & (flights.c.status != "running")
        noted = update(flights).where(over).values(summary=bindparam("noted"))
        rows = [{"flight": flight_id, "noted": summary} for flight_id, summary in summaries.items()]
        if rows:
            with self._writing() as connection:
                connection.execute(noted, rows)
            self.on_change()

    def resume(self, flight_id: str, head: int) -> None:
        """Continue an interrupted flight after sample `head`; other flights are left unchanged.

        Samples stored beyond `head` were never acknowledged: delete them, the source resends them.
        """
        interrupted = (flights.c.id == flight_id) & (flights.c.status == INTERRUPTED)
        with self._writing() as connection:
            running = {"status": "running", "ended": None, "summary": None}
            running |= {"journal_digest": None}
            if connection.execute(update(flights).where(interrupted).values(**running)).rowcount:
                _cut(connection, flight_id, head)
        self.on_change()

    def delete(self, flight_id: str) -> None:
        """Delete an ended flight with its assessments, alarms and markers.

        FlightInProgress; KeptPermanently.   Deleting it again within a day succeeds.
        """
        with self._deleting() as connection:
            if was_deleted(connection, "flights", flight_id):
                return
            note_deleted(connection, "flights", flight_id)
            if self._fetch(connection, flight_id).status == "running":
                raise FlightInProgress(
                    f"flight {flight_id} is in progress: end it, then delete its record"
                )
            check_deletable(connection, flights, flight_id)
            connection.execute(delete(flights).where(flights.c.id == flight_id))
        self.on_change()

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
        cause: Sequence[int] | None = None,
        manoeuvre: npt.ArrayLike | None = None,
    ) -> None:
        """Store the next samples of a flight, numbered from first_seq.

        t: (n,) [s].   y: (n, n_channels).   p_value: (n,), NaN if none.   alert: (n,) bool.
        state: (n,) indices into STATES.   y_hat: (n, n_channels), None or NaN without a forecast.
        reasons: (n,) why a sample was not assessed; None for the default of its state.
        display: assessments by each display monitor.   cause: (n,) indices into CAUSES; None to go
        by the reasons.   manoeuvre: (n,) see StoredAssessments.
        ValueError for wrong shapes and for samples that are already stored.
        """
        if cause is None:
            codes = np.asarray(state, np.uint8)
            cause = causes_of(codes, reasons or [REASONS[code] for code in codes])
        if manoeuvre is None:
            manoeuvre = np.full(len(cause), UNKNOWN)
        samples = pack(t, y, p_value, alert, state, y_hat, cause, manoeuvre)
        chunks = [
            chunk_row(
                flight_id,
                first_seq + i,
                samples[i : i + CHUNK],
                (reasons or ())[i : i + CHUNK],
                [monitor.part(slice(i, i + CHUNK)) for monitor in display],
            )
            for i in range(0, len(samples), CHUNK)
        ]
        if not chunks:
            return
        with self._writing() as connection:
            head = fetch(connection, _HEAD_OF.params(id=flight_id), "flight", flight_id).head
            if head is not None and first_seq <= head:
                raise ValueError(
                    f"flight {flight_id} is stored up to sample {head}: samples from {first_seq} "
                    f"were given, continue from {head + 1}"
                )
            connection.execute(insert(assessment_chunks), chunks)

    def assessments(
        self, flight_id: str, first_seq: int = 0, last_seq: int | None = None
    ) -> StoredAssessments:
        """The stored samples first_seq to last_seq, both included. Damaged."""
        chunk = assessment_chunks.c
        query = select(assessment_chunks).where(
            chunk.flight_id == flight_id, chunk.last_seq >= first_seq
        )
        if last_seq is not None:
            query = query.where(chunk.first_seq <= last_seq)
        with self._reading() as connection:
            require(connection, flights, flight_id)
            rows = connection.execute(query.order_by(chunk.first_seq)).all()
        chunks = [chunk_of(row) for row in rows]
        none = np.empty(0, sample_type(len(LATERAL)))
        samples = np.concatenate([part.samples for part in chunks] or [none])
        reasons = [text for part in chunks for text in part.reasons]
        numbers = [np.arange(len(part.samples)) + part.first_seq for part in chunks]
        seq = np.concatenate([np.empty(0, np.int64), *numbers])
        selected = slice(
            np.searchsorted(seq, first_seq),
            None if last_seq is None else np.searchsorted(seq, last_seq, "right"),
        )
        display = joined([part.display for part in chunks])
        return StoredAssessments(
            seq=seq[selected],
            reasons=tuple(reasons[selected]),
            display=tuple(monitor.part(selected) for monitor in display),
            **{name: np.ascontiguousarray(samples[name][selected]) for name in FIELDS},
        )

    def check(self, flight_id: str, rest: Callable[[], None] = lambda: None) -> bool:
        """Compare every chunk with its digest; return whether all have one. Damaged.

        rest: called between pieces of work.
        """
        chunk, head, verified = assessment_chunks.c, -1, True
        while True:
            query = select(assessment_chunks).where(
                chunk.flight_id == flight_id, chunk.first_seq > head
            )
            with self._reading() as connection:
                require(connection, flights, flight_id)
                query = query.order_by(chunk.first_seq).limit(ROWS_AT_ONCE)
                rows = connection.execute(query).all()
            for row in rows:
                verified &= chunk_of(row).is_verified
                rest()
            if len(rows) < ROWS_AT_ONCE:
                return verified
            head = rows[-1].first_seq

    def sources(self, flight_ids: Iterable[str]) -> dict[str, dict[str, Any]]:
        """Sources of flights by id; flights that do not exist are absent."""
        query = select(flights.c.id.label("flight_id"), flights.c.source)
        rows = self._by_flight(query, flight_ids)
        return {flight_id: row["source"] for flight_id, (row,) in rows.items()}

    def last_state(self, flight_id: str) -> NewestState | None:
        """Of the newest stored sample, DAMAGED where it is; None if none."""
        chunk = assessment_chunks.c
        query = select(assessment_chunks).where(chunk.flight_id == flight_id)
        with self._reading() as connection:
            row = connection.execute(query.order_by(chunk.last_seq.desc()).limit(1)).one_or_none()
        if row is None:
            return None
        try:
            newest = chunk_of(row)
        except Damaged:
            return DAMAGED
        sample = newest.samples[-1]
        return int(sample["state"]), newest.reasons[-1], CAUSES[sample["cause"]]

    def is_assessed(self, flight_id: str) -> bool:
        """Whether a stored sample has an assessment; damaged ones do not count."""
        assessed = code_of(State.OK)
        return any((each["state"] == assessed).any() for each in self._undamaged(flight_id))

    def samples(self, flight_id: str) -> tuple[Array, Array]:
        """Times (n,) [s] and values (n, n_channels) of its samples, without damaged ones."""
        parts = [(each["t"].copy(), each["y"].copy()) for each in self._undamaged(flight_id)]
        if not parts:
            return np.empty(0), np.empty((0, len(LATERAL)))
        t, y = zip(*parts, strict=True)
        return np.concatenate(t), np.concatenate(y)

    def _undamaged(self, flight_id: str) -> Iterator[npt.NDArray]:
        """The samples of each chunk in order, without damaged chunks."""
        chunk = assessment_chunks.c
        query = select(assessment_chunks).where(chunk.flight_id == flight_id)
        with self._reading() as connection:
            for row in connection.execute(query.order_by(chunk.first_seq)):
                with suppress(Damaged):
                    yield chunk_of(row).samples

    def recover(self) -> None:
        """Mark running flights as interrupted: the process that flew them died."""
        running = flights.c.status == "running"
        interrupted = {"status": INTERRUPTED, "ended": now()}
        with self._deleting() as connection:
            connection.execute(update(flights).where(running).values(**interrupted))

    def _query(self) -> Select:
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


def _conditions(wanted: FlightFilter) -> list[ColumnElement[bool]]:
    source, name = flights.c.source, flights.c.source["name"].as_string()
    conditions = list[ColumnElement[bool]]()
    if wanted.progress == ("running",):
        conditions.append(flights.c.status == "running")
    elif wanted.progress:  # not by the index of states, whose flights are in no order of time
        conditions.append(flights.c.status.not_in(set(get_args(Progress)) - set(wanted.progress)))
    if wanted.monitor:
        conditions.append(flights.c.monitor_id == wanted.monitor)
    if wanted.aircraft:
        of_aircraft = select(recordings.c.id).where(recordings.c.aircraft == wanted.aircraft)
        conditions.append(source["recording"].as_string().in_(of_aircraft))
    if wanted.since:
        conditions.append(flights.c.created >= wanted.since)
    if wanted.until:
        conditions.append(flights.c.created <= wanted.until)
    if text := wanted.text.strip():
        named = select(monitors.c.id).where(monitors.c.name.icontains(text, autoescape=True))
        sets = select(monitor_sets.c.id).where(monitor_sets.c.name.icontains(text, autoescape=True))
        of_sets = flight_monitor_sets.c.monitor_set_id.in_(sets)
        on_sets = select(flight_monitor_sets.c.flight_id).where(of_sets)
        conditions.append(
            name.icontains(text, autoescape=True)
            | (flights.c.id == text)
            | flights.c.monitor_id.in_(named)
            | flights.c.id.in_(on_sets)
        )
    return conditions


def _cut(connection: Connection, flight_id: str, head: int) -> None:
    chunk = assessment_chunks.c
    beyond = (chunk.flight_id == flight_id) & (chunk.last_seq > head)
    query = select(assessment_chunks).where(beyond, chunk.first_seq <= head)
    parts = [chunk_of(row) for row in connection.execute(query)]
    connection.execute(delete(assessment_chunks).where(beyond))
    for part in parts:
        rest = slice(head + 1 - part.first_seq)
        display = [monitor.part(rest) for monitor in part.display]
        row = chunk_row(flight_id, part.first_seq, part.samples[rest], part.reasons[rest], display)
        connection.execute(insert(assessment_chunks).values(**row))


def replays_of(connection: Connection, kind: str, identity: str) -> list[tuple[str, str]]:
    """Running flights whose source is this recording or scoring: their kind and id."""
    running = select(flights.c.id, flights.c.source).where(flights.c.status == "running")
    return [
        ("running flight", row.id)
        for row in connection.execute(running.order_by(flights.c.created))
        if row.source.get(kind) == identity
    ]
