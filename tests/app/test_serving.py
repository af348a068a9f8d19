import asyncio
import signal
import socket
import sys
import threading
from base64 import b64encode
from multiprocessing import active_children
from typing import Any
from unittest.mock import AsyncMock, Mock

import httpx2
import pytest
from fastapi import FastAPI, Response

from app import demonstration, serving
from app.cli import main
from app.commands import demo
from app.demonstration import NAME
from app.http.events import Changes
from app.serving import Server, address_of, alone, listen
from app.settings import Settings, SettingsError
from app.store.store import open_store
from core.evaluation.rates import evaluate
from tests.support.api import command, served
from tests.support.patience import PATIENCE, until


def test_a_server_serves_its_page_and_stops_when_told(tmp_path):
    with command("serve", "--data-dir", str(tmp_path), "--port", "0") as (process, address):
        page = httpx2.get(address)
        assert page.status_code == 200
        assert page.headers["content-type"].startswith("text/html")
        assert "script-src 'self'" in page.headers["content-security-policy"]
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_a_second_server_of_the_same_data_is_refused(tmp_path):
    settings = Settings(data_dir=tmp_path)
    with (
        alone(settings),
        pytest.raises(SettingsError, match="another forewarn serves"),
        alone(settings),
    ):
        pass
    with alone(settings):
        pass


def test_a_second_server_of_the_same_database_is_refused(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path, target_is_directory=True)
    one, other, apart = (
        Settings(data_dir=tmp_path / name, database_url=f"sqlite:///{tmp_path}/{database}")
        for name, database in (("a", "x.db"), ("b", "link/x.db"), ("c", "y.db"))
    )
    with (
        alone(one),
        pytest.raises(SettingsError, match=r"another forewarn serves .*x\.db: .*--database-url"),
        alone(other),
    ):
        pass
    with alone(one), alone(apart):
        pass


