"""The segments of a recording to score, each with the rest that gives its trim."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, isfinite
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from app.assessment.monitors_in_use import MonitorRuling, MonitorsInUse, needs_beginning
from app.assessment.planned_test import PlannedTest
from app.assessment.recorded import RecordedFlight
from app.assessment.scored import MOST_MANOEUVRES
from app.assessment.trim import GUARD_S, FollowedManoeuvre, mean_of_rest
from app.telemetry.recording import Recording, TelemetryError
from app.telemetry.timing.repair import RepairedTraces
from core.channels import LATERAL, Dictionary
from core.kernels.causal_grid import ON_GRID
from core.monitor import Monitor
from core.types import Array

Manoeuvres = Literal["detected", "entire"]
TRIM_SEGMENT = "trim_segment"


class Interval(NamedTuple):
    """A manoeuvre marked by hand. start, end: [s] in the recording's own time."""

    start: float
    end: float
    name: str = ""


@dataclass(frozen=True)
class ScoringRecipe:
    """How to score a recording.

    epsilon: accepted miss rate; None: the monitor's own.
    trim: value to subtract from each channel of a manoeuvre: the mean of its trim segment, or of
        this many seconds before the first input (at the start of a manoeuvre marked by hand); None
        subtracts nothing. Linear models, and so their monitors, describe deviations from trim.
    manoeuvres: detected by control activity, the entire recording as one, or marked by hand.
    Raises TelemetryError for non-finite numbers, empty intervals and overlaps.
    """

    epsilon: float | None = None
    trim: float | Literal["trim_segment"] | None = TRIM_SEGMENT
    manoeuvres: Manoeuvres | tuple[Interval, ...] = "detected"

    def __post_init__(self) -> None:
        if isinstance(self.trim, str):
            _check_word("trim", self.trim, (TRIM_SEGMENT,))
        elif self.trim is not None and not 0.0 < self.trim < inf:
            raise TelemetryError(
                f"the trim segment is {self.trim:g} s long; give a length above zero"
            )
        if isinstance(self.manoeuvres, str):
            _check_word("manoeuvres", self.manoeuvres, get_args(Manoeuvres))
            return
        object.__setattr__(self, "manoeuvres", _ordered(self.manoeuvres))

    @property
    def is_as_flown(self) -> bool:
        """Whether manoeuvres and trim are those that a flight follows."""
        return self.manoeuvres == "detected" and self.trim == TRIM_SEGMENT

    def to_plain(self) -> dict[str, Any]:
        marked = self.manoeuvres
        return {
            "epsilon": self.epsilon,
            "trim": self.trim,
            "manoeuvres": marked
            if isinstance(marked, str)
            else [{"start": s.start, "end": s.end, "name": s.name} for s in marked],
        }


def _check_word(name: str, word: str, known: tuple[str, ...]) -> None:
    if word not in known:
        raise TelemetryError(f"{name} is {word!r}; give {' or '.join(known)}, or numbers")


def _ordered(intervals: Sequence[Interval]) -> tuple[Interval, ...]:
    """Sort the intervals and name those without a name."""
    if not intervals:
        raise TelemetryError("no manoeuvre is marked; mark at least one, or have them detected")
    for interval in intervals:
        if not (
            isfinite(interval.start) and isfinite(interval.end) and interval.start < interval.end
        ):
            raise TelemetryError(
                f"the manoeuvre {in_words(interval)} has no length; give an end after its start"
            )
    ordered = sorted(intervals)
    for before, after in pairwise(ordered):
        if after.start < before.end:
            raise TelemetryError(
                f"the manoeuvres {in_words(before)} and {in_words(after)} overlap; end the "
                "first before the second begins"
            )
    return tuple(
        interval._replace(name=interval.name or f"manoeuvre {number}")
        for number, interval in enumerate(ordered, 1)
    )


def in_words(interval: Interval) -> str:
    return f"{interval.start:.10g} to {interval.end:.10g} s"


class Segment(NamedTuple):
    """Samples first..last of a recording, both included, scored as a flight of their own.

    onset: sample with which a detected manoeuvre begins; earlier ones are its rest.
    rest: samples whose mean is the trim; None where no trim is subtracted.
    trim: (n_channels,) as followed in flight; None to take it from `rest`.
    requested: length of rest requested [s], if the recording has less; else None.
    since: first sample of which the monitor knows, in a monitor set.   joins: why it says nothing
    of the rest of a manoeuvre; None unless it comes into use after the beginning of one.
    ends_early: why its samples end within the manoeuvre; empty if they do not.
    unused: why no monitor of a set is in use; empty if one is.   part: number of its part of a
    manoeuvre, from 0.   is_rest: no manoeuvre was detected in it, so nothing is
    assessed.
    """

    name: str
    first: int
    last: int
    onset: int | None = None
    rest: slice | None = None
    trim: Array | None = None
    requested: float | None = None
    since: int = 0
    joins: str | None = None
    ends_early: str = ""
    unused: str = ""
    part: int = 0
    is_rest: bool = False

    def trim_of(self, y: Array, dictionary: Dictionary = LATERAL) -> Array:
        """(n_channels,) trim, NaN where unknown, 0 where none is subtracted.

        y: (n, n_channels) of the recording.
        """
        if self.trim is not None:
            return self.trim
        if self.rest is None:
            return np.zeros(y.shape[1])
        trim = mean_of_rest(y[self.rest])
        trim[list(dictionary.absolute)] = 0.0
        return trim


