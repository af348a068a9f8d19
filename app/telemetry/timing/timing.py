"""The times of a recording as a clock can have given them, and what had to be done for that."""

from dataclasses import replace

import numpy as np

from app.telemetry.plausibility import implausible, without
from app.telemetry.timing.channel_quality import channel_quality
from app.telemetry.timing.clock_repair import finished, on_one_clock, ordered
from app.telemetry.timing.quality import ChannelQuality, Quality, Span, spans
from app.telemetry.traces import Array, Trace, Traces

__all__ = ["Quality", "repaired"]


def repaired(traces: Traces) -> tuple[Traces, Quality]:
    """Channels whose times increase, with only what is certain; and how good they are.

    Channels that share their times share them afterwards, and times that nothing is wrong with
    stay the same array. In the order of the work:
    rows without a time are left out;
    late rows are sorted in, wraps counted on, and set clocks cut, as `clock_faults` tells them;
    a time at which one clock is in doubt is left out of all, since a file has one clock;
    of rows with equal times the first stays, unless coarse rounding made them equal;
    times that one rounding of an even clock explains go back onto it, as in `rounded_clock`;
    infinite values, and those that no aircraft shows, become NaN. The notes say what was done.

    Raises TelemetryError where more than a tenth of a clock's rows have no certain time.
    """
    clocks: dict[int, list[str]] = {}
    for key, trace in traces.channels.items():
        clocks.setdefault(id(trace.t), []).append(key)
    recorded = [traces.channels[keys[0]].t for keys in clocks.values()]
    values = [{key: traces.channels[key].values for key in keys} for keys in clocks.values()]
    in_order = on_one_clock([ordered(t, xs) for t, xs in zip(recorded, values, strict=True)])
    channels: dict[str, Trace] = {}
    qualities, about, marks = [], {}, []
    for clock in zip(recorded, values, in_order, strict=True):
        t, repaired_values, quality, found = finished(*clock)
        qualities.append(quality)
        marks += found
        for key, x in repaired_values.items():
            x, about[key], found = _judged(key, t, x, quality.step)
            channels[key] = replace(traces.channels[key], t=t, values=x)
            marks += found
    kept = [about[key] for key in traces.channels]
    notes = [line for quality in (*qualities, *kept) for line in quality.repairs()]
    return (
        Traces({key: channels[key] for key in traces.channels}, (*traces.notes, *notes)),
        Quality(tuple(qualities), tuple(kept), tuple(marks)),
    )


def _judged(
    key: str, t: Array, x: Array, step: float
) -> tuple[Array, ChannelQuality, tuple[Span, ...]]:
    """A channel with only what an aircraft can show, and what is to be said of it."""
    beyond = implausible(key, x)
    kept = without(x, beyond)
    quality, found = channel_quality(key, t, kept, step)
    if not len(beyond):
        return kept, quality, found
    largest = beyond[np.abs(x[beyond]).argmax()]
    quality = replace(
        quality,
        implausible=len(beyond),
        largest=float(x[largest]),
        largest_at=float(t[largest]),
    )
    marks = spans(f"implausible:{key}", t[beyond], t[beyond], float(t[-1] - t[0]))
    return kept, quality, (*marks, *found)
