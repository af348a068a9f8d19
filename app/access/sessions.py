"""Browser logins: sessions that expire, and one-time links."""

import hashlib
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from app.access.people import Admission
from app.store.people import LINK_SECONDS

MOST_SESSIONS = 1000

Clock = Callable[[], float]


@dataclass
class Session:
    """An open session. ends: [s] by the clock."""

    admission: Admission
    ends: float


class Sessions:
    """Sessions of one server, in memory: a restart ends them.

    A session ends `seconds` after its last use, or when its token ends.
    """

    def __init__(self, seconds: float, clock: Clock = time.monotonic) -> None:
        self._seconds = seconds
        self._clock = clock
        self._open: OrderedDict[bytes, Session] = OrderedDict()
        self._links: dict[bytes, float] = {}

    def start(self, admission: Admission) -> str:
        """Start a session. Returns the key for its cookie."""
        key = secrets.token_urlsafe(32)
        self._open[_digest(key)] = Session(admission, self._clock() + self._seconds)
        while len(self._open) > MOST_SESSIONS:
            self._open.popitem(last=False)
        return key

    def use(self, key: str) -> Admission | None:
        """The admission of an open session, whose time starts again; None without a session."""
        digest, now = _digest(key), self._clock()
        session = self._open.pop(digest, None)
        if session is None or now >= session.ends or session.admission.has_ended:
            return None
        session.ends = now + self._seconds
        self._open[digest] = session
        return session.admission

    def end(self, key: str) -> Admission | None:
        """End a session, if open, and return its admission."""
        session = self._open.pop(_digest(key), None)
        return session and session.admission

    def is_open(self, key: str) -> bool:
        """Whether a session is open; this does not prolong it."""
        session = self._open.get(_digest(key))
        return session is not None and self._clock() < session.ends

    def make_link(self) -> str:
        """A code for one login with the settings' token, within LINK_SECONDS."""
        code = secrets.token_urlsafe(32)
        self._links[_digest(code)] = self._clock() + LINK_SECONDS
        return code

    def use_link(self, code: str) -> bool:
        """Whether a code is valid; it is used up."""
        return self._clock() < self._links.pop(_digest(code), -math.inf)


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest()
