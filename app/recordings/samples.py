"""Samples of scorings as files: flat .npy arrays that are mapped, not loaded, with their tiles."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from app.recordings.files import spacious
from app.recordings.tiles import TILE, make_tiles
from app.recordings.verified import Verified
from app.scoring import SAMPLE
from app.store.database import Damaged
from core.whole_file import whole_file

Samples = npt.NDArray[np.void]

WHOLE, TILES = "npy", "tiles.npy"
PIECE = 8192
"""Samples that are hashed at a time."""
REMEDY = "delete this scoring and score the recording again"


def digest(samples: Samples, rest: Callable[[], None] = lambda: None) -> str:
    """SHA-256 of samples, bit for bit. rest: called between their pieces."""
    found = hashlib.sha256()
    for first in range(0, len(samples), PIECE):
        found.update(np.ascontiguousarray(samples[first : first + PIECE]).data)
        rest()
    return found.hexdigest()


def keep(folder: Path, scoring_id: str, samples: Samples) -> None:
    """Write samples and the tiles made of them, each whole or not at all. NoSpace."""
    with spacious():
        for kind, array in ((WHOLE, samples), (TILES, make_tiles(samples))):
            with whole_file(folder / f"{scoring_id}.{kind}") as file:
                np.save(file, array, allow_pickle=False)


def samples_file(folder: Path, scoring_id: str) -> Path:
    """The file of a scoring's samples."""
    return folder / f"{scoring_id}.{WHOLE}"


def check_samples(
    folder: Path,
    scoring_id: str,
    expected: str,
    verified: Verified,
    rest: Callable[[], None] = lambda: None,
) -> None:
    """Read the samples and tiles of a scoring. FileNotFoundError; Damaged.

    rest: called between pieces of the work.
    """
    open_samples(folder, scoring_id, expected, verified, rest)
    open_tiles(folder, scoring_id, expected, verified)


def open_samples(
    folder: Path,
    scoring_id: str,
    expected: str,
    verified: Verified,
    rest: Callable[[], None] = lambda: None,
) -> Samples:
    """The samples of a scoring, mapped, read-only. Damaged where they are not those stored.

    expected: their digest.   rest: called between pieces of reading them.

    Version 0.1.0 named a field otherwise; what lies in it is the same, bit for bit.
    """
    path = samples_file(folder, scoring_id)
    verified.check(path, expected, REMEDY, lambda path: digest(_mapped(path, SAMPLE), rest))
    return _mapped(path, SAMPLE)


def open_tiles(folder: Path, scoring_id: str, expected: str, verified: Verified) -> Samples:
    """The tiles of a scoring, as of app.recordings.tiles, mapped, read-only. Damaged.

    expected: digest of the samples, of which they are made.
    """
    path = folder / f"{scoring_id}.{TILES}"

    def compare(path: Path) -> str:
        samples = open_samples(folder, scoring_id, expected, verified)
        same = digest(make_tiles(samples)) == digest(_mapped(path, TILE))
        return expected if same else ""

    verified.check(path, expected, REMEDY, compare)
    return _mapped(path, TILE)


def remove(folder: Path, scoring_id: str) -> None:
    """Remove the files of a scoring, those that are there."""
    for kind in (WHOLE, TILES):
        (folder / f"{scoring_id}.{kind}").unlink(missing_ok=True)


def _mapped(path: Path, dtype: np.dtype) -> Samples:
    try:
        return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)).view(dtype)
    except FileNotFoundError:
        raise
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise Damaged(f"{path} is damaged ({error}): {REMEDY}") from error
