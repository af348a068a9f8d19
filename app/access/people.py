"""People and their tokens: the token of the settings, and stored ones with a name and a role.

Stored tokens are read into memory every second. A token that another process makes or revokes
counts within a second, and no request waits for the database.
"""

import asyncio
import logging
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from datetime import datetime

from app.store.people import LOCAL, SERVER, Role, StoredToken, digest_of
from app.store.store import Store, StoreError
from app.store.tables import now

LOG = logging.getLogger("forewarn")
REFRESH_EVERY_S = 1.0
NOTED_EVERY_S = 60.0
"""[s] The last use of a token is stored no more often."""

Clock = Callable[[], float]


@dataclass(frozen=True)
class Person:
    """A client by name and role."""

    name: str
    role: Role


@dataclass(eq=False)
class Admission:
    """Access of a person. expires: [s] by the clock.   is_revoked: it ended earlier.

    digest: of the token; empty without one.
    """

    person: Person
    digest: str = ""
    expires: float = math.inf
    clock: Clock = time.time
    is_revoked: bool = False

    @property
    def has_ended(self) -> bool:
        return self.is_revoked or self.clock() >= self.expires


async def regularly(work: Callable[[], Awaitable[None]], every_s: float, failed: str) -> None:
    """Repeat work with the store; warn when it begins to fail. Never returns."""
    is_failing = False
    while True:
        await asyncio.sleep(every_s)
        try:
            await work()
            is_failing = False
        except StoreError as error:
            if not is_failing:
                LOG.warning(failed, error)
            is_failing = True


class People:
    """The tokens of one server.

    token: that of the settings.   needs_token: without a token, access is refused. True from the
    first stored token on, and stays true when that token is revoked.
    """

    def __init__(self, token: str | None, clock: Clock = time.time) -> None:
        self._clock = clock
        self.needs_token = token is not None
        self.local = Admission(Person(LOCAL, "admin"))
        self.server = Admission(Person(SERVER, "admin"), "" if token is None else digest_of(token))
        self._of_settings = {} if token is None else {self.server.digest: self.server}
        self._stored: dict[str, tuple[str, Admission]] = {}
        self._used: dict[str, str] = {}
        self._noted = -math.inf
        self._store: Store | None = None
        self._lock = asyncio.Lock()

    def find(self, token: str) -> Admission | None:
        """The access that a token gives; None if it is wrong, revoked or expired."""
        return self.find_digest(digest_of(token))

    def find_digest(self, digest: str) -> Admission | None:
        if digest in self._of_settings:
            return self._of_settings[digest]
        token_id, admission = self._stored.get(digest, ("", None))
        if admission is None or admission.has_ended:
            return None
        self._used[token_id] = now()
        return admission

    def with_use(self, token: StoredToken) -> StoredToken:
        """A token with its last use at this server, which may not be stored yet."""
        return replace(token, last_used=self._used.get(token.id, token.last_used))

    @asynccontextmanager
    async def open(self, store: Store) -> AsyncIterator[None]:
        """Follow the tokens of a store. While they cannot be read, none of them is accepted."""
        self._store, self._lock = store, asyncio.Lock()
        try:
            await self.refresh()
        except StoreError as error:
            self._require_token()
            LOG.error("stored tokens cannot be read, so none is accepted: %s", error)
        failed = "tokens were not refreshed, or their last use not stored: %s"
        work = regularly(self._refresh_and_note, REFRESH_EVERY_S, failed)
        refreshing = asyncio.create_task(work)
        try:
            yield
        finally:
            refreshing.cancel()
            await asyncio.wait((refreshing,))

    async def refresh(self) -> None:
        """Read the stored tokens now. StoreError."""
        assert self._store is not None
        async with self._lock:  # an older read must not undo a newer one
            self._update(await asyncio.to_thread(self._store.tokens.known))

    def _update(self, known: Mapping[str, StoredToken]) -> None:
        if known:
            self._require_token()
        for digest, token in known.items():
            if digest not in self._stored:
                self._stored[digest] = token.id, self._admission(token, digest)
        for digest, (_, admission) in [*self._stored.items()]:
            token = known.get(digest)
            if token is None or token.revoked is not None:
                admission.is_revoked = True
            if token is None:
                del self._stored[digest]

    async def _refresh_and_note(self) -> None:
        await self.refresh()
        await self._note_used()

    async def _note_used(self) -> None:
        """Store the last use of tokens, at most every NOTED_EVERY_S. StoreError."""
        assert self._store is not None
        if not self._used or time.monotonic() - self._noted < NOTED_EVERY_S:
            return
        used = {**self._used}
        await asyncio.to_thread(self._store.tokens.note_used, used)
        self._used = {key: t for key, t in self._used.items() if used.get(key) != t}
        self._noted = time.monotonic()

    def _require_token(self) -> None:
        if not self.needs_token:
            self.needs_token = True
            self.local.is_revoked = True

    def _admission(self, token: StoredToken, digest: str) -> Admission:
        expiry = token.expires
        expires = math.inf if expiry is None else datetime.fromisoformat(expiry).timestamp()
        return Admission(Person(token.name, token.role), digest, expires, self._clock)
