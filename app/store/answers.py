"""Answers to requests, kept for a day so that a repeated request gets the same answer."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from app import json_codec
from app.store.repository import Repository
from app.store.tables import answers, metadata, now, time_text

KEEP_FOR = timedelta(days=1)
DELETED = "deleted"


@dataclass(frozen=True)
class Answer:
    """The answer to a request.

    fingerprint: SHA-256 of the request.   status: None if the server stopped during the request, so
    that the outcome is unknown.
    """

    fingerprint: str
    status: int | None
    headers: dict[str, str] | None
    body: bytes | None


class AnswerRepository(Repository):
    """Answers by request path and key."""

    def start(self, path: str, key: str) -> None:
        with self._writing() as connection:
            _add(connection, path, key)

    def find(self, path: str, key: str) -> Answer | None:
        """The answer to a request; None if it is unknown or older than a day."""
        with self._reading() as connection:
            return _find(connection, path, key)

    def is_gone(self, path: str, answer: Answer) -> bool:
        """Whether the thing that a request to this path created has been deleted.

        The Location header names it; without that header, the id in the body does.
        """
        if answer.status is None or answer.body is None:
            return False
        location = (answer.headers or {}).get("location")
        location = location or f"{path}/{json_codec.decode(answer.body)['id']}"
        *_, name, identity = location.split("/")
        table = metadata.tables[name]
        exists = table.c.id == identity
        if "complete" in table.c:
            exists &= table.c.complete
        with self._reading() as connection:
            return connection.execute(select(table.c.id).where(exists)).first() is None

    def finish(self, path: str, key: str, answer: Answer) -> None:
        with self._writing() as connection:
            values = vars(answer)
            connection.execute(update(answers).where(_by_key(path, key)).values(**values))

    def forget(self, path: str, key: str) -> None:
        """Forget a refused request, so that it may be sent again."""
        with self._deleting() as connection:
            connection.execute(delete(answers).where(_by_key(path, key)))


def note_deleted(connection: Connection, table: str, identity: str) -> None:
    """Record a deletion, so that deleting the same row again succeeds."""
    _add(connection, f"{table}/{identity}", DELETED)


def _add(connection: Connection, path: str, key: str) -> None:
    connection.execute(delete(answers).where(answers.c.created < _oldest()))
    row = {"path": path, "key": key, "created": now(), "fingerprint": ""}
    connection.execute(insert(answers).values(**row))


def was_deleted(connection: Connection, table: str, identity: str) -> bool:
    return _find(connection, f"{table}/{identity}", DELETED) is not None


def _find(connection: Connection, path: str, key: str) -> Answer | None:
    a = answers.c
    query = select(a.fingerprint, a.status, a.headers, a.body).where(
        _by_key(path, key), a.created >= _oldest()
    )
    row = connection.execute(query).one_or_none()
    return None if row is None else Answer(**row._mapping)


def _by_key(path: str, key: str) -> ColumnElement[bool]:
    return (answers.c.path == path) & (answers.c.key == key)


def _oldest() -> str:
    return time_text(datetime.now(UTC) - KEEP_FOR)
