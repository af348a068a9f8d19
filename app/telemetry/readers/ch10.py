"""Read IRIG 106 Chapter 10 (experimental): raw numbers of buses, discretes and analog inputs.

MIL-STD-1553 messages and ARINC 429 words become raw words, discretes bits, analog samples raw
counts. Measurements of the set-up record become separate signals, with scale and unit. PCM
frames are not decoded: the library cuts them, and takes no words out of them.
"""

import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from math import nan
from pathlib import Path

import numpy as np
import numpy.typing as npt

from app.telemetry.contents import MOST_SIGNALS, ColumnWriter, Contents
from app.telemetry.readers.ch10_packets import HEADER, TICKS, TURN, Packet, packets, ticks_between
from app.telemetry.readers.signal_tables import (
    Column,
    Pieces,
    SignalTable,
    library_errors,
    write_tables,
)
from app.telemetry.readers.tmats import Measurement, Place, SetupRecord
from app.telemetry.recording import TelemetryError
from core.types import Array

SETUP, TIME = 0x01, 0x11
COMPUTER = range(0x08)
EXPERIMENTAL = (
    "Reading Chapter 10 is experimental: words and counts are raw; give their bits, scale and "
    "offset in the mapping."
)
NAMED = "Measurements with names and scales by the set-up record: {}."
BY_XML = "The set-up record is in XML, which is not read."
LONGEST_SOURCE = 40
MOST_WORDS = 32
"""Data words of a MIL-STD-1553 message."""
MODE_CODES = (0, 31)
"""Subaddresses of mode codes, whose messages carry no data."""
MESSAGE_1553 = struct.Struct("<QHHH")
"""Header of a message: time, status, response times, length [bytes]."""
BETWEEN_TERMINALS, ERRORS_1553 = 0x0800, 0x1638
CHANNEL_WORD = 4
"""Size of the channel word after the header [bytes]."""
PACKED, HIGH_BITS, LOW_BITS = 0, 1, 3
DATA_BITS_429 = 19
GAP = 1.5
"""A longer distance between analog packets, in usual lengths, is a gap."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read the numbers of a Chapter 10 recording; times count from the first sample."""
    with library_errors("Chapter 10"):
        import chapter10  # noqa: F401  # so that its absence is reported first

        recording = PacketReader()
        for packet in packets(path):
            recording.add(packet)
        tables, ignored = recording.tables(), recording.ignored()
        if not tables:
            kinds = f" ({'; '.join(ignored)})" if ignored else ""
            raise TelemetryError(
                "no channel of the Chapter 10 file can be decoded without a description of the "
                f"aircraft{kinds}: export the decoded parameters as a table"
            )
        write_tables(tables, writer, ignored)
        notes = recording.notes()
        return writer.finish("ch10", start=recording.start(), ignored=ignored, notes=notes)


@dataclass(eq=False)
class Series:
    """Samples of one origin, with times in ticks after the first data of the file.

    labels: with the number of bits.   word: number of the first one that is a whole word.
    values: of all samples in turn, as many as labels each, NaN where missing; raw words and counts
    are exact in single precision.
    """

    place: Place
    labels: Mapping[str, int]
    word: int = 0
    times: array = field(default_factory=lambda: array("d"))
    values: array = field(default_factory=lambda: array("f"))

    def add(self, time: int, values: Sequence[float]) -> None:
        self.times.append(time)
        self.values.extend(values)
        self.values.extend([nan] * (len(self.labels) - len(values)))

    def table(
        self, name: str, measurements: Sequence[Measurement], with_raw: bool = True
    ) -> SignalTable:
        """One column per label, without those at the end that never have a value, and one per
        measurement."""
        samples = np.asarray(self.values).reshape(-1, len(self.labels))
        width = 1 + int(np.flatnonzero(~np.isnan(samples).all(axis=0)).max(initial=-1))
        labels = dict([*self.labels.items()][: width * with_raw])
        n_bits = [*self.labels.values()][self.word]

        def pieces() -> Pieces:
            yield 0, np.asarray(self.times) / TICKS
            yield from enumerate(samples.T[: len(labels)], start=1)
            counts = (m.counts(samples[:, self.word : width], n_bits) for m in measurements)
            yield from enumerate(counts, start=1 + len(labels))

        return SignalTable((name,), _columns(name, labels, measurements), len(samples), pieces)


