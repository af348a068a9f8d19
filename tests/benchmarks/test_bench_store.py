"""Storing 100,000 assessments: the store's chunks against the usual row for each sample."""

import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import delete, insert, select
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column

from app.store.assessments import StoredAssessments
from app.store.database import make_engine, writing
from app.store.store import open_store
from core.channels import KEYS
from core.dataset import Dataset
from core.monitor import train
from tests.benchmarks.pairs import in_turns

pytestmark = pytest.mark.benchmark

N, EACH, FEW = 100_000, 1000, 500


class Base(DeclarativeBase):
    pass


class Sample(Base):
    """The plain design: one row a sample, one column a number."""

    __tablename__ = "sample"
    flight_id: Mapped[str] = mapped_column(primary_key=True)
    seq: Mapped[int] = mapped_column(primary_key=True)
    t: Mapped[float]
    p_value: Mapped[float]
    alert: Mapped[bool]
    state: Mapped[int]
    y_beta: Mapped[float]
    y_p: Mapped[float]
    y_r: Mapped[float]
    y_Ny: Mapped[float]
    y_delta_a: Mapped[float]
    y_delta_r: Mapped[float]
    y_hat_beta: Mapped[float]
    y_hat_p: Mapped[float]
    y_hat_r: Mapped[float]
    y_hat_Ny: Mapped[float]
    y_hat_delta_a: Mapped[float]
    y_hat_delta_r: Mapped[float]


def flight_of(n: int) -> StoredAssessments:
    rng = np.random.default_rng(0)
    return StoredAssessments(
        seq=np.arange(n),
        t=np.linspace(0, 0.02 * (n - 1), n),
        y=rng.normal(size=(n, 6)),
        p_value=rng.random(n),
        alert=rng.random(n) > 0.9,
        state=np.zeros(n, np.uint8),
        y_hat=rng.normal(size=(n, 6)),
        cause=np.zeros(n, np.uint8),
        manoeuvre=np.ones(n, np.int32),
        reasons=("",) * n,
    )


def rows(flown: StoredAssessments, first: int, n: int) -> list[dict]:
    part = slice(first, first + n)
    names = [f"y_{key}" for key in KEYS] + [f"y_hat_{key}" for key in KEYS]
    numbers = np.hstack([flown.y[part], flown.y_hat[part]]).tolist()
    return [
        {
            "flight_id": "f",
            "seq": first + i,
            "t": float(flown.t[first + i]),
            "p_value": float(flown.p_value[first + i]),
            "alert": bool(flown.alert[first + i]),
            "state": int(flown.state[first + i]),
            **dict(zip(names, values, strict=True)),
        }
        for i, values in enumerate(numbers)
    ]


def test_storing_assessments_in_chunks_against_rows(tmp_path: Path, dataset: Dataset) -> None:
    """A commit with fsync a chunk, against a commit a sample, a thousand, and many rows at once."""
    flown = flight_of(N)
    store = open_store(tmp_path / "chunks.db")
    monitor = store.monitors.add(train(dataset), "m").id
    arrays = [getattr(flown, f.name) for f in fields(flown) if f.name not in ("seq", "reasons")]
    engine = make_engine(store.engine.url.set(database=str(tmp_path / "rows.db")))
    Base.metadata.create_all(engine)

    def in_chunks(n: int) -> str:
        flight = store.flights.add({}, monitor, 0.1)
        for i in range(0, n, EACH):
            store.flights.append(flight, i, *(array[i : min(i + EACH, n)] for array in arrays))
        return flight

    def empty() -> None:
        with writing(engine) as connection:
            connection.execute(delete(Sample))

    def a_sample_a_commit() -> None:
        empty()
        for row in rows(flown, 0, FEW):
            with Session(engine) as session, session.begin():
                session.add(Sample(**row))

    def a_thousand_a_commit() -> None:
        empty()
        with Session(engine) as session, session.begin():
            session.add_all(Sample(**row) for row in rows(flown, 0, EACH))

    def many_at_once() -> None:
        empty()
        for i in range(0, N, EACH):
            with writing(engine) as connection:
                connection.execute(insert(Sample), rows(flown, i, EACH))

    def read_rows() -> None:
        with Session(engine) as session:
            assert len(session.scalars(select(Sample).order_by(Sample.seq)).all()) == N

    print(f"\n{N:,} assessments in chunks of {EACH}, load {os.getloadavg()[0]:.1f}")
    for what, n, theirs in (
        ("ORM row and commit a sample", FEW, a_sample_a_commit),
        ("ORM rows, a commit a thousand", EACH, a_thousand_a_commit),
        ("executemany", N, many_at_once),
    ):
        # as many samples on our side as fill a chunk: what is kept of a flight is a chunk a second
        pair = in_turns(lambda n=n: in_chunks(max(n, EACH)), theirs).per(max(n, EACH), n)
        print(f"  {1e6 * np.median(pair.ours):.2f} us each; {what} takes {pair} as long")
    flight = in_chunks(N)
    pair = in_turns(lambda: store.flights.assessments(flight), read_rows)
    print(f"  read back in {1e3 * np.median(pair.ours):.1f} ms; ORM rows take {pair} as long")
    back = store.flights.assessments(flight)
    for field in fields(flown):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(flown, field.name))
    store.close()
    engine.dispose()


def test_storing_a_large_dataset_and_reading_one_rollout(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    n_safe = 20_000
    large = Dataset(
        unsafe=rng.normal(size=(200, 121, 6)),
        fail_index=np.full(200, 100),
        safe=rng.normal(size=(n_safe, 121, 6)),
        safe_times=np.tile(np.arange(50), (n_safe, 1)),
        theta_unsafe=rng.normal(size=(200, 15)),
        theta_safe=rng.normal(size=(n_safe, 15)),
        dt=0.05,
        n_safe_met=n_safe,
    )
    size = sum(array.nbytes for array in vars(large).values() if isinstance(array, np.ndarray))
    store = open_store(tmp_path / "forewarn.db")
    kept: list[str] = []

    def add() -> None:
        if kept:
            store.datasets.delete(kept.pop())
        kept.append(store.datasets.add(large, "large").id)

    def read_all() -> None:
        np.testing.assert_array_equal(store.datasets.get(kept[0]).safe, large.safe)

    def read_some() -> None:
        for index in range(0, n_safe, n_safe // 100):
            store.datasets.rollout(kept[0], "safe", index)

    peer = tmp_path / "peer.npy"
    stored = in_turns(add, lambda: np.save(peer, large.safe))
    read = in_turns(read_all, lambda: np.testing.assert_array_equal(np.load(peer), large.safe))
    one = in_turns(read_some, lambda: np.load(peer)).per(100, 1)
    store.close()
    print(
        f"\ndataset of {size / 1e6:.0f} MB, load {os.getloadavg()[0]:.1f}: stored in "
        f"{np.median(stored.ours):.2f} s, numpy.save of `safe`, not synced, takes {stored}; "
        f"read in {np.median(read.ours):.2f} s, numpy.load {read}; "
        f"one rollout in {1e3 * np.median(one.ours):.2f} ms, numpy.load of all {one}"
    )
