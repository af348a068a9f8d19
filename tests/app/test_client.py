"""The client of live sources: everything it was given is durable, or it says so."""

import shutil
import ssl
import subprocess
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2
import pytest

from app.assessment.batches import MOST_SAMPLES
from app.client import LiveClient, PushFailed
from app.client.outbox import MOST_BYTES
from app.serving import LARGEST_MESSAGE
from app.settings import Settings
from app.store.store import open_store
from core.channels import KEYS
from tests.support.live_server import LiveServer, journal_samples, live_server

DT = 0.05
REST = dict.fromkeys(KEYS, 0.0)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


def send(client: LiveClient, first: int, n: int) -> None:
    for k in range(first, first + n):
        client.send(REST, t=DT * k)


def progress(server: LiveServer, flight: str) -> str:
    return httpx2.get(f"{server.url}/api/v1/flights/{flight}").json()["progress"]


def test_all_that_was_sent_is_durable_once_the_client_is_left(server: LiveServer) -> None:
    with LiveClient(server.url) as client:
        flight = client.start(server.monitor_id, trim="none")
        send(client, 0, 400)
    assert (client.sent, client.durable, client.refused) == (400, 400, 0)
    assert sorted(journal_samples(server.root, flight)) == [DT * k for k in range(400)]


def test_an_authority_of_the_range_is_trusted_once_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    making = "openssl req -x509 -newkey rsa:2048 -nodes -days 1 -subj /CN=localhost"
    making += f" -keyout {tmp_path}/key -out {tmp_path}/pem -addext subjectAltName=DNS:localhost"
    subprocess.run(making.split(), check=True, capture_output=True)
    own = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    own.load_cert_chain(tmp_path / "pem", tmp_path / "key")
    with ThreadingHTTPServer(("127.0.0.1", 0), SimpleHTTPRequestHandler) as server:
        server.socket = own.wrap_socket(server.socket, server_side=True)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"https://localhost:{server.server_port}"
        with pytest.raises(ConnectionError, match="SSL_CERT_FILE"):
            LiveClient(url).in_progress()
        monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "pem"))
        with pytest.raises(PushFailed, match="404"):
            LiveClient(url).in_progress()
        server.shutdown()


def test_the_largest_batch_of_a_client_is_one_for_the_server() -> None:
    client = LiveClient()
    for k in range(2 * MOST_SAMPLES):
        client._samples.put({"t": DT * k, **REST})
    batch = client._samples.take()
    assert batch is not None
    assert 1 <= batch.n <= MOST_SAMPLES
    assert len(batch.text) <= LARGEST_MESSAGE


def test_a_second_client_goes_on_after_the_first(server: LiveServer) -> None:
    with LiveClient(server.url, keep_open=True) as client:
        flight = client.start(server.monitor_id, trim="none")
        send(client, 0, 10)
    with LiveClient(server.url) as client:
        client.join(flight)
        send(client, 10, 10)
    assert journal_samples(server.root, flight) == [DT * k for k in range(20)]


@pytest.mark.parametrize("keep_open", [False, True])
def test_leaving_a_client_ends_its_flight_unless_it_is_to_stay_open(
    server: LiveServer, keep_open: bool
) -> None:
    with LiveClient(server.url, keep_open=keep_open) as client:
        flight = client.start(server.monitor_id, trim="none")
        send(client, 0, 10)
    assert progress(server, flight) == ("running" if keep_open else "ended")


def test_neither_an_error_nor_a_mere_look_ends_a_flight(server: LiveServer) -> None:
    client = LiveClient(server.url)
    flight = client.start(server.monitor_id, trim="none")
    send(client, 0, 10)
    client.__exit__(ZeroDivisionError, None, None)
    with LiveClient(server.url) as other:
        other.join(flight)
    assert progress(server, flight) == "running"


def test_a_sample_that_is_none_is_left_out_and_told(server: LiveServer) -> None:
    client = LiveClient(server.url)
    client.start(server.monitor_id)
    client.send(REST, t=0.0, beta=None)
    assert not client.flush()
    send(client, 1, 1)
    with pytest.raises(PushFailed, match=r"1 of 2 samples .* missing channels: beta"):
        client.__exit__(None, None, None)
    assert (client.durable, client.refused) == (1, 1)