def until_end(segment: Segment, recording: Recording, planned: PlannedTest) -> Segment:
    """The segment; where the recording ends within the planned manoeuvre, it says so."""
    if segment.last < len(recording.t) - 1:
        return segment
    cut = _cut("the recording ends", segment, segment.last, recording.t, planned)
    return segment._replace(ends_early=cut)


def _cut(what: str, segment: Segment, last: int, t: Array, planned: PlannedTest) -> str:
    """What ends well before the planned manoeuvre does, in words; empty if it holds enough of it.

    segment: the whole manoeuvre.   last: the last sample that is held.   t: (n,) [s].
    """
    n_trim = round(planned.trim_segment_s / planned.dt)
    begin = segment.first + n_trim if segment.onset is None else segment.onset
    where = too_short(float(t[last] - t[min(begin, last)]), planned)
    return f"{what} within the manoeuvre, {where}" if where else ""


def too_short(flown: float, planned: PlannedTest) -> str:
    """What a manoeuvre of a length [s] lacks of a whole one, in words; empty if nothing."""
    least = planned.least_flown
    if least is None or flown >= least - 0.5 * planned.dt:
        return ""
    return f"{max(0.0, flown):.2f} s after its beginning; at least {least:.3g} s are needed"


def segments(
    recording: Recording,
    planned: PlannedTest,
    recipe: ScoringRecipe,
    followed: Sequence[FollowedManoeuvre],
    *,
    is_flight: bool = False,
) -> tuple[tuple[Segment, ...], tuple[str, ...]]:
    """The segments of a recipe, and notes on their detection.

    recording: on the grid of planned.dt.   followed: its manoeuvres.   is_flight: of a live flight,
    which assessed manoeuvres alone.
    TelemetryError for intervals outside it.
    """
    if isinstance(recipe.manoeuvres, tuple):
        _check_number(len(recipe.manoeuvres))
        return tuple(
            _marked(recording, planned, recipe, interval) for interval in recipe.manoeuvres
        ), ()
    entire = Interval(float(recording.t[0]), float(recording.t[-1]), "entire recording")
    if recipe.manoeuvres == "entire":
        return (_marked(recording, planned, recipe, entire),), ()
    if detected := detected_segments(planned, recipe, followed):
        return detected, (f"Manoeuvres detected by control activity: {len(detected)}.",)
    if is_flight:
        rest = _marked(recording, planned, recipe, entire)._replace(is_rest=True)
        return (rest,), ()
    controls = [planned.dictionary.channels[c].label for c in planned.controls]
    note = "No control input detected"
    if np.isnan(recording.y[:, planned.controls]).all():
        note = f"No manoeuvre can be detected without {' and '.join(controls) or 'controls'}"
    return (_marked(recording, planned, recipe, entire),), (
        f"{note}: the entire recording is scored as one.",
    )


def detected_segments(
    planned: PlannedTest, recipe: ScoringRecipe, followed: Sequence[FollowedManoeuvre]
) -> tuple[Segment, ...]:
    """The manoeuvres as they begin and end in flight, each with its trim segment before it."""
    _check_number(len(followed))
    n_trim, guard = round(planned.trim_segment_s / planned.dt), round(GUARD_S / planned.dt)
    detected, before = list[Segment](), 0
    for number, (onset, stop, flown_trim) in enumerate(followed, 1):
        end = max(before, onset - guard)
        rest, trim, requested = slice(max(before, end - n_trim), end), None, None
        if recipe.trim is None:
            rest = None
        elif isinstance(recipe.trim, str):
            trim = flown_trim
        else:
            n_wanted = round(min(recipe.trim / planned.dt, onset + 1))
            rest = slice(max(before, end - n_wanted), max(end, 1))
            requested = recipe.trim if rest.stop - rest.start < n_wanted else None
        first = max(before, onset - n_trim)
        about = onset, rest, trim, requested
        detected.append(Segment(f"manoeuvre {number}", first, stop - 1, *about))
        before = stop
    return tuple(detected)


