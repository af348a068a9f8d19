"""Stored datasets: identical to the bit, complete or absent, single rollouts readable."""

from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from sqlalchemy import delete, update

from app.store import datasets as stored_datasets
from app.store.database import writing
from app.store.datasets import (
    DatasetInfo,
    from_blob,
    from_blocks,
    peak_histograms,
    to_blob,
    to_blocks,
)
from app.store.store import NotFound, Store, StoreError
from app.store.tables import (
    dataset_blocks,
    datasets,
)
from core.dataset import Dataset
from core.limits.limits import Limits
from tests.support.stored import count, make_parts_small


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    make_parts_small(monkeypatch)


@pytest.mark.parametrize("parts", ["large", "small"])
def test_a_dataset_comes_back_to_the_bit(
    store: Store, dataset: Dataset, parts: str, request: pytest.FixtureRequest
) -> None:
    if parts == "small":
        request.getfixturevalue("small_parts")
    info = store.datasets.add(dataset, "doublets")
    back = store.datasets.get(info.id)
    for field in fields(Dataset):
        given, read = getattr(dataset, field.name), getattr(back, field.name)
        np.testing.assert_array_equal(read, given)
        if isinstance(given, np.ndarray):
            assert read.dtype == given.dtype
    assert (count(store, dataset_blocks) > 20) == (parts == "small")


def test_the_info_of_a_dataset_describes_it(store: Store, dataset: Dataset) -> None:
    added = store.datasets.add(dataset, "doublets")
    assert store.datasets.info(added.id) == added
    assert store.datasets.all() == [added]
    assert (added.n_unsafe, added.n_samples, added.n_obs, added.seed) == (12, 61, 20, 7)
    assert added.digest == dataset.digest()
    assert added.unsafe_rate == dataset.unsafe_rate
    assert added.theta_names == dataset.theta_names


def test_lists_begin_with_the_newest(store: Store, dataset: Dataset) -> None:
    added = [store.datasets.add(dataset, name).id for name in "abc"]
    assert [info.id for info in store.datasets.all()] == added[::-1]


@pytest.mark.parametrize("seed", [None, 0, 2**128 + 1])
def test_any_seed_is_kept(store: Store, dataset: Dataset, seed: int | None) -> None:
    info = store.datasets.add(replace(dataset, seed=seed), "a")
    assert store.datasets.get(info.id).seed == store.datasets.info(info.id).seed == seed


def test_a_dataset_without_safe_rollouts_is_kept(store: Store, dataset: Dataset) -> None:
    none = {name: getattr(dataset, name)[:0] for name in ("safe", "safe_times", "theta_safe")}
    lonely = replace(dataset, **none, n_safe_met=0)
    info = store.datasets.add(lonely, "a")
    assert store.datasets.get(info.id).safe.shape == (0, 61, 6)
    single = {name: getattr(lonely, name)[:1] for name in ("unsafe", "fail_index", "theta_unsafe")}
    assert store.datasets.add(replace(lonely, **single), "b").unsafe_rate is None


def test_every_rollout_ends_with_its_failure_sample(
    store: Store, dataset: Dataset, small_parts: None
) -> None:
    dataset_id = store.datasets.add(dataset, "a").id
    for index, fail_index in enumerate(dataset.fail_index):
        y, theta, fail = store.datasets.rollout(dataset_id, "unsafe", index)
        assert fail == fail_index
        np.testing.assert_array_equal(y, dataset.unsafe[index, : fail_index + 1])
        assert list(theta.values()) == dataset.theta_unsafe[index].tolist()
    for index in range(len(dataset.safe)):
        y, theta, fail = store.datasets.rollout(dataset_id, "safe", index)
        assert fail is None
        np.testing.assert_array_equal(y, dataset.safe[index])
        assert theta == dict(
            zip(dataset.theta_names, dataset.theta_safe[index].tolist(), strict=True)
        )


def test_a_rollout_is_read_without_the_others(
    store: Store, dataset: Dataset, small_parts: None
) -> None:
    dataset_id = store.datasets.add(dataset, "a").id
    block = dataset_blocks.c
    with writing(store.engine) as connection:
        connection.execute(delete(dataset_blocks).where(block.first_row > 0))
    np.testing.assert_array_equal(store.datasets.rollout(dataset_id, "safe", 0).y, dataset.safe[0])
    with pytest.raises(StoreError, match="12 rows it was stored with"):
        store.datasets.get(dataset_id)