@dataclass(eq=False)
class Sampled:
    """Analog samples (n, n_subchannels); only the first sample of each packet has a time."""

    place: Place
    labels: Mapping[str, int]
    times: list[int] = field(default_factory=list)
    blocks: list[npt.NDArray[np.integer]] = field(default_factory=list)

    def add(self, time: int, block: npt.NDArray[np.integer]) -> None:
        self.times.append(time)
        self.blocks.append(block)

    def table(
        self, name: str, measurements: Sequence[Measurement], with_raw: bool = True
    ) -> SignalTable:
        n_bits = next(iter(self.labels.values()))
        labels = self.labels if with_raw else {}

        def pieces() -> Pieces:
            for times, block in zip(self._times(), self.blocks, strict=True):
                yield 0, times / TICKS
                yield from enumerate(block.T[: len(labels)], start=1)
                counts = (measurement.counts(block, n_bits) for measurement in measurements)
                yield from enumerate(counts, start=1 + len(labels))

        n_rows = sum(map(len, self.blocks))
        return SignalTable((name,), _columns(name, labels, measurements), n_rows, pieces)

    def _times(self) -> Iterator[Array]:
        """Ticks of the samples, spread evenly up to the next packet unless there is a gap."""
        lengths = np.array([len(block) for block in self.blocks], dtype=np.float64)
        steps = np.append(np.diff(self.times), np.nan) / lengths
        usual = float(np.nanmedian(steps)) if len(steps) > 1 else 0.0
        steps[~((steps > 0) & (steps < GAP * usual))] = usual
        for first, step, block in zip(self.times, steps, self.blocks, strict=True):
            yield first + step * np.arange(len(block))


def _columns(
    name: str, labels: Mapping[str, int], measurements: Sequence[Measurement]
) -> tuple[Column, ...]:
    return (
        Column(f"{name}/time", "s", "the recorder's relative time counter", time=True),
        *(
            Column(f"{name}/{label}", "", "raw, as on the bus", n_bits=n_bits)
            for label, n_bits in labels.items()
        ),
        *(Column(m.name, m.unit, m.description, scaling=m.scaling) for m in measurements),
    )


@dataclass(eq=False)
class PacketReader:
    """Collects the packets of a recording.

    series: by name.   not_decoded: counts of content.   first: the recorder's counter at the first
    data [ticks].   sources: names of channels in the recorder's set-up, by number.
    clock: a counter and its time.   n_named: measurements of the set-up that were recorded.
    """

    series: dict[str, Series] = field(default_factory=dict)
    analog: dict[str, Sampled] = field(default_factory=dict)
    not_decoded: Counter[str] = field(default_factory=Counter)
    first: int | None = None
    setup: SetupRecord = field(default_factory=SetupRecord)
    is_xml: bool = False
    n_named: int = 0
    sources: dict[int, str] = field(default_factory=dict)
    clock: tuple[int, datetime] | None = None
    n_skipped: int = 0

    def add(self, packet: Packet | int) -> None:
        """Add a packet, or count bytes that are not a packet."""
        if isinstance(packet, int):
            self.n_skipped += packet
            return
        try:
            if packet.data_type == SETUP:
                self._set_up(packet)
            elif packet.data_type == TIME:
                utc = None if self.clock else moment(packet)
                self.clock = (packet.time, utc) if utc else self.clock
            elif packet.data_type not in DECODERS:
                if packet.data_type not in COMPUTER:
                    self.not_decoded[f"{_kind(packet.data_type)} packets"] += 1
            elif packet.stamped:
                DECODERS[packet.data_type](packet, self)
            else:
                self.not_decoded["packets with times of another clock"] += 1
        except Exception:  # the library's, of any kind
            self.not_decoded["damaged packets"] += 1

    def _set_up(self, packet: Packet) -> None:
        from chapter10.computer import ComputerF1

        text = packet.opened(ComputerF1).data
        if text.lstrip().startswith(b"<"):  # the library takes the flag from another bit
            self.is_xml = True
            return
        self.setup.add(text)
        self.sources = {
            channel: name[:LONGEST_SOURCE] for channel, name in self.setup.channel_names().items()
        }

    def channel(self, packet: Packet) -> str:
        """Number and, if known, name of a packet's channel."""
        source = self.sources.get(packet.channel, "")
        return f"channel {packet.channel}" + (f" ({source})" if source else "")

    def ticks(self, time: int) -> int:
        if self.first is None:
            self.first = time % TURN
        return ticks_between(time % TURN, self.first)

    def append(
        self,
        name: str,
        place: Place,
        labels: Mapping[str, int],
        time: int,
        values: Sequence[float],
        word: int = 0,
    ) -> None:
        """Add a sample to the series of a name, which starts with its first sample.

        word: number of the label of the first whole word.
        """
        if name not in self.series:
            self.series[name] = Series(place, labels, word)
        self.series[name].add(self.ticks(time), values)

    def tables(self) -> list[SignalTable]:
        """The series by name; analog samples of a single packet have no known rate.

        If all would be too many signals, measurements come without the words around them.
        """
        timed = {name: series for name, series in self.analog.items() if len(series.times) > 1}
        untimed = len(self.analog) - len(timed)
        self.not_decoded.update(["analog channels of one packet"] * untimed)
        of_place = self.setup.recorded({each.place for each in (self.series | timed).values()})
        self.n_named = len({m.name for measurements in of_place.values() for m in measurements})
        every = sorted((self.series | timed).items())
        tables = [each.table(name, of_place.get(each.place, ())) for name, each in every]
        if not of_place or sum(len(table.columns) for table in tables) <= MOST_SIGNALS:
            return tables
        named = [(name, each) for name, each in every if each.place in of_place]
        self.not_decoded[f"groups without raw words, to stay below {MOST_SIGNALS} signals"] = len(
            every
        )
        return [each.table(name, of_place[each.place], with_raw=False) for name, each in named]

    def ignored(self) -> list[str]:
        """Kinds of content that were not decoded, with their number."""
        return [
            f"{kind}: {count}{f', {REMEDIES[kind]}' if kind in REMEDIES else ''}"
            for kind, count in sorted(self.not_decoded.items())
        ]

    def start(self) -> str:
        """Origin of the times in ISO 8601, "" if no packet gives it."""
        if self.clock is None or self.first is None:
            return ""
        ticks, utc = self.clock
        return (utc + timedelta(seconds=ticks_between(self.first, ticks) / TICKS)).isoformat()

    def notes(self) -> list[str]:
        notes = [EXPERIMENTAL]
        if self.n_named:
            notes.append(NAMED.format(self.n_named))
        if self.is_xml:
            notes.append(BY_XML)
        notes += self.setup.notes()
        if self.analog:
            notes.append("Analog samples are spread evenly between the times of their packets.")
        if self.n_skipped:
            notes.append(f"Skipped {self.n_skipped} bytes that are not complete packets.")
        return notes


