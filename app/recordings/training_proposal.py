"""A training recipe proposed from a recording: its manoeuvre, its limits, its channels.

The recording does not name its aircraft and seldom its limits, so a person completes the recipe.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from app.assessment.limits_history import LimitsHistory
from app.assessment.planned_test import PlannedTest
from app.assessment.recorded import on_grid
from app.assessment.trim import BEGINNING, SHARE, CausalTrim
from app.recipes.labels import kind_label
from app.recordings.recordings import Recordings
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.recording import Recording
from app.telemetry.timing.repair import RepairedTraces
from core.channels import BY_KEY, KEYS, LATERAL
from core.kernels.causal_grid import RATE_RATIO
from core.limits.limits import Envelope, magnitudes_of
from core.monitor import Monitor
from core.planned_test.planned_test import DatasetRecipe
from core.recipe import to_plain
from core.simulation.maneuver import (
    MANEUVERS,
    BankToBank,
    Doublet,
    Multistep3211,
    OneSurface,
    Pulse,
    Step,
    Steps,
    Surface,
)
from core.types import Array

SURFACES = LATERAL.of_role("control")
SURFACE_NAMES = tuple(LATERAL.channels[c].label for c in SURFACES)
UNITS_S = np.arange(0.2, 5.01, 0.05)
"""Lengths of a card's shortest segment to compare with the recorded input [s]."""
RISE_S = 0.2
"""Time for a surface to follow a step of the command [s]."""
BEFORE_S, STILL = 0.5, 0.05
"""A surface begins to move within this time before it departs [s], by this part of its input."""
AFTER_S = 1.0
"""Compared time after the input, with the surface back at trim [s]."""
REST_S = 3.0
"""Duration of the rollout after the last input [s]."""
GOOD_FIT = 0.7
"""Smallest explained share of the recorded motion of a proposed card."""
USUALLY_LIMITED = "Ny"
"""The channel that the aircraft's usual test limits."""
BETTER = 0.01
"""by which a later, less simple card must explain more."""

Card = Callable[[Surface, float], Steps]
CARDS: tuple[Card, ...] = (
    lambda surface, _: Step(surface=surface),
    lambda surface, unit: Pulse(surface=surface, width_s=unit),
    lambda surface, unit: Doublet(surface=surface, half_s=unit),
    lambda surface, unit: BankToBank(surface=surface, roll_s=unit),
    lambda surface, unit: Multistep3211(surface=surface, unit_s=unit),
)


class Match(NamedTuple):
    """A card and the share of the recorded motion that it explains."""

    card: OneSurface
    share: float


@dataclass(frozen=True, eq=False)
class Input:
    """The largest control input of a recording.

    start, end: [s].   deviation: (n,) of its main surface from trim [rad], from the first movement
    to AFTER_S after the last.
    """

    surface: Surface
    start: float
    end: float
    deviation: Array

    @property
    def peak_deg(self) -> float:
        """Largest deviation, with its sign [deg]."""
        return float(np.degrees(self.deviation[np.abs(self.deviation).argmax()]))


def training_proposal(
    recordings: Recordings, recording_id: str, monitor_id: str | None = None
) -> dict[str, Any]:
    """A partial body of `POST /monitors` that fits a recording, and the fields still to add.

    monitor_id: lends its limits and lead, as the one that a scoring used.
    NotFound; TelemetryError where the mapping cannot be applied.
    """
    mapped = recordings.mapped(recording_id)
    repaired = mapped.scorable()
    recorded = [c.key for c in repaired.quality.channels if c.missing < 1.0 and c.key in KEYS]
    missing = [key for key in KEYS if key not in recorded]
    if not recorded:
        return _without_lateral_channels()
    reasons = ["A recording does not name its aircraft: choose it."]
    dataset: dict[str, Any] = {}
    recipe: dict[str, Any] = {"dataset": dataset}
    dt = _sample_interval(repaired, recorded)
    largest = _largest_input(on_grid(repaired, dt, recorded).recording, dt)
    if dt != DatasetRecipe().dt:
        dataset["dt"] = dt
    if largest is None:
        reasons.append("No control input was detected: choose the manoeuvre.")
    else:
        maneuver, words = _maneuver(largest, dt)
        reasons.append(words)
        if maneuver is not None:
            dataset["maneuver"] = maneuver
    monitor = None if monitor_id is None else recordings.store.monitors.get(monitor_id)
    if monitor is not None and monitor.dictionary != LATERAL:
        monitor = None  # its limits and lead are of another test
    limits, words = _limits(recordings, recording_id, mapped.mapping, monitor, largest)
    if limits is not None:
        dataset["limits"] = limits
    reasons.append(words)
    if monitor is not None:
        recipe["t_early"] = monitor.lead
    method, words = _without(missing, limits or {})
    recipe |= method
    reasons += words
    return {
        "recipe": recipe,
        "reasons": reasons,
        "missing_channels": missing,
        "can_train": bool(method) or not missing,
        "manoeuvre": None if largest is None else {"start": largest.start, "end": largest.end},
    }


