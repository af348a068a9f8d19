"""Scorings as plain data."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from itertools import chain
from typing import Any

import numpy as np

from app.assessment import manoeuvres_in
from app.assessment.outcome import OUTCOMES, verdict_of, wording_of
from app.messages import limited_channels, plain_frame
from app.recordings.recordings import Recordings
from app.recordings.samples import Samples
from app.recordings.scored import ScoredRecordings
from app.recordings.tiles import Window
from app.store.monitors import MonitorInfo
from app.store.scorings import ScoringInfo
from app.store.store import StoreError
from app.telemetry.contents import Contents
from app.telemetry.mapping.applying import time_zero
from app.telemetry.mapping.mapping import Mapping as TimedMapping
from core.channels import Dictionary
from core.limits.limits import specification_from_plain
from core.monitor import Assessment, State
from core.monitor.assessment import REASONS, STATES, Cause
from core.monitor.status import BETWEEN, cause_of
from core.monitor.validity.verdict import in_words
from core.types import Array

OF_ITS_OWN = ("recording_id", "monitor_id", "specification", "request_digest", "row_digest")
VERDICTS = ("manoeuvres", "outside_exceedances", "notes")
"""Omitted for a damaged scoring."""


def answers(scored: ScoredRecordings, infos: list[ScoringInfo]) -> list[dict[str, Any]]:
    """Scorings of a recording, without their samples."""
    contents = _contents(scored, infos)
    used = [(info.monitor_id, info.epsilon) for info in infos]
    of_sets = [[(case["monitor"], None) for case in _cases(info)] for info in infos]
    monitors = scored.store.monitors.used(chain(used, *of_sets))
    sent = []
    for info, pair, members in zip(infos, used, of_sets, strict=True):
        warned = (monitors[each].warnings for each in members or [pair] if each in monitors)
        answer = _answer(info, monitors[pair])
        answer["warnings"] = [*dict.fromkeys(chain.from_iterable(warned))]
        answer["alert_above"] = monitors[pair].alert_above(info.epsilon)
        answer["time_zero"] = (
            time_zero(contents, TimedMapping.from_plain(info.mapping)) if contents else ""
        )
        sent.append(answer)
    return sent


def _cases(info: ScoringInfo) -> list[dict[str, Any]]:
    """Cases of the monitor set that scored it; empty for one monitor."""
    return info.request.get("monitor_set", {}).get("cases", [])


def _contents(scored: ScoredRecordings, infos: list[ScoringInfo]) -> Contents | None:
    """Contents of the recording that was scored; None if it is damaged, or without a scoring."""
    with suppress(StoreError, IndexError):
        return scored.recordings.columns(infos[0].recording_id).contents
    return None


def _answer(info: ScoringInfo, monitor: MonitorInfo) -> dict[str, Any]:
    dictionary = Dictionary.from_stored(monitor.dictionary)
    specification = specification_from_plain(info.specification, dictionary)
    channels = limited_channels(dictionary, specification)
    plain = {key: value for key, value in asdict(info).items() if key not in OF_ITS_OWN}
    plain["manoeuvres"] = worded(info.manoeuvres)
    if info.damage:
        plain |= {key: [] for key in VERDICTS}
    if (by_set := info.request.get("monitor_set")) is not None:
        plain["monitor_name"] = f"monitor set {by_set['name']}"
    return plain | {
        "damage": info.damage,
        "recording": info.recording_id,
        "monitor": info.monitor_id,
        "channels": [channel.model_dump() for channel in channels],
    }


def worded(manoeuvres: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Stored manoeuvres with their verdicts in words."""
    return [
        manoeuvre
        | {
            "exceedance_verdict": verdict_of(manoeuvre),
            "verdict": wording_of(manoeuvre)._asdict(),
            "outcome_words": OUTCOMES[manoeuvre["outcome"]]._asdict(),
        }
        for manoeuvre in manoeuvres
    ]


