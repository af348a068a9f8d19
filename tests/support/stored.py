"""Shared by tests of the store: numbered samples, and a store opened and closed."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import func, select

from app.store import datasets as stored_datasets
from app.store import monitors as stored_monitors
from app.store import repository
from app.store.assessments import StoredAssessments
from app.store.database import address
from app.store.recordings import MappedColumns
from app.store.schema import configuration, migrating
from app.store.scorings import ScoringInfo
from app.store.store import Store, open_store
from core.flight_events import Alarm
from core.monitor import Monitor
from core.monitor.status import ALARM_LEVELS, AlarmKind

MAPPED = MappedColumns(
    mapping={"channels": {"Ny": {"signal": "ay"}}, "times": {}},
    mapping_state="proposed",
    proposal={"rationales": {}},
    quality={"groups": []},
    problem=None,
    duration=12.5,
    statistics=[[3, 1, 0.0, float("nan"), None]],
)


@contextmanager
def opened(path: str | Path) -> Iterator[Store]:
    """A store that must be sound when it is closed."""
    store = open_store(path)
    yield store
    assert store.damage() == []
    store.close()


EVALUATION = {
    "epsilon": 0.1,
    "n_unsafe": 100,
    "n_safe": 200,
    "at_epsilon": {"misses": 9, "false_alerts": 20, "withdrawn": 0, "safe_withdrawn": 4},
    "curves": {
        "epsilon": [0.05],
        "misses": [4],
        "false_alerts": [50],
        "withdrawn": [0],
        "safe_withdrawn": [6],
    },
    "leads": {"n_timely": 91, "n_without": 3, "p05": 0.3, "median": 0.4, "p95": 0.9},
    "prevention": {
        "reactions_s": [0.25, 0.5, 1.0, 1.5, 2.5],
        "n_unsafe": 100,
        "n_safe": 200,
        "stopped": 20,
        "prevented": [90, 60, 30, 10, 0],
        "prevented_interval": [[0.82, 0.95], [0.5, 0.7], [0.21, 0.4], [0.05, 0.18], [0.0, 0.04]],
        "caused": [0, 1, 0, 0, 0],
    },
    "robustness": {
        "doubled_noise": {
            "words": "sensor noise twice as large",
            "n_unsafe": 90,
            "n_safe": 210,
            "epsilon": 0.1,
            "misses": 5,
            "false_alerts": 30,
            "withdrawn": 20,
            "safe_withdrawn": 170,
        },
        "near": {
            "words": "derivatives within a factor of 1.25",
            "n_unsafe": 80,
            "n_safe": 40,
            "n_aircraft": 30,
            "worst": [3, 5],
            "epsilon": 0.1,
            "misses": 12,
            "miss_rate": 0.125,
            "miss_interval": [0.06, 0.22],
            "false_alerts": 5,
            "withdrawn": 10,
            "safe_withdrawn": 1,
        },
    },
    "groups": [
        {
            "rule": "first_limit",
            "name": "N_y limit first",
            "n_unsafe": 80,
            "misses": 5,
            "withdrawn": 0,
            "miss_interval": [0.02, 0.14],
        },
        {
            "rule": "first_limit",
            "name": "p limit first",
            "n_unsafe": 20,
            "misses": 4,
            "withdrawn": 0,
            "miss_interval": [0.06, 0.44],
        },
    ],
}
"""Of a monitor that keeps its promise, as it is stored."""


def move(path: Path | str, revision: str, config: Config | None = None) -> None:
    """Upgrade a database to a revision."""
    config = config or configuration()
    with migrating(address(path)) as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, revision)


def make_parts_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let small content take many parts and transactions, as large content does."""
    monkeypatch.setattr(stored_datasets, "BLOCK_BYTES", 10_000)
    monkeypatch.setattr(repository, "TRANSACTION_BYTES", 20_000)
    monkeypatch.setattr(stored_monitors, "PART_BYTES", 1_000)


def count(store: Store, table: Any) -> int:
    with store.engine.connect() as connection:
        return connection.execute(select(func.count()).select_from(table)).scalar_one()


def flown(store: Store, monitor: Monitor) -> str:
    return store.flights.add({"kind": "test"}, store.monitors.add(monitor, "m").id, 0.1)


def append(store: Store, flight: str, first: int, n: int) -> None:
    """Samples whose every field says its number."""
    seq = np.arange(first, first + n)
    y = seq[:, None] + np.arange(6) / 10
    store.flights.append(flight, first, seq * 0.02, y, seq / 7, seq % 3 == 0, seq % 4, -y)


def assert_says_its_number(stored: StoredAssessments, seq: np.ndarray) -> None:
    np.testing.assert_array_equal(stored.seq, seq)
    np.testing.assert_array_equal(stored.t, seq * 0.02)
    np.testing.assert_array_equal(stored.y, seq[:, None] + np.arange(6) / 10)
    np.testing.assert_array_equal(stored.p_value, seq / 7)
    np.testing.assert_array_equal(stored.alert, seq % 3 == 0)
    np.testing.assert_array_equal(stored.state, seq % 4)
    np.testing.assert_array_equal(stored.y_hat, -stored.y)


def keep_recording(
    store: Store, identity: str, digest: str = "d", name: str = "flight.csv"
) -> None:
    """A recording of which nothing is on the disk."""
    store.recordings.add(identity, name, 2**40, digest, "csv", "PH-LAB", MAPPED)
    store.recordings.complete(identity)


def scoring(store: Store, recording: str, monitor: str, request: str = "o") -> ScoringInfo:
    """A scoring of which nothing is on the disk."""
    return ScoringInfo(
        id=f"s-{recording}-{request}"[:12],
        recording_id=recording,
        monitor_id=monitor,
        monitor_name=store.monitors.info(monitor).name,
        monitor_digest=store.monitors.info(monitor).digest,
        specification=store.monitors.info(monitor).specification,
        request_digest=request,
        digest="x",
        created="2026-01-01T00:00:00.000000Z",
        version="0",
        epsilon=0.1,
        lead=0.5,
        dt=0.05,
        request={"epsilon": 0.1, "trim": None, "manoeuvres": "entire"},
        mapping=MAPPED.mapping,
        n_samples=2**40,
        start=0.0,
        end=12.5,
        notes=["one"],
        quality=None,
        manoeuvres=[{"name": "entire recording", "validity": {"valid": True}}],
        outside_exceedances=[{"t": 3.5, "channel": "Ny", "value": 0.6}],
    )


def alarm(number: int, seq: int, t: float, kind: AlarmKind = "risk", **about: Any) -> Alarm:
    """An alarm of a flight, as it is stored."""
    known = {"p_value": 0.5 if kind == "risk" else None, "raised": "2030-01-01T00:00:00Z"}
    return Alarm(number, seq, t, kind=kind, level=ALARM_LEVELS[kind], **(known | about))
