"""Telemetry as JSON, one array per channel, and its assessments as JSON."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from app.telemetry.recording import ATTITUDE, Recording, TelemetryError
from core.channels import KEYS
from core.monitor import Monitor

Values = list[float | None]
MOST_SAMPLES = 1_000_000


class TelemetryBody(BaseModel):
    """Telemetry, one array per channel, SI units; null for a missing value."""

    model_config = ConfigDict(extra="forbid", title="Telemetry to score")

    t: list[float] = Field(
        description="time [s], increasing", min_length=1, max_length=MOST_SAMPLES
    )
    beta: Values = Field(description="sideslip [rad]")
    p: Values = Field(description="roll rate [rad/s]")
    r: Values = Field(description="yaw rate [rad/s]")
    Ny: Values = Field(description="lateral acceleration [g]")
    delta_a: Values = Field(description="aileron [rad]")
    delta_r: Values = Field(description="rudder [rad]")
    phi: Values | None = Field(None, description="bank angle [rad], for the display only")
    theta: Values | None = Field(None, description="pitch angle [rad], for the display only")
    psi: Values | None = Field(None, description="heading [rad], for the display only")


def parse_telemetry(plain: dict[str, Any]) -> Recording:
    """Read telemetry from parsed JSON. TelemetryError."""
    known = ("t", *KEYS, *ATTITUDE)
    if unknown := [key for key in plain if key not in known]:
        raise TelemetryError(f"telemetry has no channel {unknown[0]!r}: choose {', '.join(known)}")
    if missing := [key for key in ("t", *KEYS) if plain.get(key) is None]:
        raise TelemetryError(
            f"missing channel: {missing[0]}; give t and {', '.join(KEYS)}, one array each"
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
    y = np.column_stack([channels[key] for key in KEYS])
    return Recording(t, y, {key: channels[key] for key in ATTITUDE if key in channels})


def _array(key: str, values: Any) -> np.ndarray:
    """(n,) of a list of numbers and nulls, null as NaN."""
    if not isinstance(values, list) or any(type(v) not in (float, int, type(None)) for v in values):
        raise TelemetryError(f"{key} is not an array of numbers: give a number or null per sample")
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError:
        raise TelemetryError(f"{key} has a number too large for a float") from None


Forecast = msgspec.defstruct("Forecast", [(key, float) for key in KEYS], gc=False)


class AssessedRow(msgspec.Struct, gc=False):
    """An Assessment without exemplars in wire form, fast to make and encode."""

    t: float
    p_value: float | None
    alert: bool | None
    alert_above: float | None
    state: str
    reason: str
    y_hat: Any
    score: float | None
    group: str | None
    nearest_unsafe: None = None
    nearest_safe: None = None


def assessed(
    monitor: Monitor, recording: Recording, epsilon: float, *, why: bool
) -> Sequence[AssessedRow | dict[str, Any]]:
    """The assessment of each sample in wire form; `why` adds the exemplars."""
    if why:
        stream = monitor.stream(epsilon)
        return [
            stream.update(t, y).as_dict()
            for t, y in zip(recording.t.tolist(), recording.y, strict=True)
        ]
    columns = monitor.assess(recording.t, recording.y, epsilon).columns()
    columns["y_hat"] = [y and Forecast(*y) for y in columns["y_hat"]]
    return [AssessedRow(*row) for row in zip(*columns.values(), strict=True)]
