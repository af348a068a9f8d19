"""Find the packets of an IRIG 106 Chapter 10 recording by their headers.

A header is 24 bytes with a sync pattern and a checksum, so damaged parts are skipped.
Reference: IRIG 106-17, chapter 11.2, "Data packet format".
"""

import io
import mmap
import struct
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SYNC = b"\x25\xeb"
HEADER = struct.Struct("<HHIIBBBB6sH")
SECONDARY = 12
HAS_SECONDARY, STAMPED_OTHERWISE = 0x80, 0x40
"""Flags: a second header follows; time stamps come from another clock."""
MOST_BYTES = 1 << 28
"""Largest packet."""
TICKS = 10_000_000
"""Rate of the recorder's relative time counter [1/s], which has 48 bits."""
TURN = 1 << 48


@dataclass(frozen=True)
class Packet:
    """A packet without its second header. time: of its counter [ticks]."""

    channel: int
    data_type: int
    time: int
    stamped: bool
    raw: bytes

    @property
    def end(self) -> int:
        """End of the data; fillers and a checksum may follow."""
        return HEADER.size + HEADER.unpack_from(self.raw)[3]

    def opened(self, kind: Any) -> Any:
        """Parse the packet with a class of the library."""
        return kind(io.BytesIO(self.raw))


def packets(path: Path) -> Iterator[Packet | int]:
    """Every complete packet of a file in order, and the number of bytes skipped in between."""
    with (
        path.open("rb") as file,
        closing(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) as recorded,
    ):
        at = 0
        while (start := recorded.find(SYNC, at)) >= 0:
            if not (length := _length(recorded, start)):
                at, before = start + 1, at
                yield at - before
                continue
            if start > at:
                yield start - at
            yield _packet(recorded[start : start + length])
            at = start + length
        if at < len(recorded):
            yield len(recorded) - at


def ticks_between(later: int, earlier: int) -> int:
    """Ticks from one time to another; the counter may have wrapped."""
    return (later - earlier + TURN // 2) % TURN - TURN // 2


def _length(recorded: mmap.mmap, at: int) -> int:
    """Length of the complete packet at a position [bytes], 0 if there is none."""
    header = recorded[at : at + HEADER.size]
    if len(header) < HEADER.size or _checksum(header[:22]) != int.from_bytes(header[22:], "little"):
        return 0
    length, n_data = HEADER.unpack(header)[2:4]
    if (
        not HEADER.size <= length <= min(MOST_BYTES, len(recorded) - at)
        or n_data > length - HEADER.size
    ):
        return 0
    return length


def _checksum(words: bytes) -> int:
    return sum(struct.unpack(f"<{len(words) // 2}H", words)) & 0xFFFF


def _packet(raw: bytes) -> Packet:
    sync, channel, length, n_data, version, number, flags, kind, rtc, _ = HEADER.unpack_from(raw)
    body = raw[HEADER.size :]
    if flags & HAS_SECONDARY:
        body, length = body[SECONDARY:], length - SECONDARY
    header = HEADER.pack(
        sync, channel, length, n_data, version, number, flags & ~HAS_SECONDARY, kind, rtc, 0
    )[:22]
    plain = header + struct.pack("<H", _checksum(header)) + body
    time = int.from_bytes(rtc, "little")
    return Packet(channel, kind, time, not flags & STAMPED_OTHERWISE, plain)
