"""Recordings: from a file to stored assessments, and replay of a long one, as ratios and times."""

import sqlite3
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from sklearn.neighbors import NearestNeighbors

from app.assessment import ScoringRecipe, score
from app.jobs.training import train_and_test
from app.telemetry.recording import Trace, Traces
from app.telemetry.timing.repair import repair
from core.channels import LATERAL
from core.monitor import Monitor, MonitorRecipe
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator
from core.simulation.maneuver import MANEUVERS
from tests.benchmarks.pairs import ROUNDS, in_turns
from tests.support.api import api, store_of

pytestmark = [pytest.mark.benchmark, pytest.mark.usefixtures("read_apart")]

DT, HOUR = 0.01, 360_000
NAMES = ["beta_deg", "p_degps", "r_degps", "ay_g", "da_deg", "dr_deg"]
TO_SI = np.array([np.pi / 180, np.pi / 180, np.pi / 180, 1.0, np.pi / 180, np.pi / 180])
RECIPE = replace(
    DatasetRecipe(),
    dt=DT,
    n_unsafe=100,
    maneuver=replace(MANEUVERS["rudder_doublet"], amplitude_deg=9.5),
)


@pytest.fixture(scope="module")
def monitor() -> Monitor:
    """A monitor at 100 Hz with about 15,000 safe points, its validity calibrated."""
    dataset = collect(RECIPE)
    return train_and_test(dataset, MonitorRecipe(), 500, lambda *_: None).monitor


