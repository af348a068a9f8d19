"""Flown manoeuvres as rollouts: their samples on the grid and from trim, as scoring sees them."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from app.assessment.planned_test import PlannedTest, rollouts_test
from app.assessment.recorded import in_units, on_grid, sizes_of
from app.assessment.segments import ScoringRecipe, Segment, segments
from app.assessment.trim import CausalTrim, motion
from app.telemetry.recording import Recording, TelemetryError
from app.telemetry.timing.repair import RepairedTraces
from core.channels import Dictionary
from core.counted import counted
from core.kernels.causal_grid import ON_GRID
from core.limits.limits import Envelope
from core.monitor.observation import channel_peaks
from core.rollouts import UNLABELLED, FlownManoeuvre
from core.types import Array, Indices

REACHED = 0.9
"""Without rollouts beside them, flights last as long as this share of the manoeuvres does."""
INPUT = 0.5
"""Without rollouts beside them, an input is this share of how far the controls move."""


class Marked(NamedTuple):
    """A manoeuvre of a scoring.

    start, end: [s].   trim: by channel, None where unknown.   detected: by control activity.
    """

    name: str
    start: float
    end: float
    trim: Mapping[str, float | None]
    detected: bool


@dataclass(frozen=True, eq=False)
class FlownFlight:
    """A recording whose manoeuvres become rollouts.

    name, digest, recording: see FlownManoeuvre.   marked: its manoeuvres; None to detect them.
    failures: times of failure [s], none for a safe flight; None if the limits tell.
    """

    name: str
    digest: str
    repaired: RepairedTraces
    recording: str = ""
    marked: tuple[Marked, ...] | None = None
    failures: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class Beside:
    """What flown manoeuvres are taken like.

    planned: test of the rollouts beside them.   largest: (n_channels,) of these; None without any.
    n_samples: of a rollout; None to last as the manoeuvres do.
    """

    planned: PlannedTest
    largest: Array | None = None
    n_samples: int | None = None

    @classmethod
    def of(cls, y: Array, dt: float, dictionary: Dictionary, recipe: dict[str, Any]) -> "Beside":
        """y: (n, n_samples, n_channels), none to go by the recordings.   recipe: of a dataset."""
        if not len(y):
            unlimited = Envelope.unlimited(len(dictionary))
            return cls(PlannedTest(dt, unlimited, dictionary=dictionary))
        return cls(rollouts_test(y, dt, dictionary, recipe), channel_peaks(y), y.shape[1])


class FlownRollouts(NamedTuple):
    """y: (n, n_samples, n_channels).   fail_index: (n,) as RolloutFile's, or UNLABELLED.

    flown: (n,).   findings: in words.
    """

    y: Array
    fail_index: Indices
    flown: tuple[FlownManoeuvre, ...]
    findings: tuple[str, ...]


class _Window(NamedTuple):
    """A manoeuvre and what follows it, until the next one.

    place: of each sample on the grid, from 0.   length: of the manoeuvre alone [samples].
    """

    flown: FlownManoeuvre
    place: Indices
    y: Array
    t: Array
    length: int
    failures: tuple[float, ...] | None


def flown_rollouts(flights: Iterable[FlownFlight], beside: Beside) -> FlownRollouts:
    """The manoeuvres of recordings, each a rollout. TelemetryError names the recording."""
    windows, findings = list[_Window](), list[str]()
    for flight in flights:
        try:
            windows += _windows(flight, beside, findings)
        except TelemetryError as error:
            raise TelemetryError(f"{flight.name}: {error}") from error
    n_samples = beside.n_samples or _usual_length(windows)
    y = np.full((len(windows), n_samples, len(beside.planned.dictionary)), np.nan)
    fail_index, late = np.full(len(windows), UNLABELLED), 0
    for k, window in enumerate(windows):
        inside = window.place < n_samples
        y[k, window.place[inside]] = window.y[inside]
        if window.failures is not None:
            failing = _failing_sample(window)
            late += failing >= n_samples
            fail_index[k] = failing if failing < n_samples else -1
    if late:
        length = (n_samples - 1) * beside.planned.dt
        flown = counted(late, "flown manoeuvre")
        findings.append(f"counted as safe: {flown} that failed only after {length:g} s")
    return FlownRollouts(y, fail_index, tuple(each.flown for each in windows), tuple(findings))


def _windows(flight: FlownFlight, beside: Beside, findings: list[str]) -> Iterator[_Window]:
    dictionary, dt = beside.planned.dictionary, beside.planned.dt
    repaired = in_units(flight.repaired, dictionary)
    recorded = [each.key for each in repaired.quality.channels if each.missing < 1.0]
    lacking = [key for key in dictionary.measured if key not in recorded]
    quality = [each for each in repaired.quality.channels if each.key in lacking]
    if implausible := [text for each in quality for text in each.repairs()]:
        raise TelemetryError(f"{' '.join(implausible)} Give it in a mapping.")
    if lacking:
        raise TelemetryError(
            f"it has no {', '.join(lacking)}: map signals to them, give a dataset or a dictionary "
            "of other channels, or leave the recording out"
        )
    grid = on_grid(repaired, dt, dictionary.measured, dictionary)
    selected = _selected(flight, grid.recording, grid.begun, beside)
    if not selected:
        findings.append(f"{flight.name} shows no manoeuvre, as no control moves: left out")
        return
    sizes = sizes_of(repaired.traces, dictionary)
    t, outside = grid.recording.t, set(flight.failures or ())
    stops = [part.first if part.onset is None else part.onset for part in selected[1:]]
    for part, stop in zip(selected, [*stops, len(t)], strict=True):
        if part.onset is None:
            stop = part.last + 1
        rows = slice(part.first, stop)
        begin, end = float(t[part.first]), float(t[stop - 1])
        failures = flight.failures
        if failures is not None:
            failures = tuple(at for at in failures if begin <= at <= end + dt)
            outside -= set(failures)
        y = grid.recording.y[rows] - part.trim_of(grid.recording.y, dictionary)
        if np.isnan(y[0]).any():
            keys = [dictionary.keys[c] for c in np.flatnonzero(np.isnan(y[0]))]
            findings.append(
                f"{part.name} of {flight.name} has no trim of {', '.join(keys)}: left out"
            )
            continue
        about = flight.name, flight.digest, part.name, begin, float(t[part.last])
        flown = FlownManoeuvre(*about, flight.recording, sizes)
        place = np.rint((t[rows] - begin) / dt).astype(int)
        yield _Window(flown, place, y, t[rows], part.last + 1 - part.first, failures)
    if outside:
        times = ", ".join(f"{at:g} s" for at in sorted(outside))
        raise TelemetryError(
            f"its label says that it fails at {times}, which is in none of its manoeuvres: "
            "correct the time, or mark the manoeuvre in a scoring and give that"
        )


def _selected(
    flight: FlownFlight, recording: Recording, begun: tuple[int, ...], beside: Beside
) -> list[Segment]:
    """Segments of the manoeuvres in order; those that may go on longer have an onset."""
    planned = beside.planned
    if flight.marked is not None:
        return [_of_scoring(marked, recording, planned) for marked in flight.marked]
    moving = None if beside.largest is None else motion(planned, beside.largest)
    sizes = None if planned.amplitudes.any() else _moved(recording.y, planned)
    followed = CausalTrim(planned, moving, sizes).follow(recording.y, begun)
    if planned.controls and not followed:
        return []
    flown, recipe = flight.repaired.flown, ScoringRecipe()
    if flown is not None and flown.is_trimmed:
        recipe = ScoringRecipe(trim=None, manoeuvres="entire")
    return list(segments(recording, planned, recipe, followed)[0])


def _of_scoring(marked: Marked, recording: Recording, planned: PlannedTest) -> Segment:
    near = ON_GRID * planned.dt
    first, stop = np.searchsorted(recording.t, (marked.start - near, marked.end + near)).tolist()
    known = [marked.trim.get(key) for key in planned.dictionary.keys]
    trim = np.array([np.nan if value is None else value for value in known])
    onset = first if marked.detected else None
    return Segment(marked.name, first, max(stop - 1, first), onset, trim=trim)


def _moved(y: Array, planned: PlannedTest) -> Array:
    """(n_controls,) size of an input on each control, from how far those of its unit move."""
    columns = list(planned.controls)
    units = [planned.dictionary.channels[c].unit for c in columns]
    moved = np.array([np.ptp(part[np.isfinite(part)]) for part in y[:, columns].T])
    largest = [moved[[each == unit for each in units]].max() for unit in units]
    return INPUT * np.array(largest)


def _usual_length(windows: list[_Window]) -> int:
    """As the longest manoeuvre, unless too few of the others go on for as long [samples]."""
    if not windows:
        return 1
    reached = np.quantile([each.place[-1] + 1 for each in windows], 1 - REACHED, method="lower")
    return min(max(each.length for each in windows), int(reached))


def _failing_sample(window: _Window) -> int:
    """First sample at or after the labelled failure; -1 for a safe manoeuvre."""
    if not window.failures:
        return -1
    at = np.searchsorted(window.t, min(window.failures) - 1e-9)
    return int(window.place[min(at, len(window.place) - 1)])