def _kind(data_type: int) -> str:
    """Kind of packets by type; types of one kind are consecutive."""
    return OTHER_KINDS.get(data_type, OTHER_KINDS.get(data_type & ~0x07, f"type {data_type:#04x}"))


def moment(packet: Packet) -> datetime | None:
    """Date and time of a time packet, None if it has no year."""
    from chapter10.time import TimeF1

    opened = packet.opened(TimeF1)
    return opened.time if opened.date_format else None


def decode_1553(packet: Packet, recording: PacketReader) -> None:
    """Sort messages by remote terminal, direction and subaddress; words in two's complement.

    They are parsed here, because the library is too slow for their number.
    """
    at = HEADER.size + CHANNEL_WORD
    while at + MESSAGE_1553.size <= packet.end:
        time, status, _, length = MESSAGE_1553.unpack_from(packet.raw, at)
        first = at + MESSAGE_1553.size
        words = packet.raw[first : min(first + length, packet.end)]
        at = first + length + length % 2
        n_commands = 2 if status & BETWEEN_TERMINALS else 1
        command = int.from_bytes(words[2 * n_commands - 2 : 2 * n_commands], "little")
        terminal, sends, address = command >> 11, command >> 10 & 1, command >> 5 & 31
        start = 2 * (n_commands + sends)  # after the commands, and the status of a sender
        n_words = command & 31 or MOST_WORDS
        data = words[start : start + 2 * n_words]
        if address in MODE_CODES:
            recording.not_decoded["1553 mode codes"] += 1
        elif status & ERRORS_1553 or len(data) < 2 * n_words:
            recording.not_decoded["1553 messages with errors"] += 1
        else:
            way = "from" if sends else "to"
            name = f"1553 {recording.channel(packet)} {way} RT{terminal:02d} SA{address:02d}"
            place = Place("1553", packet.channel, (terminal, sends, address))
            recording.append(name, place, WORDS, time, struct.unpack(f"<{n_words}h", data))


