"""Flights of a user's simulator, in the files that numpy, pandas and MATLAB write."""

import json
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from app.cli import main
from app.commands import train as train_command
from app.recordings.flown_flights import RolloutSources
from app.store.database import StoreError
from app.store.monitors import MonitorRepository
from app.store.store import open_store
from app.telemetry.recording import TelemetryError
from app.telemetry.rollouts import GivenDictionary, read_dictionary, read_rollouts
from core.channels import Dictionary
from core.monitor import load
from core.rollouts import LabelledFlights
from core.types import Array
from tests.support.rollout_files import (
    KEYS,
    LABELS,
    TO_FILE,
    arrays,
    as_folder,
    as_hdf5,
    as_long_csv,
    as_long_parquet,
    as_matlab,
    as_matlab_7_3,
    as_npz,
    flights,
    npz,
    table,
)
from tests.support.short_period import DICTIONARY, DT, LIMITS


@pytest.mark.parametrize(
    "write", [as_npz, as_matlab, as_matlab_7_3, as_hdf5, as_folder, as_long_csv, as_long_parquet]
)
def test_every_kind_of_source_gives_the_same_flights(
    write: Callable[[Path, Array], Path], tmp_path: Path
) -> None:
    y = flights()
    read = read_rollouts(write(tmp_path, y))
    np.testing.assert_allclose(read.y, y, rtol=1e-9, atol=1e-9)
    assert read.dt == pytest.approx(DT)
    assert read.dictionary.keys == KEYS
    assert [channel.unit for channel in read.dictionary.channels] == ["rad", "rad/s", "g", "rad"]
    assert read.dictionary.of_role("control") == (3,)
    assert read.fail_index is not None
    assert read.fail_index.tolist() == LABELS.tolist()


@pytest.mark.parametrize("place", [as_long_csv, as_folder])
def test_times_without_a_unit_are_read_as_those_of_recordings_are(
    place: Callable[[Path, Array], Path], tmp_path: Path
) -> None:
    source = place(tmp_path, flights())
    for file in source.glob("*.csv") if source.is_dir() else [source]:
        frame = pd.read_csv(file)
        frame["t [s]"] = (1e3 * frame["t [s]"]).round().astype(int)
        frame.rename(columns={"t [s]": "t"}).to_csv(file, index=False)
    read = read_rollouts(source)
    assert read.dt == pytest.approx(DT)
    (finding,) = read.findings
    assert "read as ms, one sample every 0.05 s" in finding


@pytest.mark.parametrize("given", [None, (DICTIONARY, {})])
def test_a_time_is_read_in_the_unit_that_its_name_ends_in(
    given: GivenDictionary | None, tmp_path: Path
) -> None:
    source = as_long_csv(tmp_path, flights())
    frame = pd.read_csv(source)
    frame["t [s]"] *= 1e3
    frame.rename(columns={"t [s]": "time_ms"}).to_csv(source, index=False)
    read = read_rollouts(source, given)
    assert read.dt == pytest.approx(DT)
    assert "time_ms" not in read.dictionary.keys


def as_pandas_csv(folder: Path, frame: pd.DataFrame) -> Path:
    frame.to_csv(folder / "pandas.csv")
    return folder / "pandas.csv"


def as_pandas_parquet(folder: Path, frame: pd.DataFrame) -> Path:
    frame.to_parquet(folder / "pandas.parquet")
    return folder / "pandas.parquet"


