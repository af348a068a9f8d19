"""Read journals of live flights: JSON lines, first the flight, then each received batch.

    {"format": 1, "flight": id, "began": UTC, "mapping": {...}, "a": 0.0}
    {"v": "rest", "s": 7, "b": {"t": [0.02], "beta": [0.01]}, "a": 0.031}

Rows are in the order of arrival; the time of arrival (`a` of each line) is a separate signal.
"""

from array import array
from collections import Counter
from datetime import UTC, datetime, timedelta
from math import inf, isfinite
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.units import convert
from core.conditions import CONDITION_KEYS

TIMES = ("t", "timestamp", "time")
"""Possible names of the time [s], if there is no mapping."""
ARRIVED = "arrived"
CALL = "call"
"""Event of a line that keeps an ABORT or KNOCK IT OFF; it settles no sample."""
NAN = float("nan")
_decoder = msgspec.json.Decoder()


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a journal: one signal per name, and the time of arrival.

    An incomplete last line is dropped; so are damaged lines, up to the writer's share.
    """
    bad, notes, n_good = writer.bad, list[str](), 0
    with path.open("rb") as file:
        header = _plain(file.readline())
        if header is None:
            raise TelemetryError("its first line is damaged: export the journal again")
        conditions, limits = _conditions(header), list[dict[str, Any]]()
        begun, calls, ended = list[list[float]](), list[float](), None
        rows = _Rows(*_declared(header), frozenset(conditions.values()))
        for number, line in enumerate(file, 2):
            if not line.endswith(b"\n"):
                notes.append("Dropped an incomplete last line, which was never acknowledged.")
                break
            plain = _plain(line)
            if plain is not None and "b" not in plain:
                limits += [plain["limits"]] if isinstance(plain.get("limits"), dict) else []
                arrived = _number(plain.get("a"))
                if plain.get("e") == "manoeuvre" and isfinite(arrived):
                    begun.append([arrived, rows.n])
                if plain.get("e") == CALL and isfinite(called := _number(plain.get("t"))):
                    calls.append(called)
                ended = arrived if plain.get("e") == "end" and isfinite(arrived) else None
                continue
            if plain is not None and rows.add(plain):
                n_good += 1
            else:
                bad.add(number, "not a batch", line[:200].decode("utf-8", "replace"))
    bad.check(n_good)
    ignored = rows.write(writer)
    notes.append(f"The live flight started {header.get('began')}; {ARRIVED} counts from then.")
    if isinstance(used := header.get("monitor_set"), dict):
        notes.append(
            f"The live flight used monitor set {used.get('name')}: score it by the set; a scoring "
            "by one monitor takes its flight condition as given throughout."
        )
    return writer.finish(
        "journal",
        start=_time_zero(header, rows.zero),
        ignored=ignored,
        notes=(*notes, *bad.notes(n_good)),
        limits=tuple(limits),
        conditions=conditions,
        flown=_source(header)
        | {"begun": begun, "calls": calls, "ended": ended}
        | {"declared": _declared_condition(header)},
    )


def _declared(header: dict[str, Any]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Possible names of the time, and units by name, as in the flight. TelemetryError."""
    if "mapping" not in header:
        return TIMES, {}
    mapping = header["mapping"]
    if mapping is None:
        return TIMES, dict.fromkeys(TIMES, "s") | {key: TARGETS[key].unit for key in TARGETS}
    try:
        times = {time["signal"]: str(time["unit"]) for time in mapping["times"].values()}
        channels = {entry["signal"]: str(entry["unit"]) for entry in mapping["channels"].values()}
        return tuple(times), channels | times
    except (AttributeError, KeyError, TypeError):
        raise TelemetryError("the journal's mapping is damaged: export it again") from None


def _time_zero(header: dict[str, Any], zero: float) -> str:
    """Zero of the source's time, in ISO 8601. zero: [s] since the flight started."""
    try:
        began = datetime.fromisoformat(header["began"])
        return (began + timedelta(seconds=zero)).astimezone(UTC).isoformat(timespec="milliseconds")
    except (KeyError, TypeError, ValueError, OverflowError):
        return ""


def _source(header: dict[str, Any]) -> dict[str, Any]:
    """How the samples were used: the delay [s], None for the usual one, and the trim."""
    source = header.get("source")
    source = source if isinstance(source, dict) else {}
    delay = _number(source.get("delay"))
    trim = "none" if source.get("trim") == "none" else "detected"
    return {"delay": delay if isfinite(delay) else None, "trim": trim}


