import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2
import pytest

from app.cli import COMMANDS, _parser, main
from app.client import LiveClient
from app.commands.options.jsbsim_simulator import jsbsim_simulator
from app.main import STATIC
from app.routes.guide import SLUGS
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from tests.support import pitch_fmu
from tests.support.api import served
from tests.support.command_line_page import PAGE, page
from tests.support.live_server import LiveServer, live_server
from tests.support.patience import until

GUIDE = STATIC / "guide"
SMALL = {
    "study": ["--n-monitors", "2", "--n-test", "50"],
    "train": ["--n-unsafe", "60", "--n-test", "20", "--epsilon", "0.1"],
    "combine": ["--n-unsafe", "50", "--n-test", "200"],
    "choose-epsilon": ["--n-test", "3000"],
}
"""Options that keep a command short; the last of an option counts."""
ENDLESS = ("serve", "demo")
MINUTES = ("sweep",)


def text_of(slug: str) -> str:
    return (GUIDE / f"{slug}.md").read_text(encoding="utf-8")


def blocks(slug: str, language: str) -> list[str]:
    """The code of a page that is written in a language."""
    return re.findall(rf"```{language}\n(.*?)```", text_of(slug), re.DOTALL)


def commands(slug: str) -> list[list[str]]:
    """The arguments of each `forewarn` command of a page."""
    lines = "".join(blocks(slug, "sh")).splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("forewarn ")]


def test_every_page_is_served():
    assert {path.stem for path in GUIDE.glob("*.md")} == {"README", *SLUGS}


def test_the_page_on_the_command_line_is_what_the_parser_says():
    assert PAGE.read_text(encoding="utf-8") == page(), "run `make command-line`"


