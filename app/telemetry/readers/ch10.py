"""Read IRIG 106 Chapter 10 (experimental): raw numbers of buses, discretes and analog inputs."""

import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.chapter10.decoding import DECODERS, OTHER_KINDS, Decoded
from app.telemetry.readers.chapter10.packets import TICKS, Packet, packets, ticks_between
from app.telemetry.readers.chapter10.series import Sampled
from app.telemetry.readers.library_errors import library_errors
from app.telemetry.readers.signal_tables import SignalTable, listed, write_tables
from app.telemetry.recording import TelemetryError

TITLE = "Chapter 10"
SETUP, TIME = 0x01, 0x11
COMPUTER = range(0x08)
EXPERIMENTAL = (
    "Reading Chapter 10 is experimental: the numbers are raw words and counts, without scales and "
    "units, which only the description of the aircraft has."
)


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read the numbers of a Chapter 10 recording; times count from the first sample."""
    with library_errors(TITLE):
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
        return writer.finish(
            "ch10", start=recording.start(), ignored=listed(ignored), notes=tuple(recording.notes())
        )


@dataclass(eq=False)
class PacketReader:
    """Collects the packets of a recording."""

    decoded: Decoded = field(default_factory=Decoded)
    clock: tuple[int, datetime] | None = None
    n_skipped: int = 0

    def add(self, packet: Packet | int) -> None:
        """Add a packet, or count bytes that are not a packet."""
        if isinstance(packet, int):
            self.n_skipped += packet
            return
        not_decoded = self.decoded.not_decoded
        try:
            if packet.data_type == SETUP:
                self.decoded.sources |= channel_names(packet)
            elif packet.data_type == TIME:
                utc = None if self.clock else moment(packet)
                self.clock = (packet.time, utc) if utc else self.clock
            elif packet.data_type not in DECODERS:
                if packet.data_type not in COMPUTER:
                    not_decoded[f"{_kind(packet.data_type)} packets"] += 1
            elif packet.stamped:
                DECODERS[packet.data_type](packet, self.decoded)
            else:
                not_decoded["packets with times of another clock"] += 1
        except Exception:  # the library's, of any kind
            not_decoded["damaged packets"] += 1

    def tables(self) -> list[SignalTable]:
        """The series by name; analog samples of a single packet have no known rate."""
        by_name = sorted(self.decoded.series.items())
        untimed = [s for _, s in by_name if isinstance(s, Sampled) and len(s.times) < 2]
        self.decoded.not_decoded.update(["analog channels of one packet"] * len(untimed))
        return [series.table(name) for name, series in by_name if series not in untimed]

    def ignored(self) -> list[str]:
        """Kinds of content that were not decoded, with their number."""
        return [f"{kind}: {count}" for kind, count in sorted(self.decoded.not_decoded.items())]

    def start(self) -> str:
        """Origin of the times in ISO 8601, "" if no packet gives it."""
        if self.clock is None or self.decoded.first is None:
            return ""
        ticks, utc = self.clock
        offset = ticks_between(self.decoded.first, ticks) / TICKS
        return (utc + timedelta(seconds=offset)).isoformat()

    def notes(self) -> list[str]:
        notes = [EXPERIMENTAL]
        if any(isinstance(series, Sampled) for series in self.decoded.series.values()):
            notes.append("Analog samples are spread evenly between the times of their packets.")
        if self.n_skipped:
            notes.append(f"Skipped {self.n_skipped} bytes that are not complete packets.")
        return notes


def _kind(data_type: int) -> str:
    """Kind of packets by type; types of one kind are consecutive."""
    return OTHER_KINDS.get(data_type, OTHER_KINDS.get(data_type & ~0x07, f"type {data_type:#04x}"))


SOURCE = re.compile(rb"R-(\d+)\\(TK1|DSI)-(\d+):([^;]*);")
LONGEST = 40


def channel_names(packet: Packet) -> dict[int, str]:
    """Names of the data sources by channel number, from the set-up record."""
    from chapter10.computer import ComputerF1

    entries: dict[tuple[bytes, bytes], dict[bytes, str]] = {}
    for recorder, key, number, value in SOURCE.findall(packet.opened(ComputerF1).data):
        text = value.decode("utf-8", "replace").strip()[:LONGEST]
        entries.setdefault((recorder, number), {})[key] = text
    return {
        int(entry[b"TK1"]): entry[b"DSI"]
        for entry in entries.values()
        if entry.get(b"TK1", "").isdecimal() and b"DSI" in entry
    }


def moment(packet: Packet) -> datetime | None:
    """Date and time of a time packet, None if it has no year."""
    from chapter10.time import TimeF1

    opened = packet.opened(TimeF1)
    return opened.time if opened.date_format else None
