"""Arrays as blobs in numpy's .npy format, never pickle; long ones in blocks of rows."""

import io
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from app.store.database import Damaged

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
