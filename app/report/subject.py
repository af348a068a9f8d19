"""The input of a report, and the metadata of exported samples."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy.typing as npt

from app.telemetry.contents import Contents
from core.monitor import Monitor

PROPOSED = "proposed by the program, not confirmed"
"""Origin of a mapping without confirmation."""


@dataclass(frozen=True, eq=False)
class ReportSubject:
    """Everything a report needs; plain data except for the monitor and the samples.

    recording: name, digest, size, format, aircraft, and the fields of `of_contents`.
    scoring: as app.store.scorings.ScoringInfo, its mapping and manoeuvres plain.
    evaluation: the monitor's test on fresh flights; None if it was not tested.
    samples: as stored.   mapped: origin of the mapping, in words; "" where unknown.
    rationales: confidence and reasons of a proposed mapping, by key of TARGETS.
    markers: of the user: t, end, kind, text.
    """

    recording: Mapping[str, Any]
    scoring: Mapping[str, Any]
    monitor: Monitor
    monitor_name: str
    monitor_digest: str
    evaluation: Mapping[str, Any] | None
    samples: npt.NDArray
    mapped: str = ""
    rationales: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    markers: Sequence[Mapping[str, Any]] = field(default=())


def of_contents(contents: Contents) -> dict[str, Any]:
    """The fields of a report about the file's contents."""
    return {
        "start": contents.start,
        "n_bad_rows": contents.n_bad_rows,
        "bad_rows": [asdict(row) for row in contents.bad_rows],
        "ignored": list(contents.ignored),
        "notes": list(contents.notes),
    }


def about(recording: Mapping[str, Any], scoring: Mapping[str, Any]) -> dict[str, Any]:
    """Metadata of exported samples: their origin, and the verdicts on them."""
    return {
        "recording": recording["name"],
        "recording_sha256": recording["digest"],
        "aircraft": recording["aircraft"],
        "monitor": scoring["monitor_name"],
        "monitor_sha256": scoring["monitor_digest"],
        "epsilon": scoring["epsilon"],
        "lead_s": scoring["lead"],
        "dt_s": scoring["dt"],
        "samples_sha256": scoring["digest"],
        "mapping": scoring["mapping"],
        "manoeuvres": scoring["manoeuvres"],
        "limits_in_force": scoring.get("limits_in_force"),
        "notes": scoring["notes"],
        "program": scoring["version"],
    }