def _declared_condition(header: dict[str, Any]) -> dict[str, float]:
    """Values of the flight condition that a flight by a monitor set declared, in SI units."""
    used = header.get("monitor_set")
    fixed = used.get("fixed") if isinstance(used, dict) else None
    fixed = fixed if isinstance(fixed, dict) else {}
    given = {key: _number(fixed.get(key)) for key in CONDITION_KEYS}
    return {key: value for key, value in given.items() if isfinite(value)}


def _conditions(header: dict[str, Any]) -> dict[str, str]:
    """Signals of the flight condition by channel, as in the flight."""
    named = header.get("conditions")
    named = named if isinstance(named, dict) else {}
    defaults = {key: key for key in CONDITION_KEYS}
    return defaults | {key: name for key, name in named.items() if isinstance(name, str)}


def _plain(line: bytes) -> dict[str, Any] | None:
    """The object on a line, None if it is damaged."""
    try:
        plain = _decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return plain if isinstance(plain, dict) else None


class _Rows:
    """The batches so far. A signal starts with its first number.

    times: possible names of the time; the first batch decides.
    conditions: signals whose null means an unknown value, stored as infinity; NaN means not sent.
    """

    def __init__(
        self, times: tuple[str, ...], units: dict[str, str], conditions: frozenset[str]
    ) -> None:
        self._times, self._units, self._conditions = times, units, conditions
        self.zero = inf
        """zero of the source's time [s] since the flight started, by the fastest batch"""
        self._time = ""
        self._signals: dict[str, array] = {}
        self._arrived = array("d")
        self._examples: dict[str, str] = {}
        self._n_unequal: Counter[str] = Counter()

    @property
    def n(self) -> int:
        """Rows so far."""
        return len(self._arrived)

    def add(self, line: dict[str, Any]) -> bool:
        """Add a batch; return whether it is valid."""
        values, arrived = line["b"], line.get("a")
        if isinstance(arrived, bool) or not isinstance(arrived, float | int):
            return False
        if not isinstance(values, dict):
            return False
        time = next((name for name in self._times if name in values), None)
        if time is None or not all(isinstance(column, list) for column in values.values()):
            return False
        if not self._time:
            self._time, self._signals[time] = time, array("d")
        n = len(values[time])
        self._note_zero(arrived, values[time])
        values[self._time] = values.pop(time)
        for name, column in values.items():
            self._add_column(name, column, n)
        self._arrived.extend([_number(arrived)] * n)
        return True

    def _note_zero(self, arrived: float, times: list[Any]) -> None:
        newest = max(map(_number, times), default=NAN)
        seconds = convert(np.array([newest]), self._units.get(self._time) or "s", "s")
        self.zero = min(self.zero, arrived - float(seconds[0]))

    def _add_column(self, name: str, column: list[Any], n: int) -> None:
        if len(column) != n:
            self._n_unequal[name] += 1
            return
        numbers = [v if type(v) is float else _number(v) for v in column]
        if name in self._conditions:
            numbers = [inf if v != v else v for v in numbers]
        if name not in self._signals:
            if all(v != v for v in numbers):
                self._examples.setdefault(name, str(column[:1])[1:60])
                return
            self._signals[name] = array("d")
        signal = self._signals[name]
        signal.extend([NAN] * (self.n - len(signal)) + numbers)

    def write(self, writer: ColumnWriter) -> list[str]:
        """Write the signals and the times of arrival; return what was dropped."""
        group = writer.add_group()
        for name, values in self._signals.items():
            unit = self._units.get(name, "")
            signal = writer.add_signal(group, name, unit, time=name == self._time)
            writer.append(signal, values)
            writer.append(signal, np.full(self.n - len(values), NAN))
        arrival = writer.add_signal(group, ARRIVED, "s", "time of arrival")
        writer.append(arrival, self._arrived)
        without = [name for name in self._examples if name not in self._signals]
        return [
            *(f"{name}: not a number but {self._examples[name]}" for name in without),
            *(
                f"{name}: {n} batches with unequal numbers of values and times"
                for name, n in self._n_unequal.items()
            ),
        ]


def _number(value: Any) -> float:
    """The number, NaN if the value is not a number."""
    try:
        return float(value) if isinstance(value, float | int) else NAN
    except OverflowError:
        return NAN
