"""People: tokens with a role, an expiry and a link for one login; sessions; the log of changes.

Tokens are stored as digests. A token has 256 random bits, so its plain SHA-256 cannot be reversed,
and the timing of a look-up by digest reveals nothing.
"""

import hashlib
import re
import secrets
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal, get_args

from sqlalchemy import ColumnElement, delete, insert, select, update

from app.store.repository import Entries, Entry, NotFound, Repository, Time, columns
from app.store.tables import audit, new_id, now, sessions, time_text, tokens

Role = Literal["viewer", "operator", "engineer", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)
"""In rising order: each role includes the permissions of those before it."""
SERVER, LOCAL = "server", "local"
"""Name for the token in the settings, and name without authentication."""
NAME = re.compile(r"\w(?:[\w .@'-]{0,62}[\w.])?")
LONGEST_DAYS = 36_500
LINK_SECONDS = 600.0
"""How long a login link is valid [s]."""
SECRET_BYTES = 32
READ_AT_ONCE = 1000
"""Rows of the audit log."""


class TokenError(ValueError):
    """A token cannot be made."""


@dataclass(frozen=True)
class StoredToken(Entry):
    """A token without its secret, which is not stored."""

    id: str
    name: str
    """person's name"""
    role: Role
    created: Time
    expires: str | None
    """UTC, ISO 8601; null: never"""
    revoked: Time | None
    last_used: str | None
    """UTC, ISO 8601, to about a minute"""

    @property
    def is_valid(self) -> bool:
        return self.revoked is None and (self.expires is None or now() < self.expires)


class TokenRepository(Entries[StoredToken]):
    """Tokens by the digest of the secret; a name has at most one valid token."""

    table, entry = tokens, StoredToken

    def add(self, name: str, role: Role, days: float | None = None) -> tuple[StoredToken, str]:
        """Store a new token; return it with its secret, which cannot be read again.

        days: until it expires; never if None.   TokenError for an invalid or taken name.
        """
        if days is not None and not 0 < days <= LONGEST_DAYS:
            raise TokenError(f"days={days:g} was given: give more than 0, at most {LONGEST_DAYS}")
        if not NAME.fullmatch(name) or name.casefold() in (SERVER, LOCAL):
            raise TokenError(
                f"{name!r} cannot be a person's name: give up to 64 letters, digits, blanks or "
                f". @ ' -, and neither {SERVER} nor {LOCAL}"
            )
        secret = secrets.token_hex(SECRET_BYTES)
        expires = None if days is None else _in(timedelta(days=days))
        token = StoredToken(new_id(), name, role, now(), expires, None, None)
        with self._writing() as connection:
            others = [self._entry(row) for row in connection.execute(self._query())]
            if any(_same(other.name, name) for other in others if other.is_valid):
                raise TokenError(f"{name} has a token already: revoke it before making another")
            connection.execute(insert(tokens).values(**vars(token), digest=digest_of(secret)))
        return token, secret

    def known(self) -> dict[str, StoredToken]:
        """All tokens ever made, by digest."""
        query = select(tokens.c.digest, *columns(tokens, StoredToken))
        with self._reading() as connection:
            rows = [dict(row._mapping) for row in connection.execute(query)]
        return {row.pop("digest"): StoredToken(**row) for row in rows}

    def of_name(self, name: str) -> StoredToken:
        for token in self.all():
            if token.is_valid and _same(token.name, name):
                return token
        raise NotFound(f"{name} has no valid token: `forewarn token list` shows who has")

    def revoke(self, token_id: str) -> StoredToken:
        """Revoke a token permanently; the time of the first revocation stays."""
        valid = _has_id(token_id) & tokens.c.revoked.is_(None)
        with self._deleting() as connection:
            connection.execute(update(tokens).where(valid).values(revoked=now(), link=None))
            return self._fetch(connection, token_id)

    def make_link(self, token_id: str) -> str:
        """Code that logs the person in once within LINK_SECONDS; it replaces an earlier code.

        TokenError if the token is revoked or has expired.
        """
        code = secrets.token_urlsafe(SECRET_BYTES)
        values = {"link": digest_of(code), "link_expires": _in(timedelta(seconds=LINK_SECONDS))}
        with self._writing() as connection:
            token = self._fetch(connection, token_id)
            if not token.is_valid:
                raise TokenError(
                    f"the token of {token.name} is revoked or has expired: make a new one"
                )
            connection.execute(update(tokens).where(_has_id(token_id)).values(**values))
        return code

    def use_link(self, code: str) -> str | None:
        """Use up a code: the digest of its token, None if the code is not valid.

        The token itself may be revoked or expired.
        """
        is_link = (tokens.c.link == digest_of(code)) & (tokens.c.link_expires > now())
        with self._writing() as connection:
            digest = connection.execute(select(tokens.c.digest).where(is_link)).scalar_one_or_none()
            connection.execute(update(tokens).where(is_link).values(link=None))
        return digest

    def note_used(self, times: Mapping[str, str]) -> None:
        with self._writing() as connection:
            for token_id, time in times.items():
                connection.execute(update(tokens).where(_has_id(token_id)).values(last_used=time))


