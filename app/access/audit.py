"""The audit log: entries are noted with the answer and stored a moment later.

No request waits for the store. Entries that it refuses wait in memory, up to MOST_WAITING.
"""

import asyncio
import logging
from collections import OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from itertools import islice

from starlette.requests import HTTPConnection

from app.access.people import Person, regularly
from app.access.roles import CHANGES_NOTHING, LOGGED_ONCE, WEBSOCKET, rule_of
from app.store.people import AuditEntry
from app.store.store import Store, StoreError
from app.store.tables import now

LOG = logging.getLogger("forewarn")
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
MOST_WAITING = 10_000
MOST_AT_ONCE = 500
MOST_REMEMBERED = 10_000
"""Pairs of person and flight whose first push is logged."""
STORE_EVERY_S = 0.5


class Audit:
    """Entries that wait for the store."""

    def __init__(self) -> None:
        self._waiting: deque[AuditEntry] = deque()
        self._lock = asyncio.Lock()
        self._pushed: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._n_lost = 0

    @asynccontextmanager
    async def open(self, store: Store) -> AsyncIterator[None]:
        """Store entries while open, and at the end those that still wait."""
        self._lock = asyncio.Lock()
        work = regularly(partial(self.flush, store), STORE_EVERY_S, "audit entries wait: %s")
        storing = asyncio.create_task(work)
        try:
            yield
        finally:
            async with self._lock:  # not in the middle of a flush
                storing.cancel()
            try:
                await self.flush(store)
            except StoreError as error:
                LOG.error("%d audit entries lost: %s", len(self._waiting), error)

    def note_answer(self, connection: HTTPConnection, person: Person, status: int) -> None:
        """Log the answer to a change, unless it was refused (4xx)."""
        method, path = method_of(connection), connection.scope["path"]
        if method in SAFE_METHODS or 400 <= status < 500:
            return
        route = rule_of(method, path).route
        if route in CHANGES_NOTHING or (method == WEBSOCKET and route not in LOGGED_ONCE):
            return
        if route in LOGGED_ONCE and not self._is_first(person.name, path):
            return
        self.note(connection, person, status)

    def note(self, connection: HTTPConnection, person: Person, status: int) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self._n_lost += 1
            return
        address = connection.client.host if connection.client else ""
        method, path = method_of(connection), connection.scope["path"]
        entry = AuditEntry(now(), person.name, person.role, address, method, path, status)
        self._waiting.append(entry)

    def _is_first(self, name: str, path: str) -> bool:
        is_first = (name, path) not in self._pushed
        self._pushed[name, path] = None
        self._pushed.move_to_end((name, path))
        while len(self._pushed) > MOST_REMEMBERED:
            self._pushed.popitem(last=False)
        return is_first

    async def flush(self, store: Store) -> None:
        """Store the waiting entries. StoreError: the rest keeps waiting."""
        async with self._lock:
            while entries := [*islice(self._waiting, MOST_AT_ONCE)]:
                await asyncio.to_thread(store.audit.add, entries)
                for _ in entries:
                    self._waiting.popleft()
        if self._n_lost:
            LOG.error("%d audit entries lost: too many waited for the store", self._n_lost)
            self._n_lost = 0


def method_of(connection: HTTPConnection) -> str:
    return WEBSOCKET if connection.scope["type"] == "websocket" else connection.scope["method"]
