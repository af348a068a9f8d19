"""Logins of browsers: sessions that end, and links for one use."""

import asyncio
import hashlib
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from app.http.people import Admission
from app.store.tokens import LINK_SECONDS

MOST_SESSIONS = 1000

Clock = Callable[[], float]


@dataclass(eq=False)
class Session:
    """One that is open. ends: when, by the clock [s].   over: set where it ends before."""

    admission: Admission
    ends: float
    over: asyncio.Event = field(default_factory=asyncio.Event)


class Sessions:
    """The sessions of one server, held in memory: a restart ends them.

    A session ends `seconds` after it was last used, and with the token that began it.
    """

    def __init__(self, seconds: float, clock: Clock = time.monotonic) -> None:
        self._seconds = seconds
        self._clock = clock
        self._open: OrderedDict[bytes, Session] = OrderedDict()
        self._links: dict[bytes, float] = {}

    def begin(self, admission: Admission) -> str:
        """Begin a session; returns what its cookie holds."""
        key = secrets.token_urlsafe(32)
        self._open[_digest(key)] = Session(admission, self._clock() + self._seconds)
        while len(self._open) > MOST_SESSIONS:
            self._open.popitem(last=False)[1].over.set()
        return key

    def use(self, key: str) -> Admission | None:
        """Who is let in by an open session, which then goes on from now; None where it is none."""
        digest, now = _digest(key), self._clock()
        session = self._open.pop(digest, None)
        if session is None or now >= session.ends or session.admission.is_over:
            return None
        session.ends = now + self._seconds
        self._open[digest] = session
        return session.admission

    def end(self, key: str) -> Admission | None:
        """End a session, if it is one; returns whose it was."""
        if (session := self._open.pop(_digest(key), None)) is None:
            return None
        session.over.set()
        return session.admission

    async def wait_for_end(self, key: str) -> None:
        """Return once a session is not open any more; this is no use of it."""
        session = self._open.get(_digest(key))
        if session is None:
            return
        while not session.over.is_set() and (left := session.ends - self._clock()) > 0:
            with suppress(TimeoutError):
                await asyncio.wait_for(session.over.wait(), left)

    def make_link(self) -> str:
        """Return a code that logs in once with the settings' token, within LINK_SECONDS."""
        code = secrets.token_urlsafe(32)
        self._links[_digest(code)] = self._clock() + LINK_SECONDS
        return code

    def use_link(self, code: str) -> bool:
        """Whether a code lets in, now and never again."""
        return self._clock() < self._links.pop(_digest(code), -math.inf)


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest()
