"""Measurements in the set-up record of a Chapter 10 recording: places, bits, scales and units.

Reference: IRIG 106-17, chapter 9, "Telemetry attributes transfer standard" (TMATS): R describes
the channels of the recorder, B the messages of a bus, C the conversion of each measurement.
"""

import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from itertools import groupby
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from app.telemetry.scaling import AS_RECORDED, COUNTS, MOST_BITS, BitField, Scaling
from core.types import Array

CODE = re.compile(r"([A-Z])-(\d{1,4})\\([A-Z0-9]+(?:\\[A-Z0-9]+)*)((?:-\d{1,4})*)")
LINKS = ("CDLN", "BDLN", "PDLN", "DSI")
"""Attributes that name the data of a recorder's channel, by version of the standard."""
BITS_1553, BITS_429 = 16, 32
MOST_NAMED = 8
CHANGED = "Set-up record: it changes within the file; the last one counts."
KINDS = {"UNS": "", "TWO": "signed", "OFF": "", "BCD": "bcd"}
"""Kinds of bit fields by binary format."""
ON_A_LINE = 1e-6
"""Largest distance of a pair set from a straight line, as a share of its range."""
STATUS = BitField(30, 31)
NORMAL, PLUS = 3, 0
"""States of an ARINC 429 word with data: NORMAL of signed ones, either of other kinds. In all
kinds 1 is no computed data and 2 a functional test."""


class Place(NamedTuple):
    """Where the words of a measurement are.

    kind: "1553", "429" or "analog".   within: terminal, whether it sends, and subaddress; or label,
    source, -1 for any, and bus.
    """

    kind: str
    channel: int
    within: tuple[int, ...] = ()

    def has(self, other: "Place") -> bool:
        """Whether words of another place, without -1, belong to this one."""
        if (self.kind, self.channel) != (other.kind, other.channel):
            return False
        return all(of in (-1, at) for of, at in zip(self.within, other.within, strict=False))


@dataclass(frozen=True)
class Run:
    """Consecutive bits of a word; the lowest word and bit are 1.   high: 0 for the whole word."""

    word: int
    low: int = 1
    high: int = 0


@dataclass(frozen=True)
class Measurement:
    """A measurement of raw counts.

    runs: its bits, the most significant first.   kind: of BitField.   unit: COUNTS without a scale.
    """

    name: str
    place: Place
    runs: tuple[Run, ...]
    kind: str = ""
    unit: str = COUNTS
    description: str = ""
    scaling: Scaling = AS_RECORDED

    def counts(self, words: npt.NDArray[Any], n_bits: int) -> Array:
        """Raw counts (n,), NaN where missing.   words: (n, n_words).   n_bits: of a word."""
        fields = [(_word(words, run.word), run.low, run.high or n_bits) for run in self.runs]
        if len(fields) == 1:
            (raw, low, high), *_ = fields
            values = BitField(low, high, self.kind).of(raw)
        else:
            values, n_bits = np.zeros(len(fields[0][0])), 0
            for raw, low, high in fields:
                values = values * 2.0 ** (high - low + 1) + BitField(low, high).of(raw)
                n_bits += high - low + 1
            if self.kind == "signed":
                values = np.where(values < 2.0 ** (n_bits - 1), values, values - 2.0**n_bits)
        if self.place.kind != "429":
            return values
        status = STATUS.of(fields[0][0])
        allowed = (NORMAL,) if self.kind == "signed" else (NORMAL, PLUS)
        return np.where(np.isin(status, allowed), values, np.nan)


def _word(words: npt.NDArray[Any], number: int) -> Array:
    """A word of each message (n,), NaN if all messages are shorter."""
    is_short = number > words.shape[1]
    return np.full(len(words), np.nan) if is_short else words[:, number - 1].astype(np.float64)


Attributes = dict[str, dict[tuple[int, ...], str]]
"""By name and numbers of an entry: TK1-2 is ["TK1"][(2,)]."""


