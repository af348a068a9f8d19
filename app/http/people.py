"""Who is let in by a token: the settings' own, and those that are stored with name and role.

What is stored is looked at every second, so that a token that another process makes or revokes
counts at once, and is kept in memory, so that no request waits for the database.
"""

import asyncio
import logging
import math
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime

from app.store.store import Store, StoreError
from app.store.tables import now
from app.store.tokens import LOCAL, SERVER, Role, StoredToken, digest_of

LOG = logging.getLogger("forewarn")
LOOK_EVERY_S = 1.0
NOTED_EVERY_S = 60.0
"""[s] So often at most it is stored that a token was used."""
LONGEST_SLEEP_S = 60.0
"""[s] After which the clock is asked again: it may have been set."""

Clock = Callable[[], float]


@dataclass(frozen=True)
class Person:
    """Who asks."""

    name: str
    role: Role


@dataclass(eq=False)
class Admission:
    """What lets a person in. expires: when, by the clock [s].   over: set once it is revoked."""

    person: Person
    expires: float = math.inf
    clock: Clock = time.time
    over: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def is_over(self) -> bool:
        """Whether it lets in no more."""
        return self.over.is_set() or self.clock() >= self.expires

    async def wait_for_end(self) -> None:
        """Return once it lets in no more."""
        while not self.is_over:
            left = min(self.expires - self.clock(), LONGEST_SLEEP_S)
            with suppress(TimeoutError):
                await asyncio.wait_for(self.over.wait(), max(left, 0.0))


class People:
    """The tokens of one server.

    token: of the settings; None: none.   asks: whether a token is asked for. It is from the first
    stored one on, also where that is revoked: who could come in without one shall not come back.
    """

    def __init__(self, token: str | None, clock: Clock = time.time) -> None:
        self._clock = clock
        self.asks = token is not None
        self.local = Admission(Person(LOCAL, "admin"))
        self.server = Admission(Person(SERVER, "admin"))
        self._own = {} if token is None else {digest_of(token): self.server}
        self._stored: dict[str, tuple[str, Admission]] = {}
        self._used: dict[str, str] = {}
        self._noted: dict[str, float] = {}
        self._store: Store | None = None
        self._turn = asyncio.Lock()

    def find(self, token: str) -> Admission | None:
        """Whom a token lets in; None for a wrong one, or one that is over."""
        return self.of_digest(digest_of(token))

    def of_digest(self, digest: str) -> Admission | None:
        """Whom the token of a digest lets in."""
        if digest in self._own:
            return self._own[digest]
        token_id, admission = self._stored.get(digest, ("", None))
        if admission is None or admission.is_over:
            return None
        self._used[token_id] = now()
        return admission

    @asynccontextmanager
    async def open(self, store: Store) -> AsyncIterator[None]:
        """Keep up with the tokens of a store; where they cannot be read, they let nobody in."""
        self._store, self._turn = store, asyncio.Lock()
        try:
            await self.refresh()
        except StoreError as error:
            self._ask()
            LOG.error("the tokens cannot be read, the server asks for one: %s", error)
        keeping = asyncio.create_task(self._keep_up())
        try:
            yield
        finally:
            keeping.cancel()
            await asyncio.wait((keeping,))

    async def refresh(self) -> None:
        """Take what is stored now. StoreError."""
        assert self._store is not None
        async with self._turn:  # an older look must not undo a newer one
            self._take(await asyncio.to_thread(self._store.tokens.known))

    def _take(self, known: Mapping[str, StoredToken]) -> None:
        if known:
            self._ask()
        for digest, token in known.items():
            if digest not in self._stored:
                self._stored[digest] = token.id, self._admission(token)
        for digest, (_, admission) in [*self._stored.items()]:
            token = known.get(digest)
            if token is None or token.revoked is not None:
                admission.over.set()
            if token is None:
                del self._stored[digest]

    async def _keep_up(self) -> None:
        """Look at what is stored until cancelled, and store when tokens were used."""
        is_well = True
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            try:
                await self.refresh()
                await self._note_used()
                is_well = True
            except StoreError as error:
                if is_well:
                    LOG.warning("tokens and their last use are not up to date: %s", error)
                is_well = False

    async def _note_used(self) -> None:
        """Store when tokens were used, of each once in a while. StoreError."""
        assert self._store is not None
        tick = time.monotonic()
        due = {
            token_id: used
            for token_id, used in self._used.items()
            if tick - self._noted.get(token_id, -math.inf) >= NOTED_EVERY_S
        }
        if due:
            await asyncio.to_thread(self._store.tokens.note_used, due)
        for token_id, used in due.items():
            self._noted[token_id] = tick
            if self._used[token_id] == used:
                del self._used[token_id]

    def _ask(self) -> None:
        if not self.asks:
            self.asks = True
            self.local.over.set()

    def _admission(self, token: StoredToken) -> Admission:
        ends = token.expires
        expires = math.inf if ends is None else datetime.fromisoformat(ends).timestamp()
        return Admission(Person(token.name, token.role), expires, self._clock)
