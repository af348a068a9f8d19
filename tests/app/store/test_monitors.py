"""Stored monitors: the same p-values, the same file, tied to their dataset."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import update

from app.store import monitor_upload
from app.store import monitors as stored_monitors
from app.store.database import writing
from app.store.monitors import SupportInfo
from app.store.store import NotFound, Store, StoreError
from app.store.tables import monitor_parts
from core.dataset import Dataset
from core.monitor import Monitor
from core.monitor.file.portable import MonitorFileError
from core.monitor.validity.support import Support
from tests.support.stored import EVALUATION, count, make_parts_small
from tests.support.wicked_reader import MAGIC


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    make_parts_small(monkeypatch)


def test_a_monitor_comes_back_with_the_same_p_values(
    store: Store, trained: Monitor, flights: np.ndarray, small_parts: None
) -> None:
    info = store.monitors.add(trained, "m")
    assert count(store, monitor_parts) > 5
    back = store.monitors.get(info.id)
    for y in flights:
        np.testing.assert_array_equal(back.p_values(y), trained.p_values(y))
    assert store.monitors.file(info.id) == trained.to_bytes()


def test_a_monitor_says_what_it_is(store: Store, dataset: Dataset, trained: Monitor) -> None:
    dataset_id = store.datasets.add(dataset, "d").id
    evaluated = replace(trained, evaluation=EVALUATION)
    added = store.monitors.add(evaluated, "m", dataset_id)
    assert store.monitors.info(added.id) == added
    assert store.monitors.all() == [added]
    assert added.dataset_id == dataset_id
    assert added.recipe["predictor"] == {"kind": "linear"}
    assert (added.lead, added.n_unsafe) == (trained.lead, trained.n_unsafe)
    assert store.monitors.evaluation(added.id) == EVALUATION
    assert store.monitors.get(added.id).evaluation == EVALUATION


def test_a_monitor_file_is_kept_as_it_is_and_finds_its_dataset(
    store: Store, dataset: Dataset, trained: Monitor
) -> None:
    content = trained.to_bytes()
    alone = store.monitors.add_file(content, "sent")
    assert alone.dataset_id is None
    dataset_id = store.datasets.add(dataset, "d").id
    tied = store.monitors.add_file(content, "sent again")
    assert tied.dataset_id == dataset_id
    assert alone.digest == tied.digest
    assert store.monitors.file(tied.id) == content
    with pytest.raises(MonitorFileError, match="broken"):
        store.monitors.add_file(content[:-1], "broken")
    assert len(store.monitors.all()) == 2


DEEDS = {
    "crash": r"m.fwm ended its reader \(SIGSEGV\): choose a file written by `forewarn train`",
    "eat": "m.fwm took more than 200 MiB of memory to read: choose",
    "loop": "m.fwm took more than 0.5 s to read: choose",
    "refuse": "m.fwmthis is wicked",
}


@pytest.mark.parametrize("deed", DEEDS)
@pytest.mark.usefixtures("read_apart")
def test_a_monitor_file_can_harm_the_reader_s_process_alone(
    deed: str, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = monitor_upload._request

    def wicked(path: Path) -> dict[str, Any]:
        return order(path) | {"reader": "tests.support.wicked_reader", "most_bytes": 2**20}

    monkeypatch.setattr(monitor_upload, "_request", wicked)
    monkeypatch.setattr(monitor_upload, "MEMORY", 200 * 2**20)
    monkeypatch.setattr(monitor_upload, "SECONDS", 0.5 if deed == "loop" else 60.0)
    monkeypatch.setattr(
        stored_monitors, "from_bytes", lambda *what: pytest.fail("read in this process")
    )
    with pytest.raises(MonitorFileError, match=DEEDS[deed]):
        store.monitors.add_file(MAGIC + deed.encode(), "m.fwm")


def test_what_validity_is_calibrated_on_is_known_without_the_file(
    store: Store, dataset: Dataset, trained: Monitor
) -> None:
    assert store.monitors.add(trained, "bare").support is None
    safe, unsafe = (np.sort(np.random.default_rng(n).random((n, 2)), axis=0) for n in (300, 200))
    support = Support(np.ones(6), safe, unsafe, dataset.unsafe.shape[1])
    monitor = replace(trained, support=support, evaluation=EVALUATION)
    expected = SupportInfo(n_safe=300, n_unsafe=200, level=0.02)
    added = store.monitors.add(monitor, "m")
    sent = store.monitors.add_file(monitor.to_bytes(), "sent")
    assert added.support == sent.support == store.monitors.info(sent.id).support == expected
    assert [info.support for info in store.monitors.all()] == [expected, expected, None]
    assert store.monitors.evaluation(added.id) == EVALUATION
    assert store.monitors.evaluation(sent.id) == EVALUATION
    stored = store.monitors.get(added.id).support
    assert stored is not None
    assert stored.unsafe.tobytes() == support.unsafe.tobytes()


def test_a_monitor_is_tied_only_to_the_dataset_it_was_trained_on(
    store: Store, dataset: Dataset, trained: Monitor
) -> None:
    other = store.datasets.add(replace(dataset, dt=0.1), "other").id
    with pytest.raises(ValueError, match="not the one this monitor was trained on"):
        store.monitors.add(trained, "m", other)
    with pytest.raises(NotFound, match="no dataset 'nowhere'"):
        store.monitors.add(trained, "m", "nowhere")
    assert store.monitors.all() == []


def test_the_last_few_monitors_stay_ready(store: Store, trained: Monitor) -> None:
    ids = [store.monitors.add(trained, "m").id for _ in range(stored_monitors.MOST_IN_MEMORY + 1)]
    first = store.monitors.get(ids[0])
    for monitor_id in ids[1:-1]:
        store.monitors.get(monitor_id)
    assert store.monitors.get(ids[0]) is first
    second = store.monitors.get(ids[1])
    store.monitors.get(ids[-1])
    assert store.monitors.get(ids[1]) is second
    assert len(store.monitors._loaded) == stored_monitors.MOST_IN_MEMORY
    store.monitors.delete(ids[1])
    with pytest.raises(NotFound):
        store.monitors.get(ids[1])


def test_an_altered_monitor_is_noticed(store: Store, trained: Monitor) -> None:
    info = store.monitors.add(trained, "m")
    with writing(store.engine) as connection:
        connection.execute(update(monitor_parts).values(content=b"FOREWARN MONITOR 1"))
    with pytest.raises(StoreError, match="digest does not match"):
        store.monitors.get(info.id)
