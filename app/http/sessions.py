"""Who is let in by the server's token: sessions that end, links for one use, guesses that wait."""

import asyncio
import hashlib
import hmac
import logging
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from ipaddress import IPv6Address, ip_address, ip_network

LOG = logging.getLogger("forewarn")
LINK_SECONDS = 600.0
"""A link that lets in once does so for so long."""
FREE_GUESSES = 5
"""Wrong tokens of one address before the next one has to wait."""
LONGEST_WAIT = 60.0
FORGOTTEN_AFTER = 900.0
"""[s] An address that gave nothing wrong for so long begins anew."""
LOGGED_AGAIN_AFTER = 60.0
"""[s] The same wrong token again, or one that comes too soon, is logged so often at most."""
MOST_ADDRESSES, MOST_SESSIONS = 1000, 1000

Clock = Callable[[], float]


@dataclass(eq=False)
class Guesses:
    """Wrong tokens from an address. given: digests of the last ones, as many as are counted.

    logged: when one was [s].
    """

    count: int = 0
    last: float = -math.inf
    logged: float = -math.inf
    given: OrderedDict[bytes, None] = field(default_factory=OrderedDict)

    @property
    def wait(self) -> float:
        """From the last guess to when the next one is looked at [s]."""
        return (
            0.0
            if self.count < FREE_GUESSES
            else min(2.0 ** min(self.count - FREE_GUESSES, 10), LONGEST_WAIT)
        )


@dataclass(eq=False)
class Session:
    """One that is open. ends: when, by the clock [s].   over: set where it ends before."""

    ends: float
    over: asyncio.Event = field(default_factory=asyncio.Event)


class Sessions:
    """The sessions of one server, held in memory: a restart ends them.

    A session ends `seconds` after it was last used. The same wrong token given again is no other
    guess: a program that was set up wrongly keeps nobody out who shares its address.
    """

    def __init__(self, token: str, seconds: float, clock: Clock = time.monotonic) -> None:
        self._token = token
        self._seconds = seconds
        self._clock = clock
        self._open: OrderedDict[bytes, Session] = OrderedDict()
        self._links: dict[bytes, float] = {}
        self._guesses: OrderedDict[str, Guesses] = OrderedDict()

    def begin(self) -> str:
        """Begin a session; returns what its cookie holds."""
        key = secrets.token_urlsafe(32)
        self._open[_digest(key)] = Session(self._clock() + self._seconds)
        while len(self._open) > MOST_SESSIONS:
            self._open.popitem(last=False)[1].over.set()
        return key

    def is_open(self, key: str) -> bool:
        """Whether a session is open; it then goes on from now."""
        digest, now = _digest(key), self._clock()
        session = self._open.pop(digest, None)
        if session is None or now >= session.ends:
            return False
        session.ends = now + self._seconds
        self._open[digest] = session
        return True

    def end(self, key: str) -> None:
        """End a session, if it is one."""
        if (session := self._open.pop(_digest(key), None)) is not None:
            session.over.set()

    async def wait_for_end(self, key: str) -> None:
        """Return once a session is not open any more; this is no use of it."""
        session = self._open.get(_digest(key))
        if session is None:
            return
        while not session.over.is_set() and (left := session.ends - self._clock()) > 0:
            with suppress(TimeoutError):
                await asyncio.wait_for(session.over.wait(), left)

    def make_link(self) -> str:
        """Return a code that begins a session once, within LINK_SECONDS."""
        code = secrets.token_urlsafe(32)
        self._links[_digest(code)] = self._clock() + LINK_SECONDS
        return code

    def use_link(self, code: str) -> bool:
        """Whether a code lets in, now and never again."""
        return self._clock() < self._links.pop(_digest(code), -math.inf)

    def wait_of(self, address: str) -> float:
        """How long an address must wait until a token of it is looked at [s]."""
        guesses = self._guesses.get(_network(address), Guesses())
        return max(0.0, guesses.last + guesses.wait - self._clock())

    def is_token(self, given: str, address: str) -> bool:
        """Whether this is the token; a wrong one is logged and slows its address down."""
        network = _network(address)
        if hmac.compare_digest(given.encode(), self._token.encode()):
            self._guesses.pop(network, None)
            return True
        self._remember(network, _digest(given), address)
        return False

    def turn_away(self, address: str) -> None:
        """Log that a token of this address is not looked at: it must wait."""
        self._log(self._guesses.setdefault(_network(address), Guesses()), address)

    def _log(self, guesses: Guesses, address: str, *, is_new: bool = False) -> None:
        """Log a login that was refused, by its address and never with what it gave."""
        now = self._clock()
        if is_new or now - guesses.logged >= LOGGED_AGAIN_AFTER:
            guesses.logged = now
            text = "%s was refused a login: wrong token, number %d of late"
            LOG.warning(text, address or "an unknown address", guesses.count)

    def _remember(self, network: str, digest: bytes, address: str) -> None:
        guesses, now = self._guesses.pop(network, Guesses()), self._clock()
        if now - guesses.last > FORGOTTEN_AFTER:
            guesses = Guesses()
        if is_new := digest not in guesses.given:
            guesses.count, guesses.last = guesses.count + 1, now
            guesses.given[digest] = None
        self._log(guesses, address, is_new=is_new)
        while len(guesses.given) > FREE_GUESSES:
            guesses.given.popitem(last=False)
        self._guesses[network] = guesses
        while len(self._guesses) > MOST_ADDRESSES:
            self._guesses.popitem(last=False)


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest()


def _network(address: str) -> str:
    """The address, or the network that one customer has of IPv6."""
    try:
        parsed = ip_address(address)
    except ValueError:
        return address
    is_wide = isinstance(parsed, IPv6Address) and parsed.ipv4_mapped is None
    return str(ip_network((address, 64), strict=False)) if is_wide else address