@pytest.mark.parametrize("index", [-1, 12])
def test_a_rollout_beyond_the_dataset_is_not_found(
    store: Store, dataset: Dataset, index: int
) -> None:
    dataset_id = store.datasets.add(dataset, "a").id
    with pytest.raises(NotFound, match=f"no unsafe rollout {index} .* it has 12"):
        store.datasets.rollout(dataset_id, "unsafe", index)


def test_an_altered_array_is_noticed(store: Store, dataset: Dataset) -> None:
    dataset_id = store.datasets.add(dataset, "a").id
    unsafe = dataset.unsafe.copy()
    unsafe[0, 0, 0] += 1e-12
    with writing(store.engine) as connection:
        connection.execute(
            update(dataset_blocks)
            .where(dataset_blocks.c.name == "unsafe")
            .values(content=to_blob(unsafe))
        )
    with pytest.raises(StoreError, match="digest does not match"):
        store.datasets.get(dataset_id)


def test_a_dataset_is_visible_only_when_complete(
    store: Store, dataset: Dataset, small_parts: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[list[DatasetInfo]] = []

    def slowly(array: np.ndarray) -> Iterator[tuple[int, bytes]]:
        for block in to_blocks(array):
            seen.append(store.datasets.all())
            yield block

    monkeypatch.setattr(stored_datasets, "to_blocks", slowly)
    added = store.datasets.add(dataset, "a")
    assert len(seen) > 20
    assert not any(seen)
    assert store.datasets.all() == [added]


def test_a_dataset_that_fails_half_way_leaves_nothing(
    store: Store, dataset: Dataset, small_parts: None
) -> None:
    with pytest.raises(ValueError, match="Object arrays"):
        store.datasets.add(replace(dataset, theta_safe=dataset.theta_safe.astype(object)), "a")
    assert store.datasets.all() == []
    assert count(store, datasets) == count(store, dataset_blocks) == 0


def test_peaks_count_every_rollout_against_its_limit(dataset: Dataset) -> None:
    histograms = peak_histograms(replace(dataset, specification=Limits(Ny=0.4, p=0.3)))
    assert [peaks.channel for peaks in histograms] == ["p", "Ny"]
    for peaks, channel in zip(histograms, (1, 3), strict=True):
        edges = np.array(peaks.edges)
        assert 1.0 in peaks.edges
        for counts, y in ((peaks.unsafe, dataset.unsafe), (peaks.safe, dataset.safe)):
            plain = [max(abs(v) for v in row if v == v) / peaks.limit for row in y[..., channel]]
            expected = [
                sum(low <= peak < high or (peak >= high and high == edges[-1]) for peak in plain)
                for low, high in pairwise(edges)
            ]
            assert list(counts) == expected


def test_a_diverged_rollout_counts_in_the_last_bin(dataset: Dataset) -> None:
    unsafe = dataset.unsafe.copy()
    unsafe[0, 1, 3] = np.inf
    (peaks,) = peak_histograms(replace(dataset, unsafe=unsafe))
    assert peaks.unsafe[-1] == 1
    assert sum(peaks.unsafe) == len(unsafe)
    assert len(peaks.edges) == 61


def test_a_specification_without_limits_has_no_peaks(dataset: Dataset) -> None:
    for specification in ("a label", None):
        assert peak_histograms(replace(dataset, specification=specification)) == ()


def test_python_objects_are_neither_stored_nor_read() -> None:
    with pytest.raises(ValueError, match="Object arrays"):
        to_blob(np.array([{}]))
    pickled = np.array([1.0]).dumps()
    with pytest.raises(StoreError, match="damaged"):
        from_blob(pickled)


def test_an_array_is_read_again_after_a_system_error_in_its_header(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    load, tries = np.load, []

    def stumble_once(*arguments: Any, **options: Any) -> Any:
        tries.append(1)
        if len(tries) == 1:
            raise SystemError("AST constructor recursion depth mismatch (before=54, after=51)")
        return load(*arguments, **options)

    blob = to_blob(np.arange(3))
    monkeypatch.setattr(np, "load", stumble_once)
    assert from_blob(blob).tolist() == [0, 1, 2]
    assert len(tries) == 2


def test_blocks_that_do_not_add_up_are_refused() -> None:
    blocks = [to_blob(np.zeros((3, 2))), to_blob(np.zeros((2, 2)))]
    assert from_blocks(blocks, 5).shape == (5, 2)
    for wrong in (
        blocks[:1],
        [],
        [*blocks, blocks[1]],
        [blocks[0], to_blob(np.zeros((2, 2), int))],
    ):
        with pytest.raises(StoreError, match="rows it was stored with"):
            from_blocks(wrong, 5)
