"""Batches by UDP, one a line, as plotting tools and simple range scripts send them."""

import asyncio
import logging
import socket
from collections.abc import Callable
from hmac import compare_digest
from ipaddress import ip_address, ip_network
from typing import NamedTuple

import msgspec

LOG = logging.getLogger("forewarn")
LARGEST = 65_535
AT_ONCE = 64
"""Datagrams that are read before other work gets its turn."""
RECEIVE_BUFFER = 4 * 2**20
KEY = "key"
"""Member of a batch that holds the key; it is not journalled."""


class UdpAccess(NamedTuple):
    """Who may send datagrams to the flights of a server.

    host: address to listen on.   senders: addresses or networks; any if empty.   key: that every
    batch must hold; none if empty.   is_shared: whether the settings have a token.
    """

    host: str = "127.0.0.1"
    senders: tuple[str, ...] = ()
    key: str = ""
    is_shared: bool = False

    @property
    def is_guarded(self) -> bool:
        return bool(self.senders or self.key)

    def admits(self, host: str) -> bool:
        address = ip_address(host.partition("%")[0])
        mapped = getattr(address, "ipv4_mapped", None) or address
        return not self.senders or any(mapped in ip_network(net, False) for net in self.senders)

    def lines(self, content: bytes) -> list[bytes]:
        """The batches of a datagram without their key; those with a wrong key are left out."""
        lines = content.splitlines()
        return [text for line in lines if (text := self._keyless(line))] if self.key else lines

    def _keyless(self, line: bytes) -> bytes | None:
        try:
            plain = msgspec.json.decode(line)
            given = plain.pop(KEY, "")
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, AttributeError, TypeError):
            return None
        is_right = isinstance(given, str) and compare_digest(given.encode(), self.key.encode())
        return msgspec.json.encode(plain) if is_right else None


class UdpReceiver:
    """Receives the datagrams of one sender: the first one, until a person changes it.

    on_datagram: called with the batches of a datagram and its sender; returns whether any was one.
    sender: the address of the source; None before the first.   other: newest one that was refused.
    n_foreign: datagrams from other senders, or without the key.   OSError if the port is not
    available.
    """

    def __init__(
        self,
        access: UdpAccess,
        port: int,
        on_datagram: Callable[[list[bytes], str], bool],
        sender: str | None = None,
    ) -> None:
        self._access, self._on_datagram, self.sender = access, on_datagram, sender
        self.n_foreign = 0
        self.other: str | None = None
        family = socket.AF_INET6 if ":" in access.host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            self._socket.bind((access.host, port))
            self._bound = self._socket.getsockname()[:2]
            self._socket.setblocking(False)
            self._loop = asyncio.get_running_loop()
            self._loop.add_reader(self._socket, self._receive)
        except BaseException:
            self._socket.close()
            raise

    @property
    def address(self) -> str:
        """host:port on which it listens, or listened until it was closed."""
        return _address(*self._bound)

    @property
    def port(self) -> int:
        return self._bound[1]

    def close(self) -> None:
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket)
        self._socket.close()

    def _receive(self) -> None:
        for _ in range(AT_ONCE):
            try:
                content, (host, port, *_) = self._socket.recvfrom(LARGEST)
            except BlockingIOError:
                return
            except OSError as error:
                LOG.warning("UDP at %s: %s", self.address, error)
                return
            sender = _address(host, port)
            lines = self._access.lines(content) if self._access.admits(host) else []
            if not lines:
                self.n_foreign += 1
            elif self.sender not in (None, sender):
                self.n_foreign, self.other = self.n_foreign + 1, sender
            elif self._on_datagram(lines, sender):
                self.sender = sender


def _address(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
