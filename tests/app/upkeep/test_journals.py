"""Journals of live flights against their digests: altered and missing ones are found."""

import shutil
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import update

from app.cli import main
from app.commands import doctor
from app.commands.doctor import Failed
from app.flights.flight_recordings import FlightRecordings
from app.recordings.files import digest_of
from app.recordings.recordings import Recordings
from app.settings import Settings
from app.store.database import Damaged
from app.store.store import open_store
from app.store.tables import flights
from app.telemetry.journal import Journals
from app.upkeep.backup import back_up
from tests.app.flights.test_flight_recordings import Range
from tests.app.upkeep.test_integrity import integrity_of
from tests.support.api import api

Damage = tuple[list[str], int, int]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A data directory with an ended live flight, and its id."""
    data_dir = tmp_path_factory.mktemp("flown")
    with api(data_dir) as client:
        flight, _ = Range(client, data_dir).flown()
    return data_dir, flight


@pytest.fixture
def settings(flown: tuple[Path, str], tmp_path: Path) -> Settings:
    return Settings(data_dir=shutil.copytree(flown[0], tmp_path / "data"))


@pytest.fixture
def journal(flown: tuple[Path, str], settings: Settings) -> Path:
    return settings.data_dir / "live" / f"{flown[1]}.jsonl"


def alter(journal: Path) -> None:
    """Change a bit of a journal, not of the recording that shares its file."""
    content = bytearray(journal.read_bytes())
    content[-30] ^= 1
    journal.unlink()
    journal.write_bytes(content)


def found(settings: Settings) -> Damage:
    """Damage, and numbers of flights not verified and elsewhere."""
    with closing(open_store(settings.url, recover=False)) as store:
        known = integrity_of(store, settings.data_dir)
        known.check_all()
        damaged = [damage.detail for damage in known.damaged()]
        return damaged, len(known.unverified), known.n_elsewhere()


def noted(settings: Settings) -> list[str | None]:
    with closing(open_store(settings.url, recover=False)) as store:
        return [info.journal_digest for info in store.flights.all()]


def test_an_ended_flight_has_the_digest_of_its_journal(settings: Settings, journal: Path) -> None:
    assert noted(settings) == [digest_of(journal)]
    assert found(settings) == ([], 0, 0)
    assert doctor.contents(settings).endswith("1 flight, undamaged")


@pytest.mark.parametrize(("spoil", "word"), [(alter, "altered"), (Path.unlink, "missing")])
def test_a_journal_altered_or_missing_is_found(
    settings: Settings, journal: Path, capsys: pytest.CaptureFixture[str], spoil: Any, word: str
) -> None:
    spoil(journal)
    ((damage,), *numbers) = found(settings)
    assert word in damage
    assert numbers == [0, 0]
    with pytest.raises(Failed, match=word):
        doctor.contents(settings)
    backup = settings.data_dir.parent / "b.fwbackup"
    made = back_up(settings.url, settings.data_dir, backup)
    assert [word in line for line in made.manifest.damaged] == [True]
    assert main(["restore", str(backup), "--data-dir", str(backup.parent / "back")]) == 0
    assert word in capsys.readouterr().out


def test_doctor_names_all_damage(settings: Settings, journal: Path) -> None:
    alter(journal)
    file = next((settings.data_dir / "recordings").glob("*/file"))
    file.write_bytes(file.read_bytes() + b"x")
    with pytest.raises(Failed, match=r"recording .*; flight .* altered"):
        doctor.contents(settings)


def test_an_altered_journal_is_not_replayed(settings: Settings, journal: Path) -> None:
    with api(settings.data_dir) as client:
        at_range = Range(client, settings.data_dir)
        source = {"kind": "journal", "flight_id": journal.stem}
        body = {"source": source, "monitor": at_range.monitor}
        assert client.post("/api/v1/flights", json=body).status_code == 201
        alter(journal)
        refused = client.post("/api/v1/flights", json=body)
        assert (refused.status_code, refused.json()["type"]) == (500, "urn:forewarn:damaged")
        assert "altered" in refused.json()["detail"]


def test_a_journal_without_a_digest_is_not_called_undamaged(settings: Settings) -> None:
    with closing(open_store(settings.url)) as store, store.engine.begin() as connection:
        connection.execute(update(flights).values(journal_digest=None))
    assert found(settings) == ([], 1, 0)
    assert "1 flight not verified: no digest recorded" in doctor.contents(settings)


def test_journals_of_another_data_directory_are_no_damage(
    settings: Settings, journal: Path
) -> None:
    journal.parent.rename(journal.parent.with_name("moved"))
    assert found(settings) == ([], 0, 1)
    with pytest.raises(Failed, match="another data directory"):
        doctor.contents(settings)


@pytest.fixture
def interrupted(tmp_path: Path) -> tuple[Settings, Path]:
    """A server that stopped during a live flight, and the flight's journal."""
    with api(tmp_path) as client:
        at_range = Range(client, tmp_path)
        flight = at_range.start()
        at_range.push(flight, 1)
    return Settings(data_dir=tmp_path), tmp_path / "live" / f"{flight}.jsonl"


def test_a_resumed_flight_has_the_digest_of_its_whole_journal(
    interrupted: tuple[Settings, Path],
) -> None:
    settings, journal = interrupted
    assert noted(settings) == [digest_of(journal)]
    with api(settings.data_dir) as client:
        at_range = Range(client, settings.data_dir)
        at_range.push(journal.stem, 2)
        assert noted(settings) == [None]
        assert found(settings) == ([], 0, 0)
        assert doctor.contents(settings).endswith("undamaged")
        at_range.end(journal.stem)
        assert noted(settings) == [digest_of(journal)]


def test_a_flight_is_not_resumed_from_an_altered_journal(
    interrupted: tuple[Settings, Path],
) -> None:
    settings, journal = interrupted
    alter(journal)
    with api(settings.data_dir) as client:
        answer = client.post(f"/api/v1/flights/{journal.stem}/samples", json={"t": [1.0]})
        assert (answer.status_code, "altered" in answer.json()["detail"]) == (409, True)
    assert "altered" in found(settings)[0][0]


def test_a_recording_gives_its_journal_a_digest_where_none_was_noted(
    settings: Settings, journal: Path
) -> None:
    with closing(open_store(settings.url)) as store, store.engine.begin() as connection:
        connection.execute(update(flights).values(journal_digest=None, recording_id=None))
    with api(settings.data_dir) as client:
        Range(client, settings.data_dir).recording_of(journal.stem)
    assert noted(settings) == [digest_of(journal)]


def test_an_altered_journal_becomes_no_recording(settings: Settings, journal: Path) -> None:
    alter(journal)
    with closing(open_store(settings.url)) as store:
        with store.engine.begin() as connection:
            connection.execute(update(flights).values(recording_id=None))
        recordings = Recordings(store, settings.data_dir / "recordings")
        with pytest.raises(Damaged, match="altered"):
            FlightRecordings(recordings, Journals(journal.parent)).make_now(journal.stem)
