"""What a person should know of a scored recording, in a few lines that do not flatter."""

import numpy as np
import numpy.typing as npt

from app.telemetry.recording import Recording
from core.channels import CHANNELS, KEYS
from core.monitor import Assessments, Monitor, State
from core.monitor.assessment import STATES
from core.specification import Limits

Array = npt.NDArray[np.float64]
BEYOND = 2.0
"""A channel this many times larger than in training lies outside of it."""


def verdict(
    monitor: Monitor, limits: Limits, recording: Recording, said: Assessments, epsilon: float
) -> list[str]:
    """Peak risk, alerts, first crossing in the recording's own samples, lead; and every doubt.

    recording: in its own samples, before resampling to those assessed.
    """
    assessed = np.isfinite(said.p_value)
    if not assessed.any():
        return ["no sample could be assessed: see the state column of assessments.csv"]
    crossing, crossing_line = _crossing(limits, recording)
    return [
        *_states(said),
        *_outside_training(monitor, recording, said),
        _peak(monitor, said),
        *_alerts(said, epsilon, crossing),
        f"first crossing {crossing_line}",
        *_lead(monitor, said, crossing),
    ]


def episodes(said: Assessments) -> tuple[Array, Array]:
    """Times of the first and the last sample of each run of alerts [s]."""
    alert = np.concatenate([[False], said.alert, [False]])
    begins = np.flatnonzero(alert[1:] & ~alert[:-1])
    ends = np.flatnonzero(alert[:-1] & ~alert[1:]) - 1
    return said.t[begins], said.t[ends]


def outside_training(monitor: Monitor, y: Array, y_hat: Array) -> npt.NDArray[np.bool_]:
    """(n, 6) whether a channel or its forecast is far larger than on any rollout in training."""
    largest = np.fmax(np.abs(y), np.abs(y_hat))
    return largest > BEYOND * np.maximum(monitor.reach, np.finfo(float).tiny)


def _states(said: Assessments) -> list[str]:
    if (said.state == STATES.index(State.OK)).all():
        return []
    counts = [f"{(said.state == code).sum()} {state}" for code, state in enumerate(STATES)]
    return [f"samples: {', '.join(counts)}"]


def _outside_training(monitor: Monitor, recording: Recording, said: Assessments) -> list[str]:
    lines = []
    for c, channel in enumerate(CHANNELS):
        largest, reach = np.nanmax(np.abs(recording.y[:, c])), monitor.reach[c]
        if largest > BEYOND * reach > 0:
            lines.append(
                f"OUTSIDE TRAINING: |{channel.key}| reaches {largest:.3g} {channel.unit}, "
                f"{largest / reach:.1f} times its largest in training: check unit and manoeuvre"
            )
    wild = outside_training(monitor, np.zeros_like(said.y_hat), said.y_hat)[:, monitor.reach > 0]
    share = wild.any(axis=1).mean()
    if share > 0:
        lines.append(
            f"OUTSIDE TRAINING: {share:.0%} of the forecasts are over {BEYOND:g} times as large as "
            "anything in training: train with the noise of these sensors"
        )
    if lines:
        lines.append("where it is outside training, the risk says nothing and nothing is promised")
    return lines


def _peak(monitor: Monitor, said: Assessments) -> str:
    peak = int(np.nanargmax(said.p_value))
    if said.p_value[peak] <= monitor.smallest_epsilon:
        return f"peak risk     {said.p_value[peak]:.3f}, never above its least"
    return f"peak risk     {said.p_value[peak]:.3f} at {said.t[peak]:.2f} s"


def _alerts(said: Assessments, epsilon: float, crossing: float | None) -> list[str]:
    begins, ends = episodes(said)
    if not len(begins):
        return [f"first alert   none (risk above epsilon {epsilon:g})"]
    lines = [
        f"first alert   at {begins[0]:.2f} s (risk above epsilon {epsilon:g})",
        f"alerts        {len(begins)}, of {said.alert.sum()} samples in all",
    ]
    before = begins <= (np.inf if crossing is None else crossing)
    if len(begins) > 1 and before.any():
        last = np.flatnonzero(before)[-1]
        lines.append(f"last alert    {begins[last]:.2f} to {ends[last]:.2f} s")
    return lines


def _crossing(limits: Limits, recording: Recording) -> tuple[float | None, str]:
    """Time of the first recorded sample that reaches a limit, and what to say of it."""
    limited = np.isfinite(limits.magnitudes)
    missing = np.isnan(recording.y[:, limited]).any(axis=1)
    gaps = np.diff(recording.t)
    lost = gaps[gaps > 1.5 * np.median(gaps)].sum() + missing.sum() * np.median(gaps)
    doubt = f"; {lost:.2f} s of the limited channels are missing" if lost > 0 else ""
    over = np.abs(recording.y) >= limits.magnitudes
    if over.any():
        sample = int(over.any(axis=1).argmax())
        channel = CHANNELS[int(over[sample].argmax())]
        value = recording.y[sample, KEYS.index(channel.key)]
        t = float(recording.t[sample])
        return t, f"at {t:.2f} s ({channel.key} {value:.3g} {channel.unit}){doubt}"
    peaks = ", ".join(
        f"|{key}| {np.nanmax(np.abs(values)):.3g} of {limit:.3g}"
        for key, values, limit in zip(KEYS, recording.y.T, limits.magnitudes, strict=True)
        if np.isfinite(limit)
    )
    return None, f"none in what was recorded (peak {peaks}){doubt}"


def _lead(monitor: Monitor, said: Assessments, crossing: float | None) -> list[str]:
    if crossing is None:
        return []
    begins, _ = episodes(said)
    if not (begins <= crossing).any():
        return ["lead          none: the monitor was silent before the crossing (a miss)"]
    lead = crossing - begins[0]
    timely = "at least" if lead >= monitor.lead - 1e-9 else "short of"
    promise = f"{timely} the promised {monitor.lead:g} s"
    return [f"lead          {lead:.2f} s from the first alert, {promise}"]
