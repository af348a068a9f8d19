"""A store is copied to an empty database of either kind, whole and verified or not at all."""

import json
import shutil
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.store.database import address, reading
from app.store.people import AuditEntry
from app.store.schema import current_revision
from app.store.store import StoreError, open_store
from app.upkeep import store_copy
from app.upkeep.store_copy import Digest, copy_store, store_address
from core.dataset import Dataset
from core.monitor import train
from tests.app.flights.test_flight_recordings import Range
from tests.app.upkeep.test_integrity import integrity_of
from tests.support.api import api
from tests.support.store_writer import serve_a_job, start
from tests.support.stored import alarm, append, assert_says_its_number, keep_recording, scoring

KINDS = [
    pytest.param(kinds, marks=[] if "postgresql" not in kinds else pytest.mark.services)
    for kinds in (("sqlite", "sqlite"), ("sqlite", "postgresql"), ("postgresql", "sqlite"))
]


@pytest.fixture(params=KINDS, ids="-".join)
def places(request: pytest.FixtureRequest, tmp_path: Path) -> list[str]:
    """URL of a store to fill, and of an empty one."""
    return [
        f"sqlite:///{tmp_path}/{kind}{k}.db"
        if kind == "sqlite"
        else request.getfixturevalue("postgresql").new_database()
        for k, kind in enumerate(request.param)
    ]


def fill(url: str, dataset: Dataset) -> str:
    """A store with something of each kind; the id of its flight."""
    store = open_store(url)
    dataset_id = store.datasets.add(dataset, "größer ∅").id
    monitor = store.monitors.add(train(dataset), "m", dataset_id).id
    flight = store.flights.add({"kind": "test", "name": "\u2603"}, monitor, 0.1)
    append(store, flight, 0, 300)
    store.alarms.add(flight, alarm(1, 3, 0.06))
    store.flights.end(flight)
    keep_recording(store, "0123456789ab")
    store.scorings.add(scoring(store, "0123456789ab", monitor))
    store.audit.add([AuditEntry("2030", "Ann", "admin", "", "PUT", "/", 200)])
    store.close()
    return flight


def contents(url: str) -> dict[str, tuple[int, int]]:
    found = {}
    with store_copy._verbatim(address(url)) as engine, reading(engine) as connection:
        for table in store_copy.metadata.sorted_tables:
            digest = Digest()
            for batch in store_copy._batches(connection, table):
                digest.add(batch)
            found[table.name] = digest.n_rows, digest.total
    return found


def test_a_copy_has_every_row(places: list[str], dataset: Dataset) -> None:
    source, target = places
    flight = fill(source, dataset)
    numbers = copy_store(address(source), address(target))
    assert contents(source) == contents(target)
    assert numbers["flights"] == numbers["recordings"] == numbers["audit"] == 1
    store = open_store(target)
    assert_says_its_number(store.flights.assessments(flight), np.arange(300))
    assert store.datasets.get(store.datasets.all()[0].id).digest() == dataset.digest()
    store.jobs.add("collect", {})
    store.close()


def test_a_target_that_is_not_empty_is_refused_and_unchanged(
    places: list[str], dataset: Dataset
) -> None:
    source, target = places
    fill(source, dataset)
    fill(target, dataset)
    before = contents(target)
    with pytest.raises(StoreError, match="is not empty"):
        copy_store(address(source), address(target))
    assert contents(target) == before


def test_a_copy_that_differs_is_undone(
    places: list[str], dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, target = places
    fill(source, dataset)
    monkeypatch.setattr(Digest, "__eq__", lambda self, other: self.n_rows == 0)
    with pytest.raises(StoreError, match="differs from what was copied"):
        copy_store(address(source), address(target))
    assert current_revision(address(target)) is None
    monkeypatch.undo()
    copy_store(address(source), address(target))
    assert contents(source) == contents(target)


def test_a_store_that_is_served_is_not_copied(places: list[str]) -> None:
    source, target = places
    server, reports = start(serve_a_job, source)
    reports.recv()
    with pytest.raises(StoreError, match="another forewarn serves"):
        copy_store(address(source), address(target))
    server.kill()
    server.join()


def test_stores_are_copied_on_the_command_line(
    tmp_path: Path, dataset: Dataset, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = tmp_path / "one", tmp_path / "two"
    assert main(["copy-store", str(source), str(target)]) == 1
    assert "holds no store" in capsys.readouterr().err
    assert not target.exists()
    fill(str(source / "forewarn.db"), dataset)
    assert main(["copy-store", str(source), str(target), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"]["monitors"] == 1
    assert contents(str(source / "forewarn.db")) == contents(str(target / "forewarn.db"))
    assert store_address(str(target)) == address(target / "forewarn.db")
    assert main(["copy-store", str(source), f"sqlite:///{tmp_path / 'two.db'}"]) == 0
    said = capsys.readouterr().out
    assert "`recordings` and `live`" in said
    assert "rename" in said


def test_a_copied_store_serves_its_recordings_and_journals(tmp_path: Path) -> None:
    source, target = tmp_path / "one", tmp_path / "two"
    with api(source) as client:
        flown = Range(client, source)
        _, recording = flown.flown()
    assert copy_store(*(store_address(str(place)) for place in (source, target)))["flights"] == 1
    for name in ("recordings", "live"):
        shutil.copytree(source / name, target / name)
    with api(target) as client:
        scorings = f"/api/v1/recordings/{recording}/scorings"
        assert client.post(scorings, json={"monitor": flown.monitor}).status_code == 201
    with closing(open_store(store_address(str(target)).render_as_string())) as store:
        known = integrity_of(store, target)
        known.check_all()
        assert (known.damaged(), known.n_elsewhere(), len(known.unverified)) == ([], 0, 0)