def detected_manoeuvres(
    recordings: Recordings, recording_id: str, monitor_id: str
) -> list[dict[str, Any]]:
    """Manoeuvres that scoring by a monitor would detect. NotFound; TelemetryError."""
    monitor = recordings.store.monitors.get(monitor_id)
    recorded = recordings.mapped(recording_id).scorable()
    return [interval._asdict() for interval in manoeuvres_in(monitor, recorded)]


def reason(code: int, t: float, manoeuvre: int, manoeuvres: Sequence[Mapping[str, Any]]) -> str:
    """Why a stored sample has no assessment; empty if its state needs no reason.

    code, t, manoeuvre: as stored, see app.assessment.   manoeuvres: plain, as stored. Earlier
    versions withdrew them as a whole, or did not store when.
    """
    if STATES[code] is not State.INVALID:
        return REASONS[code]
    if manoeuvre < 0:
        return BETWEEN
    scored = manoeuvres[manoeuvre]
    in_force = [limits for limits in scored.get("limits_in_force", ()) if limits["start"] <= t]
    if in_force and in_force[-1]["reason"]:
        return in_force[-1]["reason"]
    validity, begin = scored["validity"], scored.get("withdrawn_t", t)
    if validity["valid"] is not False or begin is None or t < begin:
        return REASONS[code]
    return scored.get("withdrawn_reason") or in_words(validity["reasons"]) or REASONS[code]


def _unused(info: ScoringInfo, t: float) -> str:
    """Why no monitor of the set was in use at t [s]; empty if one was."""
    before = [each for each in info.limits_in_force or () if each["start"] <= t]
    return before[-1]["reason"] if before else ""


def stored_assessment(
    t: float, sample: Any, reason: str, y_hat: Array | None = None, cause: Cause | None = None
) -> Assessment:
    """The assessment of a sample stored with p_value, alert and state.

    cause: None to go by the reason.
    """
    state = STATES[sample["state"]]
    if state is not State.OK:
        cause = cause or cause_of(state, reason)
        return Assessment(float(t), None, None, state, reason, cause=cause)
    risk = float(sample["p_value"]), bool(sample["alert"])
    return Assessment(float(t), *risk, state, reason, y_hat)


def frames(info: ScoringInfo, samples: Samples, first: int) -> list[dict[str, Any]]:
    """Frames of samples, numbered from `first`; NaN and infinity become null when encoded."""
    answer = []
    for seq, sample in enumerate(samples, first):
        t, manoeuvre, y_hat = float(sample["t"]), int(sample["manoeuvre"]), sample["y_hat"]
        why = reason(sample["state"], t, manoeuvre, info.manoeuvres)
        if manoeuvre < 0 and "monitor_set" in info.request:
            why = _unused(info, t) or why
        known = y_hat if np.isfinite(y_hat).all() else None
        frame = plain_frame(seq, sample["y"], stored_assessment(t, sample, why, known), None)
        withdrawn = float(sample["withdrawn"])
        answer.append(frame | {"withdrawn": withdrawn, "manoeuvre": manoeuvre})
    return answer


def tiled(dt: float, keys: Sequence[str], samples: Samples, window: Window) -> dict[str, Any]:
    """A window of a scoring's samples.   keys: of the channels."""
    bins, n = window.bins, len(window.bins)
    t = samples["t"]
    end = min(window.first + n * window.width, len(t)) - 1
    return {
        "start": float(t[window.first]) if n else None,
        "end": float(t[end]) if n else None,
        "step": window.width * dt,
        "samples": window.width,
        "t": np.ascontiguousarray(t[window.first : end + 1 : window.width]) if n else [],
        "channels": {
            key: {
                "low": np.ascontiguousarray(bins["low"][:, channel]),
                "high": np.ascontiguousarray(bins["high"][:, channel]),
            }
            for channel, key in enumerate(keys)
        },
        "risk": {
            "low": np.ascontiguousarray(bins["risk_low"]),
            "high": np.ascontiguousarray(bins["risk_high"]),
        },
        "withdrawn": {"high": np.ascontiguousarray(bins["withdrawn"])},
        "state": bins["state"].tolist(),
        "alert": bins["alert"].tolist(),
    }
