"""Stored datasets: arrays in blocks, so that one rollout is read without the others.

An array is a blob in numpy's .npy format, never pickle; a long one is several blocks of rows.
"""

import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field
from sqlalchemy import Connection, Row, delete, select

from app.recipes.recipes import SentRecipe
from app.store.database import Damaged
from app.store.repository import Entries, Entry, InUse, NotFound, Time
from app.store.tables import dataset_blocks, datasets, monitors, new_id, now
from core import __version__
from core.channels import Dictionary
from core.dataset import Dataset
from core.limits.limits import (
    Envelope,
    PlainSpecification,
    envelope_of,
    specification_from_plain,
    specification_to_plain,
)
from core.types import Array

ROWS = {
    "unsafe": "n_unsafe",
    "fail_index": "n_unsafe",
    "theta_unsafe": "n_unsafe",
    "safe": "n_safe",
    "safe_times": "n_safe",
    "theta_safe": "n_safe",
}
"""Arrays of a dataset, and the field that counts their rows."""
BINS_TO_THE_LIMIT = 20
MOST_BINS = 60

Outcome = Literal["unsafe", "safe"]
BLOCK_BYTES = 256 * 1024


def to_blob(array: npt.NDArray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def from_blob(blob: bytes) -> npt.NDArray:
    """Unpack an array. StoreError if the blob is damaged."""
    try:
        try:
            return np.load(io.BytesIO(blob), allow_pickle=False)
        except SystemError:  # CPython 3.11: numpy's header parser is not thread-safe
            return np.load(io.BytesIO(blob), allow_pickle=False)
    except Exception as error:  # numpy's parser raises many kinds for a damaged header
        raise Damaged(
            f"a stored array is damaged ({error}): restore the database from a backup"
        ) from error


def to_blocks(array: npt.NDArray) -> Iterator[tuple[int, bytes]]:
    """Blocks of whole rows as (first row, blob); an array without rows gives one block."""
    row_bytes = array.nbytes // max(len(array), 1)
    rows = max(1, BLOCK_BYTES // max(row_bytes, 1))
    for first in range(0, max(len(array), 1), rows):
        yield first, to_blob(array[first : first + rows])


def from_blocks(blocks: Iterable[bytes], n_rows: int) -> npt.NDArray:
    """Join blocks in order. StoreError if they do not add up to n_rows rows."""
    array, first = None, 0
    for blob in blocks:
        block = from_blob(blob)
        if array is None:
            array = np.empty((n_rows, *block.shape[1:]), block.dtype)
        if block.dtype != array.dtype or len(block) > n_rows - first:
            raise _wrong_rows(n_rows)
        array[first : first + len(block)] = block
        first += len(block)
    if array is None or first != n_rows:
        raise _wrong_rows(n_rows)
    return array


def _wrong_rows(n_rows: int) -> Damaged:
    return Damaged(
        f"a stored array does not have the {n_rows} rows it was stored with: restore the database "
        "from a backup"
    )


@dataclass(frozen=True)
class PeakHistogram(Entry):
    """Rollouts counted by their peak margin: |channel| / limit, or the share of the way from rest
    to the limit; a bin starts at 1, the limit."""

    channel: str
    limit: float | None
    """in the channel's unit; null unless it is a magnitude"""
    edges: tuple[float, ...]
    """(n_bins + 1,) the last bin counts all higher peaks"""
    unsafe: tuple[int, ...]
    """(n_bins,) rollouts"""
    safe: tuple[int, ...]
    """(n_bins,) rollouts"""

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        rows = (tuple(plain[name]) for name in ("edges", "unsafe", "safe"))
        return cls(plain["channel"], plain["limit"], *rows)


@dataclass(frozen=True)
class DatasetInfo(Entry):
    """A dataset without its arrays."""

    id: str
    name: str
    created: Time
    digest: str
    """SHA-256 of the data a monitor can learn from"""
    seed: int | None
    version: str
    """version of the program that simulated it"""
    recipe: SentRecipe
    """recipe as requested; empty if not simulated here"""
    dt: float
    """sample interval [s]"""
    n_unsafe: int
    n_safe: int
    """safe rollouts stored"""
    n_safe_met: int
    """safe rollouts simulated, stored or not"""
    n_samples: int
    """samples per rollout"""
    n_obs: int
    """observation times stored per safe rollout"""
    unsafe_rate: float | None
    """unbiased share of unsafe rollouts; null if too few were simulated"""
    theta_names: tuple[str, ...]
    """names of theta, the uncertain parameters"""
    specification: Annotated[PlainSpecification, Field(serialization_alias="limits")]
    """by channel; a label for limits known only by verdicts; null if unknown"""
    dictionary: dict[str, Any] | None
    """channels of its samples; null for the six lateral ones"""
    peaks: tuple[PeakHistogram, ...]
    """one histogram per limited channel"""
    findings: list[str] | None
    """what was left out of rollouts, or looks implausible; null for simulated ones"""


class StoredRollout(NamedTuple):
    """One rollout of a dataset.

    y: (k, n_channels), up to and including the failure sample.   theta: parameters by name.
    fail_index: failure sample, None for a safe rollout.
    """

    y: Array
    theta: dict[str, float]
    fail_index: int | None


class DatasetRepository(Entries[DatasetInfo]):
    """Datasets by id."""

    table, parts, entry = datasets, dataset_blocks, DatasetInfo

    def add(
        self, dataset: Dataset, name: str, findings: Sequence[str] | None = None
    ) -> DatasetInfo:
        """Store a dataset; it becomes visible once complete."""
        n_unsafe, n_met = len(dataset.unsafe), dataset.n_safe_met
        info = DatasetInfo(
            id=new_id(),
            name=name,
            created=now(),
            digest=dataset.digest(),
            seed=dataset.seed,
            version=__version__,
            recipe=dataset.recipe,
            dt=dataset.dt,
            n_unsafe=n_unsafe,
            n_safe=len(dataset.safe),
            n_safe_met=n_met,
            n_samples=dataset.unsafe.shape[1],
            n_obs=dataset.safe_times.shape[1],
            unsafe_rate=dataset.unsafe_rate if n_unsafe and n_unsafe + n_met > 1 else None,
            theta_names=tuple(dataset.theta_names),
            peaks=peak_histograms(dataset),
            specification=specification_to_plain(dataset.specification),
            dictionary=dataset.dictionary.stored,
            findings=None if findings is None else list(findings),
        )
        row = vars(info) | {"peaks": [asdict(peaks) for peaks in info.peaks]}
        self._add_in_parts(datasets, row, dataset_blocks, _blocks(info.id, dataset))
        return info

    def get(self, dataset_id: str) -> Dataset:
        """The dataset with its arrays. StoreError if damaged."""
        with self._reading() as connection:
            info = self._fetch(connection, dataset_id)
            arrays: dict[str, Any] = {
                name: from_blocks(_contents(connection, dataset_id, name), getattr(info, count))
                for name, count in ROWS.items()
            }
        dictionary = Dictionary.from_stored(info.dictionary)
        dataset = Dataset(
            **arrays,
            dt=info.dt,
            theta_names=info.theta_names,
            n_safe_met=info.n_safe_met,
            seed=info.seed,
            recipe=info.recipe,
            specification=specification_from_plain(info.specification, dictionary),
            dictionary=dictionary,
        )
        if dataset.digest() != info.digest:
            raise Damaged(
                f"dataset {info.name} ({dataset_id}) is damaged (its digest does not match): "
                "simulate it again from its recipe and seed, or add its rollouts again"
            )
        return dataset

    def rollout(self, dataset_id: str, outcome: Outcome, index: int) -> StoredRollout:
        """Return one rollout, reading little more than its own rows.

        index: from 0 within its outcome.
        """
        with self._reading() as connection:
            info = self._fetch(connection, dataset_id)
            n = info.n_unsafe if outcome == "unsafe" else info.n_safe
            if not 0 <= index < n:
                raise NotFound(
                    f"there is no {outcome} rollout {index} in dataset {dataset_id!r}: it has {n} "
                    f"{outcome} rollouts, numbered from 0"
                )
            y = _array_row(connection, dataset_id, outcome, index)
            theta = _array_row(connection, dataset_id, f"theta_{outcome}", index)
            fail_index = None
            if outcome == "unsafe":
                fail_index = int(_array_row(connection, dataset_id, "fail_index", index))
                y = y[: fail_index + 1]
        names = info.theta_names or tuple(f"theta[{i}]" for i in range(len(theta)))
        return StoredRollout(y.copy(), dict(zip(names, theta.tolist(), strict=True)), fail_index)

    def delete(self, dataset_id: str) -> None:
        """Delete a dataset. InUse if monitors were trained on it."""
        users = select(monitors.c.name, monitors.c.id).where(monitors.c.dataset_id == dataset_id)
        with self._deleting() as connection:
            name = self._fetch(connection, dataset_id).name
            if using := connection.execute(users.order_by(monitors.c.created)).all():
                raise InUse(f"dataset {name}", [(row.name, row.id) for row in using])
            connection.execute(delete(datasets).where(datasets.c.id == dataset_id))

    def _entry(self, row: Row) -> DatasetInfo:
        values = dict(row._mapping)
        values["theta_names"] = tuple(values["theta_names"])
        values["peaks"] = tuple(PeakHistogram.from_plain(peak) for peak in values["peaks"])
        return DatasetInfo(**values)


def _blocks(dataset_id: str, dataset: Dataset) -> Iterator[dict[str, Any]]:
    for name in ROWS:
        for first_row, content in to_blocks(getattr(dataset, name)):
            yield {
                "dataset_id": dataset_id,
                "name": name,
                "first_row": first_row,
                "content": content,
            }


def _contents(connection: Connection, dataset_id: str, name: str) -> Iterator[bytes]:
    block = dataset_blocks.c
    query = select(block.content).where(block.dataset_id == dataset_id, block.name == name)
    rows = connection.execution_options(yield_per=8).execute(query.order_by(block.first_row))
    yield from rows.scalars()


def _array_row(connection: Connection, dataset_id: str, name: str, index: int) -> Any:
    block = dataset_blocks.c
    query = (
        select(block.first_row, block.content)
        .where(block.dataset_id == dataset_id, block.name == name, block.first_row <= index)
        .order_by(block.first_row.desc())
        .limit(1)
    )
    first_row, content = connection.execute(query).one()
    return from_blob(content)[index - first_row]


def peak_histograms(dataset: Dataset) -> tuple[PeakHistogram, ...]:
    """One histogram per limited channel; none unless the specification is one of limits."""
    envelope = envelope_of(dataset.specification)
    if envelope is None:
        return ()
    limited = np.flatnonzero(envelope.limited).tolist()
    return tuple(_histogram(dataset, envelope, c) for c in limited)


def _histogram(dataset: Dataset, envelope: Envelope, c: int) -> PeakHistogram:
    own = Envelope(*(ends[[c]] for ends in envelope))
    margins = [own.margin(y[..., [c]]) for y in (dataset.unsafe, dataset.safe)]
    peaks = [np.fmax.reduce(margin, axis=1, initial=0.0) for margin in margins]
    bins = [np.minimum(p * BINS_TO_THE_LIMIT, MOST_BINS - 1).astype(int) for p in peaks]
    n_bins = max(BINS_TO_THE_LIMIT, *(int(b.max(initial=0)) + 1 for b in bins))
    counts = [tuple(np.bincount(b, minlength=n_bins).tolist()) for b in bins]
    edges = np.arange(n_bins + 1) / BINS_TO_THE_LIMIT
    low, high, rest = (float(end[0]) for end in own)
    limit = high if low == -high and rest == 0.0 else None
    return PeakHistogram(dataset.dictionary.keys[c], limit, tuple(edges.tolist()), *counts)
