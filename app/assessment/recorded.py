"""A recording as its monitor sees it in flight: its samples on the grid, rest and manoeuvres.

A recording is a source whose samples have all arrived: that of a live flight in the order and at
the times of their arrival, an uploaded file in the order of time.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, nan
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from app.assessment.grid import (
    DELAY_INTERVALS,
    Arrivals,
    CausalGrid,
    GridRows,
    joined,
    missing_after,
)
from app.assessment.input_checks import FrozenPart, frozen_parts
from app.assessment.lag import Lag
from app.assessment.limits_history import (
    InForceTimeline,
    LimitsHistory,
    SetHistory,
    limits_over_time,
)
from app.assessment.outcome import Hole, RecordedExceedance, holes_in, warned_at
from app.assessment.planned_test import PlannedTest, needed_channels, planned_test
from app.assessment.scored import BETWEEN
from app.assessment.trim import CausalTrim, FollowedManoeuvre, TrimSteps
from app.telemetry.contents import release
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.recording import ATTITUDE, Recording, TelemetryError, Trace, Traces
from app.telemetry.targets import largest_plausible, without
from app.telemetry.timing.quality import Quality
from app.telemetry.timing.repair import FlownOrder, RepairedTraces
from app.telemetry.units import convert
from core.channels import LATERAL, Channel, Dictionary
from core.computed import fill
from core.kernels.causal_grid import FASTER, ON_GRID, RATE_RATIO, values_at
from core.limits.exceedance import SAME_TIME
from core.monitor import Monitor, State
from core.monitor.assessment import STATES
from core.types import Array, Flags, Indices

CONDITION = ("V", "h")
MISSING = {"state": STATES.index(State.INVALID), "alert": False, "manoeuvre": BETWEEN}
"""Fields of a time without a sample; the others are NaN."""
RECEIVED_NEAR = 2.0
"""A received sample is judged before those of the grid up to this many intervals earlier."""
SPARSE = 1.5
"""A channel whose usual step is this many times that of its rows has its own clock."""
BLOCK = 65_536
"""Values that are checked at once."""
MOST_SAMPLES = 10_000_000
"""More than any flight needs; only a clock that jumps exceeds this."""


class MissingChannels(TelemetryError):
    """Channels a monitor needs and a recording lacks; the message offers derivations.

    recorded: keys of TARGETS in the recording.
    """

    def __init__(
        self, keys: list[str], recorded: Collection[str] = (), empty: Collection[Trace] = ()
    ) -> None:
        """empty: channels among them that are mapped, but of which no sample has a value."""
        self.keys = tuple(keys)
        ways = [
            f"{way.target} from {' and '.join(way.needs)}"
            for way in DERIVATIONS.values()
            if way.target in keys and all(key in recorded for key in way.needs)
        ]
        derive = f"derive {', '.join(ways)}, " if ways else ""
        why = "; ".join(
            f"{trace.source} has no value"
            + f", since {trace.why_missing}" * bool(trace.why_missing)
            for trace in empty
        )
        super().__init__(
            f"the monitor needs {', '.join(keys)}, which the recording does not have"
            f"{f' ({why})' if why else ''}: map {'other ' if why else ''}signals "
            f"to the missing channels, {derive}or choose a monitor that does not need them or "
            "train one for these channels"
        )


class OnGrid(NamedTuple):
    """A recording on a grid.

    judged: every received sample, by flight time, to judge the limits.
    begun: for each manoeuvre begun by hand, the row that it begins with.
    shown: (n,) when each row of a live flight was shown [s]; None for others.
    delay: of a live flight, subtracted from the lead of the monitor [s].
    frozen: channels of a live flight.
    """

    recording: Recording
    judged: Traces
    begun: tuple[int, ...] = ()
    shown: Array | None = None
    delay: float = 0.0
    frozen: tuple[FrozenPart, ...] = ()


@dataclass(frozen=True, eq=False)
class RecordedFlight:
    """A recording and the monitor that scores it.

    traces: repaired.   grid: of the monitor.   needed: (n_channels,) channels the monitor needs.
    timeline: limits in force over time; None where no limit set was in force.
    use: in the training of the monitor; empty for none.   members: of the monitor set that scores
    it, one by one as if alone; empty for one monitor.
    """

    monitor: Monitor
    planned: PlannedTest
    traces: Traces
    quality: Quality
    grid: OnGrid
    needed: Flags
    notes: tuple[str, ...]
    timeline: InForceTimeline | None = None
    use: str = ""
    members: tuple[Monitor, ...] = ()

    @property
    def recording(self) -> Recording:
        return self.grid.recording

    @property
    def judged(self) -> Traces:
        return self.grid.judged

    @property
    def promised(self) -> float:
        """Lead time in effect [s], as in flight."""
        return self.monitor.lead - self.grid.delay

    def warned(
        self, exceedance: RecordedExceedance | None, alerts: Sequence[tuple[float, float]]
    ) -> tuple[tuple[float, float], ...]:
        """Alerts (first and last time [s]) from when they warned of an exceedance, as in flight."""
        shown = self.grid.shown
        if shown is None or exceedance is None or exceedance.arrived is None:
            return tuple(alerts)
        t, lag = exceedance.t, Lag(self.promised)
        n = np.searchsorted(shown, exceedance.arrived, "right")
        for row, at in zip(self.recording.t[:n].tolist(), shown[:n].tolist(), strict=True):
            lag.note(at, row)
        arrived = lag.due(t, exceedance.arrived)
        rows = np.searchsorted(self.recording.t, [begin for begin, _ in alerts])
        return tuple(
            sorted(
                (begin if begin > t else warned_at(begin, at, t, arrived), end)
                for (begin, end), at in zip(alerts, shown[rows].tolist(), strict=True)
            )
        )

    def holes(self, keys: Iterable[str], start: float, end: float) -> list[Hole]:
        """Where channels have no sample between two times [s]: of a live flight, none was shown.

        Its samples that came too late to be shown are missing, as they were to its crew.
        """
        is_shown, keys_of_y = self.grid.shown is not None, self.monitor.dictionary.keys
        holes = list[Hole]()
        for key in keys:
            if is_shown:
                t, values = self.recording.t, self.recording.y[:, keys_of_y.index(key)]
            elif (trace := self.judged.channels.get(key)) is None:
                continue
            else:
                t, values = trace.t, trace.values
            part = slice(*np.searchsorted(t, (start - SAME_TIME, end + SAME_TIME)).tolist())
            holes += holes_in(key, t[part][np.isfinite(values[part])], start, end)
        return holes

    def is_before(self, row: int, exceedance: RecordedExceedance) -> bool:
        """Whether a sample was shown before an exceedance was judged."""
        t, shown = float(self.recording.t[row]), self.grid.shown
        if shown is None or exceedance.arrived is None:
            return t < exceedance.t - SAME_TIME
        if (when := float(shown[row])) == exceedance.arrived:  # of one batch
            return t + RECEIVED_NEAR * self.monitor.dt < exceedance.t
        return when < exceedance.arrived

    @property
    def manoeuvres(self) -> list[FollowedManoeuvre]:
        """As followed in flight."""
        return self._followed[0]

    @property
    def trims(self) -> TrimSteps:
        """As followed in flight, also between the manoeuvres."""
        return self._followed[1]

    @cached_property
    def _followed(self) -> tuple[list[FollowedManoeuvre], TrimSteps]:
        t, y = self.recording.t, self.recording.y
        in_force = None if self.timeline is None else self.timeline.changes(t)
        levels = np.empty(y.shape)
        trim = CausalTrim.of(*(self.members or (self.monitor,)))
        manoeuvres = trim.follow(y, self.grid.begun, in_force, levels)
        return manoeuvres, TrimSteps.of_samples(t, levels)

    @cached_property
    def place(self) -> Indices:
        """(n,) place of each sample in a table that also has the times without a sample."""
        missing = np.cumsum(missing_after(self.recording.t, self.monitor.dt))
        return np.arange(len(missing)) + np.concatenate([[0], missing[:-1]])

    def spread(self, samples: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
        """A table of samples with a row for each time without one, which is INVALID."""
        place, n = self.place, len(samples)
        if place[-1] == n - 1:
            return samples
        table = np.empty(place[-1] + 1, samples.dtype)
        after = np.searchsorted(place, np.arange(len(table)))
        for name in samples.dtype.names or ():
            table[name] = MISSING.get(name, np.nan)
        table["t"] = self.recording.t[after] - (place[after] - np.arange(len(table))) * (
            self.monitor.dt
        )
        same = samples["manoeuvre"][after] == samples["manoeuvre"][np.maximum(after - 1, 0)]
        table["trim"] = samples["trim"][np.maximum(after - 1, 0)]
        table["manoeuvre"] = np.where(same, samples["manoeuvre"][after], BETWEEN)
        table[place] = samples
        return table

    @classmethod
    def of(
        cls,
        monitor: Monitor,
        repaired: RepairedTraces,
        history: LimitsHistory | SetHistory | None = None,
    ) -> Self:
        """Raises MissingChannels, or TelemetryError for a channel that is too slow."""
        repaired = in_units(repaired, monitor.dictionary)
        quality, planned = repaired.quality, planned_test(monitor)
        members = tuple(history.in_use.members) if isinstance(history, SetHistory) else ()
        each_needed = [needed_channels(each) for each in members or (monitor,)]
        needed, dictionary = np.logical_or.reduce(each_needed), monitor.dictionary
        recorded = [c.key for c in quality.channels if c.missing < 1.0 or c.implausible]
        absent = [key for key in dictionary.measured if key not in recorded]
        read = dictionary.sources([dictionary.keys[c] for c in np.flatnonzero(needed)])
        if lacking := [key for key in absent if key in read]:
            mapped = repaired.traces.channels
            empty = [mapped[key] for key in lacking if key in mapped]
            raise MissingChannels(lacking, recorded, empty)
        grid = on_grid(repaired, monitor.dt, read, dictionary)
        notes = list(grid.recording.notes)
        timeline = limits_over_time(history, [monitor])
        if timeline is not None:
            notes += timeline.notes
        if history is not None and timeline is None:
            notes.append(
                f"A limit set was in force in the flight. Limit sets know only "
                f"{', '.join(LATERAL.keys)}, so the monitor's own limits apply."
            )
        if absent:
            notes.append(f"Not recorded and not read by the monitor: {', '.join(absent)}.")
        return cls(
            monitor,
            planned,
            repaired.traces,
            quality,
            grid,
            needed,
            tuple(notes),
            timeline,
            members=members,
        )

    def by(self, monitor: Monitor) -> Self:
        """The same recording as one monitor of the set sees it."""
        about = planned_test(monitor), needed_channels(monitor)
        return replace(self, monitor=monitor, planned=about[0], needed=about[1])


def sizes_of(traces: Traces, dictionary: Dictionary) -> tuple[float, ...]:
    """Duration and size of the measured channels, see `is_same_flight`."""
    sizes, begin, end = list[float](), inf, -inf
    for key in dictionary.measured:
        trace = traces.channels.get(key)
        known = np.flatnonzero(np.isfinite(trace.values)) if trace else np.empty(0, int)
        if trace is None or not len(known):
            sizes += [nan, nan]
            continue
        begin, end = min(begin, float(trace.t[known[0]])), max(end, float(trace.t[known[-1]]))
        values = trace.values[known]
        sizes += [float(values.std()), float(np.ptp(values))]
    return (end - begin, *sizes)


def in_units(repaired: RepairedTraces, dictionary: Dictionary) -> RepairedTraces:
    """The channels of a dictionary in its units, as a live flight reads them.

    Values beyond the largest plausible one of a channel are missing. The same object if nothing
    changes.   TelemetryError for a channel that was recorded in a unit of another kind.
    """
    if dictionary == LATERAL:
        return repaired
    traces = _in_units(repaired.traces, dictionary)
    if traces is repaired.traces:
        return repaired
    flown = repaired.flown
    if flown is not None:
        flown = replace(flown, traces=_in_units(flown.traces, dictionary))
    return replace(repaired, traces=traces, flown=flown)


def _in_units(traces: Traces, dictionary: Dictionary) -> Traces:
    changed = {}
    for channel in dictionary.channels:
        if (trace := traces.channels.get(channel.key)) is None:
            continue
        read = trace if trace.unit in ("", channel.unit) else _converted(trace, channel)
        beyond = np.flatnonzero(np.abs(read.values) > largest_plausible(channel))
        read = without(read, beyond)
        if read is not trace:
            changed[channel.key] = read
    return replace(traces, channels=traces.channels | changed) if changed else traces


def _converted(trace: Trace, channel: Channel) -> Trace:
    try:
        values = convert(trace.values, trace.unit, channel.unit)
        sent = None if trace.sent is None else convert(trace.sent, trace.unit, channel.unit)
        shift, bias = convert(np.array([0.0, trace.bias]), trace.unit, channel.unit).tolist()
    except TelemetryError as error:
        raise TelemetryError(
            f"channel {channel.key} of the recording: {error}: map it to another signal"
        ) from None
    return replace(trace, values=values, bias=bias - shift, unit=channel.unit, sent=sent)


def on_grid(
    repaired: RepairedTraces,
    dt: float,
    needed: Collection[str],
    dictionary: Dictionary = LATERAL,
) -> OnGrid:
    """The channels of a recording on a grid of dt [s], each sample by those received by then.

    needed: channels with a step of at most 1.5 dt; others may be slower, for display.
    Raises TelemetryError for a needed channel that is too slow, if the needed channels have fewer
    than two common samples, and for a recording of more than MOST_SAMPLES dt.
    """
    flown, read = repaired.flown, (*dictionary.keys, *ATTITUDE)
    if flown is None:
        received, notes = _by_time(repaired.traces, dt, needed, read)
        begun, delay = (), None
    else:
        received, notes = _by_arrival(flown, read), ()
        begun, delay = flown.begun, flown.delay
    computed = _computed(received, dictionary)
    delay = DELAY_INTERVALS * dt if delay is None else delay
    grid = CausalGrid(dt, delay, len(dictionary))
    parts, times, rows_begun = [], [], list[int]()
    edges = [n for _, n in begun]
    for first, stop, arrival in zip(
        (0, *edges), (*edges, len(received.t)), (*(a for a, _ in begun), None), strict=True
    ):
        rows, flight_t = grid.receive(Arrivals(*(part[first:stop] for part in received)))
        parts.append(rows)
        times.append(flight_t)
        if arrival is not None:
            parts.append(grid.settle(arrival))
            rows_begun.append(sum(len(part.t) for part in parts))
    parts.append(grid.settle(inf if flown is None or flown.ended is None else flown.ended))
    rows = joined(parts)
    if len(rows.t) < 2:
        raise TelemetryError(
            "the recording has fewer than two samples of the monitor's interval: give one that is "
            "longer"
        )
    traces = replace(repaired.traces, channels=repaired.traces.channels | computed)
    ahead = float((rows.shown - rows.t).max()) if flown is None else 0.0
    recording = _recording(rows, traces, (*traces.notes, *notes), ahead)
    if flown is None:
        return OnGrid(recording, traces)
    flight_t = np.concatenate(times)
    received_traces = replace(flown.traces, channels=flown.traces.channels | computed)
    judged = _by_flight_time(received_traces, flight_t, flown.arrived)
    frozen = frozen_parts(dictionary, flight_t, received.values[:, : len(dictionary)])
    return OnGrid(recording, judged, tuple(rows_begun), rows.shown, delay, frozen)


def _recording(
    rows: GridRows, traces: Traces, notes: tuple[str, ...], look_ahead: float
) -> Recording:
    known = {key: trace for key, trace in traces.channels.items() if _has_value(trace.values)}
    return Recording(
        t=rows.t,
        y=np.ascontiguousarray(rows.values[:, : -len(ATTITUDE)]),
        attitude={
            key: rows.values[:, column - len(ATTITUDE)].copy()
            for column, key in enumerate(ATTITUDE)
            if key in known
        },
        condition={key: _between(rows.t, known[key]) for key in CONDITION if key in known},
        derived=frozenset(key for key, trace in known.items() if trace.derived),
        notes=notes,
        look_ahead=look_ahead,
    )


def _by_arrival(flown: FlownOrder, read: Sequence[str]) -> Arrivals:
    values = np.full((len(flown.arrived), len(read)), np.nan)
    t = next(iter(flown.traces.channels.values())).t
    for column, key in enumerate(read):
        if key in flown.traces.channels:
            values[:, column] = flown.traces.channels[key].values
    return Arrivals(np.ascontiguousarray(flown.arrived), np.ascontiguousarray(t), values)


def _computed(received: Arrivals, dictionary: Dictionary) -> dict[str, Trace]:
    """The computed channels of received samples, which it fills in."""
    fill(dictionary, received.t, received.values)
    channels = [(c, dictionary.channels[c]) for c, _ in dictionary.formulas]
    return {
        channel.key: Trace(
            received.t,
            received.values[:, c].copy(),
            source=f"computed: {channel.formula}",
            unit=channel.unit,
        )
        for c, channel in channels
    }


def _by_flight_time(traces: Traces, flight_t: Array, arrived: Array) -> Traces:
    order = np.argsort(flight_t, kind="stable")
    t = flight_t[order]
    channels = {
        key: replace(
            trace,
            t=t,
            values=trace.values[order],
            sent=None if trace.sent is None else trace.sent[order],
        )
        for key, trace in traces.channels.items()
    }
    return Traces(channels, traces.notes, arrived[order])


def _by_time(
    traces: Traces, dt: float, needed: Collection[str], read: Sequence[str]
) -> tuple[Arrivals, tuple[str, ...]]:
    """The samples of a file, in order of time, on the clock of the slowest needed channel."""
    clocks = {
        key: _clock(trace)
        for key, trace in traces.channels.items()
        if key in read and _has_value(trace.values)
    }
    of_needed = {key: clocks[key] for key in read if key in needed and key in clocks}
    if not of_needed:
        raise TelemetryError(
            "none of the channels that the monitor needs has values: map them to signals that "
            "were recorded"
        )
    steps = {key: _usual_step(t) for key, (t, _) in clocks.items()}
    slowest = max(of_needed, key=steps.__getitem__)
    if steps[slowest] > (RATE_RATIO + ON_GRID) * dt:
        raise TelemetryError(
            f"{slowest} has a value every {steps[slowest]:.4g} s, but a monitor with a step of "
            f"{dt:.4g} s needs one at least every {RATE_RATIO * dt:.4g} s: "
            f"record faster or train a monitor with dt={steps[slowest]:.4g}"
        )
    at = of_needed[slowest][0]
    first, stop = _common(of_needed, at, dt)
    at = at[first:stop]
    values, others = np.full((len(at), len(read)), np.nan), list[str]()
    for column, key in enumerate(read):
        if key not in clocks:
            continue
        t, x = clocks[key]
        if t is of_needed[slowest][0] or np.array_equal(t, of_needed[slowest][0]):
            values[:, column] = x[first:stop]
        else:
            others.append(key)
            x = np.unwrap(x) if key in ATTITUDE else np.ascontiguousarray(x)
            values[:, column] = values_at(at, t, x, steps[slowest], steps[key])
        release(traces.channels[key].values)
    notes = (
        f"{', '.join(others)}: put on the clock of {slowest} ({1.0 / steps[slowest]:.4g} Hz)."
        if others
        else "",
        _rate_note(steps[slowest], dt),
    )
    return Arrivals(np.ascontiguousarray(at), at, values), tuple(filter(None, notes))


def _rate_note(step: float, dt: float) -> str:
    if step <= FASTER * dt:
        return (
            f"Averaged from {1.0 / step:.4g} Hz to {1.0 / dt:.4g} Hz over {dt:.4g} s to either "
            "side, as in flight."
        )
    if abs(step - dt) > ON_GRID * dt:
        return f"Interpolated from {1.0 / step:.4g} Hz to {1.0 / dt:.4g} Hz, as in flight."
    return ""


def _clock(trace: Trace) -> tuple[Array, Array]:
    """Times and values; only the known ones of a channel that is slower than its rows."""
    known = np.isfinite(trace.values)
    if not known.all() and _usual_step(trace.t[known]) > SPARSE * _usual_step(trace.t):
        return trace.t[known], trace.values[known]
    return trace.t, trace.values


def _usual_step(t: Array) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0


def _common(clocks: dict[str, tuple[Array, Array]], at: Array, dt: float) -> tuple[int, int]:
    """The samples of a clock while all channels were being recorded. TelemetryError."""
    late = max(clocks, key=lambda key: clocks[key][0][0])
    early = min(clocks, key=lambda key: clocks[key][0][-1])
    begin, end = float(clocks[late][0][0]), float(clocks[early][0][-1])
    near = max(ON_GRID * dt, 2.0 * float(np.spacing(max(abs(begin), abs(end)))))
    first, stop = np.searchsorted(at, (begin - near, end + near)).tolist()
    if stop - first < 2:
        raise TelemetryError(
            f"{late} starts at {begin:.10g} s and {early} ends at {end:.10g} s, so they have less "
            f"than one step of {dt:.4g} s in common: give a recording in which all channels of the "
            "monitor were recorded together, on one clock"
        )
    span = float(at[stop - 1] - at[first])
    if span > MOST_SAMPLES * dt:
        jump = int(np.diff(at).argmax())
        raise TelemetryError(
            f"the recording spans {span:.6g} s, which is {span / dt:.3g} steps of {dt:.4g} s, more "
            f"than {MOST_SAMPLES:.3g}; its largest step is {at[jump + 1] - at[jump]:.6g} s after "
            f"t={at[jump]:.10g} s: split the file where its clock jumps"
        )
    return first, stop


def _between(t: Array, trace: Trace) -> Array:
    """A channel for information, interpolated at times [s]."""
    known = np.isfinite(trace.values)
    return np.interp(t, trace.t[known], trace.values[known], left=np.nan, right=np.nan)


def _has_value(values: Array) -> bool:
    """Whether any value is finite; usually the first block shows it."""
    blocks = (values[first : first + BLOCK] for first in range(0, len(values), BLOCK))
    return any(np.isfinite(block).any() for block in blocks)
