"""Journals of live flights: JSON lines, first what the flight is, then each batch as it came.

    {"format": 1, "flight": id, "began": UTC, "mapping": {...}, "a": 0.0}
    {"v": "rest", "s": 7, "b": {"t": [0.02], "beta": [0.01]}, "a": 0.031}

Rows are in the order of their arrival, whose time is a signal of its own (`a` of each line).
"""

from collections import Counter
from datetime import UTC, datetime, timedelta
from math import inf
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import listed
from app.telemetry.readers.text_tables.rows import BadRows
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.units import convert
from core.limit_set import CONDITION_KEYS

TIMES = ("t", "timestamp", "time")
"""Names of the time where no mapping says which it is [s]."""
ARRIVED = "arrived"
BLOCK_ROWS = 1 << 15
LONGEST_LINE = 64 * 2**20
NAN = float("nan")
_decoder = msgspec.json.Decoder()


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a journal: a signal by each name that was sent, and the time of arrival.

    A torn last line is left out; so are lines that are damaged, up to the writer's share of them.
    """
    bad, notes, n_good, number = BadRows(writer.bad_share), list[str](), 0, 1
    with path.open("rb") as file:
        header = _plain(_line(file))
        if header is None:
            raise TelemetryError("its first line is damaged: export the journal again")
        conditions, limits = _conditions(header), list[dict[str, Any]]()
        rows = _Rows(writer, *_declared(header), frozenset(conditions.values()))
        while line := _line(file):
            number += 1
            if not line.endswith(b"\n"):
                notes.append("The last line was torn and is left out: it was never acknowledged.")
                break
            plain = _plain(line)
            if plain is not None and "b" not in plain:
                limits += [plain["limits"]] if isinstance(plain.get("limits"), dict) else []
                continue
            if plain is not None and rows.add(plain):
                n_good += 1
            else:
                bad.add(number, "no batch", line[:200].decode("utf-8", "replace"))
    bad.check(n_good)
    ignored = rows.finish()
    notes.append(f"The live flight began {header.get('began')}: {ARRIVED} counts from then.")
    return writer.finish(
        "journal",
        start=_time_zero(header, rows.zero),
        bad_rows=tuple(bad.listed),
        n_bad_rows=bad.n,
        ignored=listed(ignored),
        notes=(*notes, *bad.notes(n_good)),
        limits=tuple(limits),
        conditions=conditions,
    )


def _declared(header: dict[str, Any]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Names that the time may have, and units by name, as the flight read them. TelemetryError."""
    if "mapping" not in header:
        return TIMES, {}
    mapping = header["mapping"]
    if mapping is None:
        return TIMES, dict.fromkeys(TIMES, "s") | {key: TARGETS[key].unit for key in TARGETS}
    try:
        times = {time["signal"]: str(time["unit"]) for time in mapping["times"].values()}
        read = {one["signal"]: str(one["unit"]) for one in mapping["channels"].values()}
        return tuple(times), read | times
    except (AttributeError, KeyError, TypeError):
        raise TelemetryError("the journal's mapping is damaged: export it again") from None


def _time_zero(header: dict[str, Any], zero: float) -> str:
    """When the source's time was zero, in ISO 8601. zero: [s] since the flight began."""
    try:
        began = datetime.fromisoformat(header["began"])
        return (began + timedelta(seconds=zero)).astimezone(UTC).isoformat(timespec="milliseconds")
    except (KeyError, TypeError, ValueError, OverflowError):
        return ""


def _conditions(header: dict[str, Any]) -> dict[str, str]:
    """Names of the signals of the flight condition, as the flight read them."""
    named = header.get("conditions")
    named = named if isinstance(named, dict) else {}
    own = {key: key for key in CONDITION_KEYS}
    return own | {key: name for key, name in named.items() if isinstance(name, str)}


def _line(file: BinaryIO) -> bytes:
    line = file.readline(LONGEST_LINE + 1)
    if len(line) > LONGEST_LINE:
        raise TelemetryError(f"a line is longer than {LONGEST_LINE // 2**20} MiB: it is no journal")
    return line


