"""Wrong tokens: counted by the address that they came from, which they slow down.

Only wrong ones: a right token is let in whatever came before it from its address.
"""

import hashlib
import logging
import math
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from ipaddress import IPv6Address, ip_address, ip_network

LOG = logging.getLogger("forewarn")
FREE_GUESSES = 5
"""Wrong tokens of one address before the next one has to wait."""
LONGEST_WAIT = 60.0
FORGOTTEN_AFTER = 900.0
"""[s] An address that gave nothing wrong for so long begins anew."""
LOGGED_AGAIN_AFTER = 60.0
"""[s] The same wrong token again, or one that comes too soon, is logged so often at most."""
MOST_ADDRESSES = 1000

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


class WrongTokens:
    """Wrong tokens of late. The same one given again is no other guess.

    A program that was set up wrongly keeps nobody waiting who shares its address.
    """

    def __init__(self, clock: Clock = time.monotonic) -> None:
        self._clock = clock
        self._guesses: OrderedDict[str, Guesses] = OrderedDict()

    def wait_of(self, address: str) -> float:
        """How long an address must wait until another wrong token is counted [s]."""
        guesses = self._guesses.get(_network(address), Guesses())
        return max(0.0, guesses.last + guesses.wait - self._clock())

    def forget(self, address: str) -> None:
        """Begin anew with an address: a right token came from it."""
        if self._guesses:
            self._guesses.pop(_network(address), None)

    def note(self, given: str, address: str) -> float:
        """Note a wrong token. Returns how long its address still had to wait [s], 0 as a rule.

        A new one slows the address down; one that came too soon is only logged.
        """
        if wait := self.wait_of(address):
            self._log(self._guesses.setdefault(_network(address), Guesses()), address)
        else:
            self._remember(_network(address), _digest(given), address)
        return wait

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
