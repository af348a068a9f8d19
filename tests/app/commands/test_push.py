"""`forewarn push`: a recording as its source sent it, when each sample is due; all is durable."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest

from app.cli import main
from app.client import LiveClient
from app.commands import push
from app.commands.recorded_rows import si_rows
from app.commands.sample_flight import TRIM_S, table
from app.telemetry.mapping.proposal import propose
from app.telemetry.reading import columns_of
from core.channels import KEYS
from core.planned_test.collection import DatasetRecipe, evaluation_flights
from core.types import Array
from tests.support import own_channels, short_period
from tests.support.live_server import LiveServer, journal_samples, live_server
from tests.support.recorded import csv_of

pytestmark = pytest.mark.usefixtures("read_here")
DT = DatasetRecipe().dt


@cache
def flown() -> Array:
    """What `sample-flight` writes, y (n, 6): simulated where a test asks for it."""
    return evaluation_flights(DatasetRecipe(seed=0), 1).y[0]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("file") / "flight.csv"
    path.write_text(table(flown(), DT))
    return path


def pushed(capsys: pytest.CaptureFixture, *words: Any) -> tuple[int, dict[str, Any]]:
    """Exit and printed result of a push."""
    code = main(["push", *map(str, words), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_file_is_pushed_in_si_units_and_is_durable(server: LiveServer, file: Path, capsys):
    options = ["--monitor", server.monitor_id, "--server", server.url, "--rate", "max"]
    code = main(["push", str(file), *options, "--name", "twice", "--json"])
    shown = capsys.readouterr()
    result = json.loads(shown.out)
    assert "not sent at the recorded rate" in shown.err
    assert (code, result["durable"], result["interrupted"]) == (0, result["samples"], False)
    assert result["address"] == f"{server.url}/#/fly/{result['flight']}"
    flight = httpx2.get(f"{server.url}/api/v1/flights/{result['flight']}").json()
    assert (flight["name"], flight["progress"]) == ("twice", "ended")
    for i, key in enumerate(KEYS):
        sent = journal_samples(server.root, result["flight"], key)
        assert sent[-len(flown()) :] == pytest.approx(flown()[:, i].tolist(), abs=1e-9)


def test_a_flight_that_was_given_is_ended_too_unless_it_is_to_stay_open(
    server: LiveServer, file: Path, capsys
):
    options = ["--server", server.url, "--rate", "max"]
    _, first = pushed(capsys, file, "--monitor", server.monitor_id, *options, "--keep-open")
    path = f"{server.url}/api/v1/flights/{first['flight']}"
    assert httpx2.get(path).json()["progress"] == "running"
    later = file.with_name("later.csv")
    rows = file.read_text().splitlines()
    later.write_text(
        rows[0]
        + "\n"
        + "\n".join(f"{1000 + k}{row[row.index(',') :]}" for k, row in enumerate(rows[1:]))
    )
    code, _ = pushed(capsys, later, "--flight", first["flight"], *options)
    assert (code, httpx2.get(path).json()["progress"]) == (0, "ended")


def test_a_flight_that_reads_the_names_of_a_recording_is_refused(
    server: LiveServer, file: Path, capsys
):
    recordings = f"{server.url}/api/v1/recordings"
    sent = httpx2.post(recordings, files={"file": ("f.csv", file.read_bytes())}).json()
    live = {"source": {"kind": "live", "recording": sent["id"]}, "monitor": server.monitor_id}
    unconfirmed = httpx2.post(f"{server.url}/api/v1/flights", json=live)
    assert (unconfirmed.status_code, "confirm it" in unconfirmed.text) == (422, True)
    confirmed = httpx2.put(f"{recordings}/{sent['id']}/mapping", json=sent["mapping"])
    confirmed.raise_for_status()
    flight = httpx2.post(f"{server.url}/api/v1/flights", json=live).json()["id"]
    options = ["--server", server.url, "--rate", "max", "--flight", flight]
    assert main(["push", str(file), *options]) == 1
    assert "names of a recording" in capsys.readouterr().err


class Watched:
    """A client that notes when each sample comes, by a clock that only sleeping moves."""

    problem = ""

    def __init__(self, slow: float = 0.0) -> None:
        self.now, self.slow, self.sent = 100.0, slow, []

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def send(self, sample: dict[str, float]) -> None:
        self.sent.append((self.now, sample["t"]))
        self.now += self.slow

    def flush(self) -> bool:
        return True


@pytest.mark.parametrize("rate", [1.0, 4.0, float("inf")])
def test_each_sample_is_sent_when_it_is_due_without_drift(
    rate: float, file: Path, monkeypatch: pytest.MonkeyPatch
):
    client, rows = Watched(slow=0.25 * DT / rate), si_rows(file, None)
    monkeypatch.setattr(push, "time", client)
    push._push(client, rows, rate)  # pyright: ignore[reportArgumentType]
    assert len(client.sent) == len(rows.t)
    for now, t in client.sent:
        assert now - 100.0 == pytest.approx((t - rows.t[0]) / rate, abs=1e-9)


def test_what_was_sent_is_said_when_it_is_interrupted(
    server: LiveServer, file: Path, capsys, monkeypatch: pytest.MonkeyPatch
):
    send = LiveClient.send

    def interrupted(self: LiveClient, sample: Any) -> None:
        if self.sent == 5:
            raise KeyboardInterrupt
        send(self, sample)

    monkeypatch.setattr(LiveClient, "send", interrupted)
    options = ["--monitor", server.monitor_id, "--server", server.url, "--rate", "max"]
    assert main(["push", str(file), *options]) == 130
    printed = capsys.readouterr().out
    n = len(flown()) + round(TRIM_S / DT)
    assert f"interrupted: 5 of {n} samples were sent" in printed
    assert f"durable: 5 of {n} samples" in printed


def test_a_constant_value_is_sent_unless_a_person_called_it_a_bias(
    server: LiveServer, tmp_path: Path, capsys
):
    biased, given = tmp_path / "biased.csv", tmp_path / "given.json"
    head, *rows = table(flown(), DT).splitlines()
    ny = head.split(",").index("ay_g")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[ny] = f"{float(row[ny]) + 0.225:.9g}"
    biased.write_text("\n".join([head, *map(",".join, cells)]))
    options = ["--monitor", server.monitor_id, "--server", server.url, "--rate", "max"]
    assert main(["push", str(biased), *options, "--json"]) == 0
    shown = capsys.readouterr()
    assert "bias removed" not in shown.err
    assert "mean of 0.225 g" in shown.err
    flight = f"{server.url}/api/v1/flights/{json.loads(shown.out)['flight']}"
    trims = httpx2.get(flight).json()["live"]["trims"]
    assert [(trim["channel"], trim["value"]) for trim in trims] == [("Ny", pytest.approx(0.225))]
    with columns_of(biased) as columns:
        mapping = propose(columns).mapping
    assert mapping.channels["Ny"].bias == pytest.approx(0.225)
    given.write_text(json.dumps(asdict(mapping)))
    sent, stated = si_rows(biased, None), si_rows(biased, given)
    ny = sent.names.index("Ny")
    assert sent.values[:50, ny] == pytest.approx(0.225)
    assert stated.values[:50, ny] == pytest.approx(0.0)
    assert any("bias removed: 0.225 g" in note for note in stated.notes)


def test_a_flight_that_somebody_ends_is_told_with_what_is_durable(
    server: LiveServer, file: Path, capsys, monkeypatch: pytest.MonkeyPatch
):
    send = LiveClient.send

    def ending(self: LiveClient, sample: Any) -> None:
        if self.sent == 5:
            self.end()
        send(self, sample)

    monkeypatch.setattr(LiveClient, "send", ending)
    options = ["--monitor", server.monitor_id, "--server", server.url, "--rate", "max"]
    code, result = pushed(capsys, file, *options)
    assert (code, result["durable"]) == (1, 5)
    assert "accepts no samples" in result["failure"]


def test_a_push_that_is_refused_entirely_ends_only_a_flight_that_it_started(
    server: LiveServer, tmp_path: Path, capsys
):
    path = tmp_path / "beta.csv"
    path.write_text("t_s,beta_deg\n" + "".join(f"{0.02 * k},{k % 3}\n" for k in range(50)))
    to = ["--server", server.url, "--rate", "max"]
    begun = ["--monitor", server.monitor_id, *to]
    code, opened = pushed(capsys, path, *begun, "--keep-open")
    given = ["--flight", opened["flight"], *to]
    for options, progress in ((begun, "ended"), (given, "running")):
        code, result = pushed(capsys, path, *options)
        flight = httpx2.get(f"{server.url}/api/v1/flights/{result['flight']}").json()
        assert (code, result["refused"], flight["progress"]) == (1, 50, progress)


def test_what_is_refused_is_counted_and_is_no_success(server: LiveServer, tmp_path: Path, capsys):
    path = tmp_path / "beta.csv"
    path.write_text("t_s,beta_deg\n" + "".join(f"{0.02 * k},{k % 3}\n" for k in range(50)))
    options = ["--monitor", server.monitor_id, "--server", server.url, "--rate", "max"]
    code, result = pushed(capsys, path, *options)
    assert (code, result["durable"], result["refused"]) == (1, 0, 50)
    assert "missing channels" in result["refusal"]
    assert main(["push", str(path), *options, "--rate", "0x"]) == 1
    assert "write 1x, 4x" in capsys.readouterr().err


def test_a_file_is_read_by_the_channels_of_the_monitor_or_of_the_flight(
    server: LiveServer, tmp_path: Path, capsys
):
    trained = tmp_path / "pitch.fwm"
    own_channels.monitor(4).save(trained)
    sent = httpx2.post(
        f"{server.url}/api/v1/monitors", files={"file": ("pitch.fwm", trained.read_bytes())}
    )
    y = short_period.fly(np.random.default_rng(3), 1)[1][0]
    degrees = y * [np.degrees(1), np.degrees(1), 1, np.degrees(1)]
    file = tmp_path / "pitch.csv"
    head = "t_s,alpha_deg,q_degps,N_z,elevator (deg)"
    file.write_bytes(csv_of(degrees, short_period.DT, head=head))
    monitor = ["--monitor", sent.json()["id"]]
    options = ["--server", server.url, "--rate", "max"]
    code, result = pushed(capsys, file, *monitor, *options)
    assert (code, result["refused"]) == (0, 0)
    for i, key in enumerate(("alpha", "q", "Nz", "delta_e")):
        arrived = journal_samples(server.root, result["flight"], key)
        assert arrived == pytest.approx(y[:, i].tolist(), abs=1e-6)
    body = {"monitor": sent.json()["id"], "source": {"kind": "live"}}
    flight = httpx2.post(f"{server.url}/api/v1/flights", json=body, timeout=180).json()["id"]
    code, result = pushed(capsys, file, "--flight", flight, *options)
    assert (code, result["durable"]) == (0, len(y))


def test_channels_of_other_clocks_come_on_lines_between_their_samples(tmp_path: Path):
    import h5py

    path = tmp_path / "flight.h5"
    with h5py.File(path, "w") as written:
        for name, dt, signals in (
            ("air", 0.02, {"beta": "deg", "Ny": "g"}),
            ("body", 0.04, {"p": "deg/s", "r": "deg/s"}),
        ):
            t = dt * np.arange(round(4.0 / dt))
            for key, unit in {"time": "s", **signals}.items():
                values = t if key == "time" else np.sin(2.0 * t)
                written[f"{name}/{key}"] = values
                written[f"{name}/{key}"].attrs["units"] = unit
    rows = si_rows(path, None)
    assert len(rows.t) == 200
    assert any("p, r" in note for note in rows.notes)
    p = np.degrees(rows.values[:, rows.names.index("p")])
    assert p[:190] == pytest.approx(np.sin(2.0 * rows.t[:190]), abs=1e-3)


@pytest.fixture(scope="module")
def flown_set(server: LiveServer) -> str:
    """Id of a set whose monitor holds below 20,000 ft, and below or above Mach 0.8."""
    case = {"monitor": server.monitor_id, "ranges": {"altitude": [None, 6096.0]}}
    cases = [
        case | {"name": name, "ranges": {"mach": ends} | case["ranges"]}
        for name, ends in (("slow", [None, 0.8]), ("fast", [0.8, None]))
    ]
    body = {"name": "rudder doublet", "cases": cases}
    answer = httpx2.post(f"{server.url}/api/v1/monitor-sets", json=body)
    return answer.raise_for_status().json()["id"]


def with_columns(file: Path, to: Path, **columns: Any) -> Path:
    """The flight with further columns of one value each."""
    head, *rows = file.read_text().splitlines()
    more = ["".join(f",{text}" for text in texts) for texts in (columns, columns.values())]
    to.write_text("\n".join([head + more[0], *(row + more[1] for row in rows)]))
    return to


def test_a_file_is_flown_on_a_monitor_set_with_its_flight_condition(
    server: LiveServer, file: Path, flown_set: str, tmp_path: Path, capsys
):
    columns = {"Mach": 0.9, "altitude_ft": 10_000, "TAS_kt": 500, "configuration": 2}
    flight = with_columns(file, tmp_path / "f.csv", **columns)
    options = ["--monitor-set", flown_set, "--server", server.url, "--rate", "max"]
    code, result = pushed(capsys, flight, *options, "--keep-open")
    assert (code, result["refused"]) == (0, 0)
    path = f"{server.url}/api/v1/flights/{result['flight']}"
    status = httpx2.get(path).json()
    assert status["monitor_set"]["case"] == "fast"
    condition = status["live"]["condition"]
    assert condition.pop("dynamic_pressure") == "missing"
    expected = {"mach": 0.9, "altitude": 3048.0, "V": 257.222, "configuration": 2.0}
    assert condition == pytest.approx(expected, rel=1e-4)
    httpx2.post(f"{path}/end").raise_for_status()


def test_a_condition_that_a_set_needs_is_in_the_file_or_declared(
    server: LiveServer, file: Path, flown_set: str, capsys
):
    options = ["--server", server.url, "--rate", "max", "--monitor-set", flown_set]
    assert main(["push", str(file), *options, "--condition", "altitude=18000ft"]) == 1
    assert "--condition mach=VALUE" in capsys.readouterr().err
    declared = ["--condition", "altitude=18000ft", "--condition", "mach=0.6"]
    code, result = pushed(capsys, file, *options, *declared)
    flight = httpx2.get(f"{server.url}/api/v1/flights/{result['flight']}").json()
    assert code == 0
    assert flight["monitor_set"]["fixed"] == pytest.approx({"altitude": 5486.4, "mach": 0.6})
    for wrong, word in (("mch=1", "mach"), ("mach=x", "number"), ("altitude=3kg", "kg")):
        assert main(["push", str(file), *options, "--condition", wrong]) == 1
        assert word in capsys.readouterr().err


def test_a_flight_that_needs_what_the_file_lacks_is_pushed_with_a_warning(
    server: LiveServer, file: Path, flown_set: str, capsys
):
    body = {"monitor_set": flown_set, "source": {"kind": "live"}, "condition": {"mach": "air/M"}}
    flight = httpx2.post(f"{server.url}/api/v1/flights", json=body, timeout=180).json()["id"]
    options = ["--flight", flight, "--server", server.url, "--rate", "max"]
    assert main(["push", str(file), *options]) == 0
    assert "Mach number and altitude" in capsys.readouterr().err


def test_a_condition_is_sent_by_the_name_that_the_flight_expects(
    server: LiveServer, file: Path, flown_set: str, tmp_path: Path, capsys
):
    body = {"monitor_set": flown_set, "source": {"kind": "live"}, "condition": {"mach": "air/M"}}
    flight = httpx2.post(f"{server.url}/api/v1/flights", json=body, timeout=180).json()["id"]
    recorded = with_columns(file, tmp_path / "f.csv", Mach=0.9)
    code, _ = pushed(capsys, recorded, "--flight", flight, "--server", server.url, "--rate", "max")
    assert code == 0
    assert set(journal_samples(server.root, flight, "air/M")) == {0.9}


def test_the_number_of_a_configuration_is_held_not_interpolated(tmp_path: Path):
    import h5py

    path = tmp_path / "flight.h5"
    with h5py.File(path, "w") as written:
        fast, slow = 0.02 * np.arange(200), np.arange(5.0)
        for name, t in (("body", fast), ("state", slow)):
            written[f"{name}/time"] = t
            written[f"{name}/time"].attrs["units"] = "s"
        for key, unit in {"beta": "deg", "p": "deg/s", "r": "deg/s", "Ny": "g"}.items():
            written[f"body/{key}"] = np.sin(2.0 * fast)
            written[f"body/{key}"].attrs["units"] = unit
        written["state/configuration"] = [1.0, 1.0, 3.0, 3.0, 3.0]
    rows = si_rows(path, None)
    sent = rows.values[:, rows.names.index("configuration")]
    assert set(sent[: len(fast)]) == {1.0, 3.0}
    assert sent[rows.t < 1.99].max() == 1.0
