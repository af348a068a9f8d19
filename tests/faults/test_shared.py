"""Several servers on one database: one owns the flights, the others relay and take over."""

import asyncio
import json
import random
import re
import shutil
import signal
import ssl
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

import httpx2
import pytest
from websockets.sync.client import connect

from app import serving
from app.http import relay
from app.main import STATIC
from app.serving import alone, listen, serve, shared
from app.settings import Settings, SettingsError
from core.monitor import Monitor
from tests.faults.conftest import keep_monitor
from tests.faults.server import Running, answers, reserved_port, sharing
from tests.faults.test_live_flights import FLIGHTS, assert_kept, batch, push_until_broken, start
from tests.support.api import problem
from tests.support.patience import PATIENCE, until
from tests.support.postgresql import PostgreSQL

N_ENDS, N_LONG = 3, 20


@pytest.fixture
def ports() -> Iterator[tuple[int, int]]:
    with reserved_port() as one, reserved_port() as other:
        yield one, other


def test_a_second_server_relays_to_the_owner(
    tmp_path: Path, ports: tuple[int, int], flyable: Monitor
) -> None:
    monitor = keep_monitor(tmp_path, flyable)
    with sharing(tmp_path, ports[0]) as (_, owner), sharing(tmp_path, ports[1]) as (_, other):
        published = json.loads((tmp_path / "forewarn.owner").read_text())
        assert published["address"] == str(owner.base_url).rstrip("/")
        flight = start(other, monitor)
        stream = f"ws://127.0.0.1:{ports[1]}{FLIGHTS}/{flight}/stream"
        with connect(stream, proxy=None) as screen:
            assert json.loads(screen.recv(PATIENCE))["type"] == "hello"
            sent = owner.post(f"{FLIGHTS}/{flight}/samples", json=batch(0, flyable.dt))
            assert sent.status_code == 200
            kinds = iter(lambda: json.loads(screen.recv(PATIENCE))["type"], "frames")
            assert "frames" not in [*kinds]
        file = ",".join(["t", *"abc"]) + "\n" + "0.1,1,2,3\n" * 100_000
        octets = {"content-type": "application/octet-stream"}
        kept = other.post("/api/v1/recordings?name=a.csv", content=file.encode(), headers=octets)
        assert kept.status_code == 201
        assert owner.get("/api/v1/recordings").json()[0]["id"] == kept.json()["id"]
        assert other.get("/").text == owner.get("/").text


def end_so_often(
    data_dir: Path, ports: tuple[int, int], monitor: Monitor, n: int, url: str | None = None
) -> None:
    """End the owner, or every third time the one that relays the samples, again and again."""
    monitor_id, chance = keep_monitor(data_dir, monitor, url), random.Random(3)
    acknowledged: set[int] = set()
    flight = ""
    with ExitStack() as at_end:

        def joined(port: int) -> tuple[Running, ExitStack, int]:
            stack = at_end.enter_context(ExitStack())
            return stack.enter_context(sharing(data_dir, port, database_url=url)), stack, port

        owner, free = joined(ports[0]), ports[1]
        for k in range(n):
            relaying = joined(free)
            flight = flight or start(relaying[0].client, monitor_id)
            ended, stays = (relaying, owner) if k % 3 == 2 else (owner, relaying)
            process, how = ended[0].process, (signal.SIGTERM, signal.SIGKILL)[k % 2]
            end = process.kill if how is signal.SIGKILL else process.terminate
            when = monitor.dt, chance.uniform(0.0, 0.4)
            acknowledged |= push_until_broken(relaying[0].client, flight, *when, end)
            process.join()
            until(partial(answers, stays[0].client))
            ended[1].close()
            owner, free = stays, ended[2]
    assert_kept(data_dir, flight, monitor, acknowledged, url)


def test_the_other_server_takes_over_with_all_that_was_acknowledged(
    tmp_path: Path, ports: tuple[int, int], flyable: Monitor
) -> None:
    end_so_often(tmp_path, ports, flyable, N_ENDS)


@pytest.mark.fuzz
def test_many_servers_end_and_nothing_acknowledged_is_lost(
    tmp_path: Path, ports: tuple[int, int], flyable: Monitor
) -> None:
    end_so_often(tmp_path, ports, flyable, N_LONG)


@pytest.mark.services
def test_the_other_server_takes_over_on_postgresql(
    tmp_path: Path, ports: tuple[int, int], flyable: Monitor, postgresql: PostgreSQL
) -> None:
    end_so_often(tmp_path, ports, flyable, N_ENDS, postgresql.new_database())


