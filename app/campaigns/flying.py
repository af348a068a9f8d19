"""A recorded point: its manoeuvre cut out of a recording, on the test's samples, from trim."""

import numpy as np

from app.campaigns.campaign import CampaignError, FlownPoint
from app.scoring.planned_test import PlannedTest
from app.scoring.recipe import Interval, ScoringRecipe
from app.scoring.segments import Segment, mean_of_rest, segments
from app.telemetry.recording import Recording
from app.telemetry.resampling.resampling import on_grid
from app.telemetry.timing.repair import RepairedTraces
from core.channels import KEYS
from core.planned_test import DatasetRecipe


def flown_point(
    name: str,
    recorded: RepairedTraces,
    test: DatasetRecipe,
    marked: Interval | None,
    recording_id: str = "",
) -> FlownPoint:
    """Cut the manoeuvre of a point out of a recording.

    name: of the recording.   marked: from trim to the end of the manoeuvre; the only one that is
    detected where None.   recording_id: where it is stored.
    CampaignError where there is none, or several; where samples of it are missing.
    """
    recording = on_grid(recorded.traces, test.dt)
    planned = PlannedTest(test.dt, test.specification.magnitudes, test.maneuver, test.aircraft)
    recipe = ScoringRecipe(manoeuvres="detected" if marked is None else (marked,))
    found, _ = segments(recording, planned, recipe)
    if marked is None:
        found = tuple(segment for segment in found if segment.onset is not None)
    if len(found) != 1:
        times = ", ".join(_times(recording, segment) for segment in found) or "none"
        raise CampaignError(
            f"{name}: {len(found)} manoeuvres were detected ({times}): say which one is the point, "
            "by the start of its trim and its end"
        )
    (segment,) = found
    part = recording.y[segment.first : segment.last + 1]
    rest = np.zeros(len(KEYS)) if segment.rest is None else mean_of_rest(recording.y[segment.rest])
    y = (part - rest)[: test.maneuver.n_samples(test.dt)]
    missing = [key for key, column in zip(KEYS, y.T, strict=True) if not np.isfinite(column).all()]
    if missing:
        raise CampaignError(
            f"{name}: samples of {', '.join(missing)} are missing from "
            f"{_times(recording, segment)}: an aircraft is identified from all six channels, "
            "without gaps"
        )
    parts = np.abs(y) / test.specification.magnitudes
    first = int(test.specification.first_exceedance(y[np.newaxis])[0])
    exceeded = ""
    if first < len(y):
        exceeded = f"{KEYS[int(parts[first].argmax())]} at {first * test.dt:.2f} s"
    return FlownPoint(
        f"{name}, {_times(recording, segment)}",
        tuple(map(tuple, y.tolist())),
        float(parts.max()),
        exceeded,
        recording_id,
        float(recording.t[segment.first]),
        float(recording.t[segment.last]),
    )


def _times(recording: Recording, segment: Segment) -> str:
    return f"{recording.t[segment.first]:.2f} to {recording.t[segment.last]:.2f} s"
