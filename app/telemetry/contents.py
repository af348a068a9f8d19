"""What a file holds before anybody says what it means: signals, in groups that share their times.

A reader pours a file into a folder of columns, one flat file of numbers a signal. Nothing larger
than a block of rows is ever in memory, and what is read later is mapped, not loaded.
"""

import json
import mmap
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.recording import TelemetryError
from core.types import Array

CONTENTS = "contents.json"
MOST_SIGNALS = 4096
LONGEST_NAME, LONGEST_TEXT = 200, 500
"""Signs of a name, and of a description or note."""
MOST_LISTED = 100
"""Bad rows that are listed; the others are counted."""


@dataclass(frozen=True)
class Signal:
    """One recorded quantity, as the file names it.

    unit: as the file spells it, "" where it says none.   group: number of its group.
    """

    name: str
    unit: str
    group: int
    description: str = ""


@dataclass(frozen=True)
class Group:
    """Signals that were sampled together.

    name: "" for the one table of a file.   time: name of the signal that the format itself declares
    to be their time, "" where it declares none.   rate: at which the format declares them to be
    sampled [Hz], 0 where it declares none, the first row at `start` [s].
    """

    name: str
    n_rows: int
    time: str = ""
    rate: float = 0.0
    start: float = 0.0


@dataclass(frozen=True)
class BadRow:
    """A row that could not be read and was left out. text: its beginning."""

    line: int
    reason: str
    text: str = ""


