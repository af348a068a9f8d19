"""Samples of scorings and their tiles as files: memory-mapped .npy arrays."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from app.assessment import sample_type
from app.recordings.files import Verified, reporting_full_disk
from app.recordings.tiles import make_tiles, tile_type
from app.store.database import Damaged
from core.whole_file import whole_file

Samples = npt.NDArray[np.void]

WHOLE, TILES = "npy", "tiles.npy"
PIECE = 8192
"""Samples that are hashed at once."""
REMEDY = "delete this scoring and score the recording again"


def digest(samples: Samples, rest: Callable[[], None] = lambda: None) -> str:
    """SHA-256 of samples, bit for bit. rest: called between pieces of work."""
    sha = hashlib.sha256()
    for first in range(0, len(samples), PIECE):
        sha.update(np.ascontiguousarray(samples[first : first + PIECE]).data)
        rest()
    return sha.hexdigest()


def save_samples(folder: Path, scoring_id: str, samples: Samples) -> None:
    """Write samples and their tiles, each complete or not at all. NoSpace."""
    with reporting_full_disk():
        for kind, array in ((WHOLE, samples), (TILES, make_tiles(samples))):
            with whole_file(folder / f"{scoring_id}.{kind}") as file:
                np.save(file, array, allow_pickle=False)


def open_samples(
    folder: Path,
    scoring_id: str,
    expected: str,
    verified: Verified,
    rest: Callable[[], None] = lambda: None,
) -> Samples:
    """The samples of a scoring, memory-mapped, read-only. Damaged if they changed since stored.

    expected: their digest.   rest: called between pieces of work.

    Version 0.1.0 used another name for one field, with the same bits.
    """
    path = folder / f"{scoring_id}.{WHOLE}"
    verified.check(path, expected, REMEDY, lambda path: digest(_samples(path), rest))
    return _samples(path)


def _samples(path: Path) -> Samples:
    return _mapped(path, _stored_type)


def _stored_type(stored: np.dtype) -> np.dtype:
    """Earlier versions stored none of the newest field, trim."""
    newest = sample_type(stored["y"].shape[0])
    return newest if stored.itemsize == newest.itemsize else np.dtype(newest.descr[:-1])


def open_tiles(folder: Path, scoring_id: str, expected: str, verified: Verified) -> Samples:
    """The tiles of a scoring (app.recordings.tiles), memory-mapped, read-only. Damaged.

    expected: digest of the samples that they are made from.
    """
    path = folder / f"{scoring_id}.{TILES}"

    def compare(path: Path) -> str:
        samples = open_samples(folder, scoring_id, expected, verified)
        is_intact = digest(make_tiles(samples)) == digest(_mapped(path, _tile_type))
        return expected if is_intact else ""

    verified.check(path, expected, REMEDY, compare)
    return _mapped(path, _tile_type)


def _tile_type(stored: np.dtype) -> np.dtype:
    return tile_type(stored["low"].shape[0])


def remove(folder: Path, scoring_id: str) -> None:
    for kind in (WHOLE, TILES):
        (folder / f"{scoring_id}.{kind}").unlink(missing_ok=True)


def _mapped(path: Path, type_of: Callable[[np.dtype], np.dtype]) -> Samples:
    """A stored array of structures. type_of: from the type in its file."""
    try:
        stored = np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
        return stored.view(type_of(stored.dtype))
    except FileNotFoundError:
        raise
    except (OSError, ValueError, TypeError, EOFError, KeyError, IndexError) as error:
        raise Damaged(f"{path} is damaged ({error}): {REMEDY}") from error
