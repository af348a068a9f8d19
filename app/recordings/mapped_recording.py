"""The channels of a recording under one mapping, applied and repaired once.

Preview, quality, warnings and every scoring use the same channels. The most recent ones stay in
memory, so a mapping is not applied again when it is confirmed, or for each monitor.
"""

import json
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.readers.journal import ARRIVED
from app.telemetry.recording import TelemetryError, Traces
from app.telemetry.targets import plausible
from app.telemetry.timing.repair import FlownOrder, RepairedTraces, repair

MOST_BYTES = 2**28
"""Limit of the memory; a larger recording is mapped again each time."""


@dataclass(frozen=True, eq=False)
class MappedRecording:
    """The result of a mapping.

    applied: channels as recorded; None if the mapping cannot be applied.   repaired: None if
    `applied` is, or if the times cannot be repaired.   problem: the reason in one sentence.
    """

    mapping: Mapping
    applied: Traces | None
    repaired: RepairedTraces | None
    problem: str | None = None

    @classmethod
    def of(cls, columns: Columns, mapping: Mapping) -> Self:
        applied = None
        try:
            applied = apply_mapping(columns, mapping)
            flown = _flown(columns, applied)
            repaired = repair(applied) if flown is None else _repaired(flown, applied)
            return cls(mapping, applied, replace(repaired, flown=flown))
        except TelemetryError as error:
            return cls(mapping, applied, None, str(error))

    def scorable(self) -> RepairedTraces:
        """The repaired channels; TelemetryError if there are none."""
        if self.repaired is None:
            raise TelemetryError(self.problem or "")
        return self.repaired

    @property
    def n_bytes(self) -> int:
        """Size of the arrays, each counted once."""
        parts = [self.applied, self.repaired.traces if self.repaired else None]
        traces = [trace for part in parts if part for trace in part.channels.values()]
        arrays = {id(array): array for trace in traces for array in (trace.t, trace.values)}
        return sum(array.nbytes for array in arrays.values())


def _flown(columns: Columns, applied: Traces) -> FlownOrder | None:
    """The channels of a live flight as they arrived; None for another recording."""
    contents = columns.contents
    if contents.format != "journal" or len({id(c.t) for c in applied.channels.values()}) != 1:
        return None
    about = contents.flown
    return FlownOrder(
        Traces({key: plausible(key, trace) for key, trace in applied.channels.items()}),
        columns.values(ARRIVED),
        about.get("delay"),
        about.get("trim") == "none",
        tuple((arrived, int(n)) for arrived, n in about.get("begun", ())),
        about.get("ended"),
        tuple(about.get("calls", ())),
    )


def _repaired(flown: FlownOrder, applied: Traces) -> RepairedTraces:
    """The channels of a live flight, by arrival where the times of its source are useless."""
    try:
        return repair(applied)
    except TelemetryError as error:
        t = np.ascontiguousarray(flown.arrived)
        channels = {key: replace(trace, t=t) for key, trace in applied.channels.items()}
        note = f"Times are those of arrival, because {error}"
        return repair(Traces(channels, (*applied.notes, note)))


class RecentMappings:
    """Recently mapped recordings, at most MOST_BYTES. Safe in any thread."""

    def __init__(self) -> None:
        self._mapped: OrderedDict[tuple[str, str], MappedRecording] = OrderedDict()
        self._lock = threading.Lock()

    def mapped(
        self, recording_id: str, mapping: Mapping, columns: Callable[[], Columns]
    ) -> MappedRecording:
        """A recording under a mapping. columns: opens the recording's columns if needed."""
        key = _key(recording_id, mapping)
        with self._lock:
            if key in self._mapped:
                self._mapped.move_to_end(key)
                return self._mapped[key]
        mapped = MappedRecording.of(columns(), mapping)
        self.add(recording_id, mapped)
        return mapped

    def add(self, recording_id: str, mapped: MappedRecording) -> None:
        """Store a mapped recording, and drop the oldest ones beyond MOST_BYTES."""
        with self._lock:
            self._mapped[_key(recording_id, mapped.mapping)] = mapped
            n_bytes = sum(recent.n_bytes for recent in self._mapped.values())
            while n_bytes > MOST_BYTES:
                _, dropped = self._mapped.popitem(last=False)
                n_bytes -= dropped.n_bytes

    def forget(self, recording_id: str) -> None:
        with self._lock:
            for key in [key for key in self._mapped if key[0] == recording_id]:
                del self._mapped[key]


def _key(recording_id: str, mapping: Mapping) -> tuple[str, str]:
    return recording_id, json.dumps(mapping.to_plain(), sort_keys=True)
