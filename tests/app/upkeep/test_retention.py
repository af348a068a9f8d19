"""Retention: what is old or too much goes, but never what is kept, flown or referred to."""

import asyncio
import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import update
from starlette.testclient import TestClient

from app.cli import main
from app.store.database import StoreError, writing
from app.store.tables import flights as flight_rows
from app.store.tables import recordings as recording_rows
from app.upkeep import retention
from app.upkeep.retention import (
    GB,
    Retained,
    Retention,
    RetentionRule,
    choose,
    everything,
    retain,
    retention_rule,
)
from app.upkeep.usage import SHORT_BYTES
from core.dataset import Dataset
from core.monitor import train
from tests.support.api import api, problem, store_of
from tests.support.recorded import csv_of, uploaded
from tests.support.stored import append

NOW = datetime(2030, 1, 31, tzinfo=UTC)


def thing(
    identity: str, day: int, size: int = 1, *, needed: bool = False, replays: str | None = None
) -> Retained:
    kind = "flight" if identity.startswith("f") else "recording"
    since = f"2030-01-{day:02}T00:00:00.000000Z"
    return Retained(kind, identity, identity, since, size, needed, needed, replays)


def gone(rule: RetentionRule, *things: Retained) -> list[str]:
    return [one.id for one in choose(things, rule, NOW).goes]


def test_by_age_goes_what_is_older_and_stays_what_is_needed() -> None:
    things = thing("f1", 1), thing("f2", 2, needed=True), thing("r1", 3), thing("f3", 29)
    assert gone(RetentionRule(older_than=10), *things) == ["f1", "r1"]
    assert gone(RetentionRule(older_than=40), *things) == []


def test_by_size_the_oldest_go_until_the_rest_fits() -> None:
    things = [thing("f1", 1, 10), thing("r1", 2, 30), thing("f2", 3, 20), thing("r2", 4, 40)]
    assert gone(RetentionRule(above=100), *things) == []
    assert gone(RetentionRule(above=99), *things) == ["f1"]
    assert gone(RetentionRule(above=89), *things) == ["f1", "r1"]
    kept = [thing("f0", 1, 50, needed=True), *things]
    assert gone(RetentionRule(above=60), *kept) == ["f1", "r1", "f2", "r2"]


def test_a_recording_stays_for_a_flight_that_replays_it_and_goes_with_the_last_one() -> None:
    recording, flight = thing("r1", 1, 10), thing("f1", 20, 1, replays="r1")
    assert gone(RetentionRule(older_than=15), recording, flight) == []
    assert gone(RetentionRule(older_than=5), recording, flight) == ["r1", "f1"]
    assert gone(RetentionRule(above=5), recording, flight, thing("f2", 30)) == ["r1", "f1"]
    kept = thing("f1", 20, 1, needed=True, replays="r1")
    assert gone(RetentionRule(older_than=5, above=0), recording, kept) == []


THINGS = st.lists(
    st.tuples(
        st.booleans(), st.integers(1, 28), st.integers(0, 9), st.booleans(), st.integers(0, 9)
    ),
    max_size=10,
).map(
    lambda rows: [
        thing(
            f"{'f' if is_flight else 'r'}{k}",
            day,
            size,
            needed=needed,
            replays=f"r{other}" if is_flight else None,
        )
        for k, (is_flight, day, size, needed, other) in enumerate(rows)
    ]
)


@given(THINGS, st.none() | st.integers(0, 30), st.none() | st.integers(0, 40))
def test_nothing_that_is_needed_or_referred_to_ever_goes(
    things: list[Retained], days: int | None, above: int | None
) -> None:
    chosen: Retention = choose(things, RetentionRule(days, above), NOW)
    assert sorted(one.id for one in [*chosen.goes, *chosen.stays]) == sorted(t.id for t in things)
    referred = {one.replays for one in chosen.stays}
    assert not any(one.needed or one.id in referred for one in chosen.goes)
    if above is not None and sum(one.size for one in chosen.stays) > above:
        assert all(one.needed or one.id in referred or not one.size for one in chosen.stays)


