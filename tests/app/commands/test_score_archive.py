"""`forewarn score-archive`: each recording as `forewarn score` judges it, and only what changed."""

import csv
import gc
import json
import os
import pickle
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset as pads
import pyarrow.parquet as pq
import pytest

from app.cli import main
from app.recordings import archive
from app.recordings.archive import ArchiveRequest, month_of, summary_of
from app.recordings.scored_file import Scored, ScoreRequest
from app.telemetry.readers import isolation
from core.channels import KEYS
from core.monitor import Monitor
from tests.support.attas import fly, recorded, score
from tests.support.places import DATA

pytestmark = pytest.mark.usefixtures("read_here")
MONITOR_FILE = DATA / "version_0_1_0" / "certified.fwm"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of recordings, one of them damaged."""
    folder = tmp_path_factory.mktemp("flown")
    for seed, name in enumerate(("PH-LAB/2024-05/one.csv", "PH-LAB/20240601.csv", "D-FLY/two.csv")):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        assert main(["sample-flight", "--seed", str(seed), "-o", str(path)]) == 0
    (folder / "bad.csv").write_text("junk\n")
    return folder


@pytest.fixture
def source(flown: Path, tmp_path: Path) -> Path:
    return shutil.copytree(flown, tmp_path / "source")


@pytest.fixture
def scored(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., dict[str, Any]]:
    """Score the archive; what the command printed."""

    def score(*more: str) -> dict[str, Any]:
        capsys.readouterr()
        out = ["--out", str(tmp_path / "out"), "--workers", "1", "--json"]
        assert main(["score-archive", str(MONITOR_FILE), str(source), *out, *more]) == 0
        return json.loads(capsys.readouterr().out)

    return score


def tables(out: Path) -> list[Any]:
    return [pq.read_table(out / f"{name}.parquet").to_pylist() for name in ("summary", "files")]


def test_a_recording_has_the_bits_and_the_judgement_of_score(
    source: Path, tmp_path: Path, scored: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert scored()["scored"] == 3
    row = next(row for row in tables(tmp_path / "out")[0] if row["flight"] == "D-FLY/two.csv")
    one = tmp_path / "one"
    file = str(source / "D-FLY/two.csv")
    assert main(["score", str(MONITOR_FILE), file, "-o", str(one), "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)["scorings"][0]
    table = pq.read_table(tmp_path / "out" / row["samples"])
    with (one / "assessments.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    for name in ("t", "p_value", "alert", "state", "beta", "predicted_p"):
        column = next(key for key in rows[0] if key == name or key.startswith(f"{name}_"))
        stored = ["" if value is None else value for value in table[name].to_pylist()]
        written = [each[column] for each in rows]
        if name in ("alert", "state"):
            assert [str(value).lower() for value in stored] == [each.lower() for each in written]
        else:
            numbers = [np.nan if value == "" else float(value) for value in written]
            np.testing.assert_array_equal([np.nan if x == "" else x for x in stored], numbers)
    outcomes = [manoeuvre["outcome"] for manoeuvre in plain["manoeuvres"]]
    assert row["manoeuvres"] == len(outcomes)
    assert row["misses"] == outcomes.count("missed")
    assert row["warned_in_time"] == outcomes.count("timely_alert")
    assert row["false_alarms"] == outcomes.count("false_alert")
    assert row["peak_risk"] == max(each["peak_risk"] for each in plain["manoeuvres"])
    assert row["epsilon"] == plain["epsilon"]


def test_an_exceedance_as_recorded_only_is_counted_apart_and_the_counts_add_up(
    attas: Monitor,
) -> None:
    y = fly(1, 5).y[0]
    y[:, KEYS.index("Ny")] += 0.3  # beyond the limit with this trim only
    flight = score(attas, recorded(np.array([*y, *y])))
    row = summary_of(Scored("", Path(), attas, flight))
    outcomes = ("warned_in_time", "warned_late", "misses", "false_alarms", "quiet", "no_verdict")
    assert (row["manoeuvres"], row["exceedances"]) == (2, 0)
    assert row["exceedances_as_recorded"] == 2
    assert sum(row[name] for name in outcomes) == 2


def test_a_recording_of_a_guessed_mapping_is_marked(
    source: Path, tmp_path: Path, scored: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "DOUBTED", 0.8)
    text = (source / "D-FLY/two.csv").read_text().partition("\n")[2]
    (source / "no_units.csv").write_text("t,beta,p,r,Ny,da,dr\n" + text)
    assert scored()["doubted"] == 1
    sure = {row["flight"]: row["mapping_confidence"] for row in tables(tmp_path / "out")[0]}
    assert [flight for flight, each in sure.items() if each < 0.8] == ["no_units.csv"]


def test_a_mapping_that_is_given_is_no_guess(source: Path, tmp_path: Path, scored: Any) -> None:
    file = str(source / "D-FLY/two.csv")
    main(["score", str(MONITOR_FILE), file, "-o", str(tmp_path / "one")])
    assert scored("--mapping", str(tmp_path / "one" / "mapping.json"))["doubted"] == 0
    assert {row["mapping_confidence"] for row in tables(tmp_path / "out")[0]} == {None}


def test_the_tables_are_read_by_aircraft_and_month(
    source: Path, tmp_path: Path, scored: Any
) -> None:
    told = scored()
    assert list(told["failed"]) == ["bad.csv"]
    summary, files = tables(tmp_path / "out")
    places = [(row["aircraft"], row["month"], row["flight"]) for row in summary]
    assert places == [
        ("D-FLY", None, "D-FLY/two.csv"),
        ("PH-LAB", "2024-05", "PH-LAB/2024-05/one.csv"),
        ("PH-LAB", "2024-06", "PH-LAB/20240601.csv"),
    ]
    assert [row["flight"] for row in files if row["error"]] == ["bad.csv"]
    samples = pads.dataset(tmp_path / "out" / "samples", partitioning="hive").to_table()
    assert {*samples["month"].to_pylist()} == {None, "2024-05", "2024-06"}
    assert samples.num_rows == sum(row["n_samples"] for row in summary)
    assert {*samples["flight"].to_pylist()} == {row["flight"] for row in summary}


def test_only_what_changed_is_scored_again(source: Path, tmp_path: Path, scored: Any) -> None:
    scored()
    before = tables(tmp_path / "out")
    again = scored()
    assert (again["scored"], again["unchanged"]) == (0, 3)
    assert tables(tmp_path / "out") == before
    longer = (source / "D-FLY/two.csv").read_text()
    (source / "PH-LAB/20240601.csv").write_text(f"{longer}\n")
    (source / "bad.csv").write_text(f"{longer}\n\n")
    changed = scored()
    assert (changed["scored"], changed["unchanged"], changed["failed"]) == (2, 2, {})
    assert scored("--epsilon", "0.3")["scored"] == 4
    (source / "bad.csv").write_text("junk\n")
    assert list(scored("--epsilon", "0.3")["failed"]) == ["bad.csv"]
    (source / "D-FLY/two.csv").unlink()
    assert scored("--epsilon", "0.3")["unchanged"] == 2
    summary, _ = tables(tmp_path / "out")
    stored = {path.relative_to(tmp_path / "out") for path in tmp_path.glob("out/samples/**/*.par*")}
    assert stored == {Path(row["samples"]) for row in summary}
    assert {row["aircraft"] for row in summary} == {"PH-LAB"}


def test_a_run_that_was_interrupted_is_continued(
    source: Path, tmp_path: Path, scored: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    score_file, calls = archive.score_file, []

    def interrupted(*about: Any, **more: Any) -> Any:
        calls.append(about)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return score_file(*about, **more)

    monkeypatch.setattr(archive, "score_file", interrupted)
    call = ["score-archive", str(MONITOR_FILE), str(source), "--workers", "1"]
    assert main([*call, "--out", str(tmp_path / "out")]) == 130
    monkeypatch.undo()
    assert scored()["unchanged"] > 0
    assert main([*call, "--out", str(tmp_path / "whole")]) == 0
    assert tables(tmp_path / "out") == tables(tmp_path / "whole")


def test_results_of_other_recordings_are_left_alone(
    source: Path, tmp_path: Path, scored: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    scored()
    before = tables(tmp_path / "out")
    other = tmp_path / "other"
    other.mkdir()
    call = ["score-archive", str(MONITOR_FILE), str(other), "--out", str(tmp_path / "out")]
    assert main(call) == 1
    assert "holds no files" in capsys.readouterr().err
    shutil.copy(source / "bad.csv", other / "else.csv")
    assert main(call) == 1
    assert "other recordings" in capsys.readouterr().err
    assert tables(tmp_path / "out") == before


def test_results_of_a_monitor_that_is_not_given_are_left_alone(
    source: Path, tmp_path: Path, scored: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    second = str(shutil.copy(MONITOR_FILE, tmp_path / "second.fwm"))
    scored()
    call = ["score-archive", second, str(source), "--out", str(tmp_path / "out"), "--workers", "1"]
    before = tables(tmp_path / "out")
    assert main(call) == 1
    assert f"{MONITOR_FILE.name}, which was not given" in capsys.readouterr().err
    assert tables(tmp_path / "out") == before
    assert main(["score-archive", str(MONITOR_FILE), *call[1:]]) == 0
    summary, _ = tables(tmp_path / "out")
    assert {row["monitor"] for row in summary} == {MONITOR_FILE.stem, "second"}


def test_a_process_that_the_system_ended_is_one_sentence(
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Killed(ThreadPoolExecutor):
        def __init__(self, *_: Any) -> None:
            super().__init__(1)

        def submit(self, *_: Any) -> Any:  # pyright: ignore
            return super().submit(self.die)

        def die(self) -> None:
            raise BrokenProcessPool("terminated abruptly")

    monkeypatch.setattr(archive, "ProcessPoolExecutor", Killed)
    call = ["score-archive", str(MONITOR_FILE), str(source), "--workers", "2"]
    assert main([*call, "--out", str(tmp_path / "out")]) == 1
    assert "--workers" in capsys.readouterr().err


def test_results_among_the_recordings_or_in_a_file_are_refused(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(source.rglob("*"))
    for out in (source, source / "results", tmp_path / "file"):
        (tmp_path / "file").touch()
        assert main(["score-archive", str(MONITOR_FILE), str(source), "--out", str(out)]) == 1
        assert str(out) in capsys.readouterr().err
    assert sorted(source.rglob("*")) == before


@pytest.mark.fuzz
def test_two_processes_give_the_tables_of_one(source: Path, tmp_path: Path, scored: Any) -> None:
    scored()
    call = ["score-archive", str(MONITOR_FILE), str(source), "--workers", "2"]
    assert main([*call, "--out", str(tmp_path / "two")]) == 0
    assert tables(tmp_path / "two") == tables(tmp_path / "out")


@pytest.mark.services
def test_a_cluster_gives_the_tables_of_one_process(
    source: Path, tmp_path: Path, scored: Any, dask_cluster: Any
) -> None:
    scored()
    call = ["score-archive", str(MONITOR_FILE), str(source), "--out", str(tmp_path / "there")]
    assert main([*call, "--scheduler", dask_cluster.scheduler_address]) == 0
    assert tables(tmp_path / "there") == tables(tmp_path / "out")


def test_a_worker_keeps_its_readers(source: Path, tmp_path: Path) -> None:
    score = ScoreRequest((MONITOR_FILE,), source)
    packed = pickle.dumps(ArchiveRequest(score, tmp_path / "out"))
    archive._opened(packed)
    gc.collect()
    assert isolation._keeping
    archive._RESOURCES.close()
    archive._opened.cache_clear()


def test_a_month_is_of_the_first_sample_or_of_a_date_in_the_path() -> None:
    assert month_of("2024-05/a.csv", 1.7e9) == "2023-11"
    assert month_of("2023/x/2024-05-17_3.csv", 12.0) == "2024-05"
    assert month_of("PH-LAB/20240601.csv", 0.0) == "2024-06"
    assert month_of("flight 20245.csv", 0.0) is None


def test_equal_files_are_scored_and_counted_once(source: Path, tmp_path: Path, scored: Any) -> None:
    shutil.copy(source / "D-FLY/two.csv", source / "PH-LAB/20240601.csv")
    told = [scored(), scored()][1]
    assert told["copies"] == {"PH-LAB/20240601.csv": "D-FLY/two.csv"}
    assert (told["scored"], told["unchanged"], list(told["failed"])) == (0, 2, ["bad.csv"])
    summary, files = tables(tmp_path / "out")
    assert [row["flight"] for row in summary] == ["D-FLY/two.csv", "PH-LAB/2024-05/one.csv"]
    assert [row["copy_of"] for row in files if row["copy_of"]] == ["D-FLY/two.csv"]


def test_links_and_pipes_that_are_no_recordings_are_listed(
    source: Path, tmp_path: Path, scored: Any
) -> None:
    (source / "lost.csv").symlink_to("nowhere.csv")
    (source / "folder").symlink_to(source / "D-FLY")
    os.mkfifo(source / "pipe.csv")
    told = scored()
    assert {*told["failed"]} == {"bad.csv", "lost.csv", "folder", "pipe.csv"}
    assert "nowhere.csv, which does not exist" in told["failed"]["lost.csv"]
    assert told["scored"] == 3
    assert {row["flight"] for row in tables(tmp_path / "out")[1]} >= {*told["failed"]}
    call = ["score-archive", str(MONITOR_FILE), f"file://{source}", "--workers", "1"]
    assert main([*call, "--out", str(tmp_path / "by_url")]) == 0
    assert tables(tmp_path / "by_url") == tables(tmp_path / "out")


@pytest.fixture
def remote(source: Path) -> Iterator[str]:
    """The same recordings in a file system without a folder on this machine."""
    import fsspec

    memory: Any = fsspec.filesystem("memory")
    memory.put(f"{source}/", "/range/", recursive=True)
    yield "memory://range"
    memory.rm("/range", recursive=True)


def test_recordings_at_a_url_give_the_tables_of_a_folder_and_are_fetched_once(
    remote: str, tmp_path: Path, scored: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fsspec

    scored()
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    call = ["score-archive", str(MONITOR_FILE), remote, "--out", str(tmp_path / "there")]
    assert main([*call, "--workers", "1"]) == 0
    assert tables(tmp_path / "there") == tables(tmp_path / "out")
    assert not [*temporary.iterdir()]
    memory: Any = fsspec.filesystem("memory")
    fetched, get_file = [], type(memory).get_file

    def counted(self: Any, path: str, *more: Any) -> None:
        fetched.append(path)
        get_file(self, path, *more)

    monkeypatch.setattr(type(memory), "get_file", counted)
    content = memory.cat_file("/range/D-FLY/two.csv")
    memory.pipe_file("/range/PH-LAB/20240601.csv", content + b"\n")
    assert main([*call, "--workers", "1"]) == 0
    assert {*fetched} == {"/range/PH-LAB/20240601.csv", "/range/bad.csv"}


@pytest.mark.fuzz
def test_two_processes_fetch_from_a_url(source: Path, tmp_path: Path, scored: Any) -> None:
    scored()
    call = ["score-archive", str(MONITOR_FILE), f"simplecache::file://{source}", "--workers", "2"]
    assert main([*call, "--out", str(tmp_path / "two")]) == 0
    assert tables(tmp_path / "two") == tables(tmp_path / "out")


def test_a_url_that_no_file_system_opens_is_refused_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["score-archive", str(MONITOR_FILE), "nowhere://range", "--out", str(tmp_path / "out")]
    assert main(call) == 1
    assert "nowhere" in capsys.readouterr().err
    among = tmp_path / "results"
    for source, out in (
        (f"file://{tmp_path}", str(among)),
        (str(tmp_path), "memory://results"),
    ):
        assert main(["score-archive", str(MONITOR_FILE), source, "--out", out]) == 1
        assert "results" in capsys.readouterr().err
    assert not among.exists()