@pytest.mark.parametrize("write", [as_pandas_csv, as_pandas_parquet])
def test_names_that_end_in_units_are_read_and_a_pandas_index_is_not(
    write: Callable[[Path, pd.DataFrame], Path], tmp_path: Path
) -> None:
    y = flights()
    names = ["alpha_deg", "q_degps", "Nz", "delta_e_rad"]
    parts = [
        pd.DataFrame(y[k] * TO_FILE, columns=names).assign(t=DT * np.arange(y.shape[1]), flight=k)
        for k in range(len(y))
    ]
    frame = pd.concat(parts)
    frame["delta_e_rad"] = y[..., 3].reshape(-1)
    frame = frame.assign(de_deg=1.5, V_kt=100.0, load_deg=2.0, load=3.0, stick_a=1.0)
    read = read_rollouts(write(tmp_path, frame))
    assert read.dictionary.keys == (*KEYS, "de", "V", "load_deg", "load", "stick_a")
    np.testing.assert_allclose(read.y[..., :4], y, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(read.y[0, 0, 4:], [np.radians(1.5), 51.444444, 2, 3, 1], rtol=1e-6)
    assert read.dictionary.of_role("control") == (3, 4, 8)
    file = tmp_path / "mine.csv"
    file.write_text("key,unit\nNz,g\nV_kt,kt\n")
    chosen = read_rollouts(write(tmp_path, frame), read_dictionary(file))
    assert chosen.dictionary.keys == ("Nz", "V_kt")


def test_flights_without_a_control_say_so() -> None:
    y = flights()
    found = LabelledFlights.of(y[..., :3], dt=DT, channels=KEYS[:3], fail_index=LABELS).findings
    assert any("role control" in text for text in found)
    found = LabelledFlights.of(y, dt=DT, channels=KEYS, fail_index=LABELS).findings
    assert not any("role control" in text for text in found)


def test_a_label_of_the_whole_flight_fails_at_its_last_sample(tmp_path: Path) -> None:
    y = flights()
    y[1, 41:] = np.nan
    path = tmp_path / "labels.npz"
    np.savez(path, **arrays(y, unsafe=LABELS >= 0))  # pyright: ignore[reportArgumentType]
    fail_index = read_rollouts(path).fail_index
    assert fail_index is not None
    assert fail_index.tolist() == [-1, 40, -1, -1, y.shape[1] - 1, -1]


def test_a_dictionary_chooses_channels_and_their_roles(tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text("key,unit,role,label\nNz,g,output,load factor\nalpha,rad,control,vane\n")
    given = read_dictionary(file)
    assert given.dictionary.channels[0].label == "load factor"
    read = read_rollouts(as_npz(tmp_path, flights()), given)
    np.testing.assert_allclose(read.y, flights()[..., [2, 0]], rtol=1e-9)
    as_json = tmp_path / "mine.json"
    as_json.write_text(json.dumps(given.dictionary.to_plain()))
    assert read_dictionary(as_json).dictionary == given.dictionary


def test_values_without_a_unit_in_the_file_are_in_that_of_the_dictionary(tmp_path: Path) -> None:
    y, file, source = flights(), tmp_path / "mine.csv", tmp_path / "plain.npz"
    file.write_text("key,unit\nNz,g\nalpha,deg\nq,deg/s\n")
    bare = arrays(y, unsafe=LABELS >= 0)
    del bare["units"]
    np.savez(source, **bare)  # pyright: ignore[reportArgumentType]
    read = read_rollouts(source, read_dictionary(file))
    np.testing.assert_allclose(read.y, y[..., [2, 0, 1]], rtol=1e-9)
    np.savez(source, **arrays(y, unsafe=LABELS >= 0))  # pyright: ignore[reportArgumentType]
    file.write_text("key,unit\nNz,g\nalpha,rad\nq,rad/s\n")
    read = read_rollouts(source, read_dictionary(file))
    np.testing.assert_allclose(read.y, y[..., [2, 0, 1]], rtol=1e-9)


def test_names_in_greek_and_with_spaces_are_channels(tmp_path: Path) -> None:
    path = tmp_path / "greek.npz"
    np.savez(path, y=flights(), dt=DT, channels=("α", "pitch rate", "Nz", "stick"),
             units=("rad", "rad/s", "g", "rad"), unsafe=LABELS >= 0)  # fmt: skip
    assert read_rollouts(path).dictionary.keys == ("α", "pitch rate", "Nz", "stick")


def no_time(folder: Path, y: Array) -> Path:
    place = as_folder(folder, y)
    file = place / "flight_001.csv"
    pd.read_csv(file).drop(columns="t [s]").to_csv(file, index=False)
    return place


def two_rates(folder: Path, y: Array) -> Path:
    place = as_folder(folder, y)
    file = place / "flight_003.csv"
    frame = pd.read_csv(file)
    frame["t [s]"] *= 2
    frame.to_csv(file, index=False)
    return place


def time_in_metres(folder: Path, y: Array) -> Path:
    path = as_long_csv(folder, y)
    path.write_text(path.read_text().replace("t [s]", "t [m]"))
    return path


def no_flight(folder: Path, y: Array) -> Path:
    path = folder / "one.csv"
    table(y, 0).to_csv(path, index=False)
    return path


def unknown_unit(folder: Path, y: Array) -> Path:
    path = folder / "unit.npz"
    np.savez(path, y=y, dt=DT, channels=("vane", *KEYS[1:]), units=("degg", "rad/s", "g", "rad"))
    return path


def no_interval(folder: Path, y: Array) -> Path:
    path = folder / "dt.npz"
    np.savez(path, y=y, channels=KEYS)
    return path


def truncated(folder: Path, y: Array) -> Path:
    path = as_npz(folder, y)
    path.write_bytes(path.read_bytes()[:-3000])
    return path


def pickled(folder: Path, y: Array) -> Path:
    path = folder / "objects.npz"
    np.savez(path, y=np.full((2, 3, 4), {}, object))
    return path


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (truncated, "rollouts.npz: the arrays of rollouts file is damaged or cut short"),
        (pickled, "y holds objects"),
        (lambda folder, y: folder / "absent", "no such file or folder"),
        (lambda folder, y: folder, "is empty"),
        (no_time, "has no t .s., as flight_000"),
        (two_rates, "1 of 6 flights are not sampled every 0.05 s"),
        (no_flight, "no column that names the flight"),
        (unknown_unit, "did you mean deg"),
        (time_in_metres, "give one of s, ms"),
        (no_interval, "has no dt"),
    ],
)
def test_a_source_that_cannot_be_used_says_what_to_do(
    write: Callable[[Path, Array], Path], words: str, tmp_path: Path
) -> None:
    with pytest.raises(TelemetryError, match=words):
        read_rollouts(write(tmp_path, flights()))


