"""A flight on an MQTT broker: samples in; assessments, alarms and its state out.

A message is acknowledged to the broker once the server has its samples on the disk, so the broker
repeats after a break what the server may lack; the server uses a repeated sample once. The retained
state of a flight expires, and the broker replaces it when the bridge is gone, so that an
old state never looks safe.
"""

import asyncio
import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import aclosing
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any
from uuid import uuid4

import msgspec

try:
    from paho.mqtt.client import Client, MQTTMessage, MQTTMessageInfo
    from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties
    from paho.mqtt.reasoncodes import ReasonCode
    from paho.mqtt.subscribeoptions import SubscribeOptions
except ImportError as error:
    raise OSError("MQTT needs paho-mqtt: install forewarn[mqtt]") from error

from app.client.client import FIRST_WAIT_S, LONGEST_WAIT_S, LiveClient
from app.client.mqtt_messages import Unacknowledged, read_batch
from app.client.outbox import PushFailed

KEEPALIVE_S = 5
"""The broker takes a bridge for dead one and a half times this after its last packet."""
STATE_EXPIRES_S = 5
"""The retained state is published each second and vanishes when it is older."""
CONNECT_S, RECONNECT_S = 10.0, 1
KEPT_S = 600
"""The broker keeps samples for a stopped bridge for so long."""
MOST_UNACKNOWLEDGED = 1_000
"""Messages that the broker sends before an acknowledgement."""
EXCERPT = 200
"""Longest part of a refused message that is published with the reason [characters]."""
SHOWN = (
    "state",
    "reason",
    "cause",
    "status",
    "level",
    "beside",
    "exceeded_t",
    "exceeded_as_recorded",
    "verdict",
)
"""Of the stream's messages, in the state."""
STALE = {"state": "stale", "status": "stale", "level": "caution"}
GONE = "the command `forewarn mqtt` is gone"
WITHOUT_RETAINED = SubscribeOptions(1, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
UNSPECIFIED = 0x80
TAKEN_OVER = ReasonCode(PacketTypes.DISCONNECT, "Session taken over")


@dataclass(frozen=True)
class Broker:
    """An MQTT 5 broker and how to log in.

    tls: None for a connection without encryption.
    """

    host: str
    port: int
    user: str | None = None
    password: str | None = None
    tls: ssl.SSLContext | None = None

    def __str__(self) -> str:
        return f"{'mqtts' if self.tls else 'mqtt'}://{self.host}:{self.port}"

    def client(self, name: str) -> Client:
        """Not connected yet; knows how to log in."""
        mqtt = Client(
            CallbackAPIVersion.VERSION2, name, protocol=MQTTProtocolVersion.MQTTv5, manual_ack=True
        )
        if self.tls is not None:
            mqtt.tls_set_context(self.tls)
        if self.user is not None:
            mqtt.username_pw_set(self.user, self.password)
        return mqtt

    def connect(self, mqtt: Client, answered: threading.Event, **about: Any) -> None:
        """Connect in the background, and wait until `answered` is set. ConnectionError."""
        try:
            mqtt.connect(self.host, self.port, KEEPALIVE_S, **about)
        except (OSError, ValueError) as error:
            raise ConnectionError(
                f"{self} does not answer ({error}): {self._what_to_do(error)}"
            ) from None
        mqtt.loop_start()
        if not answered.wait(CONNECT_S):
            raise ConnectionError(
                f"{self} does not answer within {CONNECT_S:g} s: is it an MQTT 5 broker, "
                "with TLS only if the address begins with mqtts?"
            )

    def _what_to_do(self, error: Exception) -> str:
        if isinstance(error, ssl.SSLCertVerificationError):
            return "give the PEM file that certifies it by --ca"
        if self.tls is not None:
            return "is the broker running, with TLS on this port? Without TLS give mqtt://"
        return "is the broker running?"

    def refuses_login(self, reason: ReasonCode) -> str:
        return f"{self} refuses the connection ({reason}): check user and password"

    def refuses_topics(self, topic: str, reasons: list[ReasonCode]) -> str:
        """Empty if it does not."""
        refusal = next((reason for reason in reasons if reason.is_failure), None)
        return f"{self} refuses to subscribe below {topic} ({refusal})" if refusal else ""


def try_broker(broker: Broker, topic: str) -> None:
    """Log in and subscribe below `topic` once, beside any other bridge. ConnectionError."""
    mqtt, refusals = broker.client(f"forewarn-{topic}-{uuid4().hex}"), list[str]()
    answered = threading.Event()

    def on_connect(_: Any, __: Any, ___: Any, reason: ReasonCode, ____: Any) -> None:
        if reason.is_failure:
            refusals.append(broker.refuses_login(reason))
            answered.set()
        else:
            mqtt.subscribe([(f"{topic}/{name}", WITHOUT_RETAINED) for name in ("state", "samples")])

    def on_subscribe(_: Any, __: Any, ___: Any, reasons: list[ReasonCode], ____: Any) -> None:
        refusals.append(broker.refuses_topics(topic, reasons))
        answered.set()

    mqtt.on_connect, mqtt.on_subscribe = on_connect, on_subscribe
    try:
        broker.connect(mqtt, answered)
    finally:
        mqtt.disconnect()
        mqtt.loop_stop()
    if refusals[0]:
        raise ConnectionError(refusals[0])


class _State(msgspec.Struct):
    bridge: str = ""
    since: str = ""


class MqttBridge:
    """Connects the flight of `client` with topics below `topic`, until the flight is over.

    say: called with messages for a person, in any thread.
    """

    def __init__(
        self,
        broker: Broker,
        topic: str,
        server: str,
        token: str | None,
        say: Callable[[str], object],
    ) -> None:
        self.client = LiveClient(server, token, keep_open=True, on_settled=self._on_settled)
        self.broker, self.topic, self._say = broker, topic, say
        self._lock = threading.Lock()
        self._unacknowledged = Unacknowledged(lambda mid: self._mqtt.ack(mid, 1))
        self._n_unreadable, self._last_message = 0, ""
        self._id, self._since, self._is_leaving = uuid4().hex, _now(), False
        self._is_live, self._about = False, dict[str, Any]()
        self._state: dict[str, Any] = {}
        self._alarms: dict[str, dict[str, Any]] = {}
        self._answered, self._refusal = threading.Event(), ""
        self._names: list[str] = []
        self._loop: asyncio.AbstractEventLoop
        self._online: asyncio.Event
        self._ended: asyncio.Future[str]
        self._mqtt = self._paho()

    async def run(self) -> str:
        """Connect the flight that the client has joined. Returns why it is over. OSError."""
        self._loop, self._online = asyncio.get_running_loop(), asyncio.Event()
        self._ended = self._loop.create_future()
        status = await asyncio.to_thread(self.client.flight_status, self.client.flight)
        self._is_live = status["source"]["kind"] == "live"
        self._about = {"flight": status["id"], "name": status["name"]}
        last = self._gone(GONE)
        try:
            await asyncio.to_thread(self._connect)
            over = await self._until_over()
            last = self._gone(over) | {"progress": "ended"}
            return over
        except OSError as error:
            last = self._gone(str(error))
            raise
        finally:
            await asyncio.to_thread(self._leave, last)

    async def _until_over(self) -> str:
        watching = asyncio.create_task(self._watch())
        try:
            await asyncio.wait((watching, self._ended), return_when=asyncio.FIRST_COMPLETED)
            return self._ended.result() if self._ended.done() else watching.result()
        except PushFailed:  # also where a person has ended the flight
            if over := await asyncio.to_thread(self._why_over):
                return over
            raise
        finally:
            watching.cancel()

    # --- the broker ---------------------------------------------------------------------------

    def _paho(self) -> Client:
        mqtt = self.broker.client(f"forewarn-{self.topic}")
        mqtt.reconnect_delay_set(RECONNECT_S, RECONNECT_S)
        mqtt.on_connect, mqtt.on_disconnect = self._on_connect, self._on_disconnect
        mqtt.on_subscribe, mqtt.on_publish = self._on_subscribe, self._on_publish
        mqtt.on_message, mqtt.on_socket_open = self._on_message, send_at_once
        return mqtt

    def _connect(self) -> None:
        """Connect, and wait for the broker's answer. ConnectionError."""
        will = msgspec.json.encode(self._gone(GONE))
        self._mqtt.will_set(f"{self.topic}/state", will, qos=1, retain=True)
        about = Properties(PacketTypes.CONNECT)
        about.SessionExpiryInterval = KEPT_S
        about.ReceiveMaximum = MOST_UNACKNOWLEDGED
        self.broker.connect(self._mqtt, self._answered, clean_start=False, properties=about)
        if self._refusal:
            raise ConnectionError(self._refusal)

    def _leave(self, last: dict[str, Any]) -> None:
        """Publish the last state and disconnect."""
        if self._mqtt.is_connected() and not self._is_leaving:
            published = self._publish("state", last, retain=True)
            if published.rc == 0:
                published.wait_for_publish(RECONNECT_S)
        self._is_leaving = True
        self._mqtt.disconnect()
        self._mqtt.loop_stop()
        self.client.close()

    def _on_connect(self, _: Any, __: Any, ___: Any, reason: ReasonCode, ____: Any) -> None:
        if reason.is_failure:
            self._fail(self.broker.refuses_login(reason))
            return
        topics = [(f"{self.topic}/state", SubscribeOptions(0))]
        if self._is_live:
            topics.append((f"{self.topic}/samples", WITHOUT_RETAINED))
        self._mqtt.subscribe(topics)

    def _on_subscribe(
        self, _: Any, __: Any, ___: Any, reasons: list[ReasonCode], ____: Any
    ) -> None:
        if refusal := self.broker.refuses_topics(self.topic, reasons):
            self._fail(refusal)
            return
        if self._answered.is_set():
            self._say(f"connected with {self.broker} again")
        self._answered.set()
        self._loop.call_soon_threadsafe(self._online.set)

    def _on_disconnect(self, _: Any, __: Any, ___: Any, reason: ReasonCode, ____: Any) -> None:
        with self._lock:
            self._unacknowledged.disconnected()
        self._loop.call_soon_threadsafe(self._online.clear)
        if reason == TAKEN_OVER:
            self._yield()
        elif self._answered.is_set() and not self._is_leaving:
            why = "" if reason.value == UNSPECIFIED else f" ({reason})"
            self._say(f"the connection with {self.broker} broke{why}: connecting again")

    def _on_publish(self, _: Any, __: Any, ___: Any, reason: ReasonCode, ____: Any) -> None:
        if reason.is_failure:
            self._fail(f"{self.broker} refuses to publish below {self.topic} ({reason})")

    def _on_state(self, text: bytes) -> None:
        """Yield to a later bridge: not every broker reports which one it dropped."""
        try:
            other = msgspec.json.decode(text, type=_State)
        except msgspec.DecodeError:
            return
        if other.bridge not in ("", self._id) and other.since > self._since:
            self._yield()

    def _yield(self) -> None:
        """Leave the topics to another bridge."""
        self._is_leaving = True
        self._answered.set()
        text = f"another `forewarn mqtt` has taken over {self.topic}"
        self._loop.call_soon_threadsafe(self._end, text)

    def _fail(self, reason: str) -> None:
        """End the bridge, in any thread."""
        if not self._answered.is_set():
            self._refusal = reason
            self._answered.set()
        self._loop.call_soon_threadsafe(self._end, ConnectionError(reason))

    def _end(self, why: str | OSError) -> None:
        if self._ended.done():
            return
        if isinstance(why, str):
            self._ended.set_result(why)
        else:
            self._ended.set_exception(why)

    def _publish(
        self, name: str, content: Any, *, retain: bool = False, expires: int | None = None
    ) -> MQTTMessageInfo:
        about = Properties(PacketTypes.PUBLISH)
        if expires is not None:
            about.MessageExpiryInterval = expires
        text = content if isinstance(content, bytes) else msgspec.json.encode(content)
        return self._mqtt.publish(f"{self.topic}/{name}", text, 1, retain, about)

    # --- samples ------------------------------------------------------------------------------

    def _on_message(self, _: Any, __: Any, message: MQTTMessage) -> None:
        text, mid = bytes(message.payload), message.mid if message.qos else None
        if message.topic == f"{self.topic}/state":
            self._on_state(text)
            return
        with self._lock:
            if message.dup and mid is not None and self._unacknowledged.is_repeated(mid, text):
                return
            try:
                values = read_batch(text)
                if mid is None and self.client.is_full:
                    raise ValueError("dropped, the server does not answer: publish with QoS 1")
                self._unacknowledged.add(self.client.send_batch(values), mid, text)
                return
            except ValueError as error:
                refusal = str(error)
                self._n_unreadable += 1
                self._unacknowledged.add(-self._n_unreadable, mid, text)
            except PushFailed as error:  # never acknowledged: a later bridge gets it
                self._loop.call_soon_threadsafe(self._end, error)
                return
        self._on_settled(-self._n_unreadable, refusal)

    def _on_settled(self, sequence: int, refusal: str) -> None:
        with self._lock:
            text = self._unacknowledged.settle(sequence)
        if refusal:
            excerpt = text.decode(errors="replace")[:EXCERPT]
            self._publish("errors", self._about | {"reason": refusal, "message": excerpt})
            self._tell(f"a message was refused: {refusal}")

    def _tell(self, text: str) -> None:
        """Pass on a message, unless it repeats the last one."""
        if text != self._last_message:
            self._last_message = text
            self._say(text)

    # --- the flight ---------------------------------------------------------------------------

    async def _watch(self) -> str:
        """Publish the state of the flight whenever both are connected. Returns why it is over."""
        stream, wait = self.client.stream(), FIRST_WAIT_S
        while True:
            await self._online.wait()
            reason = "the server closed the stream"
            try:
                async with aclosing(stream.messages()) as messages:
                    async for message in messages:
                        if not self._online.is_set():
                            break
                        await self._on_news(message)
                        wait = FIRST_WAIT_S
            except PushFailed:
                raise
            except ConnectionError as error:
                reason = str(error)
            if not self._online.is_set():
                continue
            if over := await asyncio.to_thread(self._why_over):
                return over
            self._tell(reason)
            self._publish("state", self._stale(reason), retain=True)
            await asyncio.sleep(wait)
            wait = min(2.0 * wait, LONGEST_WAIT_S)

    async def _on_news(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "frames":
            about = msgspec.json.encode({"flight": self.client.flight})[:-1] + b","
            for frame in message["frames"]:
                self._publish("assessments", about + frame[1:])
            return
        if kind == "hello":
            alarms, names = await asyncio.to_thread(self._read)
            for alarm in alarms:
                self._note_alarm(alarm)
            self._names = names
        elif kind == "alarm":
            self._note_alarm(message["alarm"])
        elif kind == "heartbeat" and self.client.failure:
            raise PushFailed(self.client.failure)
        if "channels" in message:
            content = self._about | {"samples": self._names, "channels": message["channels"]}
            self._publish("channels", content, retain=True)
        if kind in ("hello", "state", "status", "alarm", "heartbeat"):
            self._state |= {name: message[name] for name in SHOWN if name in message}
            self._publish("state", self._known(), retain=True, expires=STATE_EXPIRES_S)

    def _read(self) -> tuple[list[dict[str, Any]], list[str]]:
        """All alarms of the flight, and the names that it reads in samples. OSError."""
        return self.client.alarms(), self.client.status()["names"] if self._is_live else []

    def _note_alarm(self, alarm: dict[str, Any]) -> None:
        """Publish an alarm that is new or changed."""
        known = self._alarms.get(alarm["id"], {})
        is_older = known.get("acknowledged") and not alarm["acknowledged"]
        if alarm != known and not (is_older and known["raised"] == alarm["raised"]):
            self._alarms[alarm["id"]] = alarm
            self._publish("alarms", self._about | alarm)

    def _known(self) -> dict[str, Any]:
        """The state while both are connected; `since`: when this bridge was started."""
        return {
            **self._about,
            "bridge": self._id,
            "since": self._since,
            "progress": "running",
            **self._state,
            "open_alarms": [x for x in self._alarms.values() if x["acknowledged"] is None],
            "problem": self.client.problem,
            "published": _now(),
        }

    def _stale(self, reason: str) -> dict[str, Any]:
        """The state while the server does not answer: an unacknowledged warning stays one."""
        known = self._known()
        if any(alarm["level"] == "warning" for alarm in known["open_alarms"]):
            headline = {"status": "alarm", "level": "warning", "beside": ["stale"]}
            return known | STALE | headline | {"reason": reason}
        return known | STALE | {"reason": reason}

    def _gone(self, reason: str) -> dict[str, Any]:
        """The state where it is unknown."""
        unknown = {"progress": "unknown", "reason": reason, "open_alarms": None}
        return self._about | STALE | unknown

    def _why_over(self) -> str:
        """Why the flight is over; empty if it is not, or the server does not answer. PushFailed."""
        try:
            progress = self.client.flight_status(self.client.flight)["progress"]
        except PushFailed:
            raise
        except OSError:
            return ""
        is_in_progress = progress == "running" or (progress == "interrupted" and self._is_live)
        return "" if is_in_progress else "the flight has ended"


def send_at_once(_: Any, __: Any, connection: Any) -> None:
    """No small packet waits for the answer to the one before, up to 40 ms."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