def _without_lateral_channels() -> dict[str, Any]:
    return {
        "recipe": {"dataset": {}},
        "reasons": [
            "No lateral channel is mapped, and only lateral manoeuvres are simulated here: train a "
            "monitor on rollouts of your own simulator."
        ],
        "missing_channels": list(KEYS),
        "can_train": False,
        "manoeuvre": None,
    }


def _sample_interval(repaired: RepairedTraces, recorded: list[str]) -> float:
    """[s] The usual one, or a longer one for a slower recording."""
    times = [repaired.traces.channels[key].t for key in recorded]
    slowest = max(float(np.median(np.diff(t))) if len(t) > 1 else 0.0 for t in times)
    usual = DatasetRecipe().dt
    return usual if slowest <= RATE_RATIO * usual else ceil(slowest * 100.0) / 100.0


def _largest_input(recording: Recording, dt: float) -> Input | None:
    surfaces = recording.y[:, SURFACES]
    if np.isnan(surfaces).all():
        return None
    surfaces = np.nan_to_num(surfaces)
    sizes = np.full(2, 0.5 * np.ptp(surfaces, axis=0).max())
    unknown = PlannedTest(dt, Envelope.unlimited(len(KEYS)))
    inputs = [
        _input(recording.t, surfaces, trim[SURFACES,], sizes, onset, stop, dt)
        for onset, stop, trim in CausalTrim(unknown, sizes=sizes).follow(recording.y)
    ]
    return max(inputs, key=lambda each: abs(each.peak_deg), default=None)


def _input(
    t: Array, surfaces: Array, trim: Array, sizes: Array, onset: int, stop: int, dt: float
) -> Input:
    """The input of a manoeuvre, from its first sample to AFTER_S after the last movement.

    surfaces: (n, 2), trim, sizes: (2,) [rad].   onset, stop: samples of the manoeuvre.
    """
    since = max(0, onset - round(BEFORE_S / dt))
    moves = (np.abs(surfaces[since:onset] - trim) > STILL * sizes).any(axis=1)
    onset = since + int(np.flatnonzero(~moves)[-1]) if not moves.all() else since
    deviation = surfaces[onset:stop] - trim
    moved = np.flatnonzero((np.abs(deviation) > BEGINNING * SHARE * sizes).any(axis=1))
    last = int(moved[-1]) if len(moved) else 0
    deviation = deviation[: last + 1 + round(AFTER_S / dt)]
    main = int(np.abs(deviation).max(axis=0).argmax())
    surface: Surface = "rudder" if SURFACE_NAMES[main] == "rudder" else "aileron"
    start, end = float(t[onset]), float(t[onset + last])
    return Input(surface, start, end, deviation[:, main])


