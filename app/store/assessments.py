"""Assessments of a flight as they are stored: samples in one array, reasons run by run."""

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
"""One assessed sample as it is stored; `state` is a code into core.monitor.assessment.STATES."""
DISPLAY = np.dtype([("p_value", "<f8"), ("alert", "?"), ("state", "u1")])
"""What a monitor that is flown for display says of a sample, as SAMPLE."""


@dataclass(frozen=True, eq=False)
class StoredDisplay:
    """Assessments of one monitor that is flown for display."""

    samples: npt.NDArray
    """(n,) of DISPLAY"""
    reasons: tuple[str, ...]
    """(n,) why a sample was not assessed"""

    def part(self, wanted: slice) -> "StoredDisplay":
        """Those of some samples."""
        return StoredDisplay(self.samples[wanted], self.reasons[wanted])


@dataclass(frozen=True, eq=False)
class StoredAssessments:
    """Assessments of a run of samples of a flight, one array a field."""

    seq: npt.NDArray[np.int64]
    """(n,) sample numbers, ascending; a gap is a sample that was never stored"""
    t: Array
    """(n,) [s]"""
    y: Array
    """(n, 6) the samples themselves"""
    p_value: Array
    """(n,), NaN where there is none"""
    alert: npt.NDArray[np.bool_]
    """(n,)"""
    state: npt.NDArray[np.uint8]
    """(n,) codes into core.monitor.assessment.STATES"""
    y_hat: Array
    """(n, 6), NaN where there is no forecast"""
    reasons: tuple[str, ...]
    """(n,) why a sample was not assessed"""
    display: tuple[StoredDisplay, ...] = ()
    """of each monitor that is flown for display, in the order of the flight"""

    def __len__(self) -> int:
        return len(self.seq)


def pack(*fields: Any) -> npt.NDArray:
    """Pack the fields of SAMPLE, in its order."""
    samples = np.empty(len(fields[0]), SAMPLE)
    for name, values in zip(SAMPLE.names or (), fields, strict=True):
        if values is None:
            samples[name] = np.nan
        elif np.shape(values) != samples[name].shape:
            raise ValueError(
                f"{name} has shape {np.shape(values)}: it needs {samples[name].shape}, a row for "
                "each sample"
            )
        else:
            samples[name] = values
    return samples


def display_columns(display: Sequence[StoredDisplay]) -> dict[str, Any]:
    """What a chunk holds of monitors that are flown for display; nulls where there is none."""
    if not display:
        return {"display": None, "display_reasons": None}
    return {
        "display": to_blob(np.stack([one.samples for one in display], axis=1)),
        "display_reasons": [runs_of(one.samples["state"], one.reasons) for one in display],
    }


def display_of(blob: bytes | None, runs: Sequence[Any] | None) -> list[StoredDisplay]:
    """What `display_columns` stored, a monitor each."""
    if blob is None:
        return []
    samples = from_blob(blob)
    return [
        StoredDisplay(column, tuple(reasons_of(column["state"], (runs or [])[m] or ())))
        for m, column in enumerate(samples.T)
    ]


def joined(parts: Sequence[Sequence[StoredDisplay]]) -> list[StoredDisplay]:
    """Assessments of chunk after chunk, as many monitors in each, as one of each monitor."""
    return [
        StoredDisplay(
            np.concatenate([one.samples for one in column]),
            tuple(text for one in column for text in one.reasons),
        )
        for column in zip(*parts, strict=True)
    ]


def runs_of(state: npt.NDArray, reasons: Sequence[str]) -> list[list[Any]] | None:
    """[first, last, text] of each run of samples whose reason is not that of their state."""
    runs = []
    given = zip(state.tolist(), reasons, strict=True) if reasons else ()
    other = ("" if text == REASONS[code] else text for code, text in given)
    for text, run in groupby(enumerate(other), lambda numbered: numbered[1]):
        numbers = [k for k, _ in run]
        if text:
            runs.append([numbers[0], numbers[-1], text])
    return runs or None


def reasons_of(state: npt.NDArray, runs: Iterable[Sequence[Any]]) -> list[str]:
    """The reason of each sample of a chunk."""
    reasons = [REASONS[code] for code in state.tolist()]
    for first, last, text in runs:
        reasons[first : last + 1] = [text] * (last + 1 - first)
    return reasons