@dataclass(eq=False)
class SetupRecord:
    """Attributes of the set-up records of a file, by group and its number.

    faults: measurements without a place or a scale, by reason.   rest: beginning of an attribute
    that the next packet continues.   is_changed: whether a later record has other values.
    """

    groups: dict[tuple[str, int], Attributes] = field(default_factory=dict)
    faults: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    rest: bytes = b""
    is_changed: bool = False

    def add(self, text: bytes) -> None:
        """Read attributes, CODE:value; in turn; later ones replace earlier ones."""
        *lines, self.rest = (self.rest + text).split(b";")
        for line in lines:
            code, _, value = line.decode("utf-8", "replace").partition(":")
            if match := CODE.fullmatch(code.strip().upper()):
                group, number, name, numbers = match.groups()
                attributes = self.groups.setdefault((group, int(number)), {})
                place = tuple(map(int, numbers.split("-")[1:]))
                entries = attributes.setdefault(name, {})
                self.is_changed |= entries.get(place, value.strip()) != value.strip()
                entries[place] = value.strip()

    def channel_names(self) -> dict[int, str]:
        """Names of the data sources by channel number."""
        return {
            channel: name
            for recorder, n, channel in self._channels()
            if (name := recorder.get("DSI", {}).get(n, ""))
        }

    def recorded(self, places: Collection[Place]) -> dict[Place, list[Measurement]]:
        """The measurements at each place of words in the recording; sets the faults."""
        at_place: dict[Place, list[Measurement]] = {}
        for measurement in self._measurements():
            matching = [place for place in places if measurement.place.has(place)]
            for place in matching:
                at_place.setdefault(place, []).append(measurement)
            if not matching:
                self.faults["its words were not recorded"].append(measurement.name)
        return at_place

    def _measurements(self) -> list[Measurement]:
        self.faults.clear()
        conversions = {
            attributes["DCN"][()]: attributes
            for (group, _), attributes in sorted(self.groups.items())
            if group == "C" and () in attributes.get("DCN", {})
        }
        placed = [*self._analog(), *self._of_buses()]
        return [
            converted
            for each in placed
            if (converted := self._converted(each, conversions.get(each.name, {})))
        ]

    def notes(self) -> list[str]:
        """Measurements without a place or a scale, and the reasons."""
        notes = [CHANGED] if self.is_changed else []
        for reason, names in self.faults.items():
            more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
            notes.append(f"Set-up record: {reason}: {', '.join(names[:MOST_NAMED])}{more}.")
        return notes

    def _channels(self) -> Iterator[tuple[Attributes, tuple[int, ...], int]]:
        """(attributes of the recorder, numbers of the entry, channel)."""
        for (group, _), attributes in sorted(self.groups.items()):
            for n, channel in attributes.get("TK1", {}).items() if group == "R" else ():
                if channel.isdecimal():
                    yield attributes, n, int(channel)

    def _analog(self) -> Iterator[Measurement]:
        """Named subchannels, in the order of those that are enabled."""
        for recorder, n, channel in self._channels():
            named = sorted(
                (_whole(recorder.get("AMCN", {}).get(m, "")) or m[-1], name, m)
                for m, name in recorder.get("AMN", {}).items()
                if len(m) == 2
                and m[:-1] == n
                and recorder.get("AMCE", {}).get(m, "T").upper() != "F"
            )
            for number, (_, name, m) in enumerate(named, start=1):
                mask = recorder.get("AMSK", {}).get(m, "FW")
                runs = _runs(number, mask)
                if runs is None:
                    self.faults[f"its mask is {mask!r:.40}"].append(name)
                elif name:
                    yield Measurement(name, Place("analog", channel), runs)

    def _of_buses(self) -> Iterator[Measurement]:
        links = defaultdict[str, list[int]](list)
        for recorder, n, channel in self._channels():
            for name in {recorder.get(link, {}).get(n, "") for link in LINKS}:
                links[name].append(channel)
        for (group, _), bus in sorted(self.groups.items()):
            link = bus.get("DLN", {}).get((), "")
            for at, name in sorted(bus.get("MN", {}).items()) if group == "B" else ():
                if len(at) != 3 or not name:
                    continue
                channels = links.get(link, ()) if link else ()
                if not channels:
                    self.faults["no channel of the recorder has its data link"].append(name)
                within = _of_message(bus, at[:2])
                runs = _of_words(bus, at, within[0] if within else "")
                for channel in channels:
                    if within is None:
                        self.faults["its message is not one of 1553 or ARINC 429"].append(name)
                    elif runs is None:
                        self.faults["its words and masks are not understood"].append(name)
                    else:
                        yield Measurement(name, Place(within[0], channel, within[1]), runs)

    def _converted(self, placed: Measurement, conversion: Attributes) -> Measurement | None:
        """A measurement with format, scale and unit; None if its raw counts are not known."""
        given = {name: values[()] for name, values in conversion.items() if () in values}
        binary = given.get("BFM", "").upper() or ("UNS" if placed.place.kind == "analog" else "")
        several = len(placed.runs) > 1
        if binary not in KINDS or (several and binary != "UNS" and binary != "TWO"):
            self.faults[f"its binary format is {binary[:20] or 'missing'}"].append(placed.name)
            return None
        named = replace(placed, kind=KINDS[binary], description=given.get("MN1", ""))
        if given.get("DCT", "").upper() in ("", "NON"):
            return named
        scaling = _scaling(given, conversion)
        if scaling is None:
            self.faults["its conversion is no straight line, so these are raw counts"].append(
                placed.name
            )
            return named
        if binary == "OFF":
            (run,) = placed.runs
            if not run.high:
                self.faults["its binary format is OFF of unknown width"].append(placed.name)
                return None
            half = 2.0 ** (run.high - run.low)
            scaling = replace(scaling, offset=scaling.offset - scaling.scale * half)
        return replace(named, scaling=scaling, unit=given.get("MN3", ""))


