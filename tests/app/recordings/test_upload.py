"""Uploads over a socket: an interruption at any moment leaves nothing behind."""

import asyncio
import json
import shutil
import socket
import threading

import httpx2
import pytest

from app import serving as serving_module
from app.recordings import upload as upload_module
from app.recordings.recordings import Recordings
from app.settings import Settings
from app.store.store import open_store
from core.monitor import MonitorRecipe, train
from tests.faults.server import running
from tests.support.api import api, problem, served, store_of
from tests.support.patience import PATIENCE, until
from tests.support.recorded import OCTETS, RECORDINGS, csv_of, kept_files, upload, uploaded

HEAD = "POST {path}?name=half.csv HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {length}\r\n"
HEAD += "Content-Type: application/octet-stream\r\n\r\n"
LENGTH = 4 * upload_module.BLOCK_BYTES
ENDLESS = {"n_unsafe": 2000, "maneuver": {"duration_s": 60.0}, "max_safe": 10}


@pytest.fixture(scope="module")
def file(flights):
    return csv_of(flights[0])


def half_sent(address, length=LENGTH, share=0.5):
    """A connection that has sent a part of a body."""
    host, port = address.removeprefix("http://").split(":")
    connection = socket.create_connection((host, int(port)), PATIENCE)
    connection.sendall(HEAD.format(path=RECORDINGS, length=length).encode())
    connection.sendall(b"0.0,1.0,2.0\n" * int(share * length / 12))
    return connection


def coming_in(data_dir):
    return list((data_dir / "recordings" / "incoming").glob("*/file"))


def some_came(data_dir):
    return any(file.stat().st_size for file in coming_in(data_dir))


def test_a_client_that_disconnects_half_way_leaves_nothing(tmp_path):
    with served(tmp_path) as (address, _):
        for close in ("shut", "reset"):
            connection = half_sent(address)
            until(lambda: some_came(tmp_path))
            if close == "reset":
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            connection.close()
            until(lambda: not kept_files(tmp_path))
        assert httpx2.get(f"{address}{RECORDINGS}").json() == []


def test_a_client_that_stops_sending_gets_an_error_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(upload_module, "STALL_AFTER_S", 0.2)
    with served(tmp_path) as (address, _), half_sent(address) as connection:
        answer = b"".join(iter(lambda: connection.recv(4096), b"")).decode()
        assert answer.startswith("HTTP/1.1 408")
        assert "no data for 0.2 s" in answer
        assert kept_files(tmp_path) == set()


def test_a_client_that_disconnects_during_reading_leaves_nothing(tmp_path, file, monkeypatch):
    reading, left = threading.Event(), threading.Event()
    real = Recordings._read

    def slow(self, *arguments):
        reading.set()
        assert left.wait(PATIENCE)
        return real(self, *arguments)

    monkeypatch.setattr(Recordings, "_read", slow)
    with served(tmp_path) as (address, server):
        host, port = address.removeprefix("http://").split(":")
        connection = socket.create_connection((host, int(port)), PATIENCE)
        connection.sendall(HEAD.format(path=RECORDINGS, length=len(file)).encode() + file)
        assert reading.wait(PATIENCE)
        connection.close()
        httpx2.get(f"{address}/healthz")  # its loop has come round since
        left.set()
        until(lambda: not server.app.state.recordings.under_way)
        assert kept_files(tmp_path) == set()
        assert httpx2.get(f"{address}{RECORDINGS}").json() == []


def test_a_server_that_stops_leaves_nothing_of_uploads_in_progress(tmp_path, monkeypatch):
    monkeypatch.setattr(serving_module, "PATIENCE", 0)
    with served(tmp_path) as (address, _):
        connection = half_sent(address)
        until(lambda: coming_in(tmp_path))
    connection.close()
    assert kept_files(tmp_path) == set()


def test_a_server_that_is_killed_leaves_nothing_half_done_after_its_next_start(
    tmp_path, file, dataset
):
    """Of an upload; and its job and its flight are interrupted."""
    store = open_store(Settings(data_dir=tmp_path).url)
    monitor = store.monitors.add(train(dataset, MonitorRecipe(epsilon=0.2)), "oscillator").id
    store.close()
    with running(tmp_path, max_jobs=1) as (process, server):
        address = str(server.base_url).rstrip("/")
        query = {"name": "whole.csv"}
        response = httpx2.post(
            f"{address}{RECORDINGS}", params=query, content=file, headers=OCTETS, timeout=PATIENCE
        )
        assert response.status_code == 201, response.text
        source = {"kind": "simulated", "recipe": {"n_unsafe": 2}}
        flown = httpx2.post(
            f"{address}/api/v1/flights", json={"source": source, "monitor": monitor}
        )
        assert flown.status_code == 201, flown.text
        job = httpx2.post(f"{address}/api/v1/datasets", json=ENDLESS).headers["location"]
        until(lambda: httpx2.get(f"{address}{job}").json()["status"] == "running")
        with half_sent(address):
            until(lambda: some_came(tmp_path))
            process.kill()
            process.join(PATIENCE)
    assert coming_in(tmp_path)
    with api(tmp_path) as client:
        assert client.get(job).json()["status"] == "interrupted"
        store = store_of(client)
        assert store.flights.info(flown.json()["id"]).status == "interrupted"
        assert store.damage() == []
        assert coming_in(tmp_path) == []
        recording = response.json()
        assert [entry["id"] for entry in client.get(RECORDINGS).json()] == [recording["id"]]
        assert client.get(f"{RECORDINGS}/{recording['id']}").json() == recording
        assert {name.partition("/")[0] for name in kept_files(tmp_path)} == {recording["id"]}


