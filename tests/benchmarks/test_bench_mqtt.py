"""Samples through an MQTT broker: broker, bridge, server and source in four processes."""

import asyncio
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from app.client.mqtt_bridge import Broker, MqttBridge
from tests.benchmarks.test_bench_flight import serving
from tests.support import mosquitto
from tests.support.patience import until

pytestmark = [pytest.mark.benchmark, pytest.mark.services]
SECONDS = float(os.environ.get("LIVE_SECONDS", "20"))
HZ, SETTLE_S, TOPIC = 1000.0, 2.0, "forewarn/F16"


@pytest.mark.parametrize("inflight", [20, 1000])
def test_a_thousand_samples_a_second(inflight: int, tmp_path: Path) -> None:
    """inflight: the broker's `max_inflight_messages`; 20 is its default."""
    settled_at: list[float] = []
    with mosquitto.running(inflight=inflight) as broker, serving(tmp_path, dt=1.0 / HZ) as server:
        bridge = MqttBridge(Broker("127.0.0.1", broker.port), TOPIC, server.address, None, print)
        settle = bridge.client._samples._on_settled
        assert settle is not None

        def settled(sequence: int, refusal: str) -> None:
            settle(sequence, refusal)
            assert not refusal
            assert sequence == len(settled_at)
            settled_at.append(time.monotonic())

        bridge.client._samples._on_settled = settled
        flight = bridge.client.start(server.monitor, trim="none")
        running = threading.Thread(target=asyncio.run, args=(bridge.run(),))
        running.start()
        until(lambda: bridge._answered.is_set())
        load = [sys.executable, "-m", "tests.benchmarks.mqtt_load", str(broker.port), TOPIC]
        began, cpu_s = time.process_time(), server.cpu_s
        out = subprocess.run([*load, str(SECONDS), str(HZ)], stdout=subprocess.PIPE, check=True)
        bridge_cpu_s, cpu_s = time.process_time() - began, server.cpu_s - cpu_s
        run = json.loads(out.stdout)
        server.client.post(f"/api/v1/flights/{flight}/end").raise_for_status()
        running.join()
    due, late_ms = np.array(run["due"]), np.array(run["late_ms"])
    is_timed = due > due[0] + SETTLE_S
    assert len(settled_at) == len(due)
    ages = dict(run["ages_ms"])
    print(f"\n{len(due)} samples at {HZ:g} Hz, {inflight} messages in flight at most")
    for what, ms in (
        ("source late", late_ms),
        ("published to durable on the server", 1e3 * (np.array(settled_at) - due) - late_ms),
        ("published to assessment received", np.array([ages[t] for t in due]) - late_ms),
    ):
        shown = ", ".join(f"{x:.1f}" for x in np.percentile(ms[is_timed], [50, 99, 100]))
        print(f"{what}: p50, p99, max {shown} ms")
    cores = (100 * x / SECONDS for x in (bridge_cpu_s, cpu_s, run["cpu_s"]))
    used = "bridge {:.0f} %, server {:.0f} %, source {:.0f} % of a core".format(*cores)
    print(f"{used}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