def _maneuver(recorded: Input, dt: float) -> tuple[dict[str, Any] | None, str]:
    """The card most like an input, as plain data; None where none is. And why."""
    motion = f"The {recorded.surface} moves by up to {recorded.peak_deg:.3g} deg"
    at = f"from {recorded.start:.4g} to {recorded.end:.4g} s"
    match = best_card(recorded, dt)
    if match.share < GOOD_FIT:
        return None, f"{motion} {at}, unlike any card: choose the manoeuvre, or give a table."
    last = sum(s for s in match.card.segments_s if np.isfinite(s)) or recorded.end - recorded.start
    length = match.card.lead_in_s + last + REST_S
    kind: str = to_plain(match.card)["kind"]
    usual = MANEUVERS[kind]
    plain = {
        key: value
        for key, value in to_plain(match.card).items()
        if key in ("kind", "surface", "amplitude_deg") or value != getattr(usual, key)
    } | {"duration_s": round(ceil(length / dt - 1e-6) * dt, 6)}
    label = kind_label(kind)
    words = (
        f"{motion} {at}. Most like it: {label}, {match.card.peak_deg:.3g} deg, which explains "
        f"{100.0 * match.share:.0f} % of the motion. Check it against the test card."
    )
    return plain, words


def best_card(recorded: Input, dt: float) -> Match:
    """The card that explains most of an input; the simpler one of two that explain as much."""
    best = Match(Step(surface=recorded.surface), -np.inf)
    for card in CARDS:
        match = max(_matches(card, recorded, dt), key=lambda match: match.share)
        if match.share > best.share + BETTER:
            best = match
    return best


def _matches(card: Card, recorded: Input, dt: float) -> Iterator[Match]:
    u = recorded.deviation
    moved = float(u @ u) or 1.0
    rise = np.linspace(0.0, RISE_S, 5)
    times = dt * np.arange(len(u)) - rise[:, np.newaxis]
    for unit in UNITS_S:
        steps = card(recorded.surface, round(float(unit), 2))
        segments = np.tile(steps.segments_s, (len(rise), 1))
        shape = steps.shape(times, segments).mean(axis=0)
        size = float(shape @ shape)
        if not size:
            continue
        amplitude = float(u @ shape) / size
        rounded = float(f"{np.degrees(amplitude):.3g}")
        if rounded:
            named = steps.with_peak(rounded)
            assert isinstance(named, OneSurface)
            yield Match(named, amplitude * amplitude * size / moved)


def _limits(
    recordings: Recordings,
    recording_id: str,
    mapping: Mapping,
    monitor: Monitor | None,
    recorded: Input | None,
) -> tuple[dict[str, float | None] | None, str]:
    """Magnitude of each channel, null without a limit; None where not known. And whose they are."""
    magnitudes, source = None, "those in force during the recorded flight"
    with recordings.present(recording_id):
        history = LimitsHistory.of(recordings.columns(recording_id), mapping)
    if history is not None and recorded is not None:
        magnitudes = history.timeline([None]).at(np.array([recorded.start])).high[0]
    if (magnitudes is None or np.isinf(magnitudes).all()) and monitor is not None:
        magnitudes, source = magnitudes_of(monitor.specification), "those of the monitor"
    if magnitudes is None or np.isinf(magnitudes).all():
        return None, "No limits are recorded: check the usual ones of the aircraft."
    limits = {
        key: float(limit) if np.isfinite(limit) else None
        for key, limit in zip(KEYS, magnitudes, strict=True)
    }
    words = ", ".join(f"{BY_KEY[k].symbol} {BY_KEY[k].read(v)}" for k, v in limits.items() if v)
    return limits, f"Limits: {source} ({words})."


def _without(missing: list[str], limits: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The method that works without missing channels, if there is one, and why.

    Only the newest output's magnitude leaves channels unread; limited channels are needed too.
    """
    if not missing:
        return {}, []
    named = ", ".join(BY_KEY[key].symbol for key in missing)
    limited = [key for key, limit in limits.items() if limit] or [USUALLY_LIMITED]
    unseen = [BY_KEY[key].symbol for key in limited if key in missing]
    if unseen:
        method: dict[str, Any] = {}
        words = [
            f"Missing channels: {named}. No method works without them: {', '.join(unseen)} has a "
            "limit and is not recorded."
        ]
    else:
        method = {
            "predictor": {"kind": "last_output"},
            "score": {"kind": "negative_magnitude", "key": limited[0]},
        }
        words = [
            f"Missing channels: {named}. Proposed method: {kind_label('last_output')}, "
            f"{kind_label('negative_magnitude')}. It reads {BY_KEY[limited[0]].symbol} only and "
            "works without them. It does not forecast, so expect more false alarms. All other "
            "methods read all six channels."
        ]
    return method, words
