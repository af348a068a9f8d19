"""A database that is older than its last good stop is reported; one that crashed is not."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from app.commands import doctor
from app.settings import Settings
from app.store.disk import LastStop
from app.store.store import open_store
from app.upkeep.backup import back_up
from app.upkeep.restore import restore
from tests.support.api import api, store_of
from tests.support.forked_processes import PROCESSES


def serve_and_die(path: Path) -> None:
    store = open_store(path)
    store.start()
    store.jobs.add("train", {})
    store.touch()
    os._exit(1)


def crash(path: Path) -> None:
    process = PROCESSES.Process(target=serve_and_die, args=(path,))
    process.start()
    process.join()
    assert process.exitcode == 1


def finding(path: Path) -> str:
    store = open_store(path)
    store.start()
    store.close()
    return store.last_stop.older


def test_a_crash_alone_is_no_finding(path: Path) -> None:
    for _ in range(2):
        crash(path)
        assert finding(path) == ""


def delete_log(path: Path) -> None:
    path.with_name(f"{path.name}-wal").unlink()


def delete_database(path: Path) -> None:
    delete_log(path)
    path.unlink()


@pytest.mark.parametrize("lose", [delete_log, delete_database])
def test_a_database_whose_log_was_deleted_is_older(
    path: Path, lose: Callable[[Path], None]
) -> None:
    crash(path)
    lose(path)
    assert "older than when it was last served" in finding(path)


def test_an_older_copy_is_older_than_the_last_good_stop(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    database = tmp_path / "forewarn.db"
    with api(tmp_path):
        pass
    shutil.copy(database, tmp_path / "copy")
    for _ in range(2):
        with api(tmp_path) as client:
            assert client.get("/readyz").json()["older"] == ""
    assert "newest" in doctor.schema(settings)
    shutil.copy(tmp_path / "copy", database)
    with pytest.raises(doctor.Failed, match="older than at its last good stop"):
        doctor.schema(settings)
    with api(tmp_path) as client:
        ready = client.get("/readyz")
        assert ready.status_code == 200
        assert "last good stop" in ready.json()["older"]
        assert client.get("/api/v1/integrity").json()["older"] == ready.json()["older"]
        with pytest.raises(doctor.Failed, match="older"):
            doctor.schema(settings)
        store_of(client).touch()
    assert LastStop(store_of(client).engine.url).finding() == ""


def test_a_damaged_mark_is_no_finding(tmp_path: Path) -> None:
    with api(tmp_path):
        pass
    (tmp_path / "forewarn.db.stop").write_text("{")
    assert finding(tmp_path / "forewarn.db") == ""


def test_every_write_is_noted_by_the_next_check(path: Path) -> None:
    store = open_store(path)
    store.start()
    assert not store.has_written
    store.jobs.add("train", {})
    assert store.has_written
    store.touch()
    assert not store.has_written
    store.close()


def test_a_restored_backup_is_not_compared_with_what_it_replaced(tmp_path: Path) -> None:
    data, backup = tmp_path / "data", tmp_path / "one.fwbackup"
    settings = Settings(data_dir=data)
    with api(data):
        pass
    back_up(settings.url, data, backup)
    for _ in range(2):
        with api(data):
            pass
    restore(backup, data, settings.url, replace=True)
    with api(data) as client:
        assert client.get("/readyz").json()["older"] == ""