def _check_number(n: int) -> None:
    if n > MOST_MANOEUVRES:
        raise TelemetryError(
            f"{n} manoeuvres exceed the {MOST_MANOEUVRES} that one scoring holds: split the "
            "recording, or mark fewer by hand"
        )


def _marked(
    recording: Recording, planned: PlannedTest, recipe: ScoringRecipe, interval: Interval
) -> Segment:
    """The samples within an interval, as a segment that starts with its rest."""
    t, dt = recording.t, planned.dt
    if interval.start < t[0] - 0.5 * dt or interval.end > t[-1] + 0.5 * dt:
        raise TelemetryError(
            f"the manoeuvre {in_words(interval)} is not inside the recording, which lasts from "
            f"{t[0]:.10g} to {t[-1]:.10g} s; give times within it"
        )
    near = ON_GRID * dt
    first, stop = np.searchsorted(t, (interval.start - near, interval.end + near)).tolist()
    if stop - first < 2:
        raise TelemetryError(
            f"the manoeuvre {in_words(interval)} holds fewer than two samples of the monitor's "
            f"{dt:g} s; give a longer one"
        )
    rest = None
    if recipe.trim is not None:
        seconds = planned.trim_segment_s if isinstance(recipe.trim, str) else recipe.trim
        length = (stop - first - 1) * dt
        if seconds > length + near and seconds == recipe.trim:
            raise TelemetryError(
                f"a trim segment of {seconds:g} s is longer than {interval.name} ({length:.4g} s); "
                "give a shorter one"
            )
        rest = slice(first, min(first + max(1, round(seconds / dt)), stop))
    return Segment(interval.name, first, stop - 1, None, rest)


def by_monitor(
    flight: RecordedFlight,
    members: Sequence[RecordedFlight],
    in_use: MonitorsInUse,
    selected: Sequence[Segment],
) -> tuple[list[tuple[RecordedFlight, Segment]], list[str]]:
    """The segments in parts, each with the monitor in use as in flight; and notes on the others.

    Where none is in use, the limits are checked alone, by the first monitor's channels.
    """
    t, y, timeline = flight.recording.t, flight.recording.y, flight.timeline
    assert timeline is not None
    index = timeline.index(t)
    edges = [*np.flatnonzero(np.diff(index, prepend=-1)).tolist(), len(t)]
    controls = np.abs(y[:, flight.planned.controls])
    has_moved = np.maximum.accumulate(~(controls <= in_use.departure()).all(axis=1))
    parts, unused = list[tuple[RecordedFlight, Segment]](), list[str]()
    for segment in selected:
        trim = segment.trim_of(y, flight.monitor.dictionary)
        begin = segment.first if segment.onset is None else segment.onset
        n_before = len(parts)
        if segment.is_rest:
            parts.append((members[0], segment))
            continue
        for first, stop in pairwise(edges):
            ruling = timeline.rulings[index[first]]
            start, last = max(begin, first), min(segment.last, stop - 1)
            if start > last or not isinstance(ruling, MonitorRuling):
                continue
            if ruling.used is None:
                times = f"{t[start]:.2f} to {t[last]:.2f} s"
                why, name = f"no monitor in use, {ruling.reason}", f"{segment.name}, no monitor"
                unused.append(f"{segment.name}, {times}: {why}.")
                begins = segment.first if start == begin else start
                part = Segment(name, begins, last, None, None, trim, unused=why)
                parts.append((members[0], part._replace(part=len(parts) - n_before)))
                continue
            part = segment._replace(last=last, trim=trim, since=first)
            if start > begin:
                is_moving = segment.onset is not None or bool(has_moved[start])
                monitor = in_use.monitor(ruling.used)
                why = needs_beginning(monitor, ruling.case, float(t[start])) if is_moving else ""
                part = Segment(segment.name, start, last, None, None, trim, None, start, why)
                part = part._replace(ends_early=segment.ends_early)
            if last < segment.last:
                what = f"{ruling.case} holds until {t[last]:.2f} s,"
                part = part._replace(ends_early=_cut(what, segment, last, t, flight.planned))
            name = f"{segment.name}, {ruling.case}"
            part = part._replace(name=name, part=len(parts) - n_before)
            parts.append((members[ruling.used], part))
    if all(part.unused for _, part in parts):
        needed = " and ".join(in_use.monitors.needed)
        unused.append(f"Declare {needed} as a condition, or map a signal to it.")
    return parts, unused


def manoeuvres_in(monitor: Monitor, recorded: RepairedTraces) -> tuple[Interval, ...]:
    """The manoeuvres that scoring would detect; may be empty."""
    flight = RecordedFlight.of(monitor, recorded)
    t = flight.recording.t
    return tuple(
        Interval(float(t[segment.first]), float(t[segment.last]), segment.name)
        for segment in detected_segments(flight.planned, ScoringRecipe(), flight.manoeuvres)
    )
