"""The signals of a file before they are mapped, in groups that share their times.

A reader writes a file into a folder of columns, one flat file of numbers per signal. Only one block
of rows is in memory at a time, and columns are memory-mapped later, not loaded.
"""

import json
import mmap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.recording import TelemetryError
from app.telemetry.scaling import AS_RECORDED, Scaling
from core.types import Array

CONTENTS = "contents.json"
MOST_SIGNALS = 4096
LONGEST_NAME, LONGEST_TEXT = 200, 500
"""Most characters of a name, and of a description or note."""
MOST_LISTED = 100
"""Most bad rows and ignored parts that are listed; the others are only counted."""
BAD_ROWS_ALLOWED = 3
"""Bad rows that are allowed even in a small table, if twice as many are good."""


@dataclass(frozen=True)
class Signal:
    """One recorded quantity.

    name, unit: as in the file; unit is "" if missing.   group: number of its group.
    scale, offset: of raw counts, as the file declares: value in `unit` = scale * raw + offset.
    n_bits: of a raw word, 0 if unknown.
    """

    name: str
    unit: str
    group: int
    description: str = ""
    scale: float = 1.0
    offset: float = 0.0
    n_bits: int = 0


@dataclass(frozen=True)
class Group:
    """Signals that were sampled together.

    name: "" for the only table of a file.   time: name of the signal that the format declares as
    their time, "" if none.   rate: sample rate that the format declares [Hz], 0 if none, with the
    first row at `start` [s].
    """

    name: str
    n_rows: int
    time: str = ""
    rate: float = 0.0
    start: float = 0.0


@dataclass(frozen=True)
class BadRow:
    """A row that could not be read and was dropped. text: its beginning."""

    line: int
    reason: str
    text: str = ""


