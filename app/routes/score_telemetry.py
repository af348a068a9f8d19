"""Score telemetry at once: one array per channel as JSON, and its assessments as JSON."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from fastapi import APIRouter, Query
from pydantic import Field

from app.routes.dependencies import Described, PlainBody, StoreDep, body_of, json_response, refused
from app.telemetry.recording import ATTITUDE, Recording, TelemetryError
from core.channels import CHANNELS, KEYS, Dictionary
from core.computed import fill
from core.evaluation.certificate import warnings_of
from core.monitor import Monitor

router = APIRouter(prefix="/api/v1/monitors", tags=["monitors"])
MOST_SAMPLES = 1_000_000
VALUES: dict[str, Any] = {"type": "array", "items": {"type": ["number", "null"]}}
TIMES = {"type": "array", "items": {"type": "number"}, "minItems": 1, "maxItems": MOST_SAMPLES}
TELEMETRY: dict[str, Any] = {
    "title": "Telemetry to score",
    "description": "Telemetry, one array for each channel of the monitor, by its key, in its unit; "
    "null for a missing value. Those named here are of monitors of the six lateral channels.",
    "type": "object",
    "required": ["t"],
    "properties": {"t": TIMES | {"description": "time [s], increasing"}}
    | {c.key: VALUES | {"description": f"{c.label} [{c.unit}]"} for c in CHANNELS},
}


class AssessedSample(Described):
    """Assessment of one sample."""

    t: float = Field(description="[s]")
    p_value: float | None = Field(description="risk, higher is worse; null unless state is `ok`")
    alert: bool | None = Field(description="whether p_value exceeds alert_above")
    alert_above: float | None = Field(description="null unless state is `ok`")
    state: Literal["ok", "warming_up", "stale", "invalid"]
    reason: str = Field(description="why the state is not `ok`")
    y_hat: dict[str, float] | None
    """forecast of each channel t_early ahead, by its key"""
    score: float | None
    group: str | None
    """group of failing flights whose calibration gives p_value; null while unknown and for monitors
    without groups"""


class AssessedTelemetry(Described):
    """Assessments of telemetry, one per sample."""

    epsilon: float = Field(description="miss rate of the alerts")
    lead: float = Field(description="promised lead time [s]")
    warnings: list[str] = Field(description="reasons not to rely on the monitor")
    exceeded_t: float | None
    """first sample beyond a limit [s], whatever its risk; null: none, or the limits are unknown"""
    assessments: list[AssessedSample]


def parse_telemetry(plain: dict[str, Any], dictionary: Dictionary) -> Recording:
    """Read telemetry of the monitor's channels from parsed JSON. TelemetryError."""
    keys = dictionary.measured
    known = tuple(dict.fromkeys(("t", *dictionary.keys, *ATTITUDE)))
    if unknown := [key for key in plain if key not in known]:
        raise TelemetryError(f"telemetry has no channel {unknown[0]!r}: choose {', '.join(known)}")
    if missing := [key for key in ("t", *keys) if plain.get(key) is None]:
        raise TelemetryError(
            f"missing channel: {missing[0]}; give t and {', '.join(keys)}, one array each"
        )
    t = _array("t", plain["t"])
    if not 1 <= len(t) <= MOST_SAMPLES:
        raise TelemetryError(f"t has {len(t)} samples: give 1 to {MOST_SAMPLES}")
    if not np.isfinite(t).all():
        raise TelemetryError("t has a missing or infinite value: give the time of each sample")
    channels = {key: _array(key, plain[key]) for key in known if plain.get(key) is not None}
    for key, values in channels.items():
        if len(values) != len(t):
            raise TelemetryError(
                f"{key} has {len(values)} samples, t has {len(t)}: give equally many"
            )
    unknown = np.full(len(t), np.nan)
    y = np.column_stack([channels.get(key, unknown) for key in dictionary.keys])
    fill(dictionary, t, y)
    return Recording(t, y, {key: channels[key] for key in ATTITUDE if key in channels})


def _array(key: str, values: Any) -> np.ndarray:
    """(n,) of a list of numbers and nulls, null as NaN."""
    if not isinstance(values, list) or any(type(v) not in (float, int, type(None)) for v in values):
        raise TelemetryError(f"{key} is not an array of numbers: give a number or null per sample")
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError:
        raise TelemetryError(f"{key} has a number too large for a float") from None


AssessedRow = msgspec.defstruct("AssessedRow", [*AssessedSample.model_fields], gc=False)
"""An AssessedSample that is fast to make and encode."""


def assessed(monitor: Monitor, recording: Recording, epsilon: float) -> Sequence[Any]:
    """The assessment of each sample in wire form."""
    columns = monitor.assess(recording.t, recording.y, epsilon).columns()
    keys = monitor.dictionary.keys
    columns["y_hat"] = [y and dict(zip(keys, y, strict=True)) for y in columns["y_hat"]]
    return [AssessedRow(*row) for row in zip(*columns.values(), strict=True)]


@router.post(
    "/{monitor_id}/score",
    openapi_extra=body_of(
        TELEMETRY,
        {"t": [0.0, 0.05, 0.1]} | {key: [0.0, 0.01, 0.02] for key in KEYS},
    ),
)
def score_telemetry(
    monitor_id: str,
    plain: PlainBody,
    store: StoreDep,
    epsilon: Annotated[
        float | None,
        Query(ge=1e-6, le=1 - 1e-6, description="miss rate; the monitor's if absent"),
    ] = None,
) -> AssessedTelemetry:
    """Assess telemetry sample by sample. Its interval must be that of the monitor.

    One array per channel of the monitor, in SI units, N_y in g; null for a missing value. A sample
    at any other interval after the last one is `invalid`.
    """
    monitor = store.monitors.get(monitor_id)
    recording = parse_telemetry(plain, monitor.dictionary)
    with refused(422, "epsilon", ValueError):
        served = monitor.check_epsilon(epsilon)
    assessments = assessed(monitor, recording, served)
    calibrated = monitor.support is not None
    warnings = warnings_of(monitor.evaluation, served, is_calibrated=calibrated)
    limits = monitor.envelope
    beyond = [] if limits is None else recording.t[limits.exceeds(recording.y)].tolist()
    about = {"epsilon": served, "lead": monitor.lead, "warnings": warnings}
    about["exceeded_t"] = beyond[0] if beyond else None
    return json_response(about | {"assessments": assessments})