class Stocked:
    """A server with two flights and two recordings, one each of an old day."""

    def __init__(self, client: TestClient, data: Path, flights: np.ndarray, dataset: Dataset):
        self.client, self.data, self.store = client, data, store_of(client)
        monitor = self.store.monitors.add(train(dataset), "oscillator").id
        self.flights = [self.store.flights.add({"name": n}, monitor, 0.3) for n in "ab"]
        for flight in self.flights:
            append(self.store, flight, 0, 100)
            self.store.flights.end(flight)
        self.recordings = [uploaded(client, csv_of(y))["id"] for y in flights[:2]]
        old = "2020-01-01T00:00:00.000000Z"
        with writing(self.store.engine) as connection:
            first = flight_rows.c.id == self.flights[0]
            connection.execute(update(flight_rows).where(first).values(ended=old))
            first = recording_rows.c.id == self.recordings[0]
            connection.execute(update(recording_rows).where(first).values(created=old))

    def there(self) -> list[str]:
        lists = (self.client.get(f"/api/v1/{kind}").json() for kind in ("flights", "recordings"))
        return sorted(one["id"] for listed in lists for one in listed)


@pytest.fixture
def stocked(tmp_path: Path, flights: np.ndarray, dataset: Dataset) -> Iterator[Stocked]:
    with api(tmp_path) as client:
        yield Stocked(client, tmp_path, flights, dataset)


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["retain", "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_command_says_what_would_go_and_deletes_it_beside_a_server(
    stocked: Stocked, capsys: pytest.CaptureFixture[str]
) -> None:
    (old, new), (upload, other) = stocked.flights, stocked.recordings
    before, data = stocked.there(), f"--data-dir={stocked.data}"
    dry = said(capsys, "--older-than", "365", "--dry-run", data)
    assert sorted(one["id"] for one in dry["goes"]) == sorted([old, upload])
    assert dry["freed"] == sum(one["size"] for one in dry["goes"]) > 10_000
    assert stocked.there() == before
    path = f"/api/v1/recordings/{upload}/keep"
    assert stocked.client.put(path, json={"keep": True}).json() == {"keep": True}
    assert [one["id"] for one in said(capsys, "--older-than", "365", data)["goes"]] == [old]
    assert stocked.there() == sorted([new, upload, other])
    assert said(capsys, "--above", "1e-9", data)["goes"]
    assert stocked.there() == [upload]
    assert (stocked.data / "recordings" / upload / "file").exists()
    assert not (stocked.data / "recordings" / other).exists()
    assert main(["retain", data]) == 1
    assert "--older-than DAYS" in capsys.readouterr().err
    assert main(["retain", "--older-than", "-1", data]) == 1
    assert main(["retain", "--above", "1", "--data-dir", str(stocked.data / "none")]) == 1


def test_a_permanently_kept_row_cannot_be_deleted_until_released(
    stocked: Stocked,
) -> None:
    client = stocked.client
    for kind, identity in (("flights", stocked.flights[0]), ("recordings", stocked.recordings[0])):
        path = f"/api/v1/{kind}/{identity}"
        assert client.get(path).json()["keep"] is False
        client.put(f"{path}/keep", json={"keep": True})
        assert client.get(path).json()["keep"] is True
        assert "kept permanently" in problem(client.delete(path), 409)
        assert client.get(path).status_code == 200
        client.put(f"{path}/keep", json={"keep": False})
        assert client.delete(path).status_code == 204
        problem(client.put(f"{path}/keep", json={"keep": True}), 404)


def test_what_is_kept_between_the_choice_and_the_deletion_stays(
    stocked: Stocked, monkeypatch: pytest.MonkeyPatch
) -> None:
    recordings = stocked.client.app.state.recordings  # pyright: ignore
    journals = stocked.client.app.state.journals  # pyright: ignore
    listed = everything(recordings, journals)
    monkeypatch.setattr("app.upkeep.retention.everything", lambda *_: listed)
    stocked.store.flights.keep(stocked.flights[0], True)
    done = retain(recordings, journals, retention_rule(365.0, 0.0))
    assert [one.id for one in done.goes] == [stocked.recordings[0]]
    assert stocked.flights[0] in [one.id for one in done.stays]
    assert stocked.flights[0] in stocked.there()


