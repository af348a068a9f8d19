"""`forewarn report`: one file to keep, exports beside it, and every error in one line."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from app.cli import main
from app.jobs.training import with_test
from core.channels import CHANNELS
from core.monitor import Monitor
from tests.support.attas import TEST, fly, record_file
from tests.support.recorded import csv_of


@pytest.fixture(scope="module")
def flown() -> np.ndarray:
    """One failing doublet from rest, (n, 6)."""
    flights = fly(20, 5)
    return flights.y[flights.is_unsafe][0]


@pytest.fixture
def given(attas: Monitor, flown: np.ndarray, tmp_path: Path, monkeypatch) -> Path:
    """A directory with a monitor and a recording, in which commands run."""
    attas.save(tmp_path / "attas.fwm")
    (tmp_path / "flight.csv").write_bytes(csv_of(flown, TEST.dt))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(tmp_path / "data"))
    return tmp_path


def report(*more: str) -> int:
    return main(["report", "attas.fwm", "flight.csv", *more])


def refused(capsys: pytest.CaptureFixture, *more: str) -> str:
    """Check that nothing is written; return the one line that says why."""
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    assert report(*more) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before
    return line


def test_a_report_is_one_file_that_says_it_all(
    given: Path, attas: Monitor, capsys: pytest.CaptureFixture
):
    tested, _ = with_test(attas, TEST, 200, 0.25)
    tested.save(given / "attas.fwm")
    assert report() == 0
    printed = capsys.readouterr().out
    assert "written: flight-report.html" in printed
    assert "not tested" not in printed
    html = (given / "flight-report.html").read_text()
    assert "<h1>flight.csv</h1>" in html
    assert "on fresh simulated flights at ε = 0.1: missed" in html
    assert "proposed by the program, not confirmed" in html
    assert "rudder doublet" in html
    assert len(re.findall("<section>", html)) == 1
    assert re.findall(r"(?:src|href)\s*=", html) == []


def test_exports_lie_beside_it_and_are_what_score_writes(given: Path):
    assert report("-o", "kept.html", "--export", "csv,parquet,mat") == 0
    assert main(["score", "attas.fwm", "flight.csv", "-o", "scored"]) == 0
    assert Path("kept.csv").read_bytes() == Path("scored/assessments.csv").read_bytes()
    table, mat = pq.read_table("kept.parquet"), loadmat("kept.mat", simplify_cells=True)
    csv = pd.read_csv("kept.csv")
    for channel in CHANNELS:
        field = table.schema.field(channel.key)
        assert (field.metadata or {})[b"unit"] == channel.unit.encode()
        assert mat["units"][channel.key] == channel.unit
        np.testing.assert_array_equal(table[channel.key], mat[channel.key])
    np.testing.assert_array_equal(csv["Ny_from_trim_g"], mat["Ny"])
    about = json.loads(mat["about"])
    assert about["recording"] == "flight.csv"
    html = Path("kept.html").read_text()
    assert all(about[key] in html for key in ("recording_sha256", "monitor_sha256"))
    assert about["samples_sha256"] in html


def test_each_monitor_at_each_epsilon_gets_its_own_report(given: Path, attas: Monitor):
    attas.save(given / "other.fwm")
    arguments = ["report", "attas.fwm", "other.fwm", "flight.csv", "--epsilon", "0.1,0.4"]
    assert main([*arguments, "--export", "csv", "-o", "kept.html"]) == 0
    labels = [f"kept-{name}-epsilon-{e}" for name in ("attas", "other") for e in ("0.1", "0.4")]
    made = {path.name for path in given.glob("kept*")}
    assert made == {f"{label}{ending}" for label in labels for ending in (".html", ".csv")}
    assert "ε = 0.4" in Path("kept-other-epsilon-0.4.html").read_text()


def test_an_input_is_never_overwritten(given: Path, capsys: pytest.CaptureFixture):
    line = refused(capsys, "-o", "flight.html", "--export", "csv")
    assert line.startswith("forewarn: flight.csv is an input")
    assert "attas.fwm is an input" in refused(capsys, "-o", "attas.fwm")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--export", "csv,xlsx"], "--export 'xlsx': choose from csv, parquet, mat"),
        (["-o", "nowhere/kept.html"], "nowhere is not a directory"),
        (["-o", "."], "is a directory: give the path of the file to write"),
        (["--epsilon", "0.0001"], "epsilon=0.0001 needs at least"),
        (["--manoeuvres", "1:999"], "1 to 999 s is not inside the recording"),
        (["--mapping", "none.json"], "none.json"),
    ],
)
def test_a_bad_argument_gets_one_line(
    given: Path, capsys: pytest.CaptureFixture, arguments: list[str], words: str
):
    assert words in refused(capsys, *arguments)


def test_a_mapping_as_given_is_reported_as_such(given: Path, capsys: pytest.CaptureFixture):
    assert main(["score", "attas.fwm", "flight.csv", "-o", "scored"]) == 0
    assert report("--mapping", "scored/mapping.json", "--aircraft", "D-ADAM") == 0
    html = Path("flight-report.html").read_text()
    assert "Channels: as given" in html
    assert "D-ADAM" in html


def test_a_monitor_without_a_recipe_has_no_certificate(given: Path, attas: Monitor):
    replace(attas, dataset_recipe={}, evaluation=None).save(given / "attas.fwm")
    assert report() == 0
    html = Path("flight-report.html").read_text()
    assert "the monitor's file has no test on fresh flights" in html
    assert "not simulated here" in html


def test_a_file_that_nothing_can_be_said_of_is_reported_but_no_success(
    given: Path, flown: np.ndarray
):
    rows = csv_of(flown, TEST.dt).decode().splitlines()
    half = len(rows) // 2
    rows = [
        ",".join("" if (c == 4) == (k < half) and c else cell for c, cell in enumerate(cells))
        for k, cells in enumerate(row.split(",") for row in rows[1:])
    ]
    text = "\n".join(["t_s,beta_rad,p_radps,r_radps,Ny_g,delta_a_rad,delta_r_rad", *rows])
    (given / "flight.csv").write_text(text)
    assert report("--manoeuvres", "entire") == 1
    assert "No verdict: the monitor is not applicable" in (Path("flight-report.html").read_text())


def test_the_real_doublet_is_reported_as_it_is_scored(given: Path):
    flight = str(record_file("attas_rud1"))
    assert main(["report", "attas.fwm", flight, "-o", "rud1.html"]) == 0
    html = Path("rud1.html").read_text()
    assert "r_radps" in html
    assert "flight condition" in html


def test_the_real_record_of_another_manoeuvre_says_what_was_withdrawn(given: Path):
    flight = str(record_file("attas_ail1"))
    assert main(["report", "attas.fwm", flight, "-o", "ail1.html"]) == 0
    html = Path("ail1.html").read_text()
    assert "without the withdrawal the risk would have" in html
    assert "The guarantee is withdrawn for this recording" in html
