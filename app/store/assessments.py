"""Stored assessments of a flight: samples in one array, reasons as runs of samples.

A chunk ends with a digest of its whole row, so that no changed bit is served. Chunks of earlier
versions have none and stay readable.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt
from sqlalchemy import Row

from app.store.database import Damaged, to_text
from app.store.datasets import from_blob, to_blob
from core.monitor.assessment import CAUSES, REASONS, STATES
from core.monitor.status import cause_of
from core.types import Array

FIELDS = ("t", "y", "p_value", "alert", "state", "y_hat", "cause", "manoeuvre")
"""Fields of a stored sample."""
UNKNOWN = -1
"""Manoeuvre of samples stored by earlier versions."""
DISPLAY = np.dtype([("p_value", "<f8"), ("alert", "?"), ("state", "u1")])
"""Result of a display monitor for one sample; fields as in FIELDS."""
DIGEST_BYTES = hashlib.sha256().digest_size


def sample_type(n_channels: int) -> np.dtype:
    """Type of an assessed sample.

    state, cause: indices into STATES and CAUSES of core.monitor.assessment.   manoeuvre: number of
    the one that it is part of, 0 for none.
    """
    return np.dtype([*_without_cause(n_channels).descr, ("cause", "u1"), ("manoeuvre", "<i4")])


def _without_cause(n_channels: int) -> np.dtype:
    """Type of a sample stored by earlier versions."""
    channels = ("<f8", (n_channels,))
    return np.dtype(
        [
            ("t", "<f8"),
            ("y", *channels),
            ("p_value", "<f8"),
            ("alert", "?"),
            ("state", "u1"),
            ("y_hat", *channels),
        ]
    )


@dataclass(frozen=True, eq=False)
class StoredDisplay:
    """Assessments by one display monitor."""

    samples: npt.NDArray
    """(n,) of DISPLAY"""
    reasons: tuple[str, ...]
    """(n,) why a sample was not assessed"""

    def part(self, rows: slice) -> "StoredDisplay":
        """The assessments of some samples."""
        return StoredDisplay(self.samples[rows], self.reasons[rows])


@dataclass(frozen=True, eq=False)
class StoredAssessments:
    """Assessments of consecutive samples of a flight, one array per field."""

    seq: npt.NDArray[np.int64]
    """(n,) sample numbers, ascending; a gap means samples that were never stored"""
    t: Array
    """(n,) [s]"""
    y: Array
    """(n, n_channels) samples"""
    p_value: Array
    """(n,), NaN if none"""
    alert: npt.NDArray[np.bool_]
    """(n,)"""
    state: npt.NDArray[np.uint8]
    """(n,) indices into core.monitor.assessment.STATES"""
    y_hat: Array
    """(n, n_channels), NaN without a forecast"""
    cause: npt.NDArray[np.uint8]
    """(n,) indices into core.monitor.assessment.CAUSES"""
    manoeuvre: npt.NDArray[np.int32]
    """(n,) number of the manoeuvre, 0 for none, UNKNOWN for samples of earlier versions"""
    reasons: tuple[str, ...]
    """(n,) why a sample was not assessed"""
    display: tuple[StoredDisplay, ...] = ()
    """for each display monitor, in the order of the flight"""

    def __len__(self) -> int:
        return len(self.seq)


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples of a flight, as read from one row."""

    first_seq: int
    samples: npt.NDArray
    """(n,) of sample_type"""
    reasons: list[str]
    """(n,)"""
    display: list[StoredDisplay]
    is_verified: bool
    """False for a chunk that was stored without a digest"""


def chunk_row(
    flight_id: str,
    first_seq: int,
    samples: npt.NDArray,
    reasons: Sequence[str],
    display: Sequence[StoredDisplay],
) -> dict[str, Any]:
    """Row of the samples from first_seq; its content ends with the digest."""
    row = {
        "flight_id": flight_id,
        "first_seq": first_seq,
        "last_seq": first_seq + len(samples) - 1,
        "content": to_blob(samples),
        "reasons": runs_of(samples["state"], reasons),
        **display_columns(display),
    }
    return row | {"content": row["content"] + _digest(row)}


