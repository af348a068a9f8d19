"""A mapping is applied and repaired once per recording."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from app.assessment import ScoringRecipe
from app.cli import main
from app.recordings import mapped_recording
from app.recordings.mapped_recording import MappedRecording, RecentMappings
from app.recordings.scored_file import ScoreRequest, score_file
from app.telemetry.mapping import applying
from app.telemetry.mapping.mapping import (
    ChannelSource,
    Mapping,
    TimeSource,
    mapping_template,
    read_rate,
)
from app.telemetry.recording import TelemetryError
from app.telemetry.timing import repair as repairing
from core.channels import KEYS
from core.monitor import MonitorRecipe, train
from tests.support.api import api, store_of
from tests.support.recorded import HEAD, RECORDINGS, csv_of, uploaded
from tests.support.tables import columns_of


@pytest.fixture
def repairs(monkeypatch) -> list[str]:
    """An entry for each clock that is repaired; the recordings of this test have one."""
    return counted(monkeypatch, repairing, "repair_clock")


@pytest.fixture
def applications(monkeypatch) -> list[str]:
    """An entry for each time that a mapping is applied."""
    return counted(monkeypatch, applying, "derivation_order")


def counted(monkeypatch, module, name: str) -> list[str]:
    calls, original = [], getattr(module, name)

    def call(*arguments):
        calls.append(name)
        return original(*arguments)

    monkeypatch.setattr(module, name, call)
    return calls


@pytest.fixture(scope="module")
def monitor(dataset):
    return train(replace(dataset, recipe={}), MonitorRecipe(epsilon=0.2))


def test_a_preview_its_confirmation_and_every_scoring_share_one_repair(
    repairs, applications, monitor, flights, tmp_path
):
    with api(tmp_path) as client:
        stored = store_of(client).monitors.add(monitor, "oscillator").id
        recording = uploaded(client, csv_of(np.concatenate(flights)))
        path = f"{RECORDINGS}/{recording['id']}"
        assert len(repairs) == 1
        for sign in (1, -1):
            repairs.clear()
            applications.clear()
            source = recording["mapping"]["channels"]["beta"] | {"sign": sign}
            channels = recording["mapping"]["channels"] | {"beta": source}
            body = {"mapping": recording["mapping"] | {"channels": channels}}
            preview = client.post(f"{path}/preview", json=body).json()
            assert preview["quality"]["sentences"]
            assert client.put(f"{path}/mapping", json=body).status_code == 200
            manoeuvres = client.get(f"{path}/manoeuvres", params={"monitor": stored})
            assert manoeuvres.status_code == 200, manoeuvres.text
            for epsilon in (0.2, 0.4):
                recipe = {"monitor": stored, "epsilon": epsilon, "trim": None}
                answer = client.post(f"{path}/scorings", json=recipe | {"manoeuvres": "entire"})
                assert answer.status_code == 201, answer.text
            # what the upload proposed is in memory already
            assert len(repairs) == len(applications) == (0 if sign == 1 else 1)


def test_a_file_is_repaired_once_for_all_monitors_and_miss_rates(
    repairs, monitor, flights, tmp_path
):
    file, path = tmp_path / "flight.csv", tmp_path / "oscillator.forewarn"
    file.write_bytes(csv_of(np.concatenate(flights)))
    monitor.save(path)
    recipe = ScoringRecipe(trim=None, manoeuvres="entire")
    scored = score_file(ScoreRequest((path, path), file, (0.2, 0.4), recipe=recipe)).scored
    assert len(scored) == 4
    assert len(repairs) == 1


def test_a_file_without_times_is_scored_by_its_rate(monitor, flights, tmp_path):
    timed, untimed = tmp_path / "timed.csv", tmp_path / "untimed.csv"
    timed.write_bytes(csv_of(np.concatenate(flights)))
    untimed.write_text("".join(row.partition(",")[2] for row in timed.read_text().splitlines(True)))
    path = tmp_path / "oscillator.forewarn"
    monitor.save(path)
    recipe = ScoringRecipe(trim=None, manoeuvres="entire")
    request = ScoreRequest((path,), untimed, recipe=recipe)
    with pytest.raises(TelemetryError, match="or give the sample rate"):
        score_file(request)
    (scored,) = score_file(replace(request, rate=read_rate("20 Hz from 12:31:05"))).scored
    (expected,) = score_file(replace(request, file=timed)).scored
    samples = scored.recording.samples
    np.testing.assert_array_equal(samples["p_value"], expected.recording.samples["p_value"])
    assert samples["t"][0] == 45_065.0
    with pytest.raises(TelemetryError, match=r"--rate 20 Hz .* every group of .* has a time"):
        score_file(replace(request, file=timed, rate=TimeSource(rate=20.0)))


def test_a_file_that_cannot_be_mapped_gives_a_mapping_template(monitor, flights, tmp_path, capsys):
    file, path = tmp_path / "strange.csv", tmp_path / "oscillator.forewarn"
    names = b"x0 [s],x1,x2,x3,x4,x5,rudder_rad"
    file.write_bytes(csv_of(flights[0]).replace(HEAD.encode(), names, 1))
    monitor.save(path)
    settings = ("--trim", "none", "--manoeuvres", "entire", "-o", str(tmp_path / "out"))
    command = ["score", str(path), str(file), *settings]
    assert main(command) == 1
    message = capsys.readouterr().err
    written = tmp_path / "out" / "mapping.json"
    assert f"{written} and give it with --mapping" in message.splitlines()[-1]
    assert "    rudder_rad" in message
    template = json.loads(written.read_text())
    assert template["channels"]["delta_r"]["signal"] == "rudder_rad"
    assert template["channels"]["beta"] == asdict(ChannelSource(unit="rad"))
    assert main([*command, "--mapping", str(written)]) == 1
    assert "'beta' needs either a signal or a derivation" in capsys.readouterr().err
    for number, key in enumerate(("beta", "p", "r", "Ny", "delta_a"), start=1):
        template["channels"][key]["signal"] = f"x{number}"
    written.write_text(json.dumps(template))
    assert main([*command, "--mapping", str(written)]) == 0
    assert main(command) == 1
    assert (tmp_path / "out" / "mapping-2.json").exists()


def test_where_no_group_has_a_time_the_template_asks_for_one(columns):
    template = mapping_template(Mapping(), columns.contents)
    assert template["times"] == {"": asdict(TimeSource())}
    assert template["channels"].keys() == set(KEYS)


@pytest.fixture
def columns(tmp_path):
    return columns_of(tmp_path, {"t": 0.05 * np.arange(100), "b": np.ones(100)})


def mapped(unit: str = "rad") -> Mapping:
    return Mapping({"beta": ChannelSource("b", unit)}, {"": TimeSource("t", "s")})


def test_a_mapping_that_cannot_be_applied_is_not_scored(columns):
    wrong = MappedRecording.of(columns, mapped("m"))
    assert (wrong.applied, wrong.repaired) == (None, None)
    with pytest.raises(TelemetryError, match="'m' is not a unit of this quantity"):
        wrong.scorable()


def test_the_oldest_mappings_are_dropped_beyond_the_memory_for_them(columns, monkeypatch, repairs):
    n_bytes = MappedRecording.of(columns, mapped()).n_bytes
    assert n_bytes == 2 * 100 * 8
    monkeypatch.setattr(mapped_recording, "MOST_BYTES", 2 * n_bytes)
    recent = RecentMappings()
    repairs.clear()
    for recording_id, n_repairs in (("a", 1), ("b", 2), ("a", 2), ("c", 3), ("a", 3), ("b", 4)):
        recent.mapped(recording_id, mapped(), lambda: columns)
        assert len(repairs) == n_repairs, recording_id
    recent.forget("b")
    recent.mapped("b", mapped(), lambda: columns)
    assert len(repairs) == 5
