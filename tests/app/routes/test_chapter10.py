"""A Chapter 10 recording from the upload to the scoring, mapped by its set-up record."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.cli import main
from core.channels import KEYS
from core.monitor import Monitor
from tests.support import ch10_flight
from tests.support.api import api, problem, store_of
from tests.support.attas import TEST, fly
from tests.support.ch10_flight import NAMES, OFFSETS, SCALES
from tests.support.recorded import RECORDINGS, uploaded

pytest.importorskip("chapter10")
HEAD = "t_s,beta_deg,p_degps,r_degps,Ny_g,delta_a_deg,delta_r_deg"
BUS = "1553 channel 5 (NAV) from RT03 SA02"


@pytest.fixture(scope="module")
def files() -> tuple[bytes, bytes]:
    """The recording, and a table of the values that its counts mean."""
    flown = fly(30, 5)
    y = np.concatenate([flown.y[~flown.is_unsafe][0], flown.y[flown.is_unsafe][0]])[:400]
    values = {key: x if key == "Ny" else np.degrees(x) for key, x in zip(KEYS, y.T, strict=True)}
    content, exact, t = ch10_flight.recorded(values, TEST.dt)
    rows = np.column_stack([t, *(exact[key] for key in KEYS)]).tolist()
    table = "\n".join([HEAD, *(",".join(map(repr, row)) for row in rows), ""])
    return content, table.encode()


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory, attas: Monitor) -> Iterator[TestClient]:
    with api(tmp_path_factory.mktemp("data")) as client:
        store_of(client).monitors.add(attas, "attas")
        yield client


def frames_of(client: TestClient, recording: dict[str, Any]) -> list[dict[str, Any]]:
    """The assessments of a recording, scored as it is mapped."""
    monitor = client.get("/api/v1/monitors").json()[0]["id"]
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    answer = client.post(path, json={"monitor": monitor})
    assert answer.status_code == 201, answer.text
    return client.get(f"{path}/{answer.json()['id']}/assessments").json()["frames"]


def risks(frames: list[dict[str, Any]]) -> list[float | None]:
    return [frame["p_value"] for frame in frames]


def test_a_recording_is_scored_as_its_set_up_record_maps_it(client, files):
    recording = uploaded(client, files[0], name="flight.ch10")
    assert recording["missing"] == []
    for key, name in NAMES.items():
        source = recording["mapping"]["channels"][key]
        assert source["signal"] == name
        assert source["scale"] == SCALES[key]
        assert source.get("offset", 0.0) == OFFSETS.get(key, 0.0)
    (beta,) = [s for s in recording["contents"]["signals"] if s["name"] == "BETA"]
    assert (beta["unit"], beta["scale"], beta["offset"]) == ("DEG", SCALES["beta"], 0.0)
    assert abs(beta["max"]) < 10, "in the unit, not in counts"
    frames = frames_of(client, recording)
    expected = risks(frames_of(client, uploaded(client, files[1], name="flight.csv")))
    assert len({*expected}) > 5
    assert risks(frames) == expected


def test_bits_in_the_mapping_score_the_same(client, files):
    recording = uploaded(client, files[0], name="flight.ch10")
    expected = risks(frames_of(client, recording))
    mapping = recording["mapping"]
    words = {
        "beta": (f"{BUS}/word 01", "1-16 signed"),
        "r": (f"{BUS}/word 02", "2-16 signed"),
        "p": ("429 channel 6 bus 2 label 325 source 1/word", "11-29 bnr"),
        "Ny": ("analog channel 8, 2 of 16 bits/analog 2", ""),
    }
    for key, (signal, bits) in words.items():
        mapping["channels"][key] |= {"signal": signal, "bits": bits}
    path = f"{RECORDINGS}/{recording['id']}/mapping"
    put = client.put(path, json={"mapping": mapping})
    assert put.status_code == 200, put.text
    assert risks(frames_of(client, recording)) == expected
    mapping["channels"]["beta"]["signal"] = f"{BUS}/word 09"
    refused = problem(client.put(path, json={"mapping": mapping}), 422)
    assert f"choose one of {BUS}/word 0" in refused


@pytest.mark.usefixtures("read_here")
def test_the_command_line_scores_it_without_a_mapping(files, attas, tmp_path, capsys):
    attas.save(tmp_path / "attas.fwm")
    for name, content in zip(("flight.ch10", "flight.csv"), files, strict=True):
        (tmp_path / name).write_bytes(content)
        arguments = [str(tmp_path / "attas.fwm"), str(tmp_path / name)]
        assert main(["score", *arguments, "-o", str(tmp_path / name[-3:])]) == 0
        if name == "flight.ch10":
            printed = capsys.readouterr().out
            assert "beta     BETA = 0.005493164062 * raw [deg]" in printed
            assert "Ny       NY = 0.0001 * raw - 2 [g]" in printed
    tables = [(tmp_path / name / "assessments.csv").read_text() for name in ("h10", "csv")]
    assert tables[0].splitlines() == tables[1].splitlines()
    mapping = json.loads((tmp_path / "h10" / "mapping.json").read_text())
    assert mapping["channels"]["Ny"]["offset"] == -2.0