@pytest.fixture
def proxied(tmp_path: Path, ports: tuple[int, int]) -> Iterator[str]:
    """Address of nginx with the guide's configuration, before two servers."""
    nginx = shutil.which("nginx")
    if nginx is None or shutil.which("openssl") is None:
        pytest.skip("nginx and openssl are not installed")
    (tmp_path / "proxy").mkdir()
    pem, key = tmp_path / "proxy/forewarn.pem", tmp_path / "proxy/forewarn.key"
    making = f"openssl req -x509 -newkey rsa:2048 -nodes -days 1 -subj /CN=localhost -keyout {key}"
    subprocess.run([*making.split(), "-out", pem], check=True, capture_output=True)
    text = (STATIC / "guide/several-servers.md").read_text()
    (configured,) = re.findall(r"```nginx\n(.*?)```", text, re.DOTALL)
    with reserved_port() as port:
        for ours, theirs in (
            ("range-1:8000", f"127.0.0.1:{ports[0]}"),
            ("range-2:8000", f"127.0.0.1:{ports[1]}"),
            ("listen 443", f"listen 127.0.0.1:{port}"),
            ("/etc/nginx/forewarn.pem", str(pem)),
            ("/etc/nginx/forewarn.key", str(key)),
        ):
            assert configured.count(ours) == 1
            configured = configured.replace(ours, theirs)
        (tmp_path / "proxy/nginx.conf").write_text(f"daemon off; pid nginx.pid;\n{configured}")
        program = [nginx, "-p", str(tmp_path / "proxy"), "-c", "nginx.conf", "-e", "stderr"]
        process = subprocess.Popen(program)
        yield f"https://localhost:{port}"
        process.terminate()
        process.wait()


@pytest.mark.services
def test_behind_nginx_the_flight_goes_on_when_the_owner_ends(
    tmp_path: Path, ports: tuple[int, int], flyable: Monitor, proxied: str
) -> None:
    monitor, trusting = keep_monitor(tmp_path, flyable), ssl.create_default_context()
    trusting.load_verify_locations(tmp_path / "proxy/forewarn.pem")
    with (
        sharing(tmp_path, ports[0]) as owner,
        sharing(tmp_path, ports[1]),
        httpx2.Client(base_url=proxied, verify=trusting, timeout=PATIENCE, trust_env=False) as http,
    ):
        until(lambda: answers(http))
        flight = start(http, monitor)
        stream = f"{proxied.replace('http', 'ws', 1)}{FLIGHTS}/{flight}/stream"
        with connect(stream, ssl=trusting, proxy=None) as screen:
            assert json.loads(screen.recv(PATIENCE))["type"] == "hello"
            sent = http.post(f"{FLIGHTS}/{flight}/samples", json=batch(0, flyable.dt))
            assert sent.status_code == 200
        owner.process.kill()
        until(lambda: answers(http))
        sent = http.post(f"{FLIGHTS}/{flight}/samples", json=batch(0, flyable.dt))
        assert (sent.status_code, sent.json()["repeated"]) == (200, True)


async def refuse(*_: object) -> None:
    raise AssertionError("it serves")


def test_a_server_is_refused_where_the_owner_shares_with_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "NO_OWNER_S", 0.0)
    other = Settings(data_dir=tmp_path, port=0, shared="http://127.0.0.1:8000")
    with (
        alone(Settings(data_dir=tmp_path)),
        pytest.raises(
            SettingsError, match="both with --shared, one data directory and an address each"
        ),
    ):
        serve(other, refuse)


def test_a_server_that_would_admit_others_than_the_owner_is_refused(tmp_path: Path) -> None:
    one = Settings(data_dir=tmp_path, port=0, shared="http://127.0.0.1:8001")
    other = replace(one, shared="http://127.0.0.1:8002", token="of sixteen letters")
    with (
        alone(one),
        shared(one),
        pytest.raises(SettingsError, match="8001, which owns the database, has another token"),
    ):
        serve(other, refuse)


def test_who_relays_to_nobody_says_so_in_the_answer(
    tmp_path: Path, ports: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(relay, "HELD_S", 0.1)
    listening = listen(Settings(data_dir=tmp_path, port=ports[0]))

    async def ask() -> httpx2.Response:
        relaying = asyncio.create_task(
            relay.Relay(listening, lambda: f"http://127.0.0.1:{ports[1]}").run()
        )
        async with httpx2.AsyncClient(trust_env=False, timeout=PATIENCE) as client:
            answer = await client.get(f"http://127.0.0.1:{ports[0]}/healthz")
        relaying.cancel()
        return answer

    try:
        refused = problem(asyncio.run(ask()), 503)
    finally:
        listening.close()
    assert refused == "the server that owns the database does not answer: try again"