@pytest.mark.parametrize("slug", SLUGS)
def test_commands_and_options_of_a_page_exist(slug: str):
    for arguments in commands(slug):
        assert arguments[0] in COMMANDS
        options, unknown = _parser(arguments[0]).parse_known_args(arguments)
        assert not unknown, arguments
        assert options.run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a reader would be, with what the first pages write."""
    folder = tmp_path_factory.mktemp("guide")
    (folder / "model.json").write_text(*blocks("first-monitor", "json"))
    (folder / "kick.csv").write_text(*blocks("first-monitor", "csv"))
    return folder


@pytest.mark.usefixtures("few_flights")
@pytest.mark.parametrize("slug", ["first-monitor", "first-recording", "own-simulator", "method"])
def test_commands_of_a_page_run(slug: str, folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(folder)
    assert commands(slug)
    if slug == "first-recording":
        assert main(["sample-flight"]) == 0
        lines = Path("flight.csv").read_text().splitlines()
        Path("rows.csv").write_text("\n".join(line.partition(",")[2] for line in lines))
    if slug == "own-simulator":
        monkeypatch.setattr(sys, "path", [*sys.path])
        module, *code = blocks(slug, "python")
        Path("pitch.py").write_text(module)
        exec("".join(code), {})
        point, aircraft = blocks(slug, "json")
        Path("point.json").write_text(point)
        Path("c172p.json").write_text(aircraft)
        assert len(jsbsim_simulator("jsbsim:c172p", Path("c172p.json")).parameters) == 31
        if not pitch_fmu.MISSING:
            pitch_fmu.make_fmu(Path("model.fmu"))
    for arguments in commands(slug):
        small = [] if "--rollouts" in arguments else SMALL.get(arguments[0], [])
        is_slow = arguments[0] in MINUTES or "jsbsim:c172p" in arguments
        if not is_slow and not ("model.fmu" in arguments and pitch_fmu.MISSING):
            assert main([*arguments, *small]) == 0, arguments


def test_commands_on_stored_data_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(tmp_path / "data"))
    with served(tmp_path / "data") as (address, _):
        httpx2.get(f"{address}/api/v1/monitors").raise_for_status()
    (tmp_path / "backups").mkdir()
    for arguments in commands("several-people") + commands("keeping-data"):
        files = [str(file) for word in arguments for file in tmp_path.glob(word) if "*" in word]
        words = [word for word in arguments if "*" not in word]
        assert main([*words, *files]) == 0, arguments


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


def flown(server: LiveServer, **source: Any) -> str:
    """Id of a live flight that is started."""
    body = {"source": {"kind": "live", **source}, "monitor": server.monitor_id}
    answer = httpx2.post(f"{server.url}/api/v1/flights", json=body).raise_for_status()
    return answer.json()["id"]


def answers_of(server: LiveServer, slug: str) -> list[Any]:
    """What the server answered to the script of a page."""
    script = "".join(block for block in blocks(slug, "sh") if block.startswith(("api=", "set=")))
    script = script.replace("http://127.0.0.1:8000", server.url)
    run = subprocess.run(["bash", "-ec", script], stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(f"[{run.stdout.replace('}{', '},{')}]")


def test_the_script_of_the_first_live_flight_pushes_batches(server: LiveServer):
    first, second, status, ended = answers_of(server, "first-live-flight")
    assert (first["accepted"], second["accepted"], second["repeated"]) == (1, 2, False)
    assert status["last_sequence"] == 1
    kinds = re.findall(r"^\| `(\w+)` \| [^|]+ \|$", text_of("first-live-flight"), re.MULTILINE)
    assert [kind for kind in kinds if kind in status["counts"]] == [*status["counts"]]
    assert ended["progress"] == "ended"


def test_the_script_of_own_rollouts_adds_them(
    server: LiveServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    exec(blocks("own-simulator", "python")[1], {})
    preview, job = answers_of(server, "own-simulator")
    assert preview["n_flights"] == 1500
    path = f"{server.url}/api/v1/jobs/{job['id']}"
    until(lambda: httpx2.get(path).json()["status"] not in ("queued", "running"))
    assert httpx2.get(path).json()["result"]["findings"] == []


def test_the_script_of_the_limit_sets_changes_limits(server: LiveServer):
    accepted, limits, _, sent, flight, _ = answers_of(server, "limit-sets")
    assert (accepted["accepted"], limits["case"]) == (1, "from M 0.8 on")
    assert limits["limits"]["Ny"] == 0.4
    assert (sent["accepted"], flight["monitor_set"]["case"]) == (4, "high")


def test_the_udp_sender_and_the_client_reach_a_flight(server: LiveServer):
    sender, client = blocks("first-live-flight", "python")
    columns = ("timestamp", "air/beta_deg", "air/ay_g", "body/p_degps", "body/r_degps")
    rows = [f"{0.02 * k}" + f",{k % 7}" * 6 for k in range(200)]
    file = "\n".join([",".join([*columns, "body/da_deg", "body/dr_deg"]), *rows])
    recordings = f"{server.url}/api/v1/recordings"
    sent = httpx2.post(recordings, files={"file": ("names.csv", file)}).json()
    path = f"{recordings}/{sent['id']}/mapping"
    httpx2.put(path, json=sent["mapping"]).raise_for_status()
    flight = flown(server, udp=0, recording=sent["id"])
    with LiveClient(server.url) as waiting:
        waiting.join(flight)
        port = str(waiting.status()["udp"]).rpartition(":")[2]
        sender = sender.replace("9870", port).replace("sleep(0.02)", "sleep(0.0)")
        exec(compile(sender, "first-live-flight.md", "exec"), {})
        until(lambda: waiting.status()["batches"] == 100)
        assert waiting.status()["malformed"] == 0
    client = client.replace("http://127.0.0.1:8000", server.url)
    printed: list[Any] = []
    code = compile(client.replace("MONITOR", server.monitor_id), "first-live-flight.md", "exec")
    exec(code, {"print": lambda *words: printed.append(words)})
    assert printed == [(True, 100, "samples are durable")]


def test_pushes_are_durable(server: LiveServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert main(["sample-flight"]) == 0
    lines = [words for words in commands("first-live-flight") if words[0] == "push"]
    assert len(lines) == 3
    cases = [{"name": "all", "monitor": server.monitor_id, "ranges": {"mach": [0.8, 0.9]}}]
    body = {"name": "doublet", "cases": cases}
    made = httpx2.post(f"{server.url}/api/v1/monitor-sets", json=body).raise_for_status()
    for words in lines:
        ids = {"MONITOR": server.monitor_id, "SET": made.json()["id"]}
        if "FLIGHT" in words:
            ids["FLIGHT"] = flown(server, udp=0)
        words = [ids.get(word, word) for word in words]
        assert main([*words, "--server", server.url, "--rate", "max"]) == 0, words


def test_examples_of_rest_and_streams_run(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(["sample-flight", "--out", str(tmp_path / "flight.csv")]) == 0
    (curls,) = blocks("rest-and-streams", "sh")
    scored, job, watched, *library = blocks("rest-and-streams", "python")
    assert len(library) == 2
    times: list[float] = []
    with served(tmp_path / "data") as (address, server):
        monitor = train(collect(DatasetRecipe()), MonitorRecipe())
        monitor.save(tmp_path / "monitor.fwm")
        stored = server.app.state.store.monitors.add(monitor, "doublet").id
        for command in curls.splitlines():
            words = shlex.split(command.replace("http://127.0.0.1:8000", address))
            answer = subprocess.run(
                [words[0], "--silent", "--fail", *words[1:]], cwd=tmp_path, stdout=subprocess.PIPE
            )
            assert answer.returncode == 0, command
            assert json.loads(answer.stdout)["name"] in ("flight.csv", "monitor")
        body = {"source": {"kind": "simulated", "seed": 1}, "monitor": stored}
        started = httpx2.post(f"{address}/api/v1/flights", json=body).raise_for_status()
        flight = f"{address}/api/v1/flights/{started.json()['id']}"

        def print_time(t: float, _: float | None) -> None:
            times.append(t)
            if t > 1.0 >= max(times[:-1], default=0.0):  # once; a busy machine gets few frames
                httpx2.post(f"{flight}/end").raise_for_status()

        names: dict[str, Any] = {}
        host = urlsplit(address).netloc
        for code in (scored, job, watched):
            names["print"] = print_time if code == watched else print
            code = code.replace("127.0.0.1:8000", host)
            exec(compile(code, "rest-and-streams.md", "exec"), names)
    assert times
    assert times == sorted(times)
    printed = capsys.readouterr().out
    assert "0.15" in printed
    assert "done" in printed


def test_python_without_a_server_runs(tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for code in blocks("rest-and-streams", "python")[3:]:
        code = code.replace("n_unsafe=200", "n_unsafe=60")
        exec(compile(code, "rest-and-streams.md", "exec"), names)
    assert names["monitor"].recipe == names["ahead"]
    assert "risk" in capsys.readouterr().out


def test_every_command_of_the_page_on_the_command_line_is_of_the_program():
    headings = re.findall(r"^## forewarn (\S+)$", text_of("command-line"), re.MULTILINE)
    assert headings == [*COMMANDS]
    assert {*ENDLESS, *MINUTES} < {*COMMANDS}