def _plain(line: bytes) -> dict[str, Any] | None:
    """The object of a line; None where it is none."""
    try:
        plain = _decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return plain if isinstance(plain, dict) else None


class _Rows:
    """Batches on their way to the writer. A signal begins with its first number.

    times: names that the time may have; that of the first batch is its name in all.
    conditions: names of which null says that the value is unknown, which infinity stands for; NaN
    where none came.
    """

    def __init__(
        self,
        writer: ColumnWriter,
        times: tuple[str, ...],
        units: dict[str, str],
        conditions: frozenset[str] = frozenset(),
    ) -> None:
        self._conditions = conditions
        self.zero = inf
        """when the source's time was zero [s] since the flight began, by what came quickest"""
        self._writer, self._times, self._units = writer, times, units
        self._group, self._time = writer.add_group(), ""
        self._signals: dict[str, int] = {}
        self._pending: dict[str, list[float]] = {}
        self._arrived: list[float] = []
        self._n_written, self._n = 0, 0
        self._no_numbers: dict[str, str] = {}
        self._n_unequal: Counter[str] = Counter()

    def add(self, line: dict[str, Any]) -> bool:
        """Take a batch; whether it is one."""
        values, arrived = line["b"], line.get("a")
        if isinstance(arrived, bool) or not isinstance(arrived, float | int):
            return False
        if not isinstance(values, dict):
            return False
        time = next((name for name in self._times if name in values), None)
        if time is None or not all(isinstance(column, list) for column in values.values()):
            return False
        if not self._time:
            self._time = time
            self._begin(time)
        n = len(values[time])
        self._note_zero(arrived, values[time])
        self._take(self._time, values.pop(time), n)
        for name, column in values.items():
            self._take(name, column, n)
        self._arrived += [_number(arrived)] * n
        self._n += n
        if self._n >= BLOCK_ROWS:
            self._flush()
        return True

    def _note_zero(self, arrived: float, times: list[Any]) -> None:
        newest = max(map(_number, times), default=NAN)
        seconds = convert(np.array([newest]), self._units.get(self._time) or "s", "s")
        self.zero = min(self.zero, arrived - float(seconds[0]))

    def finish(self) -> list[str]:
        """Write the rest; return what was left out."""
        self._flush()
        arrival = self._writer.add_signal(self._group, ARRIVED, "s", "time of arrival")
        for start in range(0, len(self._arrived), BLOCK_ROWS):
            self._writer.append(arrival, self._arrived[start : start + BLOCK_ROWS])
        without = [name for name in self._no_numbers if name not in self._signals]
        return [
            *(f"{name}: no number, but {self._no_numbers[name]}" for name in without),
            *(
                f"{name}: {n} batches with another number of values than of times"
                for name, n in self._n_unequal.items()
            ),
        ]

    def _take(self, name: str, column: list[Any], n: int) -> None:
        if len(column) != n:
            self._n_unequal[name] += 1
            return
        numbers = [v if type(v) is float else _number(v) for v in column]
        if name in self._conditions:
            numbers = [inf if v != v else v for v in numbers]
        if name not in self._signals:
            if all(v != v for v in numbers):
                self._no_numbers.setdefault(name, str(column[:1])[1:60])
                return
            self._begin(name)
        pending = self._pending[name]
        pending += [NAN] * (self._n - len(pending))
        pending += numbers

    def _begin(self, name: str) -> None:
        unit, is_time = self._units.get(name, ""), name == self._time
        signal = self._writer.add_signal(self._group, name, unit, time=is_time)
        self._signals[name], self._pending[name] = signal, []
        for start in range(0, self._n_written, BLOCK_ROWS):
            self._writer.append(signal, np.full(min(BLOCK_ROWS, self._n_written - start), NAN))

    def _flush(self) -> None:
        for name, pending in self._pending.items():
            padded = pending + [NAN] * (self._n - len(pending))
            self._writer.append(self._signals[name], padded)
            self._pending[name] = []
        self._n_written += self._n
        self._n = 0


def _number(value: Any) -> float:
    """The number that was sent; NaN for what is none."""
    try:
        return float(value) if isinstance(value, float | int) else NAN
    except OverflowError:
        return NAN
