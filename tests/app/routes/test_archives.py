"""Archives over REST: sums, rows and samples of `forewarn score-archive`, however many flights."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from starlette.testclient import TestClient

from app.cli import main
from app.recordings.archive import ABOUT, FILES, SUMMARY
from tests.support.api import api, problem
from tests.support.places import DATA

ARCHIVES = "/api/v1/archives"
MONITOR_FILE = DATA / "version_0_1_0" / "certified.fwm"
N_FLIGHTS = 3000


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two flights, a copy and a damaged file."""
    folder = tmp_path_factory.mktemp("scored")
    for seed, name in enumerate(("PH-LAB/2024-05/one.csv", "D-FLY/two.csv")):
        path = folder / "source" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        assert main(["sample-flight", "--seed", str(seed), "-o", str(path)]) == 0
    (folder / "source" / "bad.csv").write_text("junk\n")
    shutil.copy(folder / "source/D-FLY/two.csv", folder / "source/D-FLY/zwei.csv")
    call = ["score-archive", str(MONITOR_FILE), str(folder / "source"), "--workers", "1"]
    assert main([*call, "--epsilon", "0.3", "--epsilon", "0.1", "--out", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tables of many flights, as version 0.2.0 wrote them."""
    folder = tmp_path_factory.mktemp("large")
    rng = np.random.default_rng(1)
    rows: list[dict[str, Any]] = [
        dict.fromkeys(SUMMARY, 0)
        | {"monitor": "m", "aircraft": f"A{k % 3}", "flight": f"A{k % 3}/f{k:05d}.csv"}
        | {"month": f"2024-0{1 + k % 9}", "samples": "x", "misses": int(rng.integers(5))}
        | {"exceedances": int(rng.integers(9)), "manoeuvres": 9, "epsilon": 0.1}
        for k in range(N_FLIGHTS)
    ]
    rows.sort(key=lambda row: row["flight"])
    about = {ABOUT: json.dumps({"scored": "2026", "version": "1", "source": "s", "monitors": []})}
    for name, kinds in (("summary", SUMMARY), ("files", FILES)):
        schema = pa.schema([(key, pa.type_for_alias(kind)) for key, kind in kinds.items()], about)
        plain = rows if kinds is SUMMARY else [{"flight": row["flight"]} for row in rows]
        pq.write_table(pa.Table.from_pylist(plain, schema), folder / f"{name}.parquet")
    return folder


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory, scored: Path, large: Path) -> dict[str, Path]:
    empty = tmp_path_factory.mktemp("empty")
    begun = tmp_path_factory.mktemp("begun")
    (begun / "flights").mkdir()
    half = tmp_path_factory.mktemp("half")
    shutil.copy(large / "summary.parquet", half)
    shutil.copy(scored / "files.parquet", half)
    damaged = tmp_path_factory.mktemp("damaged")
    for name in ("summary", "files"):
        (damaged / f"{name}.parquet").write_bytes((large / f"{name}.parquet").read_bytes()[:-9])
    missing = empty / "missing"
    broken = {"empty": empty, "begun": begun, "half": half, "damaged": damaged, "missing": missing}
    return {"scored": scored, "large": large, **broken}


@pytest.fixture(scope="module")
def client(
    tmp_path_factory: pytest.TempPathFactory, places: dict[str, Path]
) -> Iterator[TestClient]:
    folders = tuple(str(place) for place in places.values())
    with api(tmp_path_factory.mktemp("data"), archives=folders) as client:
        yield client


@pytest.fixture(scope="module")
def paths(client: TestClient, places: dict[str, Path]) -> dict[str, str]:
    """Addresses of the archives."""
    ids = {each["folder"]: each["id"] for each in client.get(ARCHIVES).json()}
    return {name: f"{ARCHIVES}/{ids[str(place)]}" for name, place in places.items()}


def test_an_archive_says_when_and_by_what_it_was_scored(
    client: TestClient, paths: dict[str, str]
) -> None:
    about = client.get(paths["scored"]).json()
    assert (about["n_flights"], about["n_failed"], about["n_copies"]) == (2, 1, 1)
    assert (about["aircraft"], about["months"]) == (["D-FLY", "PH-LAB"], ["2024-05"])
    assert [monitor["epsilon"] for monitor in about["monitors"]] == [0.3, 0.1]
    assert about["scored"].startswith("20")
    assert about["source"].endswith("source")
    failed = client.get(f"{paths['scored']}/files?state=failed").json()
    assert [file["flight"] for file in failed] == ["bad.csv"]
    assert failed[0]["error"]
    copies = client.get(f"{paths['scored']}/files?state=copy").json()
    assert [file["copy_of"] for file in copies] == ["D-FLY/two.csv"]


@pytest.mark.parametrize("name", ["empty", "begun", "half", "damaged", "missing"])
def test_a_folder_without_a_whole_archive_is_named_with_the_reason(
    client: TestClient, paths: dict[str, str], places: dict[str, Path], name: str
) -> None:
    listed = {each["folder"]: each["problem"] for each in client.get(ARCHIVES).json()}
    assert str(places[name]) in listed[str(places[name])]
    for more in ("", "/summary", "/flights", "/files"):
        assert str(places[name]) in problem(client.get(paths[name] + more), 409)
    assert not listed[str(places["scored"])]


def test_sums_are_those_of_the_rows(client: TestClient, paths: dict[str, str], large: Path) -> None:
    rows = pq.read_table(large / "summary.parquet").to_pylist()
    path = f"{paths['large']}/summary?limit=1000"
    (total,) = client.get(path).json()
    assert total["flights"] == N_FLIGHTS
    assert total["misses"] == sum(row["misses"] for row in rows)
    groups = client.get(f"{path}&by=aircraft&by=month").json()
    assert len(groups) == len({(row["aircraft"], row["month"]) for row in rows})
    for group in groups:
        mine = [row for row in rows if all(row[key] == group[key] for key in ("aircraft", "month"))]
        assert group["exceedances"] == sum(row["exceedances"] for row in mine)
        assert group["flights"] == len(mine)


def test_the_worst_flights_come_first_in_parts_of_a_fixed_size(
    client: TestClient, paths: dict[str, str], large: Path
) -> None:
    rows = pq.read_table(large / "summary.parquet").to_pylist()
    rows.sort(key=lambda row: (-row["misses"], -row["exceedances"], row["flight"]))
    address, found = f"{paths['large']}/flights?limit=1000", []
    while address:
        answer = client.get(address)
        assert answer.status_code == 200, answer.text
        assert len(answer.json()) <= 1000
        found += [row["flight"] for row in answer.json()]
        address = "".join(re.findall('<(.+)>; rel="next"', answer.headers.get("link", "")))
    assert found == [row["flight"] for row in rows]
    assert len(client.get(f"{paths['large']}/flights").json()) == 50


def test_flights_are_found_by_path_aircraft_month_and_what_they_have(
    client: TestClient, paths: dict[str, str]
) -> None:
    def found(**query: Any) -> list[dict[str, Any]]:
        return client.get(f"{paths['large']}/flights", params={"limit": 1000} | query).json()

    assert [row["flight"] for row in found(text="F00012")] == ["A0/f00012.csv"]
    assert len(found(aircraft="A1", month="2024-02")) == len(range(1, N_FLIGHTS, 9))
    assert {*(row["misses"] > 0 for row in found(some=["misses", "exceedances"]))} == {True}
    assert found(aircraft="") == []
    assert [row["flight"] for row in found(sort="flight", limit=2)] == [
        "A0/f00000.csv",
        "A0/f00003.csv",
    ]
    without = client.get(f"{paths['scored']}/flights?month=").json()
    assert {row["flight"] for row in without} == {"D-FLY/two.csv"}
    assert "sort" in problem(client.get(f"{paths['large']}/flights?sort=nothing"), 422)
    assert "cursor" in problem(client.get(f"{paths['large']}/flights?cursor=x~y"), 422)
    assert "again" in problem(client.get(f"{paths['large']}/flights?cursor=5~before"), 409)


def test_a_flight_opens_with_its_samples_to_the_bit(
    client: TestClient, paths: dict[str, str], scored: Path
) -> None:
    rows = client.get(f"{paths['scored']}/flights").json()
    assert len(rows) == 4
    path = ""
    for row in rows:
        query = {"monitor": row["monitor"]}
        path = f"{paths['scored']}/flights/{row['id']}"
        flight = client.get(path, params=query).json()
        assert {key: flight[key] for key in ("flight", "epsilon", "misses")} == {
            key: row[key] for key in ("flight", "epsilon", "misses")
        }
        assert all(each["verdict"]["word"] for each in flight["manoeuvres"])
        table = pq.ParquetFile(scored / row["samples"]).read()
        bins = {"bins": 10_000, **query}
        tiles = client.get(f"{path}/tiles", params=bins).json()
        assert tiles["samples"] == 1
        assert tiles["t"] == table["t"].to_pylist()
        assert tiles["channels"]["beta"]["low"] == table["beta"].to_pylist()
        assert tiles["risk"]["high"] == table["p_value"].to_pylist()
        assert tiles["alert"] == table["alert"].to_pylist()
        few = client.get(f"{path}/tiles", params={"bins": 20, **query}).json()
        assert len(few["t"]) <= 20
        assert max(x for x in few["channels"]["beta"]["high"] if x is not None) == max(
            x for x in table["beta"].to_pylist() if x is not None
        )
    unknown = client.get(f"{paths['scored']}/flights/{'0' * 16}")
    assert "deleted" in problem(unknown, 404)
    assert "nobody" in problem(client.get(f"{path}?monitor=nobody"), 404)


def test_a_link_out_of_the_archive_is_not_followed(scored: Path, tmp_path: Path) -> None:
    inside, secret = tmp_path / "inside", tmp_path / "secret.parquet"
    shutil.copytree(scored, inside)
    with api(tmp_path / "data", archives=(str(inside),)) as client:
        (about,) = client.get(ARCHIVES).json()
        flights = f"{ARCHIVES}/{about['id']}/flights"
        row = client.get(flights).json()[0]
        tiles, query = f"{flights}/{row['id']}/tiles", {"monitor": row["monitor"]}
        (inside / row["samples"]).rename(secret)
        (inside / row["samples"]).symlink_to(secret)
        assert "link out of" in problem(client.get(tiles, params=query), 409)
