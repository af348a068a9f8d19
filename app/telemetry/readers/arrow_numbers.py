"""Arrow's columns as numbers: what has no value is NaN, what is time is in seconds."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from app.telemetry.recording import Array

PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
NANOSECONDS = 10**9


def not_numbers(kind: pa.DataType) -> str:
    """Why a column of a type is no signal, "" where it is one."""
    if pa.types.is_dictionary(kind):
        return not_numbers(kind.value_type)
    if pa.types.is_nested(kind):
        return "nested"
    if pa.types.is_null(kind):
        return "no value"
    if pa.types.is_boolean(kind) or pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return ""
    if pa.types.is_decimal(kind) or is_moment(kind) or is_span(kind):
        return ""
    return "dates" if pa.types.is_date(kind) else "text"


def is_moment(kind: pa.DataType) -> bool:
    """Whether values are moments in history."""
    return pa.types.is_timestamp(kind)


def is_span(kind: pa.DataType) -> bool:
    """Whether values are lengths of time, or times of a day."""
    return pa.types.is_duration(kind) or pa.types.is_time(kind)


@dataclass(eq=False)
class Moments:
    """Timestamps as seconds from the first one of the file that is met [ns from 1970]."""

    first: int | None = None
    zoned: bool = False

    @property
    def start(self) -> str:
        """The first moment in ISO 8601, in UTC where the file names a zone; "" if there is none."""
        if self.first is None:
            return ""
        text = str(np.datetime64(self.first, "ns"))
        return text.rstrip("0").rstrip(".") + ("Z" if self.zoned else "")

    def numbers(self, column: pa.Array) -> Array:
        """Return values as floating-point numbers, NaN where missing."""
        if pa.types.is_dictionary(column.type):
            column = column.dictionary_decode()
        kind = column.type
        if not (is_moment(kind) or is_span(kind)):
            return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        missing = column.is_null().to_numpy(zero_copy_only=False)
        whole = column.cast(pa.int32()) if pa.types.is_time32(kind) else column
        counts = whole.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False)
        rate = PER_SECOND[kind.unit]
        seconds = (
            self._since_first(counts, missing, kind, rate) if is_moment(kind) else counts / rate
        )
        return np.where(missing, np.nan, seconds)

    def _since_first(
        self, counts: np.ndarray, missing: np.ndarray, kind: pa.TimestampType, rate: int
    ) -> Array:
        """Subtract as integers: a count of nanoseconds from 1970 is too long for a float."""
        if missing.all():
            return np.zeros(len(counts))
        if self.first is None:
            self.first = int(counts[~missing][0]) * (NANOSECONDS // rate)
            self.zoned = kind.tz is not None
        first, rest = divmod(self.first, NANOSECONDS // rate)
        return (counts - first) / rate - rest / NANOSECONDS
