"""Stored flights: assessments in chunks of samples, alarms with their acknowledgement."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt
from sqlalchemy import Connection, Select, delete, func, insert, select, update

from app.store.arrays import from_blob, to_blob
from app.store.entries import Alarm, FlightInfo, StoredAssessments
from app.store.repository import Shelf, columns, found, whole
from app.store.tables import alarms, assessment_chunks, flights, monitors, new_id, now
from core.channels import N_CHANNELS
from core.monitor.assessment import REASONS

CHUNK = 1000
"""Most samples in one blob."""

SAMPLE = np.dtype(
    [
        ("t", "<f8"),
        ("y", "<f8", (N_CHANNELS,)),
        ("p_value", "<f8"),
        ("alert", "?"),
        ("state", "u1"),
        ("y_hat", "<f8", (N_CHANNELS,)),
    ]
)
"""One assessed sample as it is stored; `state` is a code into core.monitor.assessment.STATES."""


class StoredFlights(Shelf):
    """Flights by id."""

    def add_flight(self, source: dict[str, Any], monitor_id: str, epsilon: float) -> str:
        """Keep a flight that runs from now on; return its id. NotFound for the monitor."""
        flight_id = new_id()
        row = {"id": flight_id, "source": source, "monitor_id": monitor_id, "epsilon": epsilon}
        with self._writing() as connection:
            query = select(monitors.c.id).where(whole(monitors, monitor_id))
            found(connection, query, "monitor", monitor_id)
            connection.execute(insert(flights).values(**row, status="running", created=now()))
        return flight_id

    def end_flight(self, flight_id: str, status: str = "ended") -> FlightInfo:
        """Note that a flight is over and how; one that has ended stays as it ended. NotFound."""
        if not status or status == "running":
            raise ValueError(f"a flight cannot end as {status!r}: say how it ended, in one word")
        running = (flights.c.id == flight_id) & (flights.c.status == "running")
        with self._writing() as connection:
            connection.execute(update(flights).where(running).values(status=status, ended=now()))
            return _flight(connection, flight_id)

    def flight(self, flight_id: str) -> FlightInfo:
        """What a flight is; NotFound."""
        with self._reading() as connection:
            return _flight(connection, flight_id)

    def flights(self) -> list[FlightInfo]:
        """All flights, newest first."""
        query = _flights().order_by(flights.c.created.desc())
        with self._reading() as connection:
            return [FlightInfo(**row._mapping) for row in connection.execute(query)]

    def delete_flight(self, flight_id: str) -> None:
        """Delete a flight with its assessments and alarms. NotFound."""
        with self._writing() as connection:
            _flight(connection, flight_id)
            connection.execute(delete(flights).where(flights.c.id == flight_id))

    def append_assessments(
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
    ) -> None:
        """Keep the next samples of a flight, numbered from first_seq.

        t: (n,) [s].   y: (n, 6).   p_value: (n,), NaN where there is none.   alert: (n,) bool.
        state: (n,) codes into STATES.   y_hat: (n, 6), None or NaN where there is no forecast.
        reasons: (n,) why a sample was not assessed; None: what its state says.
        NotFound; ValueError for other shapes and for samples that are already stored.
        """
        samples = _samples(t, y, p_value, alert, state, y_hat)
        chunks = [
            {
                "flight_id": flight_id,
                "first_seq": first_seq + i,
                "last_seq": first_seq + min(i + CHUNK, len(samples)) - 1,
                "content": to_blob(samples[i : i + CHUNK]),
                "reasons": _runs(samples["state"][i : i + CHUNK], (reasons or ())[i : i + CHUNK]),
            }
            for i in range(0, len(samples), CHUNK)
        ]
        if not chunks:
            return
        with self._writing() as connection:
            head = _flight(connection, flight_id).head
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
        query = select(chunk.first_seq, chunk.content, chunk.reasons).where(
            chunk.flight_id == flight_id, chunk.last_seq >= first_seq
        )
        if last_seq is not None:
            query = query.where(chunk.first_seq <= last_seq)
        with self._reading() as connection:
            _flight(connection, flight_id)
            rows = connection.execute(query.order_by(chunk.first_seq)).all()
        parts = [from_blob(row.content) for row in rows]
        samples = np.concatenate([np.empty(0, SAMPLE), *parts])
        reasons = [
            text
            for row, part in zip(rows, parts, strict=True)
            for text in _reasons(part["state"], row.reasons or ())
        ]
        numbers = [np.arange(len(p)) + row.first_seq for row, p in zip(rows, parts, strict=True)]
        seq = np.concatenate([np.empty(0, np.int64), *numbers])
        asked = slice(
            np.searchsorted(seq, first_seq),
            None if last_seq is None else np.searchsorted(seq, last_seq, "right"),
        )
        return StoredAssessments(
            seq=seq[asked],
            reasons=tuple(reasons[asked]),
            **{name: np.ascontiguousarray(samples[name][asked]) for name in SAMPLE.names or ()},
        )

    def add_alarm(self, flight_id: str, seq: int, t: float, p_value: float | None) -> str:
        """Keep an alarm of a flight, raised now; return its id. NotFound."""
        alarm_id = new_id()
        last = select(func.max(alarms.c.number)).where(alarms.c.flight_id == flight_id)
        row = {"id": alarm_id, "flight_id": flight_id, "seq": seq, "t": t, "p_value": p_value}
        with self._writing() as connection:
            _flight(connection, flight_id)
            number = (connection.execute(last).scalar() or 0) + 1
            connection.execute(insert(alarms).values(**row, number=number, raised=now()))
        return alarm_id

    def acknowledge_alarm(self, alarm_id: str, by: str) -> Alarm:
        """Note who has seen an alarm; the first one stays. NotFound."""
        waiting = (alarms.c.id == alarm_id) & alarms.c.acknowledged.is_(None)
        with self._writing() as connection:
            connection.execute(update(alarms).where(waiting).values(acknowledged=now(), by=by))
            return _alarm(connection, alarm_id)

    def alarm(self, alarm_id: str) -> Alarm:
        """Return one alarm; NotFound."""
        with self._reading() as connection:
            return _alarm(connection, alarm_id)

    def alarms(self, flight_id: str) -> list[Alarm]:
        """Alarms of a flight in the order they were raised. NotFound."""
        query = select(*columns(alarms, Alarm)).where(alarms.c.flight_id == flight_id)
        with self._reading() as connection:
            _flight(connection, flight_id)
            rows = connection.execute(query.order_by(alarms.c.number))
            return [Alarm(**row._mapping) for row in rows]


def interrupt_flights(connection: Connection) -> None:
    """Report flights that nobody flies any more: the process that flew them died."""
    words = {"status": "interrupted", "ended": now()}
    connection.execute(update(flights).where(flights.c.status == "running").values(**words))


def _samples(*fields: Any) -> npt.NDArray:
    """Pack the fields of SAMPLE, in its order."""
    samples = np.empty(len(fields[0]), SAMPLE)
    for name, values in zip(SAMPLE.names or (), fields, strict=True):
        if values is None:
            samples[name] = np.nan
        elif np.shape(values) != samples[name].shape:
            raise ValueError(
                f"{name} has shape {np.shape(values)}: it needs {samples[name].shape}, a row for "
                "each sample"
            )
        else:
            samples[name] = values
    return samples


def _runs(state: npt.NDArray, reasons: Sequence[str]) -> list[list[Any]] | None:
    """[first, last, text] of each run of samples whose reason is not that of their state."""
    runs = []
    said = zip(state.tolist(), reasons, strict=True) if reasons else ()
    other = ("" if text == REASONS[code] else text for code, text in said)
    for text, run in groupby(enumerate(other), lambda numbered: numbered[1]):
        numbers = [k for k, _ in run]
        if text:
            runs.append([numbers[0], numbers[-1], text])
    return runs or None


def _reasons(state: npt.NDArray, runs: Iterable[Sequence[Any]]) -> list[str]:
    """The reason of each sample of a chunk."""
    reasons = [REASONS[code] for code in state.tolist()]
    for first, last, text in runs:
        reasons[first : last + 1] = [text] * (last + 1 - first)
    return reasons


def _flights() -> Select:
    chunk = assessment_chunks.c
    head = (
        select(func.max(chunk.last_seq))
        .where(chunk.flight_id == flights.c.id)
        .scalar_subquery()
        .label("head")
    )
    return select(*columns(flights, FlightInfo), head)


def _flight(connection: Connection, flight_id: str) -> FlightInfo:
    query = _flights().where(flights.c.id == flight_id)
    return FlightInfo(**found(connection, query, "flight", flight_id)._mapping)


def _alarm(connection: Connection, alarm_id: str) -> Alarm:
    query = select(*columns(alarms, Alarm)).where(alarms.c.id == alarm_id)
    return Alarm(**found(connection, query, "alarm", alarm_id)._mapping)
