"""What was answered to requests that may come twice, for a day."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from app import json_codec
from app.store.repository import Repository
from app.store.tables import answers, metadata, now, time_text

KEPT = timedelta(days=1)
DELETED = "deleted"


@dataclass(frozen=True)
class Answer:
    """What a request was answered with.

    fingerprint: SHA-256 of the request.   status: None where the server ended during the request:
    whether it was carried out is not known.
    """

    fingerprint: str
    status: int | None
    headers: dict[str, str] | None
    body: bytes | None


class AnswerRepository(Repository):
    """Answers by the path of the request and its key."""

    def begin(self, path: str, key: str, fingerprint: str) -> Answer | None:
        """Note a request that is about to be carried out; an earlier one's answer if there is."""
        with self._writing() as connection:
            connection.execute(delete(answers).where(answers.c.created < _oldest()))
            if (earlier := _find(connection, path, key)) is not None:
                return earlier
            row = {"path": path, "key": key, "created": now(), "fingerprint": fingerprint}
            connection.execute(insert(answers).values(**row))
        return None

    def find(self, path: str, key: str) -> Answer | None:
        """What a request was answered with; None for one that never came, or too long ago."""
        with self._reading() as connection:
            return _find(connection, path, key)

    def is_gone(self, path: str, answer: Answer) -> bool:
        """Whether what a request to a path created is there no more.

        The Location of its answer says what that is; without one, the id in its body.
        """
        if answer.status is None or answer.body is None:
            return False
        location = (answer.headers or {}).get("location")
        location = location or f"{path}/{json_codec.decode(answer.body)['id']}"
        *_, name, identity = location.split("/")
        table = metadata.tables[name]
        there = table.c.id == identity
        if "complete" in table.c:
            there &= table.c.complete
        with self._reading() as connection:
            return connection.execute(select(table.c.id).where(there)).first() is None

    def finish(self, path: str, key: str, answer: Answer) -> None:
        """Keep the answer to a request that was carried out."""
        with self._writing() as connection:
            values = vars(answer)
            connection.execute(update(answers).where(_this(path, key)).values(**values))

    def forget(self, path: str, key: str) -> None:
        """Forget a request that was refused: it may come again."""
        with self._deleting() as connection:
            connection.execute(delete(answers).where(_this(path, key)))


def note_deleted(connection: Connection, table: str, identity: str) -> None:
    """Note that a row is deleted, so that it may be asked for twice."""
    row = {"path": f"{table}/{identity}", "key": DELETED, "created": now(), "fingerprint": ""}
    connection.execute(delete(answers).where(answers.c.created < _oldest()))
    connection.execute(insert(answers).values(**row))


def was_deleted(connection: Connection, table: str, identity: str) -> bool:
    """Whether a row was deleted within the last day."""
    return _find(connection, f"{table}/{identity}", DELETED) is not None


def _find(connection: Connection, path: str, key: str) -> Answer | None:
    a = answers.c
    query = select(a.fingerprint, a.status, a.headers, a.body).where(
        _this(path, key), a.created >= _oldest()
    )
    row = connection.execute(query).one_or_none()
    return None if row is None else Answer(**row._mapping)


def _this(path: str, key: str) -> ColumnElement[bool]:
    return (answers.c.path == path) & (answers.c.key == key)


def _oldest() -> str:
    return time_text(datetime.now(UTC) - KEPT)