def flown(n: int) -> npt.NDArray[np.float64]:
    """Channels (n, 6) of doublets one after the other."""
    per_flight = RECIPE.maneuver.n_samples(DT)
    rollouts = LateralSimulator(RECIPE).rollouts(-(-n // per_flight), np.random.default_rng(5))
    return rollouts.y.reshape(-1, 6)[:n]


def write_csv(path: Path, n: int) -> None:
    table = pd.DataFrame(flown(n) / TO_SI, columns=NAMES)
    table.insert(0, "t_s", DT * np.arange(n))
    table["alpha_deg"] = 4.0
    table.to_csv(path, index=False, float_format="%.12g")


def plain_way(path: Path, monitor: Monitor, database: Path) -> npt.NDArray[np.float64]:
    """What one glues together: pandas reads and stores, scikit-learn looks up neighbours."""
    table = pd.read_csv(path)
    y = table[NAMES].to_numpy() * TO_SI
    n_delay = monitor.recipe.n_delay
    lags = [pd.DataFrame(y).shift(k).bfill().to_numpy() for k in range(n_delay, -1, -1)]
    z = np.hstack(lags) @ monitor.affine.matrix + monitor.affine.offset
    unsafe = NearestNeighbors(n_neighbors=1).fit(monitor.unsafe_points)
    safe = NearestNeighbors(n_neighbors=1).fit(monitor.safe_points)
    s = unsafe.kneighbors(z)[0][:, 0] ** 2 - safe.kneighbors(z)[0][:, 0] ** 2
    n = monitor.n_unsafe
    p = (1 + n - np.searchsorted(monitor.alphas, s)) / (n + 1)
    scored = pd.DataFrame(y, columns=NAMES).assign(
        t=table["t_s"], p_value=p, alert=p > monitor.recipe.epsilon
    )
    with sqlite3.connect(database) as connection:
        scored.to_sql("assessments", connection, index=False, if_exists="replace")
    return p


def upload(client: Any, path: Path, name: str) -> dict[str, Any]:
    content = path.read_bytes()
    answer = client.post(
        f"/api/v1/recordings?name={name}",
        content=content,
        headers={"content-type": "application/octet-stream"},
    )
    assert answer.status_code == 201, answer.text
    return answer.json()


def test_an_hour_at_100_hz_from_upload_to_stored_assessments(
    monitor: Monitor, tmp_path: Path
) -> None:
    path = tmp_path / "hour.csv"
    write_csv(path, HOUR)
    with api(tmp_path / "data") as client:
        monitor_id = store_of(client).monitors.add(monitor, "bench").id
        order = {"monitor": monitor_id, "trim": None, "manoeuvres": "entire"}
        small = tmp_path / "small.csv"
        write_csv(small, 2_000)
        warm = upload(client, small, "warm.csv")
        client.post(f"/api/v1/recordings/{warm['id']}/scorings", json=order)
        ratios, ours, theirs = [], [], []
        plain, recording, answer = np.empty(0), {}, None
        for k in range(ROUNDS):
            begin = perf_counter()
            recording = upload(client, path, f"hour{k}.csv")
            read = perf_counter()
            answer = client.post(f"/api/v1/recordings/{recording['id']}/scorings", json=order)
            end = perf_counter()
            assert answer.status_code == 201, answer.text
            plain = plain_way(path, monitor, tmp_path / "plain.db")
            theirs.append(perf_counter() - end)
            ratios.append(theirs[-1] / (end - begin))
            ours.append((end - begin, read - begin))
        assert answer is not None
        scoring = answer.json()
        assert scoring["n_samples"] == HOUR
        frames = client.get(
            f"/api/v1/recordings/{recording['id']}/scorings/{scoring['id']}/assessments"
        ).json()["frames"]
    said = np.array([frame["withdrawn"] or frame["p_value"] for frame in frames], float)
    assert np.nanmean(said != plain[: len(said)]) < 1e-3
    whole, reading = min(ours)
    shortest = min(theirs) / whole
    print(
        f"\n{path.stat().st_size / 1e6:.0f} MB CSV, {HOUR} rows, {len(monitor.safe_points)} safe "
        f"points: {whole:.2f} s, of which upload and reading {reading:.2f} s; pandas + "
        f"scikit-learn ratio {np.median(ratios):.1f} x (shortest {shortest:.1f} x)"
    )


def test_scoring_an_hour_against_its_assessments_alone(monitor: Monitor) -> None:
    """The grid, the judge of limits, validity and the table of samples come on top."""
    y = flown(HOUR)
    t = np.arange(HOUR, dtype=np.float64) * DT
    columns = zip(LATERAL.keys, np.ascontiguousarray(y.T), strict=True)
    recorded = repair(Traces({key: Trace(t, x, source=key) for key, x in columns}))
    whole = ScoringRecipe(trim=None, manoeuvres="entire")
    pair = in_turns(
        lambda: score(monitor, recorded, whole), lambda: monitor.assess(t, y), clock=process_time
    )
    print(f"\nscoring {HOUR} samples: {pair.ours.min():.3f} s; their assessments alone {pair}")


def test_replay_of_ten_hours_starts_and_seeks_at_once(monitor: Monitor, tmp_path: Path) -> None:
    path = tmp_path / "ten_hours.csv"
    write_csv(path, 10 * HOUR)
    with api(tmp_path / "data") as client:
        monitor_id = store_of(client).monitors.add(monitor, "bench").id
        recording = upload(client, path, "ten_hours.csv")
        at = f"/api/v1/recordings/{recording['id']}/scorings"
        scoring = client.post(
            at, json={"monitor": monitor_id, "trim": None, "manoeuvres": "entire"}
        ).json()
        begin = perf_counter()
        flight = client.post(
            "/api/v1/flights",
            json={
                "source": {
                    "kind": "recording",
                    "recording": recording["id"],
                    "scoring": scoring["id"],
                },
                "monitor": monitor_id,
                "epsilon": scoring["epsilon"],
            },
        ).json()
        started = perf_counter() - begin
        there = f"/api/v1/flights/{flight['id']}"
        seeks, looks = [], []
        for t in np.random.default_rng(1).uniform(0, 36_000, 20):
            begin = perf_counter()
            moved = client.post(f"{there}/transport", json={"action": "seek", "value": t}).json()
            before = client.get(
                f"{there}/source?first={max(0, moved['sample'] - 5000)}&last={moved['sample']}"
            )
            seeks.append(perf_counter() - begin)
            assert before.json()["frames"][-1]["t"] == pytest.approx(t, abs=0.02)
            begin = perf_counter()
            tiles = client.get(f"{at}/{scoring['id']}/tiles?start={t / 2}&end={t}&bins=1500")
            looks.append(perf_counter() - begin)
            assert tiles.status_code == 200
        client.delete(there)
    print(
        f"\nten hours at 100 Hz: replay starts in {started * 1e3:.0f} ms, seeks with 50 s of "
        f"history in median {np.median(seeks) * 1e3:.0f} ms, most {max(seeks) * 1e3:.0f} ms; "
        f"a window of tiles median {np.median(looks) * 1e3:.0f} ms, most {max(looks) * 1e3:.0f} ms"
    )