@dataclass(frozen=True)
class Contents:
    """Everything about a file but its numbers.

    format: key of FORMATS.
    start: time zero where the file says it, else "": in ISO 8601, or "234:15:35:50.7", "15:35:50.7"
        or "35:50.7" where its clock has no year, no date or no hour.
    bad_rows: the first MOST_LISTED of n_bad_rows.   ignored: what was left out, with the reason.
    limits: limit sets that were put in force meanwhile, plain, see app.scoring.limits_in_force.
    conditions: name of the signal of a channel of the flight condition where it is not its own.
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


@dataclass(eq=False)
class ColumnWriter:
    """A folder of columns being written.

    most_bytes: of numbers that a file may unfold to.   bad_share: of its rows that may be bad.
    notes: on the choice of the reader, before its own.
    """

    folder: Path
    most_bytes: int
    bad_share: float = 0.01
    notes: tuple[str, ...] = ()
    _groups: list[Group] = field(default_factory=list)
    _times: dict[int, str] = field(default_factory=dict)
    _signals: list[Signal] = field(default_factory=list)
    _rows: list[int] = field(default_factory=list)
    _numbers: dict[str, int] = field(default_factory=dict)
    """Of each name that is taken, the last number behind it."""
    _bytes: int = 0

    def add_group(self, name: str = "", *, rate: float = 0.0, start: float = 0.0) -> int:
        """Begin a group; return its number. rate, start: as in Group."""
        self._groups.append(Group(printable(name, LONGEST_NAME), 0, "", rate, start))
        return len(self._groups) - 1

    def add_signal(
        self, group: int, name: str, unit: str = "", description: str = "", *, time: bool = False
    ) -> int:
        """Begin a signal; return its number.

        A name that is taken gets a number behind it, and one that says nothing is a number.

        time: the format itself declares that it is the time of its group.
        """
        if len(self._signals) == MOST_SIGNALS:
            raise TelemetryError(
                f"the file has more than {MOST_SIGNALS} signals: export the ones of this test"
            )
        name = printable(name, LONGEST_NAME) or f"signal_{len(self._signals) + 1}"
        unique = self._unique(name)
        self._signals.append(
            Signal(
                unique,
                printable(unit, LONGEST_NAME),
                group,
                printable(description, LONGEST_TEXT),
            )
        )
        self._rows.append(0)
        if time:
            self._times[group] = unique
        return len(self._signals) - 1

    def _unique(self, name: str) -> str:
        number, unique = self._numbers.get(name, 1), name
        while unique in self._numbers:
            number += 1
            unique = f"{name} ({number})"
        self._numbers |= {name: number, unique: self._numbers.get(unique, 1)}
        return unique

    def append(self, signal: int, values: npt.ArrayLike) -> None:
        """Add values to a signal: (n,), NaN where nothing was recorded."""
        block = np.ascontiguousarray(values, "<f8")
        self._bytes += block.nbytes
        if self._bytes > self.most_bytes:
            raise TelemetryError(
                f"the file unfolds to more than {self.most_bytes / 2**20:.0f} MiB of numbers, the "
                "most that one of its size may: export the time range and the signals of this test"
            )
        with (self.folder / f"{signal}.f8").open("ab") as file:
            file.write(block.data)
        self._rows[signal] += len(block)

    def finish(
        self,
        file_format: str,
        *,
        start: str = "",
        bad_rows: tuple[BadRow, ...] = (),
        n_bad_rows: int = 0,
        ignored: tuple[str, ...] = (),
        notes: tuple[str, ...] = (),
        limits: tuple[dict[str, Any], ...] = (),
        conditions: dict[str, str] | None = None,
    ) -> Contents:
        """Write what the columns are, which makes the folder whole. TelemetryError if empty."""
        groups = []
        for number, group in enumerate(self._groups):
            of_group = zip(self._signals, self._rows, strict=True)
            lengths = {rows for signal, rows in of_group if signal.group == number}
            assert len(lengths) <= 1, "signals of a group have equal lengths"
            n_rows, time = lengths.pop() if lengths else 0, self._times.get(number, "")
            groups.append(replace(group, n_rows=n_rows, time=time))
        if max((group.n_rows for group in groups), default=0) < 2:
            raise TelemetryError(
                "the file holds no table of numbers with at least two rows: export the signals "
                "of the test with their times"
            )
        contents = Contents(
            format=file_format,
            groups=tuple(groups),
            signals=tuple(self._signals),
            start=start,
            bad_rows=bad_rows[:MOST_LISTED],
            n_bad_rows=n_bad_rows or len(bad_rows),
            ignored=tuple(printable(text, LONGEST_TEXT) for text in ignored),
            notes=tuple(printable(text, LONGEST_TEXT) for text in (*self.notes, *notes)),
            limits=limits,
            conditions=conditions or {},
        )
        text = json.dumps(asdict(contents), ensure_ascii=False)
        (self.folder / CONTENTS).write_text(text, encoding="utf-8")
        return contents


@dataclass(frozen=True, eq=False)
class Columns:
    """The contents of a file with its numbers, which are mapped into memory as they are used.

    check: called with the file of a signal before it is read; raises where it is damaged.
    """

    folder: Path
    contents: Contents
    check: Callable[[Path], None] | None = None

    def values(self, name: str) -> Array:
        """(n,) of a signal, in the unit of the file, read-only. KeyError if there is none."""
        if not self.contents.groups[self.signal(name).group].n_rows:
            return np.empty(0)
        path = self.folder / f"{self._numbers[name]}.f8"
        if self.check is not None:
            self.check(path)
        return np.memmap(path, "<f8", mode="r")

    def signal(self, name: str) -> Signal:
        """Return a signal by its name; KeyError."""
        return self.contents.signals[self._numbers[name]]

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {signal.name: number for number, signal in enumerate(self.contents.signals)}


def release(values: Array) -> None:
    """Leave a column on the disk until it is used again; nothing for one that is in memory alone.

    What is mapped from a file counts as memory of the process from its first use on.
    """
    owner: Any = values
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        owner.madvise(mmap.MADV_DONTNEED)


def open_columns(folder: Path) -> Columns:
    """Open a whole folder of columns. FileNotFoundError where it is none."""
    plain = json.loads((folder / CONTENTS).read_text(encoding="utf-8"))
    return Columns(
        folder,
        Contents(
            **plain
            | {
                "groups": tuple(Group(**group) for group in plain["groups"]),
                "signals": tuple(Signal(**signal) for signal in plain["signals"]),
                "bad_rows": tuple(BadRow(**row) for row in plain["bad_rows"]),
                "ignored": tuple(plain["ignored"]),
                "notes": tuple(plain["notes"]),
                "limits": tuple(plain.get("limits", ())),
            }
        ),
    )


def printable(text: str, most: int) -> str:
    """Text on one line of up to `most` signs; what cannot be shown becomes a blank or "?"."""
    if not text.isprintable():
        text = "".join(
            sign if sign.isprintable() else " " if sign.isspace() else "?" for sign in text
        )
    text = text.strip()
    return text if len(text) <= most else f"{text[: most - 3]}..."
