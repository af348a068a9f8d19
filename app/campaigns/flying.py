"""Cut a flown point out of a recording: its manoeuvre on the test's samples, from trim."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.assessment.outcome import exceedances_outside, notes_on_outside
from app.assessment.planned_test import PlannedTest
from app.assessment.recorded import on_grid
from app.assessment.segments import Interval, ScoringRecipe, Segment, detected_segments, segments
from app.assessment.trim import AFTERWARDS, CausalTrim, FollowedManoeuvre, TrimSteps
from app.assessment.validity import surfaces_flown
from app.campaigns.point import CampaignError, FlownPoint
from app.telemetry.recording import Recording
from app.telemetry.timing.repair import RepairedTraces
from core.channels import LATERAL
from core.limits.limits import Envelope
from core.planned_test.planned_test import ManeuverTest
from core.types import Array

ENOUGH = 0.8
"""Smallest share of the planned samples; a shorter record is incomplete."""
AS_PLANNED = 0.75, 1.33
"""Range of the flown amplitude, as shares of the planned one, without a remark."""
N_SIMULATED = 100


def flown_point(
    name: str,
    recorded: RepairedTraces,
    test: ManeuverTest,
    marked: Interval | None,
    recording_id: str = "",
) -> FlownPoint:
    """Cut the manoeuvre of a point out of a recording.

    name: of the recording.   marked: from trim to the end of the manoeuvre; None: the only detected
    one.   recording_id: where it is stored.
    Every recorded sample counts against the limits, from trim and as recorded, up to AFTERWARDS.
    CampaignError if there is no manoeuvre or several, if samples are missing, or if it is not the
    planned one.
    """
    dictionary, planned = test.dictionary, PlannedTest.of(test)
    grid = on_grid(recorded, test.dt, dictionary.measured, dictionary)
    recording = grid.recording
    followed = CausalTrim(planned).follow(grid.recording.y, grid.begun)
    segment, span = _segment(name, recording, planned, marked, followed)
    where, n_planned = _times(recording, segment), test.maneuver.n_samples(test.dt)
    part = recording.y[segment.first : segment.last + 1]
    rest = segment.trim_of(recording.y, dictionary)
    y = (part - rest)[:n_planned]
    whole = zip(dictionary.keys, np.isfinite(y).min(axis=0, initial=True), strict=True)
    if missing := [key for key, is_whole in whole if not is_whole]:
        raise CampaignError(
            f"{name}: samples of {', '.join(missing)} are missing from {where}: the clearance "
            f"needs all {len(dictionary)} channels without gaps"
        )
    if len(y) < ENOUGH * n_planned:
        raise CampaignError(
            f"{name}: {where} holds {len(y)} samples, the manoeuvre takes {n_planned} of "
            f"{test.dt:g} s: give the whole manoeuvre"
        )
    remark = _flown_as_planned(f"{name}, {where}", y, planned, test)
    traces = _limited(recorded, test, planned.limits, recording)
    worst = _worst(traces, planned.limits, rest, span)
    as_is = _worst(traces, planned.limits, np.zeros(len(dictionary)), span)
    if worst.part < 1.0 <= as_is.part:
        worst = as_is._replace(words=f"{as_is.words} as recorded, trim not subtracted")
    about = recorded.traces, dictionary, planned.limits, [span], TrimSteps.constant(rest)
    elsewhere = exceedances_outside(*about)
    return FlownPoint(
        f"{name}, {where}",
        tuple(map(tuple, y.tolist())),
        worst.part,
        worst.words if worst.part >= 1.0 else "",
        recording_id,
        float(recording.t[segment.first]),
        float(recording.t[segment.last]),
        " ".join([remark, *notes_on_outside(elsewhere, dictionary)]).strip(),
    )


def aborted_flight(
    name: str,
    recorded: RepairedTraces,
    test: ManeuverTest,
    marked: Interval | None,
    recording_id: str = "",
) -> FlownPoint:
    """The limits reached by a point that was aborted in flight.

    marked: times to judge; None for the whole recording.
    Every sample counts as recorded, trim not subtracted: an incomplete manoeuvre may not be
    detected. CampaignError if a limited channel has no sample.
    """
    start, end = (-np.inf, np.inf) if marked is None else (marked.start, marked.end)
    where = "entire recording" if marked is None else f"{start:.2f} to {end:.2f} s"
    limits, dictionary = PlannedTest.of(test).limits, test.dictionary
    on_samples = (
        on_grid(recorded, test.dt, dictionary.measured, dictionary).recording
        if dictionary.formulas
        else None
    )
    traces = _limited(recorded, test, limits, on_samples)
    empty = {key for key, (t, _) in traces.items() if not ((t >= start) & (t <= end)).any()}
    if missing := [key for key in traces if key in empty]:
        raise CampaignError(
            f"{name}: {where} holds no sample of {', '.join(missing)}, which has a limit: map the "
            "channel, or give other times"
        )
    worst = _worst(traces, limits, np.zeros(len(dictionary)), (start, end))
    return FlownPoint(
        f"{name}, {where}",
        (),
        worst.part,
        worst.words if worst.part >= 1.0 else "",
        recording_id,
        None if marked is None else start,
        None if marked is None else end,
    )


def _segment(
    name: str,
    recording: Recording,
    planned: PlannedTest,
    marked: Interval | None,
    followed: list[FollowedManoeuvre],
) -> tuple[Segment, tuple[float, float]]:
    """The point's segment, and the interval in which its samples count [s].

    The interval covers the whole manoeuvre around marked times, and AFTERWARDS up to the next one.
    """
    candidates = detected = detected_segments(planned, ScoringRecipe(), followed)
    if marked is not None:
        candidates, _ = segments(recording, planned, ScoringRecipe(manoeuvres=(marked,)), followed)
    if len(candidates) != 1:
        times = ", ".join(_times(recording, segment) for segment in candidates) or "none"
        raise CampaignError(
            f"{name}: {len(candidates)} manoeuvres detected ({times}): choose the point, by the "
            "start of its trim and its end"
        )
    (segment,) = candidates
    whole = [each for each in (segment, *detected) if _overlap(each, segment)]
    first, last = min(each.first for each in whole), max(each.last for each in whole)
    end = float(recording.t[last]) + AFTERWARDS
    following = [float(recording.t[each.first]) for each in detected if each.first > last]
    return segment, (float(recording.t[first]), min([end, *following]))


class _Worst(NamedTuple):
    """Largest part of a limit, with its channel and time in words."""

    part: float
    words: str


def _limited(
    recorded: RepairedTraces, test: ManeuverTest, limits: Envelope, samples: Recording | None
) -> dict[str, tuple[Array, Array]]:
    """Times and finite values of each limited channel: every recorded sample, those on the test's
    samples where it is computed."""
    traces: dict[str, tuple[Array, Array]] = {}
    for c in np.flatnonzero(limits.limited):
        key, t, values = test.dictionary.keys[c], np.empty(0), np.empty(0)
        if (trace := recorded.traces.channels.get(key)) is not None:
            t, values = trace.t, trace.values
        elif samples is not None:
            t, values = samples.t, samples.y[:, c]
        traces[key] = t[np.isfinite(values)], values[np.isfinite(values)]
    return traces


def _worst(
    traces: dict[str, tuple[Array, Array]],
    limits: Envelope,
    trim: Array,
    span: tuple[float, float],
) -> _Worst:
    """Over every recorded sample within a span, minus its trim."""
    worst = _Worst(0.0, "")
    for c, (key, (t, values)) in zip(np.flatnonzero(limits.limited), traces.items(), strict=True):
        here = (t >= span[0]) & (t <= span[1])
        t, off = t[here], values[here] - trim[c] - limits.rest[c]
        parts = np.maximum(
            off / (limits.high[c] - limits.rest[c]), off / (limits.low[c] - limits.rest[c])
        )
        if len(parts) and (part := float(parts.max())) > worst.part:
            worst = _Worst(part, f"{key} at {t[parts.argmax()]:.2f} s")
    return worst


def _flown_as_planned(where: str, y: Array, planned: PlannedTest, test: ManeuverTest) -> str:
    """Remark on the flown input, or ""; CampaignError if it is another manoeuvre."""
    each = np.abs(test.simulator().rollouts(N_SIMULATED, np.random.default_rng(0)).y).max(axis=1)
    usual = each.max(axis=0)
    if planned.dictionary != LATERAL:  # its law moves the surfaces by other amounts than commanded
        moved = np.median(each, axis=0)[list(planned.controls)]
        planned = replace(planned, flown=np.where(planned.amplitudes > 0.0, moved, 0.0))
    as_planned, words = surfaces_flown(planned, y, usual)
    if as_planned is False:
        raise CampaignError(
            f"{where}: {words}. This is not the planned point: check the signs and units of the "
            "mapping, or choose the part of the recording"
        )
    flown, amplitudes = np.abs(y).max(axis=0)[list(planned.controls)], planned.amplitudes
    shares = flown[amplitudes > 0.0] / amplitudes[amplitudes > 0.0]
    low, high = AS_PLANNED
    return f"{words}." if (shares < low).any() or (shares > high).any() else ""


def _overlap(a: Segment, b: Segment) -> bool:
    return a.first <= b.last and b.first <= a.last


def _times(recording: Recording, segment: Segment) -> str:
    return f"{recording.t[segment.first]:.2f} to {recording.t[segment.last]:.2f} s"
