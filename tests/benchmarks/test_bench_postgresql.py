"""What PostgreSQL costs beside SQLite: the same assessments in the same batches."""

import os
from dataclasses import fields
from pathlib import Path

import pytest

from app.store.store import open_store
from core.dataset import Dataset
from core.monitor import train
from tests.benchmarks.pairs import in_turns
from tests.benchmarks.test_bench_store import N, flight_of
from tests.support.postgresql import PostgreSQL

pytestmark = [pytest.mark.benchmark, pytest.mark.services]


def test_storing_assessments_in_postgresql_against_sqlite(
    tmp_path: Path, dataset: Dataset, postgresql: PostgreSQL
) -> None:
    flown = flight_of(N)
    arrays = [getattr(flown, f.name) for f in fields(flown) if f.name not in ("seq", "reasons")]
    stores = [open_store(tmp_path / "forewarn.db"), open_store(postgresql.new_database())]
    monitors = [store.monitors.add(train(dataset), "m").id for store in stores]

    def append(k: int, each: int) -> None:
        flight = stores[k].flights.add({}, monitors[k], 0.1)
        for i in range(0, N, each):
            stores[k].flights.append(flight, i, *(array[i : i + each] for array in arrays))

    print(f"\n{N:,} assessments, load {os.getloadavg()[0]:.1f}")
    for each in (100, 1000):
        pair = in_turns(lambda each=each: append(0, each), lambda each=each: append(1, each))
        print(
            f"  batches of {each}: SQLite {1e6 * min(pair.ours) / N:.2f} us each; "
            f"PostgreSQL takes {pair} as long"
        )
    for store in stores:
        store.close()
