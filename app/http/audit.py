"""The audit log as it is written: noted at the answer, stored a moment later.

No request waits for it. What cannot be stored waits in memory, so much of it, and is tried again.
"""

import asyncio
import logging
from collections import OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import islice

from starlette.requests import HTTPConnection

from app.http.people import Person
from app.http.roles import CHANGES_NOTHING, LOGGED_ONCE, WEBSOCKET, rule_of
from app.store.audit import AuditEntry
from app.store.store import Store, StoreError
from app.store.tables import now

LOG = logging.getLogger("forewarn")
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
MOST_WAITING = 10_000
MOST_AT_ONCE = 500
MOST_REMEMBERED = 10_000
"""Persons and flights of which the first push is known."""
AGAIN_AFTER_S = 1.0


class Audit:
    """What is to be logged."""

    def __init__(self) -> None:
        self._waiting: deque[AuditEntry] = deque()
        self._some, self._turn = asyncio.Event(), asyncio.Lock()
        self._closing = False
        self._pushed: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._n_lost = 0

    @asynccontextmanager
    async def open(self, store: Store) -> AsyncIterator[None]:
        """Store what is noted meanwhile; in the end all that waits."""
        self._some, self._turn, self._closing = asyncio.Event(), asyncio.Lock(), False
        keeping = asyncio.create_task(self._keep(store))
        try:
            yield
        finally:
            self._closing = True
            self._some.set()
            await keeping

    def note_answer(self, connection: HTTPConnection, person: Person, status: int) -> None:
        """Log what was answered, where it is a change and was not refused."""
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
        """Log a request and what it was answered with."""
        if len(self._waiting) >= MOST_WAITING:
            self._n_lost += 1
            return
        address = connection.client.host if connection.client else ""
        method, path = method_of(connection), connection.scope["path"]
        entry = AuditEntry(now(), person.name, person.role, address, method, path, status)
        self._waiting.append(entry)
        self._some.set()

    def _is_first(self, name: str, path: str) -> bool:
        is_first = (name, path) not in self._pushed
        self._pushed[name, path] = None
        self._pushed.move_to_end((name, path))
        while len(self._pushed) > MOST_REMEMBERED:
            self._pushed.popitem(last=False)
        return is_first

    async def _keep(self, store: Store) -> None:
        is_well = True
        while not self._closing or self._waiting:
            await self._some.wait()
            try:
                await self.flush(store)
                is_well = True
            except StoreError as error:
                if self._closing:
                    LOG.error("the audit log lacks %d entries: %s", len(self._waiting), error)
                    return
                if is_well:
                    LOG.warning("the audit log waits for the store: %s", error)
                is_well = False
                await asyncio.sleep(AGAIN_AFTER_S)

    async def flush(self, store: Store) -> None:
        """Store all that waits. StoreError: what is not stored goes on waiting."""
        async with self._turn:
            while self._waiting:
                entries = [*islice(self._waiting, MOST_AT_ONCE)]
                await asyncio.to_thread(store.audit.add, entries)
                for _ in entries:
                    self._waiting.popleft()
            if not self._closing:
                self._some.clear()
        if self._n_lost:
            LOG.error("the audit log lacks %d entries: the store took none", self._n_lost)
            self._n_lost = 0


def method_of(connection: HTTPConnection) -> str:
    """Method of a request; WEBSOCKET for one."""
    return WEBSOCKET if connection.scope["type"] == "websocket" else connection.scope["method"]
