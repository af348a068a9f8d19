"""A live source in a few lines, for programs of the range.

    with LiveClient("http://127.0.0.1:8000", token) as client:
        client.start(monitor)
        client.send(t=0.02, beta=0.001, p=0.0, r=0.0, Ny=0.0, delta_a=0.0, delta_r=0.01)

Every sample stays in memory until the server confirms that it is durable. After a broken connection
or a killed server, unacknowledged batches are sent again under the same numbers: nothing is lost
and nothing counts twice. Leaving the context ends the flight.
"""

import asyncio
import random
import secrets
import ssl
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from types import TracebackType
from typing import Any, Literal, Self

import httpx2
import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from app.client.flight_stream import FlightStream
from app.client.outbox import OnSettled, Outbox, OutgoingBatch, PushFailed

FIRST_WAIT_S, LONGEST_WAIT_S = 0.1, 5.0
"""Between two connection attempts."""
REQUEST_S, PING_S = 15.0, 5.0
START_S = 180.0
"""Longest start of a flight: the server's first one compiles kernels."""
PATIENCE_S = 60.0
"""Longest wait for acknowledgements when leaving, since the last one."""
REPEATED_S = 10.0
"""A request whose connection breaks is repeated for so long [s]."""
WRONG = frozenset({400, 401, 403, 404, 409, 410})
"""Answers after which a repetition is useless."""
UNREADABLE = frozenset({413, 422})
"""Answers to an invalid batch: it is dropped and counted."""


