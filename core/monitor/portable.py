"""The portable monitor file: one line of text, a digest, and arrays; never pickle.

FOREWARN MONITOR 2\\n  sha-256 of all that follows, hexadecimal\\n  an npz archive
with `header` (JSON) and the arrays

Format 2 holds the validity's support besides; a monitor without one is written as format 1, which
older programs read too.
"""

import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from core.recipe import to_plain

if TYPE_CHECKING:
    from core.monitor.monitor import Monitor

MAGIC = b"FOREWARN MONITOR "
FORMAT = 2
HEADER_FIELDS = ("dt", "h", "n_early", "dataset_recipe", "dataset_digest", "seed", "version")
ARRAYS = (
    "scale",
    "reach",
    "unsafe_points",
    "unsafe_where",
    "safe_points",
    "safe_where",
    "theta_unsafe",
    "theta_safe",
    "alphas",
)
SUPPORT_ARRAYS = ("sigma", "safe", "unsafe")
SUPPORT_FIELDS = ("n_samples", "level")
EXACT_ARRAYS = ("points", "unsafe", "safe", "start", "alphas")


class MonitorFileError(ValueError):
    """A file that is not a whole, unaltered monitor of a version this program reads."""


def to_bytes(monitor: "Monitor") -> bytes:
    """Pack a monitor."""
    exact, support = monitor.exact, monitor.support
    header = {key: getattr(monitor, key) for key in HEADER_FIELDS} | {
        "recipe": to_plain(monitor.recipe),
        "theta_names": monitor.theta_names,
        "exact": {"always": exact.always, "running": exact.running},
    }
    arrays = {key: getattr(monitor, key) for key in ARRAYS} | monitor.affine._asdict()
    arrays |= {f"exact_{key}": getattr(exact, key) for key in EXACT_ARRAYS}
    if support is not None:
        header["support"] = {key: getattr(support, key) for key in SUPPORT_FIELDS}
        arrays |= {f"support_{key}": getattr(support, key) for key in SUPPORT_ARRAYS}
    archive = io.BytesIO()
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez_compressed(archive, allow_pickle=False, header=text, **arrays)
    body = archive.getvalue()
    digest = hashlib.sha256(body).hexdigest().encode()
    number = 1 if support is None else FORMAT
    return MAGIC + str(number).encode() + b"\n" + digest + b"\n" + body


def unpack(blob: bytes, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Check a packed monitor and return its header and arrays; `name` is what errors call it."""
    title, _, rest = blob.partition(b"\n")
    digest, _, body = rest.partition(b"\n")
    number = title.removeprefix(MAGIC)
    if not title.startswith(MAGIC) or not number.isdigit() or number == b"0":
        raise MonitorFileError(
            f"{name} is not a Forewarn monitor: choose a file written by `forewarn train`"
        )
    if int(number) > FORMAT:
        raise MonitorFileError(
            f"{name} has monitor format {int(number)}, this program reads up to {FORMAT}: "
            "upgrade forewarn or train the monitor again"
        )
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise MonitorFileError(
            f"{name} is cut off or was altered, its digest does not match: copy it again from "
            "where it was trained"
        )
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
        return json.loads(arrays.pop("header").tobytes()), arrays
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise MonitorFileError(
            f"{name} holds no monitor ({error}): choose a file written by `forewarn train`"
        ) from error


def read(path: str | Path) -> bytes:
    """Read the file's bytes; MonitorFileError where there is no such file."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise MonitorFileError(
            f"{path} cannot be read ({error.strerror}): give the path of a monitor file"
        ) from error