@pytest.mark.parametrize("moment", ["row", "folder", "withdrawn", "gone", "scoring"])
def test_incomplete_files_of_a_crashed_server_are_removed(tmp_path, file, moment):
    """Crash between any two steps of adding, removing and scoring."""
    with api(tmp_path) as client:
        whole = uploaded(client, file, name="whole.csv")
        half = uploaded(client, file, name="half.csv")["id"]
        expected = {name for name in kept_files(tmp_path) if not name.startswith(half)}
    root = tmp_path / "recordings"
    store = open_store(Settings(data_dir=tmp_path).url)
    if moment == "scoring":
        for name in ("0123.npy", "0123.tiles.npy", ".0123.npy.abc"):
            (root / whole["id"] / "scorings" / name).write_bytes(b"half")
            (root / half / "scorings" / name).write_bytes(b"half")
    else:
        store.recordings.withdraw(half)
    if moment == "row":
        (root / half).rename(root / "incoming" / half)
    elif moment == "gone":
        (root / half).rename(root / "incoming" / f"{half}.gone")
        shutil.rmtree(root / "incoming" / f"{half}.gone" / "columns")
    store.close()
    with api(tmp_path) as client:
        left = {entry["id"] for entry in client.get(RECORDINGS).json()}
        assert left == ({whole["id"], half} if moment == "scoring" else {whole["id"]})
        assert client.get(f"{RECORDINGS}/{whole['id']}").json() == whole
        files = kept_files(tmp_path)
        assert {name for name in files if not name.startswith(half)} == expected
        assert not [name for name in files if "0123" in name]


def test_folders_that_no_row_knows_are_left_alone(tmp_path, file):
    """They may belong to another database: nothing of them is deleted for that."""
    with api(tmp_path, database_url=f"sqlite:///{tmp_path}/one.db") as client:
        identity = uploaded(client, file)["id"]
        files = kept_files(tmp_path)
    with api(tmp_path, database_url=f"sqlite:///{tmp_path}/two.db") as client:
        assert client.get(RECORDINGS).json() == []
        assert kept_files(tmp_path) == files
    with api(tmp_path, database_url=f"sqlite:///{tmp_path}/one.db") as client:
        assert client.get(f"{RECORDINGS}/{identity}").status_code == 200


def test_the_event_loop_is_free_while_a_file_is_read(tmp_path, file, monkeypatch):
    """Another request is answered while the reading waits for it."""
    reading, answered = threading.Event(), threading.Event()
    real = Recordings._read

    def waiting(self, *arguments):
        reading.set()
        assert answered.wait(PATIENCE)
        return real(self, *arguments)

    monkeypatch.setattr(Recordings, "_read", waiting)
    with api(tmp_path) as client:
        answers = []
        sender = threading.Thread(target=lambda: answers.append(upload(client, file)))
        sender.start()
        assert reading.wait(PATIENCE)
        assert client.get("/healthz").status_code == 200
        answered.set()
        sender.join(PATIENCE)
        assert answers[0].status_code == 201


def test_a_body_goes_to_disk_in_blocks(tmp_path):
    """However large, no more than a block and a chunk of it is in memory."""
    asked = []
    chunk = bytes(range(256)) * 400

    async def body():
        for _ in range(50):
            yield chunk

    received = asyncio.run(upload_module.receive(body(), tmp_path / "file", asked.append))
    assert received.size == 50 * len(chunk) == (tmp_path / "file").stat().st_size
    assert max(asked) < upload_module.BLOCK_BYTES + len(chunk)
    assert sum(asked) == received.size


def test_a_refused_upload_gets_a_reason_in_one_sentence(tmp_path):
    with api(tmp_path) as client:
        detail = problem(upload(client, b"\0" * 5000, name="noise.bin"), 422)
        assert json.dumps(detail).count("\\n") == 0