def _of_message(bus: Attributes, at: tuple[int, ...]) -> tuple[str, tuple[int, ...]] | None:
    """Kind and place of a message; None if it is not known."""

    def bits(name: str, base: int = 2) -> int | None:
        try:
            return int(bus.get(name, {}).get(at, ""), base)
        except ValueError:
            return None

    if label := bus.get("LBL", {}).get(at, ""):
        number = bits("LBL", 2 if len(label) == 8 else 8)
        source = bits("SDI")
        any_source = bus.get("SDI", {}).get(at, "ALL").upper() in ("", "ALL", "X", "XX")
        if number is None or (source is None and not any_source):
            return None
        return "429", (number, -1 if source is None or any_source else source)
    terminal, sends, address = bits("TRA"), bits("TRM"), bits("STA")
    if terminal is None or sends is None or address is None:
        return None
    return "1553", (terminal, sends, address)


def _of_words(bus: Attributes, at: tuple[int, ...], kind: str) -> tuple[Run, ...] | None:
    """Bits of a measurement in the words of its message; None if they are not known."""
    parts = []
    size = BITS_429 if kind == "429" else BITS_1553
    for part, text in bus.get("MWN", {}).items():
        if part[:-1] != at:
            continue
        order = bus.get("MTO", {}).get(part, "MSB").upper()
        runs = _runs(_whole(text), bus.get("MBM", {}).get(part, "FW"), size)
        if runs is None or not _whole(text) or order.startswith("LSB"):
            return None
        parts.append((_whole(bus.get("MFP", {}).get(part, "")) or part[-1], runs))
    runs = tuple(run for _, of_part in sorted(parts, key=lambda p: p[0]) for run in of_part)
    return runs if runs and sum(run.high - run.low + 1 for run in runs) <= MOST_BITS else None


def _runs(word: int, mask: str, size: int = 0) -> tuple[Run, ...] | None:
    """Runs of ones in a mask, the most significant first; None if it is no mask.

    mask: zeros and ones, or "FW" for the whole word.   size: of the word, 0 if unknown.
    """
    if mask.upper() in ("", "FW"):
        return (Run(word, 1, size),)
    if len(mask) != (size or len(mask)) or not {*mask} <= {"0", "1"} or "1" not in mask:
        return None
    runs, at = [], len(mask)
    for bit, same in groupby(mask):
        length = len([*same])
        if bit == "1":
            runs.append(Run(word, at - length + 1, at))
        at -= length
    return tuple(runs)


def _scaling(given: dict[str, str], conversion: Attributes) -> Scaling | None:
    """Scale and offset of a conversion; None if it is not known to be a straight line."""
    way = given.get("DCT", "").upper()
    if way == "COE":
        powers = {at[-1] if at else 0: _number(x) for at, x in conversion.get("CO", {}).items()}
        is_known = _whole(given.get("CO\\N", "")) <= max(1, *powers)
        if not is_known or any(x for power, x in powers.items() if power > 1):
            return None
        scaling = Scaling(powers.get(1, 0.0), powers.get(0, 0.0))
    elif way == "PRS" and given.get("PS1", "Y").upper() != "N":
        of_counts, of_values = (conversion.get(name, {}) for name in ("PS3", "PS4"))
        pairs = [(_number(x), _number(of_values.get(n, ""))) for n, x in sorted(of_counts.items())]
        x, y = np.array(pairs).reshape(-1, 2).T
        if len(x) < 2 or not np.isfinite(pairs).all() or x[0] == x[-1]:
            return None
        scale = float((y[-1] - y[0]) / (x[-1] - x[0]))
        scaling = Scaling(scale, float(y[0] - scale * x[0]))
        if np.abs(scale * x + scaling.offset - y).max() > ON_A_LINE * np.ptp(y):
            return None
    else:
        return None
    return None if scaling.problem() else scaling


def _whole(text: str) -> int:
    """A whole number, 0 for another text."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else 0


def _number(text: str) -> float:
    """A finite number, NaN for another text."""
    try:
        return float(text) if isfinite(float(text)) else np.nan
    except ValueError:
        return np.nan
