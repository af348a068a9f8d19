"""Stored files are checked against their digests on reading; a mismatch is an error."""

from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from sqlalchemy import text, update
from starlette.testclient import TestClient

from app.commands import doctor
from app.settings import Settings
from app.store import tables
from app.store.scorings import ScoringInfo
from app.store.tables import monitor_parts
from core.dataset import Dataset
from core.monitor import train
from tests.support.api import api, problem, store_of
from tests.support.oscillator import Array
from tests.support.recorded import RECORDINGS, csv_of, uploaded

ROW = {field.name for field in fields(ScoringInfo)} - {"row_digest"}


class StoredScoring(NamedTuple):
    client: TestClient
    folder: Path
    path: str
    scoring: str
    monitor: str


@pytest.fixture
def stored_scoring(tmp_path: Path, dataset: Dataset, flights: Array) -> Iterator[StoredScoring]:
    """A scored recording on a server that has not read it yet."""
    with api(tmp_path) as client:
        monitor = store_of(client).monitors.add(train(replace(dataset, recipe={})), "m").id
        recording = uploaded(client, csv_of(flights[0]))["id"]
        path = f"{RECORDINGS}/{recording}"
        scoring = client.post(f"{path}/scorings", json={"monitor": monitor}).json()["id"]
    with api(tmp_path) as client:
        folder = tmp_path / "recordings" / recording
        yield StoredScoring(client, folder, path, f"{path}/scorings/{scoring}", monitor)


def test_p_values_that_were_changed_are_neither_served_nor_reported(
    stored_scoring: StoredScoring,
) -> None:
    assert stored_scoring.client.get(f"{stored_scoring.scoring}/assessments").status_code == 200
    (file,) = (f for f in stored_scoring.folder.glob("scorings/*.npy") if "tiles" not in f.name)
    samples = np.load(file)
    samples["p_value"] = 0.01
    np.save(file, samples, allow_pickle=False)
    for view in ("assessments", "tiles", "report"):
        detail = problem(stored_scoring.client.get(f"{stored_scoring.scoring}/{view}"), 500)
        assert "is damaged, its digest does not match: delete this scoring" in detail


def test_a_verdict_that_was_changed_is_not_served_and_can_be_deleted(
    stored_scoring: StoredScoring,
) -> None:
    scorings, _, scoring = stored_scoring.scoring.rpartition("/")
    store = store_of(stored_scoring.client)
    (stored,) = store.scorings.of(stored_scoring.path.rpartition("/")[2])
    assert (stored.damage, len(stored.manoeuvres)) == ("", 1)
    changed = [manoeuvre | {"outcome": "missed"} for manoeuvre in stored.manoeuvres]
    with store.engine.begin() as connection:
        connection.execute(update(tables.scorings).values(manoeuvres=changed))
    for view in ("", "/assessments", "/tiles", "/report"):
        detail = problem(stored_scoring.client.get(stored_scoring.scoring + view), 500)
        assert detail.startswith(f"scoring {scoring} is damaged")
    same = stored_scoring.client.post(scorings, json={"monitor": stored_scoring.monitor})
    assert "is damaged" in problem(same, 500)
    (listed,) = stored_scoring.client.get(scorings).json()
    assert listed["manoeuvres"] == []
    assert listed["damage"].startswith(f"scoring {scoring} is damaged")
    settings = Settings(data_dir=stored_scoring.folder.parents[1])
    with pytest.raises(doctor.Failed, match=f"scoring {scoring} is damaged"):
        doctor.contents(settings)
    assert stored_scoring.client.delete(stored_scoring.scoring).status_code == 204
    rescored = stored_scoring.client.post(scorings, json={"monitor": stored_scoring.monitor})
    assert (rescored.status_code, rescored.json()["damage"]) == (201, "")


@pytest.mark.parametrize("field", sorted(ROW))
def test_every_field_of_a_scoring_is_covered_by_its_digest(field: str) -> None:
    info = ScoringInfo(**{f.name: f"any {f.name}" for f in fields(ScoringInfo)})  # pyright: ignore[reportArgumentType]
    sealed = info.sealed()
    assert sealed.damage == ""
    assert replace(sealed, **{field: "another"}).damage


def test_a_row_that_is_no_json_is_damaged_and_can_be_deleted(stored_scoring: StoredScoring) -> None:
    store = store_of(stored_scoring.client)
    with store.engine.begin() as connection:
        connection.execute(text("UPDATE scorings SET manoeuvres = '[{'"))
    assert "is damaged" in problem(stored_scoring.client.get(stored_scoring.scoring), 500)
    assert stored_scoring.client.delete(stored_scoring.scoring).status_code == 204


def test_tiles_that_were_changed_are_not_served(stored_scoring: StoredScoring) -> None:
    (file,) = stored_scoring.folder.glob("scorings/*.tiles.npy")
    tiles = np.load(file)
    tiles["risk_high"] = 0.01
    np.save(file, tiles, allow_pickle=False)
    assert "digest does not match" in problem(
        stored_scoring.client.get(f"{stored_scoring.scoring}/tiles"), 500
    )
    assert stored_scoring.client.get(f"{stored_scoring.scoring}/assessments").status_code == 200


@pytest.mark.parametrize("name", ["file", "columns/0.f8", "scorings/*.tiles.npy"])
def test_the_doctor_finds_what_was_changed(stored_scoring: StoredScoring, name: str) -> None:
    settings = Settings(data_dir=stored_scoring.folder.parents[1])
    assert "1 recording, 1 scoring," in doctor.contents(settings)
    (file,) = stored_scoring.folder.glob(name)
    content = bytearray(file.read_bytes())
    content[-3] ^= 1
    file.write_bytes(content)
    with pytest.raises(doctor.Failed, match="digest does not match"):
        doctor.contents(settings)
    file.unlink()
    with pytest.raises(doctor.Failed, match="missing"):
        doctor.contents(settings)


@pytest.mark.parametrize("name", ["0.f8", "contents.json"])
def test_columns_that_were_changed_are_not_read(stored_scoring: StoredScoring, name: str) -> None:
    file = stored_scoring.folder / "columns" / name
    content = bytearray(file.read_bytes())
    content[-3] ^= 1
    file.write_bytes(content)
    answer = stored_scoring.client.get(f"{stored_scoring.path}/signals/0/preview")
    assert "upload it again" in problem(answer, 500)


def test_a_monitor_whose_blob_was_changed_is_not_flown(stored_scoring: StoredScoring) -> None:
    store = store_of(stored_scoring.client)
    with store.engine.begin() as connection:
        connection.execute(update(monitor_parts).values(content=b"FWMON\0 something else"))
    detail = problem(
        stored_scoring.client.get(f"/api/v1/monitors/{stored_scoring.monitor}/file"), 500
    )
    assert "does not match): train it again" in detail


def test_a_recording_of_an_older_program_is_read_without_digests(
    stored_scoring: StoredScoring,
) -> None:
    (stored_scoring.folder / "digests.json").unlink()
    assert stored_scoring.client.get(f"{stored_scoring.path}/signals/0/preview").status_code == 200
