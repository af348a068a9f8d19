import json
import re
import shlex
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import httpx2
import pytest

from app.cli import main
from core.collection import DatasetRecipe, collect
from core.monitor import MonitorRecipe, train
from tests.support.api import served
from tests.support.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
SMALL = {
    "study": ["--n-monitors", "2", "--n-test", "50"],
    "train": ["--n-test", "200"],
    "report": ["--n-test", "200"],
}


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
    (code,) = re.findall(r"```py\n(.*?)```", README, re.DOTALL)
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


def test_python_of_the_readme_runs(tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    assert "risk" in capsys.readouterr().out


def test_make_targets_of_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in re.findall(r"^    make (.*?)(?:#|$)", README, re.MULTILINE):
        for target in line.split():
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
