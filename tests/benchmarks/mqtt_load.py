"""A source and a subscriber of an MQTT broker, in a separate process.

python -m tests.benchmarks.mqtt_load PORT TOPIC SECONDS HZ

A sample's time is when it is due by the machine's monotonic clock. Prints as JSON when each sample
was due, how late the source was, and how old each assessment was when it came.
"""

import json
import re
import sys
import threading
import time
from typing import Any

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from app.client.mqtt_bridge import send_at_once
from tests.benchmarks.live_load import values

DRAIN_S, TICK_S = 60.0, 0.0005
TIME = re.compile(rb'"t":([0-9.e+]+)')


def main(port: int, topic: str, seconds: float, hz: float) -> None:
    mqtt = Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)
    mqtt.max_inflight_messages_set(1000)
    ages_ms: dict[float, float] = {}
    subscribed = threading.Event()

    def on_message(_: Any, __: Any, message: Any) -> None:
        found = TIME.search(message.payload)
        assert found is not None
        t = float(found[1])
        ages_ms[t] = 1e3 * (time.monotonic() - t)

    mqtt.on_message, mqtt.on_socket_open = on_message, send_at_once
    mqtt.on_subscribe = lambda *_: subscribed.set()
    mqtt.connect("127.0.0.1", port)
    mqtt.loop_start()
    mqtt.subscribe(f"{topic}/assessments", qos=1)
    subscribed.wait()
    n, rows = round(seconds * hz), values(round(10 * hz))
    start = time.monotonic() + 0.5
    due, late_ms = [start + k / hz for k in range(n)], []
    for k, t in enumerate(due):
        while (now := time.monotonic()) < t:
            time.sleep(TICK_S)
        mqtt.publish(f"{topic}/samples", f'{{"t":{t!r},{rows[k % len(rows)]}}}', 1)
        late_ms.append(1e3 * (now - t))
    end = time.monotonic() + DRAIN_S
    while len(ages_ms) < n and time.monotonic() < end:
        time.sleep(0.05)
    cpu_s = time.process_time()
    print(
        json.dumps({"due": due, "late_ms": late_ms, "cpu_s": cpu_s, "ages_ms": [*ages_ms.items()]})
    )
    mqtt.disconnect()
    mqtt.loop_stop()


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], float(sys.argv[3]), float(sys.argv[4]))
