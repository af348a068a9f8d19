"""Read and write the sample rate of a table without times, such as "50 Hz from 12:31:05"."""

import re
from collections.abc import Iterable

from app.telemetry.mapping.mapping import LEAST_RATE_HZ, MOST_RATE_HZ, TimeSource
from app.telemetry.recording import TelemetryError

DAY_S = 86_400.0
EXAMPLE = "50 Hz, or 50 Hz from 12:31:05"
RATE = re.compile(
    r"(?P<rate>\d+(?:[.,]\d*)?) *(?:hz|1/s|samples/s)?"
    r"(?: +from +(?:(?:(?P<hour>\d{1,2}):)?(?P<minute>[0-5]?\d):)?"
    r"(?P<second>\d+(?:[.,]\d*)?) *(?:s|z|utc)?)?",
    re.IGNORECASE,
)


def read_rate(text: str) -> TimeSource:
    """Read a rate and an optional start: a time of day, or a number of seconds.

    Raises TelemetryError for any other text.
    """
    match = RATE.fullmatch(text.strip())
    if match is None:
        raise TelemetryError(f"{text!r} is not a sample rate: write {EXAMPLE}")
    hours, minutes = int(match["hour"] or 0), int(match["minute"] or 0)
    seconds = _number(match["second"] or "0")
    if match["minute"] and (hours > 23 or seconds >= 60.0):
        raise TelemetryError(f"{text!r} starts at an invalid time of day: write {EXAMPLE}")
    start = 3600.0 * hours + 60.0 * minutes + seconds
    if not _number(match["rate"]):
        raise TelemetryError(
            f"{text!r} is a rate of zero: give a rate of {LEAST_RATE_HZ:g} to {MOST_RATE_HZ:g} Hz, "
            f"such as {EXAMPLE}"
        )
    source = TimeSource(rate=_number(match["rate"]), start=start)
    if problem := source.problem():
        raise TelemetryError(f"{text!r} {problem}")
    return source


def rate_words(source: TimeSource) -> str:
    """A rate in the form that `read_rate` reads; a start of 60 s or more is a time of day."""
    rate = f"{source.rate:.10g} Hz"
    if not source.start:
        return rate
    if not _is_time_of_day(source.start):
        return f"{rate} from {source.start:.10g} s"
    hours_and_minutes, seconds = time_of_day(source.start, 6).rsplit(":", 1)
    return f"{rate} from {hours_and_minutes}:{seconds.rstrip('0').rstrip('.')}"


def counts_the_day(times: Iterable[TimeSource]) -> bool:
    """Whether times are seconds of the day: all are rates with a start at a time of day."""
    sources = list(times)
    return bool(sources) and all(each.rate and _is_time_of_day(each.start) for each in sources)


def time_of_day(t: float, decimals: int = 2) -> str:
    """Seconds of the day as `12:31:13.76`; midnight starts again at zero."""
    minutes, seconds = divmod(round(t, decimals) % DAY_S, 60.0)
    return f"{minutes // 60:02.0f}:{minutes % 60:02.0f}:{seconds:0{3 + decimals}.{decimals}f}"


def _is_time_of_day(start: float) -> bool:
    return 60.0 <= start < DAY_S


def _number(text: str) -> float:
    return float(text.replace(",", "."))
