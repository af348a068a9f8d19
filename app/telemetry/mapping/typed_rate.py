"""The rate of a table without a vector of times, as people write it: "50 Hz from 12:31:05"."""

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
    """Times by a rate, from a time of day as seconds of the day or from a number of seconds.

    TelemetryError where the text is not of that kind.
    """
    match = RATE.fullmatch(text.strip())
    if match is None:
        raise TelemetryError(f"{text!r} is no rate: write {EXAMPLE}")
    hours, minutes = int(match["hour"] or 0), int(match["minute"] or 0)
    seconds = _number(match["second"] or "0")
    if match["minute"] and (hours > 23 or seconds >= 60.0):
        raise TelemetryError(f"{text!r} begins at no time of day: write {EXAMPLE}")
    start = 3600.0 * hours + 60.0 * minutes + seconds
    if not _number(match["rate"]):
        raise TelemetryError(
            f"{text!r} has no samples: give a rate of {LEAST_RATE_HZ:g} to {MOST_RATE_HZ:g} Hz, "
            f"such as {EXAMPLE}"
        )
    source = TimeSource(rate=_number(match["rate"]), start=start)
    if problem := source.problem():
        raise TelemetryError(f"{text!r} {problem}")
    return source


def rate_words(source: TimeSource) -> str:
    """A rate as `read_rate` reads it; a start of a minute or more is a time of day."""
    rate = f"{source.rate:.10g} Hz"
    if not source.start:
        return rate
    if not _is_time_of_day(source.start):
        return f"{rate} from {source.start:.10g} s"
    hours_and_minutes, seconds = time_of_day(source.start, 6).rsplit(":", 1)
    return f"{rate} from {hours_and_minutes}:{seconds.rstrip('0').rstrip('.')}"


def counts_the_day(times: Iterable[TimeSource]) -> bool:
    """Whether times are seconds of the day: of rates that begin at a time of day, and no others."""
    sources = list(times)
    return bool(sources) and all(each.rate and _is_time_of_day(each.start) for each in sources)


def time_of_day(t: float, decimals: int = 2) -> str:
    """Seconds of the day as `12:31:13.76`, those after midnight of the next."""
    minutes, seconds = divmod(round(t, decimals) % DAY_S, 60.0)
    return f"{minutes // 60:02.0f}:{minutes % 60:02.0f}:{seconds:0{3 + decimals}.{decimals}f}"


def _is_time_of_day(start: float) -> bool:
    return 60.0 <= start < DAY_S


def _number(text: str) -> float:
    return float(text.replace(",", "."))