def chunk_of(row: Row) -> Chunk:
    """Reverse of `chunk_row`. Damaged if the row has changed since it was stored."""
    values = dict(row._mapping)
    content = values["content"]
    without_digest = values | {"content": content[:-DIGEST_BYTES]}
    is_verified = _digest(without_digest) == content[-DIGEST_BYTES:]
    try:
        samples = from_blob(content)
        n_channels = samples["y"].shape[1]
        is_sample = samples.dtype in (sample_type(n_channels), _without_cause(n_channels))
        is_whole = is_sample and len(samples) == row.last_seq - row.first_seq + 1
        if not is_whole or not (is_verified or _ends_with_samples(content, samples)):
            raise Damaged("its digest does not match")
        reasons = reasons_of(samples["state"], row.reasons or ())
        samples = _with_cause(samples, reasons)
        display = display_of(row.display, row.display_reasons)
    except (Damaged, IndexError, TypeError, ValueError) as error:
        raise Damaged(
            f"samples {row.first_seq} to {row.last_seq} of flight {row.flight_id} are damaged: "
            "restore a backup, or delete the flight"
        ) from error
    return Chunk(row.first_seq, samples, reasons, display, is_verified)


def _digest(row: dict[str, Any]) -> bytes:
    """SHA-256 of a row whose content has no digest yet."""
    blobs = [row["content"], row["display"] or b""]
    names = "flight_id", "first_seq", "last_seq", "reasons", "display_reasons"
    plain = [*(row[name] for name in names), *(len(blob) for blob in blobs)]
    return hashlib.sha256(b"".join([to_text(plain).encode(), *blobs])).digest()


def _ends_with_samples(content: bytes, samples: npt.NDArray) -> bool:
    """Whether nothing follows the array, as in chunks stored without a digest."""
    header_bytes = 10 + int.from_bytes(content[8:10], "little")
    return len(content) == header_bytes + samples.nbytes


def _with_cause(samples: npt.NDArray, reasons: Sequence[str]) -> npt.NDArray:
    """Samples of earlier versions as those of this one."""
    if samples.dtype.names == FIELDS:
        return samples
    about = [samples[name] for name in _without_cause(1).names or ()]
    return pack(*about, causes_of(samples["state"], reasons), np.full(len(samples), UNKNOWN))


def causes_of(state: npt.ArrayLike, reasons: Sequence[str]) -> list[int]:
    """Causes by the reasons, of samples whose causes are not known."""
    about = zip(np.asarray(state).tolist(), reasons, strict=True)
    return [CAUSES.index(cause_of(STATES[code], reason)) for code, reason in about]


def pack(*fields: Any) -> npt.NDArray:
    """Pack the FIELDS of samples, given in this order."""
    samples = np.empty(len(fields[0]), sample_type(np.shape(fields[1])[-1]))
    for name, values in zip(FIELDS, fields, strict=True):
        if values is None:
            samples[name] = np.nan
        elif np.shape(values) != samples[name].shape:
            raise ValueError(
                f"{name} has shape {np.shape(values)}: it needs {samples[name].shape}, one row "
                "per sample"
            )
        else:
            samples[name] = values
    return samples


def display_columns(display: Sequence[StoredDisplay]) -> dict[str, Any]:
    """Columns of a chunk for display monitors; nulls if there are none."""
    if not display:
        return {"display": None, "display_reasons": None}
    return {
        "display": to_blob(np.stack([monitor.samples for monitor in display], axis=1)),
        "display_reasons": [
            runs_of(monitor.samples["state"], monitor.reasons) for monitor in display
        ],
    }


def display_of(blob: bytes | None, runs: Sequence[Any] | None) -> list[StoredDisplay]:
    """Reverse of `display_columns`, one entry per monitor."""
    if blob is None:
        return []
    samples = from_blob(blob)
    return [
        StoredDisplay(column, tuple(reasons_of(column["state"], (runs or [])[m] or ())))
        for m, column in enumerate(samples.T)
    ]


def joined(parts: Sequence[Sequence[StoredDisplay]]) -> list[StoredDisplay]:
    """Join the assessments of successive chunks, one result per monitor."""
    return [
        StoredDisplay(
            np.concatenate([part.samples for part in column]),
            tuple(text for part in column for text in part.reasons),
        )
        for column in zip(*parts, strict=True)
    ]


def runs_of(state: npt.NDArray, reasons: Sequence[str]) -> list[list[Any]] | None:
    """[first, last, text] of each run of samples whose reason differs from its state's default."""
    runs = []
    samples = zip(state.tolist(), reasons, strict=True) if reasons else ()
    texts = ("" if text == REASONS[code] else text for code, text in samples)
    for text, run in groupby(enumerate(texts), lambda numbered: numbered[1]):
        numbers = [k for k, _ in run]
        if text:
            runs.append([numbers[0], numbers[-1], text])
    return runs or None


def reasons_of(state: npt.NDArray, runs: Iterable[Sequence[Any]]) -> list[str]:
    reasons = [REASONS[code] for code in state.tolist()]
    for first, last, text in runs:
        reasons[first : last + 1] = [text] * (last + 1 - first)
    return reasons
