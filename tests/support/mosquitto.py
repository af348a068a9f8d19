"""An MQTT broker of this machine, started for tests and stopped after them."""

import getpass
import shutil
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.support.patience import PATIENCE, until
from tests.support.postgresql import free_port

PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
CONFIGURATION = """
persistence true
persistence_location {directory}/
user {user}
max_inflight_messages {inflight}
max_queued_messages 0
set_tcp_nodelay true
listener {port} 127.0.0.1
{more}
"""


class Mosquitto:
    """A broker; `stop` and `start` restart it. It keeps its messages when it is stopped.

    more: further lines of its configuration.
    """

    def __init__(self, directory: Path, more: str, inflight: int) -> None:
        self.directory, self.port = directory, free_port()
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self._configuration, self._log = directory / "mosquitto.conf", directory / "log"
        about = {"directory": directory, "user": getpass.getuser(), "port": self.port}
        text = CONFIGURATION.format(**about, more=more, inflight=inflight)
        self._configuration.write_text(text)
        self._process: subprocess.Popen[Any] | None = None

    def start(self) -> None:
        assert PROGRAM is not None
        with self._log.open("w") as log:
            call = [PROGRAM, "-c", str(self._configuration)]
            self._process = subprocess.Popen(call, stderr=log)
        until(lambda: self._log.read_text().rstrip().endswith("running"))

    def stop(self) -> None:
        assert self._process is not None
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(PATIENCE)


class Range:
    """A program of the range: publishes samples, and keeps what it gets below a topic."""

    def __init__(self, broker: Mosquitto, topic: str, ca: str | None = None, **login: Any) -> None:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
        from paho.mqtt.packettypes import PacketTypes
        from paho.mqtt.properties import Properties

        self.topic = topic
        self.got: list[tuple[str, Any]] = []
        """Name of the topic, and content, in the order received."""
        version = CallbackAPIVersion.VERSION2
        self.mqtt = Client(version, f"range-{id(self)}", protocol=MQTTProtocolVersion.MQTTv5)
        self.mqtt.reconnect_delay_set(1, 1)
        self.mqtt.on_message = self._on_message
        if ca is not None:
            self.mqtt.tls_set(ca)
        if login:
            self.mqtt.username_pw_set(**login)
        subscribed = threading.Event()
        self.mqtt.on_connect = self._on_connect
        self.mqtt.on_subscribe = lambda *_: subscribed.set()
        keep = Properties(PacketTypes.CONNECT)
        keep.SessionExpiryInterval = 600
        self.mqtt.connect("127.0.0.1", broker.port, 5, clean_start=False, properties=keep)
        self.mqtt.loop_start()
        assert subscribed.wait(PATIENCE)

    def _on_connect(self, *_: Any) -> None:
        self.mqtt.subscribe(f"{self.topic}/#", qos=1)

    def _on_message(self, _: Any, __: Any, message: Any) -> None:
        name = message.topic.removeprefix(f"{self.topic}/")
        if name != "samples":
            self.got.append((name, msgspec.json.decode(message.payload)))

    def of(self, name: str) -> list[Any]:
        """What came on a topic so far."""
        return [content for topic, content in [*self.got] if topic == name]

    def state(self, **wanted: Any) -> dict[str, Any]:
        """The newest state, as soon as it holds these values."""

        def find() -> dict[str, Any] | None:
            newest = (self.of("state") or [{}])[-1]
            return newest if newest.items() >= wanted.items() else None

        found = until(find)
        assert found is not None
        return found

    def publish(self, content: Any, qos: int = 1) -> None:
        text = content if isinstance(content, bytes) else msgspec.json.encode(content)
        self.mqtt.publish(f"{self.topic}/samples", text, qos)

    def close(self) -> None:
        self.mqtt.disconnect()
        self.mqtt.loop_stop()


@contextmanager
def _directory() -> Iterator[Path]:
    """For a broker; the test is skipped where mosquitto is not installed."""
    if PROGRAM is None:
        pytest.skip("mosquitto is not installed: it is in the Debian package of this name")
    path = Path(tempfile.mkdtemp(prefix="forewarn-mosquitto-"))
    try:
        yield path
    finally:
        shutil.rmtree(path)


@contextmanager
def running(
    configure: Callable[[Path], str] = lambda _: "allow_anonymous true", inflight: int = 1000
) -> Iterator[Mosquitto]:
    """A started broker. configure: further lines of its configuration, of files in its folder."""
    with _directory() as path:
        broker = Mosquitto(path, configure(path), inflight)
        broker.start()
        try:
            yield broker
        finally:
            broker.stop()