def decode_429(packet: Packet, recording: PacketReader) -> None:
    """Sort words by bus, label and source; all data bits become one signed number.

    The word without its label and parity keeps the numbers of its bits, 9 to 31.
    """
    from chapter10.arinc429 import ARINC429F0

    time = packet.time
    for number, word in enumerate(packet.opened(ARINC429F0)):
        time += word.gap_time if number else 0
        if word.format_error or word.parity_error or len(word.data) < 4:
            recording.not_decoded["ARINC 429 words with errors"] += 1
            continue
        bits = int.from_bytes(word.data, "little")
        label = int(f"{bits & 0xFF:08b}"[::-1], 2)
        data = bits >> 10 & (1 << DATA_BITS_429) - 1
        signed = data - (data >> DATA_BITS_429 - 1 << DATA_BITS_429)
        source = bits >> 8 & 3
        name = f"429 {recording.channel(packet)} bus {word.bus} label {label:03o} source {source}"
        place = Place("429", packet.channel, (label, source, word.bus))
        values = (signed, bits >> 29 & 3, bits & WORD_429)
        recording.append(name, place, LABELS_429, time, values, word=2)


def decode_discrete(packet: Packet, recording: PacketReader) -> None:
    """Make one signal per bit."""
    from chapter10.discrete import DiscreteF1

    opened = packet.opened(DiscreteF1)
    n_bits = opened.length or 32
    name = f"discretes {recording.channel(packet)}, {n_bits} bits"
    labels = {f"bit {k:02d}": 1 for k in range(n_bits)}
    place = Place("discretes", packet.channel)
    for message in opened:
        state = int.from_bytes(message.data, "little")
        bits = [state >> k & 1 for k in range(n_bits)]
        recording.append(name, place, labels, message.ipts, bits)


def decode_analog(packet: Packet, recording: PacketReader) -> None:
    """Decode packets whose channels are sampled uniformly."""
    from chapter10.analog import AnalogF1

    opened = packet.opened(AnalogF1)
    samplings = {(s["length"], s["mode"], s["factor"]) for s in opened.subchannels}
    n_bits, mode, factor = next(iter(samplings))
    width = (opened.subchannel_count or 256) if opened.same else len(opened.subchannels)
    is_uniform = len(samplings) == 1 and not factor
    counts = _counts(opened.data.bytes, n_bits, mode) if is_uniform else None
    if counts is None:
        recording.not_decoded["analog packets with differently sampled channels"] += 1
        return
    name = f"analog {recording.channel(packet)}, {width} of {n_bits} bits"
    block = counts[: len(counts) // width * width].reshape(-1, width)
    if len(block):
        labels = {f"analog {k + 1}": n_bits for k in range(width)}
        place = Place("analog", packet.channel)
        series = recording.analog.setdefault(name, Sampled(place, labels))
        series.add(recording.ticks(packet.time), block)


def _counts(raw: bytes, n_bits: int, mode: int) -> npt.NDArray[np.uint32] | None:
    """Samples as counts; None for an unknown packing."""
    words = np.frombuffer(raw[: len(raw) // 2 * 2], "<u2")
    if mode in (HIGH_BITS, LOW_BITS) and n_bits <= 16:
        shifted = words >> (16 - n_bits) if mode == HIGH_BITS else words & ((1 << n_bits) - 1)
        return shifted.astype(np.uint32)
    if mode != PACKED or n_bits > 32:
        return None
    bits = np.unpackbits(words.astype(">u2").view(np.uint8))
    samples = bits[: len(bits) // n_bits * n_bits].reshape(-1, n_bits)
    weights = 1 << np.arange(n_bits - 1, -1, -1, dtype=np.uint64)
    return (samples @ weights).astype(np.uint32)


WORDS = {f"word {k:02d}": 16 for k in range(1, MOST_WORDS + 1)}
LABELS_429 = {"data": DATA_BITS_429, "sign and status": 2, "word": 31}
WORD_429 = 0x7FFFFF00
DECODERS: dict[int, Callable[[Packet, PacketReader], None]] = {
    0x19: decode_1553,
    0x21: decode_analog,
    0x29: decode_discrete,
    0x38: decode_429,
}
"""By data type of the packet."""
REMEDIES = {
    "PCM packets": "whose frames need a decommutator: export their measurements as a table",
}
OTHER_KINDS = {
    0x09: "PCM",
    0x1A: "16PP194 bus",
    0x30: "message",
    0x40: "video",
    0x50: "UART",
    0x60: "parallel",
    0x68: "Ethernet",
}
"""Content of packets of other types, by the first type of the kind."""
