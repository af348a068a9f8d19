"""Repair the times and values of a recording."""

from dataclasses import dataclass, replace

import numpy as np

from app.telemetry.contents import release
from app.telemetry.recording import Trace, Traces
from app.telemetry.targets import implausible, without
from app.telemetry.timing.clock_repair import on_one_clock, ordered, repair_clock
from app.telemetry.timing.quality import (
    ChannelQuality,
    ClockQuality,
    Fault,
    Quality,
    channel_quality,
    faults,
)
from core.types import Array


@dataclass(frozen=True, eq=False)
class FlownOrder:
    """The channels of a live flight as they arrived.

    traces: in order of arrival, on the clock of the source.   arrived: (n,) [s].
    delay: longest wait of a sample for others [s]; None for the usual one.   is_trimmed: whether
    the samples were already from trim.   begun: when manoeuvres began by hand, arrival [s] and rows
    before it.   calls: times of ABORT and KNOCK IT OFF [s].
    ended: when the flight ended [s]; None if its server was killed.
    """

    traces: Traces
    arrived: Array
    delay: float | None = None
    is_trimmed: bool = False
    begun: tuple[tuple[float, int], ...] = ()
    ended: float | None = None
    calls: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class RepairedTraces:
    """Channels with increasing, certain times and plausible values.

    quality: of the recording before repair.   flown: of a live flight, its channels as they
    arrived.
    """

    traces: Traces
    quality: Quality
    flown: FlownOrder | None = None


def repair(traces: Traces) -> RepairedTraces:
    """Repair the times of a recording and report the quality of times and channels.

    Channels that share their times still do afterwards; faultless times stay the same array.
    The steps, in this order:
    remove rows without a time;
    sort late rows, continue wraps, cut where clocks were set, see `clock_faults`;
    remove times that are ambiguous on one clock from all clocks, since a file has one clock;
    keep the first of rows with equal times, unless coarse rounding made them equal;
    restore even clocks whose times were rounded, see `rounded_clock`;
    replace infinite and implausible values by NaN. Notes list the repairs.

    Raises TelemetryError if more than a tenth of a clock's rows have no certain time.
    """
    by_clock: dict[int, dict[str, Trace]] = {}
    for key, trace in traces.channels.items():
        by_clock.setdefault(id(trace.t), {})[key] = trace
    recorded = [next(iter(sharing.values())).t for sharing in by_clock.values()]
    values = [
        {key: trace.values for key, trace in sharing.items()} for sharing in by_clock.values()
    ]
    clocks = on_one_clock([ordered(t, xs) for t, xs in zip(recorded, values, strict=True)])
    channels: dict[str, tuple[Trace, ChannelQuality]] = {}
    qualities: list[ClockQuality] = []
    marks: list[Fault] = []
    for t, xs, order in zip(recorded, values, clocks, strict=True):
        clock = repair_clock(t, xs, order)
        qualities.append(clock.quality)
        marks += clock.faults
        for key, x in clock.values.items():
            trace = replace(traces.channels[key], t=clock.t, values=x)
            trace, quality, of_channel = _plausible(key, trace, clock.quality.step)
            channels[key] = trace, quality
            marks += of_channel
            release(trace.values)
    in_order = {key: channels[key] for key in traces.channels}
    about = tuple(quality for _, quality in in_order.values())
    notes = [line for quality in (*qualities, *about) for line in quality.repairs()]
    repaired = Traces({k: trace for k, (trace, _) in in_order.items()}, (*traces.notes, *notes))
    return RepairedTraces(repaired, Quality(tuple(qualities), about, tuple(marks)))


def _plausible(
    key: str, trace: Trace, step: float
) -> tuple[Trace, ChannelQuality, tuple[Fault, ...]]:
    """A channel without implausible values, its quality and its faults."""
    t, x = trace.t, trace.values
    beyond = implausible(key, x, trace.unit)
    plausible = without(trace, beyond)
    quality, marks = channel_quality(key, t, plausible.values, step)
    if not len(beyond):
        return plausible, quality, marks
    largest = beyond[np.abs(x[beyond]).argmax()]
    quality = replace(
        quality,
        implausible=len(beyond),
        largest=float(x[largest]),
        largest_at=float(t[largest]),
    )
    at = t[beyond]
    return (
        plausible,
        quality,
        (
            *faults(f"implausible:{key}", at, at, float(t[-1] - t[0])),
            *marks,
        ),
    )
