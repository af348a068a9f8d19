"""Recordings of IRIG 106 Chapter 10, experimental: raw numbers of buses, discretes and analog."""

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
    "Reading Chapter 10 is experimental: the numbers are raw words and counts, without the scales "
    "and units that only the description of the aircraft says."
)


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read what of a Chapter 10 recording is numbers; times count from the first of them."""
    with library_errors(TITLE):
        import chapter10  # noqa: F401  # so that its absence is reported first

        opened = Opened()
        for packet in packets(path):
            opened.take(packet)
        tables, ignored = opened.tables(), opened.ignored()
        if not tables:
            kinds = f" ({'; '.join(ignored)})" if ignored else ""
            raise TelemetryError(
                f"no channel of the Chapter 10 file can be decoded without a description of the "
                f"aircraft{kinds}: export the decoded parameters as a table"
            )
        write_tables(tables, writer, ignored)
        return writer.finish(
            "ch10", start=opened.start(), ignored=listed(ignored), notes=tuple(opened.notes())
        )


@dataclass(eq=False)
class Opened:
    """A recording as its packets come."""

    decoded: Decoded = field(default_factory=Decoded)
    clock: tuple[int, datetime] | None = None
    n_passed: int = 0

    def take(self, packet: Packet | int) -> None:
        """Take a packet, or a number of bytes that are none."""
        if isinstance(packet, int):
            self.n_passed += packet
            return
        left_out = self.decoded.left_out
        try:
            if packet.data_type == SETUP:
                self.decoded.sources |= channel_names(packet)
            elif packet.data_type == TIME:
                utc = None if self.clock else moment(packet)
                self.clock = (packet.time, utc) if utc else self.clock
            elif packet.data_type not in DECODERS:
                if packet.data_type not in COMPUTER:
                    left_out[f"{_kind(packet.data_type)} packets"] += 1
            elif packet.stamped:
                DECODERS[packet.data_type](packet, self.decoded)
            else:
                left_out["packets with times of another clock"] += 1
        except Exception:  # the library's, of any kind
            left_out["damaged packets"] += 1

    def tables(self) -> list[SignalTable]:
        """Return the series by their names; analog samples of one packet have no known rate."""
        by_name = sorted(self.decoded.series.items())
        untimed = [s for _, s in by_name if isinstance(s, Sampled) and len(s.times) < 2]
        self.decoded.left_out.update(["analog channels of one packet"] * len(untimed))
        return [series.table(name) for name, series in by_name if series not in untimed]

    def ignored(self) -> list[str]:
        """Say what was left out and how often."""
        return [f"{what}: {count}" for what, count in sorted(self.decoded.left_out.items())]

    def start(self) -> str:
        """Return the moment from which times count in ISO 8601, "" where no packet tells it."""
        if self.clock is None or self.decoded.first is None:
            return ""
        ticks, utc = self.clock
        away = ticks_between(self.decoded.first, ticks) / TICKS
        return (utc + timedelta(seconds=away)).isoformat()

    def notes(self) -> list[str]:
        """Say what has to be known of the numbers."""
        notes = [EXPERIMENTAL]
        if any(isinstance(series, Sampled) for series in self.decoded.series.values()):
            notes.append(
                "Analog samples have the times of their packets, evenly spread between them."
            )
        if self.n_passed:
            notes.append(f"{self.n_passed} bytes of the file are no complete packets.")
        return notes


def _kind(data_type: int) -> str:
    """What packets of a type hold; types of a kind follow one another."""
    return OTHER_KINDS.get(data_type, OTHER_KINDS.get(data_type & ~0x07, f"type {data_type:#04x}"))


SOURCE = re.compile(rb"R-(\d+)\\(TK1|DSI)-(\d+):([^;]*);")
LONGEST = 40


def channel_names(packet: Packet) -> dict[int, str]:
    """The data sources by the number of their channel, as the set-up record lists them."""
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
    """The date and time of day of a time packet, None where it does not tell the year."""
    from chapter10.time import TimeF1

    opened = packet.opened(TimeF1)
    return opened.time if opened.date_format else None
