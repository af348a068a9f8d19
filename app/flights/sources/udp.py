"""Batches by UDP, one per datagram, as plotting tools and simple range scripts send them."""

import asyncio
import logging
import socket
from collections.abc import Callable

LOG = logging.getLogger("forewarn")
LARGEST = 65_535
AT_ONCE = 64
"""Datagrams that are read before other work gets its turn."""
SILENT_S = 1.0
"""[s] After this silence of the sender another address may take over."""
RECEIVE_BUFFER = 4 * 2**20


class UdpReceiver:
    """Receives datagrams of one sender: the first that sends a batch, until it falls silent.

    on_datagram: called with each datagram and its sender; returns whether it was a batch.
    n_foreign: datagrams from unknown senders.   OSError if the port is not available.
    """

    def __init__(self, host: str, port: int, on_datagram: Callable[[bytes, str], bool]) -> None:
        self._on_datagram, self._sender, self._last_heard = on_datagram, None, 0.0
        self.n_foreign = 0
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            self._socket.bind((host, port))
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
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _receive(self) -> None:
        for _ in range(AT_ONCE):
            try:
                content, sender = self._socket.recvfrom(LARGEST)
            except BlockingIOError:
                return
            except OSError as error:
                LOG.warning("UDP at %s: %s", self.address, error)
                return
            now = self._loop.time()
            is_other = self._sender not in (None, sender)
            if is_other and now - self._last_heard < SILENT_S:
                self.n_foreign += 1
            elif self._on_datagram(content, _address(*sender[:2])):
                self._sender, self._last_heard = sender, now


def _address(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
