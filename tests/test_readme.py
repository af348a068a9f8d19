import json
import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2
import pytest

from app.cli import main
from app.client import LiveClient
from core.collection import DatasetRecipe, collect
from core.monitor import MonitorRecipe, train
from tests.faults.test_full_disk import until
from tests.support.api import served
from tests.support.live_server import LiveServer, live_server
from tests.support.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
SECTIONS = {part.partition("\n")[0]: part for part in README.split("\n## ")}
SMALL = {
    "study": ["--n-monitors", "2", "--n-test", "50"],
    "train": ["--n-test", "200"],
    "report": ["--n-test", "200"],
}


def blocks(section: str, language: str) -> list[str]:
    """The code of a section that is written in a language."""
    return re.findall(rf"```{language}\n(.*?)```", SECTIONS[section], re.DOTALL)


def test_commands_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    commands = re.findall(
        r"^ {4,6}forewarn ((?:study|train|sample-flight|score|report) .*)$", README, re.MULTILINE
    )
    assert len(commands) == 7
    for command in commands:
        arguments = shlex.split(command)
        assert main([*arguments, *SMALL.get(arguments[0], [])]) == 0, command
    assert (tmp_path / "flight-scored" / "scored.svg").exists()
    assert (tmp_path / "flight-report.html").exists()


def test_files_are_sent_as_the_readme_says(tmp_path: Path):
    assert main(["sample-flight", "--out", str(tmp_path / "flight.csv")]) == 0
    train(collect(DatasetRecipe()), MonitorRecipe()).save(tmp_path / "monitor.fwm")
    commands = re.findall(r"^    (curl .*)$", README, re.MULTILINE)
    assert len(commands) == 3
    with served(tmp_path / "data") as (address, _):
        for command in commands:
            words = shlex.split(command.replace("http://127.0.0.1:8000", address))
            assert re.search(rf"{address}/api/v1/\w+", words[-1])
            answer = subprocess.run(
                [words[0], "--silent", "--fail", *words[1:]], cwd=tmp_path, stdout=subprocess.PIPE
            )
            assert answer.returncode == 0, command
            assert json.loads(answer.stdout)["name"] in ("flight.csv", "monitor")


def test_the_client_of_the_readme_watches_a_flight(tmp_path: Path):
    (code,) = blocks("Watching a flight from a program", "py")
    times: list[float] = []
    with served(tmp_path / "data") as (address, server):
        monitor = train(collect(DatasetRecipe()), MonitorRecipe())
        flown = server.app.state.store.monitors.add(monitor, "doublet").id
        body = {"source": {"kind": "simulated", "seed": 1}, "monitor": flown}
        started = httpx2.post(f"{address}/api/v1/flights", json=body).raise_for_status()
        flight = f"{address}/api/v1/flights/{started.json()['id']}"

        def told(t: float, _: float | None) -> None:
            times.append(t)
            if len(times) == 30:
                httpx2.post(f"{flight}/end").raise_for_status()

        host = urlsplit(address).netloc
        exec(compile(code.replace("127.0.0.1:8000", host), "README.md", "exec"), {"print": told})
    assert len(times) >= 30
    assert times == sorted(times)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


def flown(server: LiveServer, **source: Any) -> str:
    """Id of a live flight that is started."""
    body = {"source": {"kind": "live", **source}, "monitor": server.monitor_id}
    answer = httpx2.post(f"{server.url}/api/v1/flights", json=body).raise_for_status()
    return answer.json()["id"]


def test_the_curl_scripts_of_the_readme_push_batches_and_change_limits(server: LiveServer):
    script = "\n".join(blocks("Live flights", "sh"))
    script = script.replace("http://127.0.0.1:8000", server.url)
    run = subprocess.run(["bash", "-ec", script], stdout=subprocess.PIPE, text=True, check=True)
    answers = json.loads(f"[{run.stdout.replace('}{', '},{')}]")
    first, second, status, ended, third, limits, _ = answers
    assert (third["accepted"], limits["case"], limits["limits"]["Ny"]) == (1, "from M 0.8 on", 0.4)
    assert (first["accepted"], second["accepted"], second["repeated"]) == (1, 2, False)
    assert status["last_sequence"] == 1
    kinds = re.findall(r"^\| `(\w+)` \|", SECTIONS["Live flights"], re.MULTILINE)
    assert kinds == [*status["counts"]]
    assert ended["progress"] == "ended"


def test_the_udp_sender_and_the_client_of_the_readme_are_taken(server: LiveServer):
    sender, client = blocks("Live flights", "python")
    columns = ("timestamp", "air/beta_deg", "air/ay_g", "body/p_degps", "body/r_degps")
    rows = [f"{0.02 * k}" + f",{k % 7}" * 6 for k in range(200)]
    file = "\n".join([",".join([*columns, "body/da_deg", "body/dr_deg"]), *rows])
    recordings = f"{server.url}/api/v1/recordings"
    sent = httpx2.post(recordings, files={"file": ("names.csv", file)}).json()
    flight = flown(server, udp=0, recording=sent["id"])
    with LiveClient(server.url) as waiting:
        waiting.join(flight)
        port = str(waiting.status()["udp"]).rpartition(":")[2]
        sender = sender.replace("9870", port).replace("sleep(0.02)", "sleep(0.0)")
        exec(compile(sender, "README.md", "exec"), {})
        until(lambda: waiting.status()["batches"] == 100)
        assert waiting.status()["malformed"] == 0
    client = client.replace("http://127.0.0.1:8000", server.url)
    told: list[Any] = []
    code = compile(client.replace("MONITOR", server.monitor_id), "README.md", "exec")
    exec(code, {"print": lambda *words: told.append(words)})
    assert told == [(True, 100, "samples are durable")]


def test_the_pushes_of_the_readme_are_durable(server: LiveServer, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["sample-flight"]) == 0
    pushes = re.findall(r"^    forewarn (push .*)$", SECTIONS["Live flights"], re.MULTILINE)
    assert len(pushes) == 2
    for line in pushes:
        ids = line.replace("MONITOR", server.monitor_id).replace("FLIGHT", flown(server, udp=0))
        words = [*shlex.split(ids), "--server", server.url, "--rate", "max"]
        assert main(words) == 0, line


def test_python_of_the_readme_runs(tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for code in blocks("From Python", "python"):
        exec(compile(code, "README.md", "exec"), names)
    assert names["monitor"].recipe == names["ahead"]
    assert "risk" in capsys.readouterr().out


def test_make_targets_of_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in re.findall(r"^    make (.*?)(?:#|$)", README, re.MULTILINE):
        for target in line.split():
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
