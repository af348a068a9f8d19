"""Stored assessments of a flight: samples in one array, reasons as runs of samples."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from app.store.arrays import from_blob, to_blob
from core.channels import N_CHANNELS
from core.monitor.assessment import REASONS
from core.types import Array

SAMPLE = np.dtype(
    [
        ("t", "<f8"),
        ("y", "<f8", (N_CHANNELS,)),
        ("p_value", "<f8"),
        ("alert", "?"),
        ("state", "u1"),
        ("y_hat", "<f8", (N_CHANNELS,)),
    ]
)
"""One assessed sample; `state` is an index into core.monitor.assessment.STATES."""
DISPLAY = np.dtype([("p_value", "<f8"), ("alert", "?"), ("state", "u1")])
"""Result of a display monitor for one sample; fields as in SAMPLE."""


@dataclass(frozen=True, eq=False)
class StoredDisplay:
    """Assessments by one display monitor."""

    samples: npt.NDArray
    """(n,) of DISPLAY"""
    reasons: tuple[str, ...]
    """(n,) why a sample was not assessed"""

    def part(self, rows: slice) -> "StoredDisplay":
        """Those of some samples."""
        return StoredDisplay(self.samples[rows], self.reasons[rows])


@dataclass(frozen=True, eq=False)
class StoredAssessments:
    """Assessments of consecutive samples of a flight, one array per field."""

    seq: npt.NDArray[np.int64]
    """(n,) sample numbers, ascending; a gap means samples that were never stored"""
    t: Array
    """(n,) [s]"""
    y: Array
    """(n, 6) samples"""
    p_value: Array
    """(n,), NaN if none"""
    alert: npt.NDArray[np.bool_]
    """(n,)"""
    state: npt.NDArray[np.uint8]
    """(n,) indices into core.monitor.assessment.STATES"""
    y_hat: Array
    """(n, 6), NaN without a forecast"""
    reasons: tuple[str, ...]
    """(n,) why a sample was not assessed"""
    display: tuple[StoredDisplay, ...] = ()
    """for each display monitor, in the order of the flight"""

    def __len__(self) -> int:
        return len(self.seq)


def pack(*fields: Any) -> npt.NDArray:
    """Pack the fields of SAMPLE, given in its order."""
    samples = np.empty(len(fields[0]), SAMPLE)
    for name, values in zip(SAMPLE.names or (), fields, strict=True):
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