def test_a_batch_that_is_refused_takes_no_other_with_it(server: LiveServer) -> None:
    settled: dict[int, str] = {}
    client = LiveClient(server.url, on_settled=settled.__setitem__)
    client.start(server.monitor_id, trim="none")
    batches: list[dict[str, Any]] = [{"t": DT * k, **REST} for k in range(5)]
    batches[2] = {"t": "noon", **REST}
    assert [client.send_batch(batch) for batch in batches] == [*range(5)]
    assert not client.flush()
    client.close()
    assert (client.sent, client.durable, client.refused) == (5, 4, 1)
    assert [bool(settled[k]) for k in range(5)] == [False, False, True, False, False]


def test_a_batch_beyond_the_largest_message_is_refused_at_once() -> None:
    client = LiveClient()
    assert MOST_BYTES == LARGEST_MESSAGE
    client.flight = "flight"
    with pytest.raises(ValueError, match=f"at most {MOST_BYTES}"):
        client.send_batch({"t": "x" * MOST_BYTES})
    client.close()


def test_a_flight_that_was_ended_takes_no_more(server: LiveServer) -> None:
    client = LiveClient(server.url)
    client.start(server.monitor_id)
    send(client, 0, 1)
    client.end()
    send(client, 1, 1)
    with pytest.raises(PushFailed, match="accepts no samples"):
        client.flush()
    client.close()
    assert (client.sent, client.durable) == (2, 1)


def test_numbers_that_another_source_uses_are_told(server: LiveServer) -> None:
    one, other = LiveClient(server.url), LiveClient(server.url)
    other.join(one.start(server.monitor_id))
    send(one, 0, 1)
    assert one.flush()
    send(other, 1, 1)
    with pytest.raises(PushFailed, match="sequence 0 was used"):
        other.flush()
    one.close()
    other.close()


def test_a_server_that_is_not_there_and_a_flight_that_is_not_are_told(server: LiveServer) -> None:
    with pytest.raises(ConnectionError, match="server running"):
        LiveClient("http://127.0.0.1:9").start("m")
    with pytest.raises(PushFailed, match="no monitor"):
        LiveClient(server.url).start("nothing")
    with pytest.raises(PushFailed, match="call start or join"):
        LiveClient(server.url).send(t=0.0)


def test_a_token_of_a_viewer_may_not_push(tmp_path: Path) -> None:
    store = open_store(Settings(data_dir=tmp_path).url)
    _, operator = store.tokens.add("Op", "operator", None)
    _, viewer = store.tokens.add("Vi", "viewer", None)
    store.close()
    with live_server(tmp_path) as server:
        with LiveClient(server.url, operator, keep_open=True) as client:
            flight = client.start(server.monitor_id)
            send(client, 0, 1)
        watching = LiveClient(server.url, viewer)
        watching.join(flight)
        send(watching, 1, 1)
        with pytest.raises(PushFailed, match="operator"):
            watching.flush()
        watching.close()


def test_a_start_whose_answer_is_lost_is_repeated_and_makes_one_flight(
    server: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    request, asked = httpx2.Client.request, []

    def lose_first(client: httpx2.Client, method: str, *rest: Any, **more: Any) -> httpx2.Response:
        answer = request(client, method, *rest, **more)
        asked.append(method)
        if len(asked) == 1:
            raise httpx2.RemoteProtocolError("Server disconnected")
        return answer

    flights = f"{server.url}/api/v1/flights"
    before = {flight["id"] for flight in httpx2.get(flights).json()}
    monkeypatch.setattr(httpx2.Client, "request", lose_first)
    with LiveClient(server.url) as client:
        flight = client.start(server.monitor_id, trim="none")
    monkeypatch.undo()
    assert asked[:2] == ["POST", "POST"]
    assert {each["id"] for each in httpx2.get(flights).json()} - before == {flight}
