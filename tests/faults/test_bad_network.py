"""Live sources over bad networks: acknowledged samples are in the journal once, as shown."""

import json
import socket
import time
from pathlib import Path

import httpx2

from app.client import LiveClient
from core.channels import KEYS
from tests.app.flights.test_flights import monitor
from tests.faults.conftest import keep_monitor
from tests.faults.server import reserved_port, running
from tests.support.bad_network import BadLine, badly_delivered
from tests.support.live_server import assert_shown_again, journal_samples, live_server
from tests.support.patience import until

DT = 0.05
REST = dict.fromkeys(KEYS, 0.0)


def test_a_line_that_is_cut_and_slow_loses_and_doubles_nothing(tmp_path: Path) -> None:
    n, cuts = 600, 6
    with live_server(tmp_path) as server:
        with BadLine(server.url, 1, cuts, 3000).open() as line:
            with LiveClient(line.url, keep_open=True) as client:
                flight = client.start(server.monitor_id, trim="none")
                for k in range(n):
                    client.send(REST, t=DT * k)
                    if k % 20 == 0:
                        client.flush()
            assert (client.durable, client.broken > 1) == (n, True)
            assert line.cuts <= 0
        assert journal_samples(tmp_path, flight) == [DT * k for k in range(n)]
        httpx2.post(f"{server.url}/api/v1/flights/{flight}/end").raise_for_status()
    assert assert_shown_again(tmp_path, flight) == n


def test_a_batch_that_is_posted_until_it_is_answered_counts_once(tmp_path: Path) -> None:
    n_repeated = 0
    with live_server(tmp_path) as server:
        client = LiveClient(server.url)
        flight = client.start(server.monitor_id, trim="none")
        with BadLine(server.url, 1, 6, 3000).open() as line, httpx2.Client() as http:
            url = f"{line.url}/api/v1/flights/{flight}/samples"
            for k in range(100):
                batch = {"sequence": k, "t": DT * k} | REST
                while True:
                    try:
                        http.post(url, json=batch).raise_for_status()
                        break
                    except httpx2.TransportError:
                        n_repeated += 1
            assert (n_repeated > 1, line.cuts <= 0) == (True, True)
        assert journal_samples(tmp_path, flight) == [DT * k for k in range(100)]
        client.end()
    assert assert_shown_again(tmp_path, flight) == 100


def test_datagrams_that_are_lost_doubled_and_late_show_again_as_they_came(
    tmp_path: Path,
) -> None:
    sent = [json.dumps({"sequence": k, "t": DT * k} | REST).encode() for k in range(300)]
    come = badly_delivered(sent, seed=2)
    with live_server(tmp_path) as server:
        client = LiveClient(server.url)
        flight = client.start(server.monitor_id, trim="none", udp=0)
        host, _, port = str(client.status()["udp"]).rpartition(":")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for k, datagram in enumerate(come):
                sender.sendto(datagram, (host, int(port)))
                time.sleep(0.001 * (k % 3))  # the arrivals are of the real clock
        until(lambda: client.status()["batches"] >= len({*come}))
        counts = client.status()["counts"]
        client.end()
    numbers = [json.loads(each)["sequence"] for each in dict.fromkeys(come)]
    assert journal_samples(tmp_path, flight) == [DT * k for k in numbers]
    assert counts["out_of_order"] + counts["late"] > 10
    assert counts["missing"] > 10
    assert assert_shown_again(tmp_path, flight) > 200


def test_what_a_killed_server_did_not_acknowledge_is_sent_again(tmp_path: Path) -> None:
    monitor_id = keep_monitor(tmp_path, monitor())
    with reserved_port() as port:
        with running(tmp_path, port) as (process, http):
            client = LiveClient(str(http.base_url), keep_open=True)
            flight = client.start(monitor_id, trim="none")
            for k in range(150):
                client.send(REST, t=DT * k)
                assert k != 99 or client.flush()
            process.kill()
            process.join()
        with running(tmp_path, port), client:
            for k in range(150, 200):
                client.send(REST, t=DT * k)
            client.end()
    assert (client.durable, client.broken > 0) == (200, True)
    assert assert_shown_again(tmp_path, flight) == 200
    assert journal_samples(tmp_path, flight) == [DT * k for k in range(200)]
