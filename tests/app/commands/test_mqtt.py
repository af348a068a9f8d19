"""`forewarn mqtt`: what the broker was told is received, and a silence is never calm."""

import argparse
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest

from app.cli import main
from app.client import LiveClient
from app.client.mqtt_bridge import MqttBridge
from app.commands import mqtt
from app.settings import Settings
from app.store.store import open_store
from core.channels import KEYS
from tests.app.flights.test_flights import monitor
from tests.faults.server import reserved_port
from tests.faults.server import running as server_running
from tests.support import mosquitto
from tests.support.live_server import LiveServer, journal_samples, live_server
from tests.support.mosquitto import Mosquitto, Range
from tests.support.patience import PATIENCE, until

DT, TOPIC = 0.05, "forewarn/F16"
CALL = [sys.executable, "-c", "from app.cli import main; raise SystemExit(main())", "mqtt", "F16"]


def sample(k: int) -> dict[str, float]:
    return {"t": DT * k, **dict.fromkeys(KEYS, 1e-4 * (k % 5))}


@pytest.mark.parametrize(
    ("options", "needed"),
    [
        (["--broker", "http://host"], "mqtt://host or mqtts://host"),
        (["--broker", "mqtt://ann:secret@host"], "FOREWARN_MQTT_PASSWORD"),
        (["--broker", "mqtt://host:none"], "with :port"),
        (["--prefix", "range/#"], "no part of a topic"),
        (["--ca", "ca.pem"], "mqtts://"),
        (["--broker", "mqtts://host", "--ca", "ca.pem"], "ca.pem is no file"),
        (["--condition", "mach=0.6"], "--monitor-set"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_connected(
    options: list[str], needed: str, capsys: pytest.CaptureFixture
):
    assert main(["mqtt", "F16", "--monitor", "m", *options]) == 1
    assert needed in capsys.readouterr().err


@contextmanager
def bridge(
    broker: Mosquitto, server: str, *into: str, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """The command in a separate process."""
    call = [*CALL, "--broker", broker.url, "--server", server, *into]
    surroundings = os.environ | environment
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True, env=surroundings) as made:
        try:
            yield made
        finally:
            made.kill()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


@pytest.fixture
def broker() -> Iterator[Mosquitto]:
    with mosquitto.running() as broker:
        yield broker


@pytest.fixture
def far(broker: Mosquitto) -> Iterator[Range]:
    far = Range(broker, TOPIC)
    yield far
    far.close()


@pytest.mark.services
def test_samples_go_in_and_assessments_out_and_a_bad_message_stops_nothing(
    server: LiveServer, broker: Mosquitto, far: Range
):
    with bridge(broker, server.url, "--monitor", server.monitor_id):
        flight = far.state(progress="running")["flight"]
        for k in range(0, 100, 10):
            far.publish(sample(k))
            columns = [sample(k + i) for i in range(1, 5)]
            far.publish({name: [x[name] for x in columns] for name in ("t", *KEYS)})
            far.publish([sample(k + i) for i in range(5, 10)])
            far.publish(b'{"t": NaN}' if k == 50 else {"p": 1.0})
        until(lambda: len(far.of("assessments")) == 100)
        far.publish(sample(100), qos=0)
        until(lambda: len(far.of("assessments")) == 101)
        until(lambda: len(far.of("errors")) == 10)
    assessments = far.of("assessments")
    assert [x["seq"] for x in assessments] == [*range(101)]
    assert {x["flight"] for x in assessments} == {flight}
    shown = httpx2.get(f"{server.url}/api/v1/flights/{flight}/assessments").json()["frames"]
    for name in ("t", "p_value", "state", "y"):
        assert [x[name] for x in assessments] == [x[name] for x in shown]
    assert journal_samples(server.root, flight) == [DT * k for k in range(101)]
    reasons = [error["reason"] for error in far.of("errors")]
    assert sum("not JSON" in reason and "null, not NaN" in reason for reason in reasons) == 1
    assert sum("has no time" in reason for reason in reasons) == 9
    (about,) = far.of("channels")
    assert {*KEYS} < {*about["samples"]}
    assert [channel["unit"] for channel in about["channels"][:2]] == ["rad", "rad/s"]


@pytest.mark.services
def test_a_flood_of_bad_messages_loses_no_good_one(
    server: LiveServer, broker: Mosquitto, far: Range
):
    with bridge(broker, server.url, "--monitor", server.monitor_id, "--name", "flood"):
        far.state(progress="running")
        for k in range(300):  # the server closes a connection that brings a hundred in a second
            far.publish({"p": 1.0})
            if k % 30 == 0:
                far.publish(sample(k // 30))
        until(lambda: len(far.of("errors")) == 300)
        until(lambda: len(far.of("assessments")) == 10)


@pytest.mark.services
def test_an_unacknowledged_warning_stays_one_when_the_server_is_gone(
    broker: Mosquitto, far: Range, tmp_path: Path
):
    with ExitStack() as parts:
        with live_server(tmp_path) as server:
            parts.enter_context(bridge(broker, server.url, "--monitor", server.monitor_id))
            far.state(progress="running")
            far.publish(sample(0))
            far.publish(sample(1) | {"Ny": 2.0})
            until(lambda: [x for x in far.of("alarms") if x["kind"] == "limit"])
        state = far.state(state="stale", status="alarm", beside=["stale"])
        assert state["level"] == "warning"
        assert "limit" in [alarm["kind"] for alarm in state["open_alarms"]]


@pytest.mark.services
def test_alarms_are_published_with_their_acknowledgement_and_open_ones_are_in_the_state(
    server: LiveServer, broker: Mosquitto, far: Range
):
    with bridge(broker, server.url, "--monitor", server.monitor_id):
        flight = far.state(progress="running")["flight"]
        far.publish(sample(0))
        far.publish(sample(1) | {"Ny": 2.0})
        (alarm,) = until(lambda: [x for x in far.of("alarms") if x["kind"] == "limit"])
        assert alarm["level"] == "warning"
        later = Range(broker, TOPIC)
        later.state(flight=flight)
        open_alarms = until(lambda: later.of("state")[-1]["open_alarms"])
        assert alarm["id"] in [x["id"] for x in open_alarms]
        path = f"{server.url}/api/v1/flights/{flight}/alarms/{alarm['id']}/acknowledge"
        httpx2.post(path, json={"by": "Ann"}).raise_for_status()
        until(lambda: [x for x in later.of("alarms") if x["by"] and x["id"] == alarm["id"]])
        until(
            lambda: alarm["id"] not in [x["id"] for x in later.of("state")[-1]["open_alarms"] or []]
        )
        later.close()


@pytest.mark.services
def test_a_dead_bridge_leaves_a_stale_state_and_the_next_one_continues_the_flight(
    server: LiveServer, broker: Mosquitto, far: Range
):
    into = "--monitor", server.monitor_id, "--name", "continued"
    with bridge(broker, server.url, *into) as first:
        flight = far.state(progress="running")["flight"]
        far.publish(sample(0))
        until(lambda: far.of("assessments"))
        first.kill()
        far.state(progress="unknown", state="stale", open_alarms=None)
    later = Range(broker, TOPIC)
    assert later.state(flight=flight)["status"] == "stale"
    far.publish(sample(1))
    with bridge(broker, server.url, *into):
        assert later.state(progress="running")["flight"] == flight
        until(lambda: {*journal_samples(server.root, flight)} == {0.0, DT})
    later.close()


@pytest.mark.services
def test_a_flight_that_a_person_ends_ends_the_bridge(
    server: LiveServer, broker: Mosquitto, far: Range
):
    with bridge(broker, server.url, "--monitor", server.monitor_id, "--name", "ended") as made:
        flight = far.state(progress="running")["flight"]
        far.publish(sample(0))
        until(lambda: far.of("assessments"))
        httpx2.post(f"{server.url}/api/v1/flights/{flight}/end").raise_for_status()
        assert made.wait(PATIENCE) == 0
    assert far.state(progress="ended")["state"] == "stale"


def test_two_commands_of_a_source_at_the_same_moment_share_one_flight(
    server: LiveServer, monkeypatch: pytest.MonkeyPatch
):
    both, listed = threading.Barrier(2), LiveClient.in_progress

    def at_once(client: LiveClient) -> list[dict[str, Any]]:
        flights = listed(client)
        if not client.flight:  # neither has started one yet
            both.wait(PATIENCE)
        return flights

    monkeypatch.setattr(LiveClient, "in_progress", at_once)
    parser = argparse.ArgumentParser()
    mqtt.add(parser)
    options = parser.parse_args(["F16", "--monitor", server.monitor_id, "--name", "at once"])
    clients = [LiveClient(server.url, keep_open=True) for _ in range(2)]
    with ThreadPoolExecutor() as threads:
        list(threads.map(lambda client: mqtt.join_or_start(client, options, {}), clients))
    going = [each["id"] for each in listed(clients[0]) if each["name"] == "at once"]
    assert [client.flight for client in clients] == going * 2
    for client in clients:
        client.send(sample(0))
        assert client.flush()
        client.close()
    clients[0].end()


@pytest.mark.services
def test_a_second_bridge_of_a_source_ends_the_first_so_that_no_supervisor_starts_it_again(
    server: LiveServer, broker: Mosquitto, far: Range
):
    into = "--monitor", server.monitor_id, "--name", "twice"
    with bridge(broker, server.url, *into) as first:
        far.state(progress="running")
        with bridge(broker, server.url, *into):
            assert first.wait(PATIENCE) == 0
            assert first.stderr is not None
            assert "another `forewarn mqtt` has taken over" in first.stderr.read()
            far.state(progress="running", flight=far.of("state")[0]["flight"])


@pytest.mark.services
@pytest.mark.parametrize("killed", ["broker", "server", "bridge"])
def test_no_sample_is_lost_whoever_is_restarted(
    killed: str, tmp_path: Path, far: Range, broker: Mosquitto
):
    store = open_store(Settings(data_dir=tmp_path).url)
    monitor_id = store.monitors.add(monitor(), "m").id
    store.close()
    n, flight = 900, ""
    with ExitStack() as parts:
        port = parts.enter_context(reserved_port())
        serving = parts.enter_context(server_running(tmp_path, port))
        into = f"http://127.0.0.1:{port}", "--monitor", monitor_id
        bridging = parts.enter_context(bridge(broker, *into))
        flight = far.state(progress="running")["flight"]
        for k in range(n // 3):
            far.publish(sample(k))
        until(lambda: far.of("assessments"))  # in the middle of them
        if killed == "broker":
            broker.stop()
        elif killed == "server":
            serving.process.kill()
        else:
            bridging.kill()
        for k in range(n // 3, 2 * n // 3):
            far.publish(sample(k))
        if killed == "broker":
            broker.start()
        elif killed == "server":
            far.state(state="stale", progress="running")
            parts.enter_context(server_running(tmp_path, port))
        else:
            far.state(state="stale", progress="unknown")
            parts.enter_context(bridge(broker, *into))
        for k in range(2 * n // 3, n):
            far.publish(sample(k))
        wanted = {DT * k for k in range(n)}
        until(lambda: {*journal_samples(tmp_path, flight)} >= wanted)
        if killed != "bridge":
            until(lambda: {x["seq"] for x in far.of("assessments")} >= {*range(n)})
        address = f"http://127.0.0.1:{port}/api/v1/flights/{flight}/samples"
        assert httpx2.get(address).json()["counts"]["accepted"] == n


def with_password(folder: Path) -> str:
    users = folder / "users"
    call = ["mosquitto_passwd", "-b", "-c", str(users), "ann", "secret"]
    subprocess.run(call, check=True, capture_output=True)
    return f"allow_anonymous false\npassword_file {users}"


def for_reading(folder: Path) -> str:
    rights = folder / "rights"
    rights.write_text(f"topic read {TOPIC}/#\n")
    return f"allow_anonymous true\nacl_file {rights}"


def with_certificate(folder: Path) -> str:
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    call = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    call += ["-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"]
    call += ["-keyout", str(key), "-out", str(certificate)]
    subprocess.run(call, check=True, capture_output=True)
    return f"allow_anonymous true\nkeyfile {key}\ncertfile {certificate}"


def in_progress(server: LiveServer, name: str) -> list[str]:
    """The flights of a name."""
    flights = httpx2.get(f"{server.url}/api/v1/flights?progress=running").json()
    return [flight["id"] for flight in flights if flight["name"] == name]


def failed(made: subprocess.Popen[str]) -> str:
    """What a command printed that has ended with an error."""
    assert made.wait(PATIENCE) == 1
    assert made.stderr is not None
    return made.stderr.read()


@pytest.mark.services
def test_a_password_comes_from_the_environment(server: LiveServer):
    into = "--monitor", server.monitor_id, "--user", "ann", "--name", "login"
    with mosquitto.running(with_password) as broker:
        with bridge(broker, server.url, *into, FOREWARN_MQTT_PASSWORD="nonsense") as made:
            assert "check user and password" in failed(made)
        assert in_progress(server, "login") == []
        far = Range(broker, TOPIC, username="ann", password="secret")
        with bridge(broker, server.url, *into, FOREWARN_MQTT_PASSWORD="secret"):
            far.state(progress="running")
        far.close()


@pytest.mark.services
def test_a_broker_that_refuses_to_publish_is_an_error(server: LiveServer):
    into = "--monitor", server.monitor_id
    with (
        mosquitto.running(for_reading) as broker,
        bridge(broker, server.url, *into) as made,
    ):
        assert f"refuses to publish below {TOPIC}" in failed(made)


@pytest.mark.services
def test_a_broker_is_reached_by_tls_only_if_its_certificate_is_known(server: LiveServer):
    into = "--monitor", server.monitor_id
    with mosquitto.running(with_certificate) as broker:
        broker.url = broker.url.replace("mqtt", "mqtts")
        with bridge(broker, server.url, *into) as made:
            assert "by --ca" in failed(made)
        known = str(broker.directory / "certificate.pem")
        with bridge(broker, server.url, *into, "--ca", known):
            far = Range(broker, TOPIC, ca=known)
            far.state(progress="running")
            far.close()


@pytest.mark.services
def test_tls_on_a_port_without_it_is_an_error_that_names_tls(server: LiveServer, broker: Mosquitto):
    broker.url = broker.url.replace("mqtt", "mqtts")
    with bridge(broker, server.url, "--monitor", server.monitor_id) as made:
        assert "with TLS on this port?" in failed(made)


def test_a_broker_that_is_not_there_is_an_error_and_starts_no_flight(
    server: LiveServer, capsys: pytest.CaptureFixture
):
    into = ["--monitor", server.monitor_id, "--broker", "mqtt://127.0.0.1:9", "--name", "nowhere"]
    assert main(["mqtt", "F16", *into, "--server", server.url]) == 1
    assert "is the broker running?" in capsys.readouterr().err
    assert in_progress(server, "nowhere") == []


def test_without_a_flight_the_command_says_where_an_id_is(capsys: pytest.CaptureFixture):
    with pytest.raises(SystemExit):
        main(["mqtt", "F16"])
    (line,) = capsys.readouterr().err.splitlines()
    assert "--monitor" in line
    assert "GET /monitors" in line


def test_without_its_library_the_command_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    monkeypatch.delitem(sys.modules, MqttBridge.__module__)
    assert main(["mqtt", "F16", "--monitor", "m"]) == 1
    assert "forewarn[mqtt]" in capsys.readouterr().err