def test_the_storage_says_what_everything_takes(
    stocked: Stocked, monkeypatch: pytest.MonkeyPatch
) -> None:
    stocked.store.flights.keep(stocked.flights[0], True)
    usage = stocked.client.get("/api/v1/storage").json()
    kinds = {one["kind"]: one for one in usage["kinds"]}
    assert {kind: one["n"] for kind, one in kinds.items()} == {
        "flight": 2, "recording": 2, "dataset": 0, "monitor": 1,
    }  # fmt: skip
    assert (kinds["flight"]["n_kept"], kinds["flight"]["oldest"][:4]) == (1, "2020")
    folder = stocked.data / "recordings"
    on_disk = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    assert usage["recordings"] == kinds["recording"]["size"] == on_disk
    assert usage["database"] >= kinds["flight"]["size"] + kinds["monitor"]["size"] > 10_000
    assert usage["largest"][0]["size"] == max(one["size"] for one in usage["largest"])
    assert {usage["oldest"][k]["id"] for k in (0, 1)} == {
        stocked.flights[0], stocked.recordings[0],
    }  # fmt: skip
    space = usage["space"]
    assert (space["warning"] == "") is (space["free"] >= SHORT_BYTES)
    monkeypatch.setattr("app.upkeep.usage.SHORT_BYTES", 2**60)
    assert "GB left" in stocked.client.get("/api/v1/storage/space").json()["warning"]


def test_the_journal_of_a_live_flight_counts_and_goes_with_it(stocked: Stocked) -> None:
    recordings = stocked.client.app.state.recordings  # pyright: ignore
    journals = stocked.client.app.state.journals  # pyright: ignore
    flight = stocked.flights[0]
    before = {one.id: one.size for one in everything(recordings, journals)}
    journals.root.mkdir()
    journals.path(flight).write_bytes(b"x" * 1000)
    after = {one.id: one.size for one in everything(recordings, journals)}
    assert after[flight] == before[flight] + 1000
    assert stocked.client.get("/api/v1/storage").json()["journals"] == 1000
    os.link(journals.path(flight), stocked.data / "shared")
    assert {one.id: one.size for one in everything(recordings, journals)} == before
    retain(recordings, journals, retention_rule(365.0, 0.0))
    assert not journals.path(flight).exists()


def test_the_recording_of_a_flight_that_is_kept_stays(stocked: Stocked) -> None:
    recordings = stocked.client.app.state.recordings  # pyright: ignore
    journals = stocked.client.app.state.journals  # pyright: ignore
    recording = stocked.recordings[0]
    stocked.store.recordings.complete(recording, stocked.flights[0])
    stocked.store.flights.keep(stocked.flights[0], True)
    retain(recordings, journals, retention_rule(365.0, 0.0))
    assert recording in [info.id for info in stocked.store.recordings.all()]


def test_settings_say_a_rule_and_nothing_goes_without_one() -> None:
    assert not retention_rule(0.0, 0.0)
    assert retention_rule(30.0, 2.5) == RetentionRule(30.0, int(2.5 * GB))
    with pytest.raises(ValueError, match="0 or more"):
        retention_rule(-1.0, 0.0)


def test_the_server_deletes_once_a_day_where_it_is_configured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server: Any = None
    waits: list[float] = []
    rules: list[RetentionRule] = []

    async def sleep(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            raise asyncio.CancelledError

    def retained(_: Any, __: Any, rule: RetentionRule) -> None:
        rules.append(rule)
        if len(rules) == 1:
            raise StoreError("the disk is full")

    with monkeypatch.context() as day:
        day.setattr(retention.asyncio, "sleep", sleep)
        day.setattr(retention, "retain", retained)
        with pytest.raises(asyncio.CancelledError):
            asyncio.run(retention.retain_daily(server, server, retention_rule(30.0, 0.0)))
    assert waits == [retention.FIRST_AFTER_S, retention.DAY_S, retention.DAY_S]
    assert rules == [RetentionRule(older_than=30.0)] * 2
    began: list[RetentionRule] = []

    async def begin(_: Any, __: Any, rule: RetentionRule) -> None:
        began.append(rule)

    monkeypatch.setattr("app.main.retain_daily", begin)
    with api(tmp_path) as client:
        client.get("/healthz")
    assert began == []
    with api(tmp_path, retain_gb=2.0) as client:
        client.get("/healthz")
    assert began == [RetentionRule(above=2 * GB)]
