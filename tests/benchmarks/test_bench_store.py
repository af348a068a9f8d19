"""Storing 100,000 assessments: the store's chunks against the usual row for each sample."""

import os
from dataclasses import fields
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
from sqlalchemy import func, insert, select
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column

from app.store.assessments import StoredAssessments
from app.store.database import make_engine, writing
from app.store.store import open_store
from core.channels import KEYS
from core.dataset import Dataset
from core.monitor import train

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
    flown = flight_of(N)
    store = open_store(tmp_path / "chunks.db")
    flight = store.flights.add({}, store.monitors.add(train(dataset), "m").id, 0.1)
    arrays = [getattr(flown, f.name) for f in fields(flown) if f.name not in ("seq", "reasons")]
    t, y, p_value, alert, state, y_hat = arrays
    begin = perf_counter()
    for i in range(0, N, EACH):
        part = slice(i, i + EACH)
        store.flights.append(
            flight, i, t[part], y[part], p_value[part], alert[part], state[part], y_hat[part]
        )
    chunks = perf_counter() - begin
    at_once = store.flights.add({}, store.flights.info(flight).monitor_id, 0.1)
    begin = perf_counter()
    store.flights.append(at_once, 0, *arrays)
    one_commit = (perf_counter() - begin) / N
    begin = perf_counter()
    back = store.flights.assessments(flight)
    read_chunks = perf_counter() - begin
    for field in fields(flown):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(flown, field.name))
    begin = perf_counter()
    for i in range(0, N, N // 100):
        assert len(store.flights.assessments(flight, i, i + 99)) == 100
    backfill = (perf_counter() - begin) / 100

    engine = make_engine(store.engine.url.set(database=str(tmp_path / "rows.db")))
    Base.metadata.create_all(engine)
    begin = perf_counter()
    for row in rows(flown, 0, FEW):
        with Session(engine) as session, session.begin():
            session.add(Sample(**row))
    each = (perf_counter() - begin) / FEW
    begin = perf_counter()
    with Session(engine) as session, session.begin():
        session.add_all(Sample(**row) for row in rows(flown, FEW, EACH))
    together = (perf_counter() - begin) / EACH
    begin = perf_counter()
    for i in range(FEW + EACH, N, EACH):
        with writing(engine) as connection:
            connection.execute(insert(Sample), rows(flown, i, min(EACH, N - i)))
    many = (perf_counter() - begin) / (N - FEW - EACH)
    begin = perf_counter()
    with Session(engine) as session:
        assert len(session.scalars(select(Sample).order_by(Sample.seq)).all()) == N
    read_rows = perf_counter() - begin
    with Session(engine) as session:
        assert session.scalar(select(func.count()).select_from(Sample)) == N

    for opened in (engine, store.engine):
        opened.dispose()
    sizes = [(tmp_path / name).stat().st_size for name in ("chunks.db", "rows.db")]
    own = chunks / N
    print(
        f"\n{N:,} assessments, load {os.getloadavg()[0]:.1f}; chunks of {EACH}: "
        f"{own * 1e6:.2f} µs each, a commit with fsync a chunk ({one_commit * 1e6:.2f} µs in one "
        f"commit);\n"
        f"  ORM row and commit a sample {each * 1e6:.0f} µs: ratio {each / own:.0f} x; "
        f"ORM, commit a thousand {together * 1e6:.0f} µs: {together / own:.0f} x; "
        f"executemany {many * 1e6:.1f} µs: {many / own:.0f} x;\n"
        f"  read back {read_chunks * 1e3:.1f} ms, ORM rows {read_rows * 1e3:.0f} ms: "
        f"{read_rows / read_chunks:.0f} x; backfill of 100 samples {backfill * 1e3:.2f} ms;\n"
        f"  on disk {sizes[0] / N / 2:.0f} and {sizes[1] / N:.0f} bytes each"
    )


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
    begin = perf_counter()
    info = store.datasets.add(large, "large")
    added = perf_counter()
    back = store.datasets.get(info.id)
    read = perf_counter()
    for index in range(0, n_safe, n_safe // 100):
        store.datasets.rollout(info.id, "safe", index)
    one = (perf_counter() - read) / 100
    np.testing.assert_array_equal(back.safe, large.safe)
    peer = []
    for _ in range(3):
        start = perf_counter()
        np.save(tmp_path / "peer.npy", large.safe)
        peer.append(perf_counter() - start)
    store.close()
    print(
        f"\ndataset of {size / 1e6:.0f} MB, load {os.getloadavg()[0]:.1f}: stored in "
        f"{added - begin:.2f} s (numpy.save of `safe`, not synced {min(peer):.2f} s), read in "
        f"{read - added:.2f} s; one rollout {one * 1e3:.2f} ms"
    )