class LiveClient:
    """Pushes samples into one live flight, in the background. PushFailed.

    url: of the server.   token: of an operator, if the server needs one.
    patience: longest wait for acknowledgements when leaving, since the last one [s].
    keep_open: leave the flight in progress. Otherwise leaving the client's context ends the flight
    that it started or pushed into, once every sample is durable; an error never ends a flight.
    on_settled: called in another thread, see OnSettled.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8000",
        token: str | None = None,
        *,
        patience: float = PATIENCE_S,
        keep_open: bool = False,
        on_settled: OnSettled | None = None,
    ) -> None:
        self.keep_open, self._has_started = keep_open, False
        self.url, self.patience = url.rstrip("/"), patience
        self.flight = ""
        self.problem = ""
        """Why nothing is being acknowledged; empty if it is."""
        self.broken = 0
        """Connections that broke."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._options: dict[str, Any] = {"headers": headers, "timeout": REQUEST_S}
        self._options |= {"trust_env": False, "base_url": f"{self.url}/api/v1"}
        if self.url.startswith("https:"):  # the system's authorities, as for WebSockets
            self._options["verify"] = ssl.create_default_context()
        self._headers, self._samples = headers, Outbox(on_settled)
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closing = False
        self._work_available, self._stop = asyncio.Event(), asyncio.Event()

    # --- the flight ---------------------------------------------------------------------------

    def start(
        self,
        monitor: str | None = None,
        *,
        monitor_set: str | None = None,
        condition: Mapping[str, float | str] | None = None,
        name: str | None = None,
        **source: Any,
    ) -> str:
        """Start a live flight with a monitor or a monitor set, given by id. Returns its own id.

        condition: of a flight on a set: declared values in SI units, or names that samples have.
        source: further fields of the source: recording, delay, trim, udp.
        """
        source = {"kind": "live"} | {key: x for key, x in source.items() if x is not None}
        given = {"monitor": monitor, "monitor_set": monitor_set, "name": name}
        given |= {"condition": condition}
        body = {"source": source} | {key: x for key, x in given.items() if x}
        flight = self.join(self._ask("POST", "/flights", body, START_S)["id"])
        self._has_started = True
        return flight

    def join(self, flight: str) -> str:
        """Push into a started flight, after the batches that it has. Returns its id."""
        self.flight = flight
        self._samples.begin_after(self.status()["last_sequence"])
        return flight

    def dictionary(self, monitor: str) -> Any:
        """Dictionary of a monitor; None for the lateral one."""
        return self._ask("GET", f"/monitors/{monitor}")["dictionary"]

    def monitor_set(self, set_id: str) -> dict[str, Any]:
        return self._ask("GET", f"/monitor-sets/{set_id}")

    def flight_status(self, flight: str) -> dict[str, Any]:
        return self._ask("GET", f"/flights/{flight}")

    def in_progress(self) -> list[dict[str, Any]]:
        """The flights in progress."""
        return self._ask("GET", "/flights?progress=running")

    def alarms(self) -> list[dict[str, Any]]:
        """All alarms of the flight, in the order raised."""
        return self._ask("GET", f"/flights/{self.flight}/alarms")

    def stream(self) -> FlightStream:
        """Messages of the server about the flight."""
        return FlightStream(self.url, self._headers, self.flight)

    def status(self) -> dict[str, Any]:
        """State of the source on the server: last_sequence, names, counts by kind, ..."""
        return self._ask("GET", f"/flights/{self.flight}/samples")

    def end(self) -> None:
        """End the flight once every sample is durable."""
        self.flush()
        self._ask("POST", f"/flights/{self.flight}/end")

    @property
    def address(self) -> str:
        return f"{self.url}/#/fly/{self.flight}"

    # --- samples ------------------------------------------------------------------------------

    def send(self, sample: Mapping[str, float | None] | None = None, /, **values: Any) -> None:
        """Push a sample: a number or None by name, in the units of the flight's mapping.

        Returns at once, unless MOST_WAITING samples are not durable yet.
        """
        self._ensure_thread()
        named = {**(sample or {}), **values}
        self._samples.put({k: None if x is None else float(x) for k, x in named.items()})
        self._wake()

    def send_batch(self, values: dict[str, Any]) -> int:
        """Push samples as one batch, which the server accepts or refuses as a whole.

        values: a number, None or a list of them by name. Returns the number of the batch, at once.
        PushFailed; ValueError if it is too large.
        """
        self._ensure_thread()
        sequence = self._samples.put_batch(values)
        self._wake()
        return sequence

    def _ensure_thread(self) -> None:
        if self._thread is None:
            if not self.flight:
                raise PushFailed("no flight yet: call start or join before send")
            self._thread = threading.Thread(target=self._work, name="live client", daemon=True)
            self._thread.start()

    @property
    def is_full(self) -> bool:
        """Whether MOST_WAITING samples are not durable yet."""
        return self._samples.is_full

    @property
    def failure(self) -> str:
        """Why no more samples can be pushed; empty if they can."""
        return self._samples.failure

    @property
    def sent(self) -> int:
        """Number of samples given to `send` or `send_batch`."""
        return self._samples.n_put

    @property
    def durable(self) -> int:
        """Number of samples on the server's disk."""
        return self._samples.n_durable

    @property
    def refused(self) -> int:
        """Number of samples that the server refused, see `refusal`."""
        return self._samples.n_refused

    @property
    def refusal(self) -> str:
        """Why the last refused sample was refused."""
        return self._samples.refusal

    def flush(self, patience: float | None = None) -> bool:
        """Wait until every sample is durable. False if none was acknowledged for `patience` [s]."""
        return self._samples.wait(self.patience if patience is None else patience)

    def close(self) -> None:
        self._closing = True
        if self._thread is not None:
            self._call("_stop")
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None and not self.flush():
                n, of = self.sent - self.durable, self.sent
                why = self.problem or self.refusal
                raise PushFailed(f"{n} of {of} samples are not confirmed as durable: {why}")
            if kind is None and not self.keep_open and (self._has_started or self.sent):
                self.end()
        finally:
            self.close()

    # --- in the background --------------------------------------------------------------------

    def _wake(self) -> None:
        self._call("_work_available")

    def _call(self, event: Literal["_work_available", "_stop"]) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(getattr(self, event).set)

    def _work(self) -> None:
        try:
            asyncio.run(self._until_closed())
        except Exception as error:
            self._samples.fail(str(error) or repr(error))

    async def _until_closed(self) -> None:
        self._work_available, self._stop = asyncio.Event(), asyncio.Event()
        self._loop = asyncio.get_running_loop()
        pushing = asyncio.create_task(self._keep_pushing())
        stopping = asyncio.create_task(self._stop.wait())
        if not self._closing:
            await asyncio.wait((pushing, stopping), return_when=asyncio.FIRST_COMPLETED)
        for task in (pushing, stopping):
            task.cancel()
        for outcome in await asyncio.gather(pushing, stopping, return_exceptions=True):
            if isinstance(outcome, Exception):
                raise outcome

    async def _keep_pushing(self) -> None:
        """Push; after each fault reconnect, with longer waits until something is durable."""
        wait = FIRST_WAIT_S
        while True:
            n_durable = self._samples.n_durable
            try:
                await self._by_websocket()
            except PushFailed:
                raise
            except (OSError, WebSocketException, httpx2.HTTPError, _Retry) as error:
                self.problem = str(error) or repr(error)
            self._samples.rewind()
            if self._samples.n_durable > n_durable:
                wait = FIRST_WAIT_S
            self.broken += 1
            await asyncio.sleep(wait * random.uniform(0.5, 1.0))
            wait = min(2.0 * wait, LONGEST_WAIT_S)

    async def _next(self) -> OutgoingBatch:
        while (batch := self._samples.take()) is None:
            self._work_available.clear()
            await self._work_available.wait()
        return batch

    async def _by_websocket(self) -> None:
        address = f"ws{self.url.removeprefix('http')}/api/v1/flights/{self.flight}/uplink"
        about: dict[str, Any] = {"additional_headers": self._headers, "compression": None}
        about |= {"ping_interval": PING_S, "ping_timeout": PING_S, "close_timeout": 1.0}
        try:
            async with connect(address, proxy=None, **about) as socket:
                await self._talk(socket)
            reason = "the server closed the uplink"
        except ConnectionClosed as error:
            reason = str(error)
        except InvalidStatus as error:
            reason = f"the uplink was answered by {error.response.status_code}"
            is_refused = error.response.status_code in WRONG
            await asyncio.to_thread(self.status)
            if is_refused:
                raise PushFailed(f"{reason}: use an operator's token") from None
        await asyncio.to_thread(self.status)
        raise _Retry(reason)

    async def _talk(self, socket: ClientConnection) -> None:
        sending = asyncio.create_task(self._send_all(socket))
        try:
            async for text in socket:
                message = msgspec.json.decode(text)
                if message["type"] == "stored":
                    for sequence in message["sequences"]:
                        self._note(sequence, 200, "")
                elif message["type"] == "refused":
                    self._note(message["sequence"], message["status"], message["reason"])
        finally:
            sending.cancel()

    async def _send_all(self, socket: ClientConnection) -> None:
        with suppress(WebSocketException):  # the receiving side reports it
            while True:
                await socket.send((await self._next()).text, text=True)

    def _note(self, sequence: int | None, status: int, reason: str) -> None:
        """Handle the server's answer to a batch. PushFailed; _Retry."""
        if status == 200:
            self.problem = ""
            self._samples.acknowledge(sequence)
        elif status in UNREADABLE and sequence is not None:
            self._samples.refuse(sequence, reason)
        elif status in WRONG | UNREADABLE:
            raise PushFailed(reason)
        else:
            raise _Retry(reason)

    def _ask(self, method: str, path: str, body: Any = None, within_s: float = REQUEST_S) -> Any:
        """The answer to a request. PushFailed; OSError if the server does not answer.

        A request whose connection breaks is repeated: another server may take over.
        """
        end, key = time.monotonic() + REPEATED_S, {"Idempotency-Key": secrets.token_hex(16)}
        while True:
            try:
                with httpx2.Client(**self._options) as http:
                    headers = key if method == "POST" and body is not None else None
                    answer = http.request(
                        method, path, json=body, timeout=within_s, headers=headers
                    )
                break
            except httpx2.HTTPError as error:
                is_broken = isinstance(error, httpx2.RemoteProtocolError | httpx2.ReadError)
                if not is_broken or time.monotonic() > end:
                    advice = "is the server running?"
                    if "CERTIFICATE_VERIFY" in str(error):
                        advice = "give its authority's certificate by SSL_CERT_FILE=FILE.pem"
                    raise ConnectionError(
                        f"{self.url} does not answer ({error}): {advice}"
                    ) from error
            time.sleep(FIRST_WAIT_S)
        if answer.status_code in WRONG | UNREADABLE:
            raise PushFailed(_detail(answer))
        if not answer.is_success:
            raise ConnectionError(_detail(answer))
        return answer.json()


class _Retry(Exception):
    """A batch must be sent again."""


def _detail(answer: httpx2.Response) -> str:
    """The detail of a problem document, or the status of another answer."""
    with suppress(ValueError, KeyError, TypeError):
        return f"{answer.json()['detail']} ({answer.status_code})"
    return f"the server answered {answer.status_code}"
