"""The channels of a recording under one mapping: applied and repaired once, for all who need them.

A preview, the quality, the warnings and every scoring look at the same channels. The last ones are
held in memory, so that a mapping that was tried is not applied again when it is confirmed, nor the
times repaired for each monitor.
"""

import json
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.recording import TelemetryError
from app.telemetry.timing.repair import RepairedTraces, repair
from app.telemetry.traces import Traces

MOST_BYTES = 2**28
"""Held in memory; a larger recording is mapped anew each time."""


@dataclass(frozen=True, eq=False)
class MappedRecording:
    """What comes of a mapping.

    applied: channels as recorded; None where the mapping cannot be applied.   repaired: None
    where that cannot be, or the times not repaired.   problem: why, in one sentence.
    """

    mapping: Mapping
    applied: Traces | None
    repaired: RepairedTraces | None
    problem: str | None = None

    @classmethod
    def of(cls, columns: Columns, mapping: Mapping) -> Self:
        """Apply a mapping and repair the times, once."""
        applied = None
        try:
            applied = apply_mapping(columns, mapping)
            return cls(mapping, applied, repair(applied))
        except TelemetryError as error:
            return cls(mapping, applied, None, str(error))

    def scorable(self) -> RepairedTraces:
        """The repaired channels; TelemetryError where there are none."""
        if self.repaired is None:
            raise TelemetryError(self.problem or "")
        return self.repaired

    @property
    def n_bytes(self) -> int:
        """Of the arrays, each counted once."""
        parts = [self.applied, self.repaired.traces if self.repaired else None]
        traces = [trace for part in parts if part for trace in part.channels.values()]
        arrays = {id(array): array for trace in traces for array in (trace.t, trace.values)}
        return sum(array.nbytes for array in arrays.values())


class RecentMappings:
    """The mapped recordings of late, of MOST_BYTES at most. May be called from any thread."""

    def __init__(self) -> None:
        self._mapped: OrderedDict[tuple[str, str], MappedRecording] = OrderedDict()
        self._lock = threading.Lock()

    def mapped(
        self, recording_id: str, mapping: Mapping, columns: Callable[[], Columns]
    ) -> MappedRecording:
        """A recording under a mapping. columns: opens those of the recording, where needed."""
        key = _key(recording_id, mapping)
        with self._lock:
            if key in self._mapped:
                self._mapped.move_to_end(key)
                return self._mapped[key]
        mapped = MappedRecording.of(columns(), mapping)
        self.add(recording_id, mapped)
        return mapped

    def add(self, recording_id: str, mapped: MappedRecording) -> None:
        """Hold a recording that was just mapped, and drop the oldest beyond MOST_BYTES."""
        with self._lock:
            self._mapped[_key(recording_id, mapped.mapping)] = mapped
            n_bytes = sum(held.n_bytes for held in self._mapped.values())
            while n_bytes > MOST_BYTES:
                _, dropped = self._mapped.popitem(last=False)
                n_bytes -= dropped.n_bytes

    def forget(self, recording_id: str) -> None:
        """Drop all that is held of a recording."""
        with self._lock:
            for key in [key for key in self._mapped if key[0] == recording_id]:
                del self._mapped[key]


def _key(recording_id: str, mapping: Mapping) -> tuple[str, str]:
    return recording_id, json.dumps(mapping.to_plain(), sort_keys=True)