def test_an_invalid_dictionary_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad.json"
    file.write_text('[{"key": "alpha"}]')
    with pytest.raises(TelemetryError, match="give key and unit"):
        read_dictionary(file)


# --- the command ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "pitch.npz"
    np.savez(path, **arrays(flights(1600)))  # pyright: ignore[reportArgumentType]
    return path


def test_the_command_trains_on_own_rollouts_and_says_how_well(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "pitch.fwm"
    limit = ["--limit", "Nz=-1.1..2.9g"]
    assert main(["train", "--rollouts", str(source), *limit, "--out", str(out), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    names = [counts["name"] for counts in facts["methods"]]
    assert names[:3] == ["ensemble", "peak_ahead", "peak_soon"]
    assert names[3:] == ["outputs_ahead", "threshold on today's value"]
    assert facts["evaluation"]["methods"] == facts["methods"]
    assert sum(counts["chosen"] for counts in facts["methods"]) == 1
    at = facts["evaluation"]["at_epsilon"]
    assert at["misses"] <= 0.25 * facts["evaluation"]["n_unsafe"]
    assert facts["validity"] == "calibrated"
    monitor = load(out)
    assert monitor.dictionary.keys == DICTIONARY.keys
    page = tmp_path / "certificate.html"
    assert main(["certificate", str(out), "--out", str(page)]) == 0
    text = page.read_text()
    assert "Methods tried" in text
    assert "threshold on the current value" in text
    n, most = facts["methods"][0]["n_unsafe"], facts["methods"][0]["most_missed"]
    assert f"misses at most {most} of {n}" in text
    envelope = monitor.envelope
    assert envelope is not None
    assert (envelope.low[2], envelope.high[2]) == (-1.1, 2.9)
    assert envelope.rest[2] == pytest.approx(1.0, abs=0.01)


LINEAR = ("--limit", "Nz=-1.1..2.9", "--predictor", "linear")


def test_the_whole_dataset_is_stored_with_its_monitor(source: Path, tmp_path: Path) -> None:
    rest = [*LINEAR, "--out", str(tmp_path / "pitch.fwm"), "--data-dir", str(tmp_path)]
    assert main(["train", "--rollouts", str(source), *rest]) == 0
    with closing(open_store(tmp_path / "forewarn.db", recover=False)) as store:
        (monitor,), (dataset,) = store.monitors.all(), store.datasets.all()
        assert monitor.dataset_id == dataset.id
        assert dataset.n_unsafe + dataset.n_safe == 1600
        assert dataset.findings is not None


def test_a_dataset_whose_monitor_cannot_be_stored_is_not_kept(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise StoreError("the disk is full")

    monkeypatch.setattr(MonitorRepository, "add", full)
    rest = [*LINEAR, "--out", str(tmp_path / "pitch.fwm"), "--data-dir", str(tmp_path)]
    assert main(["train", "--rollouts", str(source), *rest]) != 0
    with closing(open_store(tmp_path / "forewarn.db", recover=False)) as store:
        assert store.datasets.all() == []


def test_a_method_that_is_asked_for_is_used(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "pitch.fwm"
    assert main(["train", "--rollouts", str(source), *LINEAR, "--out", str(out)]) == 0
    assert "methods" not in capsys.readouterr().out
    assert load(out).forecast is None


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        (["--limit", "Nz=x..2"], "write it as Nz=LOW..HIGH"),
        (["--limit", "Nzz=2"], "did you mean Nz"),
        (["--limit", "Nz=2deg"], "not a unit of this quantity"),
        (["--limit", "Nz=..0.5"], "normal acceleration (Nz) is 1 g in trimmed flight"),
        (["--limit", "Nz=5..2"], "'Nz=5..2': low is not below high"),
        ([], "neither labels nor limits"),
        (["--limit", "Nz=-9..20"], "0 of 1600 flights fail"),
        (["--limit", "Nz=..38g"], "values beyond 30 g"),
        (["--limit", "Nz=-1..1e400"], "1e400 is too large"),
        (["--limit", "always Nzz < 2"], "did you mean Nz"),
        (["--limit", "always (Nz < 1e-6)"], "excludes, above 0"),
        (["--limit", "eventually[0:300] (Nz > 2)"], "flights of 4 s end before its times do"),
        (["--limit", "Nz=-30..2.9g"], "the limit Nz -30 g"),
        (["--limit", "Nz=..38g for 0.2 s"], "the limit Nz 38 g"),
        (["--limit", "Nz=-1.1..2.9", "--epsilon", "0.001"], "no method can be trained"),
    ],
)
def test_what_cannot_be_trained_is_one_clear_error(
    rest: list[str], words: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "none.fwm"
    assert main(["train", "--rollouts", str(source), *rest, "--out", str(out)]) != 0
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_a_limit_beyond_the_largest_of_a_dictionary_is_refused(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "mine.json", tmp_path / "none.fwm"
    own = [replace(known, key=f"own_{known.key}") for known in DICTIONARY.channels]
    own[2] = replace(own[2], largest=2.8)
    file.write_text(json.dumps(Dictionary("own", tuple(own)).to_plain()))
    y = flights(300)
    np.savez(tmp_path / "own.npz", y=y, dt=DT, channels=[each.key for each in own])
    words = ["train", "--rollouts", str(tmp_path / "own.npz"), "--dictionary", str(file)]
    assert main([*words, "--limit", "own_Nz=..2.9g", "--out", str(out)]) != 0
    assert "a larger `largest` in the dictionary" in capsys.readouterr().err
    own[2] = replace(own[2], largest=3.0)
    file.write_text(json.dumps(Dictionary("own", tuple(own)).to_plain()))
    read = read_rollouts(tmp_path / "own.npz", read_dictionary(file))
    RolloutSources(read, limits=["own_Nz=..2.9g"]).to_dataset()


def test_rollouts_beyond_the_plausible_values_of_a_channel_are_a_finding(tmp_path: Path) -> None:
    y, path = flights(300), tmp_path / "hard.npz"
    n_failing = int(LIMITS.envelope.exceeds(y).any(axis=1).sum())
    y[..., 2][y[..., 2] >= 2.9] += 46.0
    hit = int((y[..., 2] > 30.0).any(axis=1).sum())
    np.savez(path, **arrays(y))  # pyright: ignore[reportArgumentType]
    made, found = RolloutSources(read_rollouts(path), limits=["Nz=-1.1..2.9g"]).to_dataset()
    peak = np.nanmax(np.abs(made.unsafe[..., 2]))
    assert len(made.unsafe) == n_failing
    (text,) = found
    assert text.startswith(f"Nz reaches {peak:.3g} g, and exceeds 30 g in ")
    assert 0 < int(text.split(" g in ")[1].split()[0]) <= hit
    np.savez(path, **arrays(flights(300)))  # pyright: ignore[reportArgumentType]
    assert not RolloutSources(read_rollouts(path), limits=["Nz=-1.1..2.9g"]).to_dataset()[1]


BETWEEN = "(Nz < 2.9 and Nz > -1.1)"


@pytest.mark.parametrize("text", [f"always {BETWEEN}", f"always[0:4] {BETWEEN}"])
def test_a_requirement_labels_rollouts_as_the_same_limits_do(text: str, source: Path) -> None:
    read = read_rollouts(source)
    limited, _ = RolloutSources(read, limits=["Nz=-1.1..2.9"]).to_dataset()
    made, _ = RolloutSources(read, limits=[text]).to_dataset()
    assert made.fail_index.tolist() == limited.fail_index.tolist()


def test_a_requirement_that_looks_back_is_judged_in_flight_and_others_label_alone(
    source: Path, tmp_path: Path
) -> None:
    back = "always (historically[0:0.2] (Nz > 2) implies abs(q) < 0.2)"
    ahead = "always[0:3] (Nz > 2.5 implies eventually[0:0.6] (Nz < 1))"
    for text in (back, ahead):
        out = tmp_path / "pitch.fwm"
        rest = ["--limit", text, "--predictor", "linear", "--out", str(out)]
        assert main(["train", "--rollouts", str(source), *rest]) == 0
        monitor = load(out)
        if text == back:
            envelope = monitor.envelope
            assert envelope is not None
            assert np.flatnonzero(envelope.limited).tolist() == [4]
            assert (envelope.low[4], envelope.high[4]) == (0.0, np.inf)
            rho = envelope.rest[4]
            assert rho > 0.0
        else:
            assert monitor.specification == f"requirement {ahead}"


def test_a_requirement_that_needs_later_samples_stands_alone(source: Path, tmp_path: Path) -> None:
    read, ahead = read_rollouts(source), "always[0:4] Nz < 2.9"
    with pytest.raises(TelemetryError, match="give it without limits"):
        RolloutSources(read, limits=[ahead, "Nz=..2.9"]).to_dataset()
    np.savez(tmp_path / "own.npz", **arrays(flights(300), unsafe=flights(300)[:, 0, 0] > 0.05))  # pyright: ignore[reportArgumentType]
    with pytest.raises(TelemetryError, match="rollouts without labels"):
        RolloutSources(read_rollouts(tmp_path / "own.npz"), limits=[ahead]).to_dataset()


def test_a_lead_far_shorter_than_a_sample_interval_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "ms.npz", tmp_path / "none.fwm"
    np.savez(path, **arrays(flights(100)) | {"dt": 50.0})  # pyright: ignore[reportArgumentType]
    assert main(["train", "--rollouts", str(path), *LINEAR, "--out", str(out)]) != 0
    assert "0.25 s was given: the flights have one sample every 50 s" in capsys.readouterr().err
    assert not out.exists()


def test_a_dictionary_without_rollouts_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "d.json"
    file.write_text("[]")
    assert main(["train", "--dictionary", str(file)]) != 0
    assert "--rollouts" in capsys.readouterr().err


def test_arrays_of_a_dictionary_need_each_of_its_channels(tmp_path: Path) -> None:
    more = Dictionary("more", (*DICTIONARY.channels, DICTIONARY.channels[0].__class__(
        "V", "V", "m/s", "airspeed", "kt", 1.94, 1)))  # fmt: skip
    with pytest.raises(TelemetryError, match="no channel V"):
        read_rollouts(as_npz(tmp_path, flights()), GivenDictionary(more, {}))


def test_the_certificate_names_the_limits_and_the_parts_of_the_flights(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, flight = tmp_path / "pitch.fwm", tmp_path / "flight.csv"
    method = ["--limit", "Nz=-1.1..2.9", "--predictor", "linear"]
    assert main(["train", "--rollouts", str(source), *method, "--out", str(out)]) == 0
    flight.write_text("t,beta\n0,0\n0.05,0\n")
    assert main(["score", str(out), str(flight), "--out", str(tmp_path / "scored")]) != 0
    assert "the monitor needs alpha, q, Nz, delta_e" in capsys.readouterr().err
    page = tmp_path / "certificate.html"
    assert main(["certificate", str(out), "--out", str(page)]) == 0
    text = page.read_text()
    assert "normal acceleration N_z above -1.1 g and below 2.9 g" in text
    assert "800 train and calibrate" in text
    assert "Methods tried" not in text


def test_the_command_shows_which_stage_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    @contextmanager
    def bar(label: str) -> Iterator[Callable[[str, int, int], None]]:
        yield lambda stage, done, total: shown.append(stage)

    monkeypatch.setattr(train_command, "stage_bar", bar)
    path = tmp_path / "a.npz"
    path.write_bytes(npz(flights(300)))
    words = ["train", "--rollouts", path, "--limit", "Nz=-1.1..2.9g", "--out", tmp_path / "a.fwm"]
    assert main([*map(str, words), "--epsilon", "0.3", "--guarantee", "average"]) == 0
    stages = [stage.split(" on ")[0] for stage in shown]
    assert stages == [
        *("training", "trying the methods", "calibrating validity", "certifying", "done")
    ]