@dataclass
class BadRows:
    """The bad rows so far. share: largest share of all rows."""

    share: float
    n: int = 0
    listed: list[BadRow] = field(default_factory=list)

    def add(self, line: int, reason: str, text: str) -> None:
        self.n += 1
        if len(self.listed) < MOST_LISTED:
            shown = text if text.isprintable() else ascii(text[:200])[1:-1]
            self.listed.append(BadRow(line, reason, shown[:80]))

    def check(self, n_good: int, share_read: float = 1.0) -> None:
        """Raise TelemetryError if there are too many.

        share_read: of the file. Before its end it is only refused with a clear excess.
        """
        expected = (n_good + self.n) / share_read * (1.0 if share_read == 1.0 else 1.5)
        few = min(BAD_ROWS_ALLOWED, n_good // 2)
        if self.n <= max(self.share * expected, few):
            return
        first = "; ".join(f"line {row.line}: {row.reason}" for row in self.listed[:5])
        rows = f"{n_good + self.n} rows" + (" so far" if share_read < 1.0 else "")
        raise TelemetryError(
            f"{self.n} of the {rows} cannot be read, more than {100 * self.share:g} % ({first}"
            f"{'; ...' if self.n > 5 else ''}): repair them or export the file again"
        )

    def notes(self, n_good: int) -> list[str]:
        if not self.n:
            return []
        percent = 100 * self.n / (n_good + self.n)
        return [f"Dropped {self.n} of {n_good + self.n} rows ({percent:.2g} %) as unreadable."]


@dataclass(frozen=True)
class Contents:
    """Everything about a file except its numbers.

    format: key of FORMATS.
    start: time zero if the file gives it, else "": in ISO 8601, or "234:15:35:50.7", "15:35:50.7"
        or "35:50.7" if its clock has no year, date or hour.
    bad_rows: the first MOST_LISTED of n_bad_rows.   ignored: omitted content, with reasons.
    limits: limit sets that came into force during the flight, plain, see app.assessment.
    conditions: channel of the flight condition -> name of its signal.
    flown: of a live flight, how its samples were used: delay [s], trim, when the flight ended, the
        declared flight condition, and when manoeuvres began by hand: time of arrival [s] and rows
        before it.
    """

    format: str
    groups: tuple[Group, ...]
    signals: tuple[Signal, ...]
    start: str = ""
    bad_rows: tuple[BadRow, ...] = ()
    n_bad_rows: int = 0
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    limits: tuple[dict[str, Any], ...] = ()
    conditions: dict[str, str] = field(default_factory=dict)
    flown: dict[str, Any] = field(default_factory=dict)


@dataclass(eq=False)
class ColumnWriter:
    """Writes a folder of columns.

    most_bytes: limit of the numbers that a file may expand to.   bad_share: largest share of bad
    rows.   notes: on the choice of the reader; they come before the reader's own.
    """

    folder: Path
    most_bytes: int
    bad_share: float = 0.01
    notes: tuple[str, ...] = ()
    bad: BadRows = field(init=False)
    _groups: list[Group] = field(default_factory=list)
    _signals: list[Signal] = field(default_factory=list)
    _rows: list[int] = field(default_factory=list)
    _numbers: dict[str, int] = field(default_factory=dict)
    """By used name, the last number appended to it."""
    _bytes: int = 0

    def __post_init__(self) -> None:
        self.bad = BadRows(self.bad_share)

    def add_group(self, name: str = "", *, rate: float = 0.0, start: float = 0.0) -> int:
        """Start a group; return its number. rate, start: as in Group."""
        self._groups.append(Group(printable(name, LONGEST_NAME), 0, "", rate, start))
        return len(self._groups) - 1

    def add_signal(
        self,
        group: int,
        name: str,
        unit: str = "",
        description: str = "",
        *,
        time: bool = False,
        scaling: Scaling = AS_RECORDED,
        n_bits: int = 0,
    ) -> int:
        """Start a signal; return its number.

        A number is appended to a repeated name; an empty name becomes signal_<number>.
        time: whether the format declares it as the time of its group.
        scaling: of raw counts, as the format declares it.   n_bits: of a raw word, 0 if unknown.
        """
        if len(self._signals) == MOST_SIGNALS:
            raise TelemetryError(
                f"the file has more than {MOST_SIGNALS} signals: export only those of this test"
            )
        number = len(self._signals)
        unique = self._unique(printable(name, LONGEST_NAME) or f"signal_{number + 1}")
        unit, description = printable(unit, LONGEST_NAME), printable(description, LONGEST_TEXT)
        scale, offset = scaling.scale, scaling.offset
        self._signals.append(Signal(unique, unit, group, description, scale, offset, n_bits))
        self._rows.append(0)
        if time:
            self._groups[group] = replace(self._groups[group], time=unique)
        return number

    def _unique(self, name: str) -> str:
        number, unique = self._numbers.get(name, 1), name
        while unique in self._numbers:
            number += 1
            unique = f"{name} ({number})"
        self._numbers |= {name: number, unique: self._numbers.get(unique, 1)}
        return unique

    def append(self, signal: int, values: npt.ArrayLike) -> None:
        """Append values (n,) to a signal, NaN for missing ones."""
        block = np.ascontiguousarray(values, "<f8")
        self._bytes += block.nbytes
        if self._bytes > self.most_bytes:
            raise TelemetryError(
                f"the file expands to more than {self.most_bytes / 2**20:.0f} MiB of numbers, the "
                "limit for its size: export only the time range and signals of this test"
            )
        with (self.folder / f"{signal}.f8").open("ab") as file:
            file.write(block.data)
        self._rows[signal] += len(block)

    def finish(
        self,
        file_format: str,
        *,
        ignored: Sequence[str] = (),
        notes: Sequence[str] = (),
        **others: Any,
    ) -> Contents:
        """Write the contents, which completes the folder. TelemetryError if it is empty.

        others: fields of Contents.
        """
        n_rows = {
            signal.group: rows for signal, rows in zip(self._signals, self._rows, strict=True)
        }
        groups = [replace(g, n_rows=n_rows.get(k, 0)) for k, g in enumerate(self._groups)]
        if max(n_rows.values(), default=0) < 2:
            raise TelemetryError(
                "the file has no table of numbers with at least two rows: export the signals "
                "of the test with their times"
            )
        more = len(ignored) - MOST_LISTED
        listed = [*ignored[:MOST_LISTED], *([f"and {more} more"] if more > 0 else [])]
        contents = Contents(
            format=file_format,
            groups=tuple(groups),
            signals=tuple(self._signals),
            bad_rows=tuple(self.bad.listed),
            n_bad_rows=self.bad.n,
            ignored=tuple(printable(text, LONGEST_TEXT) for text in listed),
            notes=tuple(printable(text, LONGEST_TEXT) for text in (*self.notes, *notes)),
            **others,
        )
        text = json.dumps(asdict(contents), ensure_ascii=False)
        (self.folder / CONTENTS).write_text(text, encoding="utf-8")
        return contents


@dataclass(frozen=True, eq=False)
class Columns:
    """The contents of a file with its numbers, memory-mapped on use.

    check: called with the file of a signal before reading; raises if the file is damaged.
    scalings: by signal, in place of those that the file declares.
    """

    folder: Path
    contents: Contents
    check: Callable[[Path], None] | None = None
    scalings: Mapping[str, Scaling] = field(default_factory=dict)

    def values(self, name: str) -> Array:
        """Values (n,) of a signal, in the unit of the file, read-only. KeyError."""
        raw = self.raw(name)
        values = self.scaling(name)(raw)
        if values is not raw:
            release(raw)
        return values

    def scaling(self, name: str) -> Scaling:
        """How raw counts of a signal become values in its unit. KeyError."""
        if name in self.scalings:
            return self.scalings[name]
        signal = self.signal(name)
        return Scaling(signal.scale, signal.offset)

    def raw(self, name: str) -> Array:
        """Numbers (n,) of a signal as recorded, read-only. KeyError."""
        if not self.contents.groups[self.signal(name).group].n_rows:
            return np.empty(0)
        path = self.folder / f"{self._numbers[name]}.f8"
        if self.check is not None:
            self.check(path)
        return np.memmap(path, "<f8", mode="r")

    def signal(self, name: str) -> Signal:
        return self.contents.signals[self._numbers[name]]

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {signal.name: number for number, signal in enumerate(self.contents.signals)}


def release(values: Array) -> None:
    """Release the memory of a mapped column until its next use; does nothing for other arrays.

    Mapped pages count as memory of the process from their first use.
    """
    owner: Any = values
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        owner.madvise(mmap.MADV_DONTNEED)


def open_columns(folder: Path) -> Columns:
    """Open a complete folder of columns. FileNotFoundError if it is missing or incomplete."""
    plain = json.loads((folder / CONTENTS).read_text(encoding="utf-8"))
    for name, kind in (("groups", Group), ("signals", Signal), ("bad_rows", BadRow)):
        plain[name] = [kind(**each) for each in plain[name]]
    fields: dict[str, Any] = {k: tuple(x) if isinstance(x, list) else x for k, x in plain.items()}
    return Columns(folder, Contents(**fields))


def printable(text: str, most: int) -> str:
    """Text on one line of at most `most` characters; others become blanks or "?"."""
    if not text.isprintable():
        text = "".join(
            sign if sign.isprintable() else " " if sign.isspace() else "?" for sign in text
        )
    text = text.strip()
    return text if len(text) <= most else f"{text[: most - 3]}..."
