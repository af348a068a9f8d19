"""Browser logins: sessions that expire."""

import asyncio
import logging
import secrets
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from app.access.people import NOTED_EVERY_S, Admission, Clock, regularly
from app.store.people import StoredSession, digest_of
from app.store.store import Store, StoreError

LOG = logging.getLogger("forewarn")
MOST_SESSIONS = 1000
STORED_EVERY_S = 1.0
"""[s] A session whose server is killed sooner after the login is lost."""
NOT_STORED = "sessions are not stored, so a restart ends them: %s"


@dataclass
class Session:
    """An open session. ends: [s] by the clock.   stored_ends: as the store has it."""

    admission: Admission
    ends: float
    stored_ends: float = 0.0


class Sessions:
    """Sessions of a server. They outlast it, if a store is open.

    A session ends `seconds` after its last use, or when its token ends.
    """

    def __init__(self, seconds: float, clock: Clock = time.time) -> None:
        self._seconds = seconds
        self._clock = clock
        self._open: OrderedDict[str, Session] = OrderedDict()
        self._changed: set[str] = set()
        """Sessions begun, ended, or used long after what the store has."""

    @asynccontextmanager
    async def open(
        self, store: Store, find: Callable[[str], Admission | None]
    ) -> AsyncIterator[None]:
        """Continue the stored sessions, and store them. find: access by the digest of a token."""
        try:
            for kept in await asyncio.to_thread(store.sessions.known):
                admission = find(kept.token)
                if admission is None or self._clock() >= kept.ends:
                    self._changed.add(kept.digest)
                else:
                    self._open[kept.digest] = Session(admission, kept.ends, kept.ends)
        except StoreError as error:
            LOG.warning(NOT_STORED, error)

        async def keep() -> None:
            await self.keep(store)

        keeping = asyncio.create_task(regularly(keep, STORED_EVERY_S, NOT_STORED))
        try:
            yield
        finally:
            keeping.cancel()
            await asyncio.wait((keeping,))
            try:
                await keep()
            except StoreError as error:
                LOG.warning(NOT_STORED, error)

    async def keep(self, store: Store) -> None:
        """Store what has changed. StoreError."""
        changed, self._changed = self._changed, set()
        if not changed:
            return
        kept = [
            StoredSession(digest, session.admission.digest, session.ends)
            for digest in changed
            if (session := self._open.get(digest)) is not None
        ]
        try:
            await asyncio.to_thread(store.sessions.keep, kept, changed)
        except StoreError:
            self._changed |= changed
            raise
        for stored in kept:
            if session := self._open.get(stored.digest):
                session.stored_ends = stored.ends

    def start(self, admission: Admission) -> str:
        """Start a session. Returns the key for its cookie."""
        key = secrets.token_urlsafe(32)
        digest = digest_of(key)
        self._open[digest] = Session(admission, self._clock() + self._seconds)
        self._changed.add(digest)
        while len(self._open) > MOST_SESSIONS:
            self._changed.add(self._open.popitem(last=False)[0])
        return key

    def use(self, key: str) -> Admission | None:
        """The admission of an open session, whose time starts again; None without a session."""
        digest, now = digest_of(key), self._clock()
        session = self._open.pop(digest, None)
        if session is None:
            return None
        if now >= session.ends or session.admission.has_ended:
            self._changed.add(digest)
            return None
        session.ends = now + self._seconds
        if session.ends - session.stored_ends > NOTED_EVERY_S:
            self._changed.add(digest)
        self._open[digest] = session
        return session.admission

    def end(self, key: str) -> Admission | None:
        """End a session, if open, and return its admission."""
        digest = digest_of(key)
        session = self._open.pop(digest, None)
        self._changed.add(digest)
        return session and session.admission

    def is_open(self, key: str) -> bool:
        """Whether a session is open; this does not prolong it."""
        session = self._open.get(digest_of(key))
        return session is not None and self._clock() < session.ends