def digest_of(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()


def _has_id(token_id: str) -> ColumnElement[bool]:
    return tokens.c.id == token_id


def _same(name: str, other: str) -> bool:
    return name.casefold() == other.casefold()


def _in(wait: timedelta) -> str:
    return time_text(datetime.now(UTC) + wait)


@dataclass(frozen=True)
class StoredSession:
    """A session of a browser. digest: of its key.   token: digest of its token.   ends: [s], UTC"""

    digest: str
    token: str
    ends: float


class SessionRepository(Repository):
    """Sessions, the first to end first."""

    def known(self) -> list[StoredSession]:
        query = select(*columns(sessions, StoredSession)).order_by(sessions.c.ends)
        with self._reading() as connection:
            return [StoredSession(**row._mapping) for row in connection.execute(query)]

    def keep(self, stored: Sequence[StoredSession], changed: Collection[str]) -> None:
        """Store sessions, and forget the changed ones that are not among them."""
        with self._deleting() as connection:
            connection.execute(delete(sessions).where(sessions.c.digest.in_(changed)))
            if stored:
                connection.execute(insert(sessions), [asdict(session) for session in stored])


@dataclass(frozen=True)
class AuditEntry(Entry):
    """A change, a login, or an attempt refused because of the role."""

    time: str
    """of the answer, UTC, ISO 8601"""
    who: str
    """person's name; `server` for the token in the settings, `local` without authentication"""
    role: str
    address: str
    """client address"""
    method: str
    """HTTP method; `WEBSOCKET` for a WebSocket that sends"""
    path: str
    status: int
    """of the answer; 403: refused because of the role"""


class AuditRepository(Repository):
    """Entries of the audit log in the order they were written; none is ever changed."""

    def add(self, entries: Sequence[AuditEntry]) -> None:
        with self._writing() as connection:
            connection.execute(insert(audit), [asdict(entry) for entry in entries])

    def read(
        self, since: str | None = None, until: str | None = None, who: str | None = None
    ) -> Iterator[AuditEntry]:
        """Entries with since <= time < until (UTC, ISO 8601), of a person if given."""
        conditions: list[ColumnElement[bool]] = []
        if since is not None:
            conditions.append(audit.c.time >= since)
        if until is not None:
            conditions.append(audit.c.time < until)
        if who is not None:
            conditions.append(audit.c.who == who)
        last = 0
        while True:
            query = select(*columns(audit, AuditEntry), audit.c.id)
            query = query.where(audit.c.id > last, *conditions).order_by(audit.c.id)
            with self._reading() as connection:
                rows = connection.execute(query.limit(READ_AT_ONCE)).all()
            for row in rows:
                stored = dict(row._mapping)
                last = stored.pop("id")
                yield AuditEntry(**stored)
            if len(rows) < READ_AT_ONCE:
                return