def test_a_refusal_is_one_line(tmp_path, capsys):
    assert main(["serve", "--data-dir", str(tmp_path), "--host", "0.0.0.0"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        assert main(["serve", "--data-dir", str(tmp_path), "--port", port]) == 1
    assert "choose another port with --port" in capsys.readouterr().err


def test_real_time_scheduling_that_the_system_refuses_is_said_in_one_line(
    tmp_path, monkeypatch, capsys
):
    def refuse(*_: object) -> None:
        raise PermissionError("Operation not permitted")

    monkeypatch.setattr(serving.os, "sched_setscheduler", refuse)
    options = "--data-dir", str(tmp_path), "--port", "0"
    assert main(["serve", *options, "--real-time"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "not allowed here (Operation not permitted): allow it, on Linux by systemd's" in said


def test_the_socket_gives_up_on_watchers_that_do_not_read(tmp_path):
    settings = Settings(data_dir=tmp_path, port=0)
    listening = listen(settings)
    try:
        assert listening.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 5000
        assert address_of(listening, settings).startswith("http://127.0.0.1:")
    finally:
        listening.close()


def test_a_thread_that_computes_gives_the_loop_of_a_server_its_turn_sooner(tmp_path, monkeypatch):
    intervals = []

    async def look(*_: Any, **__: Any) -> None:
        intervals.append(sys.getswitchinterval())

    monkeypatch.setattr(serving, "gc", Mock())
    monkeypatch.setattr(Server, "serve", look)
    usual = sys.getswitchinterval()
    try:
        serving.serve(Settings(data_dir=tmp_path, port=0), AsyncMock())
    finally:
        sys.setswitchinterval(usual)
    assert intervals == [pytest.approx(serving.THREAD_TURN_S)]
    assert intervals[0] < usual


def test_a_watcher_has_a_small_buffer_and_a_download_a_large_one(tmp_path):
    with served(tmp_path) as (address, server):
        host, port = address.removeprefix("http://").split(":")

        def buffer_after(request):
            """Of the server's end of a connection that has asked and reads nothing [bytes]."""
            with socket.create_connection((host, int(port)), PATIENCE) as connection:
                connection.sendall(f"GET {request}\r\nHost: 127.0.0.1\r\n\r\n".encode())
                connection.recv(1)
                (protocol,) = server.server_state.connections
                end: Any = protocol
                return end.transport.get_extra_info("socket").getsockopt(
                    socket.SOL_SOCKET, socket.SO_SNDBUF
                )

        upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        upgrade += f"Sec-WebSocket-Key: {b64encode(bytes(16)).decode()}"
        watched = buffer_after(f"/api/v1/flights/none/stream HTTP/1.1\r\n{upgrade}")
        # the kernel counts its own bookkeeping too, and says twice what was asked for
        assert watched <= 2 * 32_768
        until(lambda: not server.server_state.connections)
        assert buffer_after("/healthz HTTP/1.1") > 2 * watched


def test_a_server_that_stops_drops_who_does_not_read(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(serving, "PATIENCE", 0.1)
    app = FastAPI()
    app.state.settings = Settings(data_dir=tmp_path, port=0)
    app.state.changes = Changes()
    app.add_api_route("/", lambda: Response(bytes(16_000_000)))
    listening = listen(app.state.settings)
    server = Server(app)
    thread = threading.Thread(target=lambda: asyncio.run(server.serve([listening])))
    with socket.create_connection(listening.getsockname(), PATIENCE) as connection:
        thread.start()
        connection.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        connection.recv(1)
        server.should_exit = True
        thread.join(PATIENCE)
    assert not thread.is_alive()
    assert not server.server_state.connections
    assert "Traceback" not in capsys.readouterr().err


def test_the_demonstration_finds_a_taken_port_before_it_trains(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert main(["demo", "--data-dir", str(tmp_path / "data"), "--port", port]) == 1
    assert "choose another port with --port" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_the_demonstration_flies_among_people_and_keeps_its_monitor(tmp_path):
    store = open_store(Settings(data_dir=tmp_path).url)
    _, token = store.tokens.add("Ann", "viewer")
    store.close()
    arguments = ("demo", "--data-dir", str(tmp_path), "--port", "0", "--no-browser")
    headers = {"Authorization": f"Bearer {token}"}
    with command(*arguments) as (process, address), httpx2.Client(headers=headers) as client:
        assert process.stdout is not None
        progress = client.get(f"{address}/api/v1/demonstration").json()
        assert 0 <= progress["share"] <= 1
        assert any("flying at" in line for line in process.stdout)
        (job,) = client.get(f"{address}/api/v1/jobs").json()
        assert (job["kind"], job["request"]["name"]) == ("monitor", NAME)
        (flight,) = client.get(f"{address}/api/v1/flights").json()
        assert flight["progress"] == "running"
        assert flight["transport"]["loop"] is True
        assert flight["fail_t"] is not None
        progress = client.get(f"{address}/api/v1/demonstration").json()
        assert (progress["phase"], progress["flight"]) == ("ready", flight["id"])
    with command(*arguments) as (process, address), httpx2.Client(headers=headers) as client:
        assert process.stdout is not None
        assert any("flying at" in line for line in process.stdout)
        assert len(client.get(f"{address}/api/v1/monitors").json()) == 1
        assert len(client.get(f"{address}/api/v1/jobs").json()) == 1
        assert client.get(f"{address}/api/v1/flights").json()[0]["progress"] == "running"


def test_a_demonstration_without_a_monitor_gives_the_reason():
    ended = {"id": "1", "ended": "now", "status": "failed", "error": "there is not enough memory"}
    with pytest.raises(ValueError, match="failed: there is not enough memory"):
        asyncio.run(demonstration.trained_monitor(Mock(), ended, Mock()))
    refused = Mock(is_error=True, json=lambda: {"detail": "the server is full"})
    with pytest.raises(ValueError, match="the server is full"):
        asyncio.run(demonstration.fly(Mock(post=AsyncMock(return_value=refused)), "m"))


def test_kernels_of_training_are_compiled_by_another_process_where_none_are(monkeypatch):
    monkeypatch.setattr(demo, "n_kernels", lambda: 0)
    with demo.compiling_ahead():
        assert len(active_children()) == 1
    assert active_children() == []
    monkeypatch.setattr(demo, "n_kernels", lambda: 1)
    with demo.compiling_ahead():
        assert active_children() == []


def test_what_is_compiled_ahead_trains_and_flies_a_monitor(monkeypatch):
    flown = []
    monkeypatch.setattr(demo, "evaluate", lambda *test: flown.append(evaluate(*test)))
    demo.train_on_noise()
    assert (flown[0].n_unsafe, flown[0].n_safe) == (100, 300)


def test_a_start_that_fails_is_one_sentence_and_exit_code_1(tmp_path, monkeypatch, capfd):
    def denied(*_):
        raise PermissionError(13, "Permission denied", str(tmp_path / "recordings"))

    monkeypatch.setattr("app.main.Recordings", denied)
    assert main(["serve", "--data-dir", str(tmp_path), "--port", "0"]) == 1
    printed = capfd.readouterr().err
    assert "Traceback" not in printed
    assert "Permission denied" in printed
    assert len(printed.splitlines()) == 1


def test_a_data_directory_that_cannot_be_written_is_refused(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("app.store.ownership.os.access", lambda *_: False)
    assert main(["serve", "--data-dir", str(tmp_path), "--port", "0"]) == 1
    assert "--data-dir" in capfd.readouterr().err
