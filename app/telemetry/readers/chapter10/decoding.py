"""Decode the Chapter 10 packets that need no description of the aircraft.

MIL-STD-1553 messages and ARINC 429 words become raw words, discretes bits, analog samples raw
counts. PCM frames need a description of their layout and are not decoded.
"""

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from app.telemetry.readers.chapter10.packets import HEADER, TURN, Packet, ticks_between
from app.telemetry.readers.chapter10.series import MOST_WORDS, Sampled, Series, Values, Words

MODE_CODES = (0, 31)
"""Subaddresses of mode codes, whose messages carry no data."""
MESSAGE_1553 = struct.Struct("<QHHH")
"""Header of a message: time, status, response times, length [bytes]."""
BETWEEN_TERMINALS, ERRORS_1553 = 0x0800, 0x1638
CHANNEL_WORD = 4
"""Size of the channel word after the header [bytes]."""
PACKED, HIGH_BITS, LOW_BITS = 0, 1, 3
DATA_BITS_429 = 19

Kind = TypeVar("Kind", bound=Series)


@dataclass(eq=False)
class Decoded:
    """The series of a recording by name, and counts of content that was not decoded.

    first: the recorder's counter at the first data [ticks].
    sources: names of channels in the recorder's set-up, by number.
    """

    series: dict[str, Series] = field(default_factory=dict)
    not_decoded: Counter[str] = field(default_factory=Counter)
    first: int | None = None
    sources: dict[int, str] = field(default_factory=dict)

    def channel(self, packet: Packet) -> str:
        """Number and, if known, name of a packet's channel."""
        source = self.sources.get(packet.channel, "")
        return f"channel {packet.channel}" + (f" ({source})" if source else "")

    def ticks(self, time: int) -> int:
        """Ticks since the first data."""
        if self.first is None:
            self.first = time % TURN
        return ticks_between(time % TURN, self.first)

    def of(self, name: str, make: Callable[[], Kind]) -> Kind:
        """The series of a name, created at first use."""
        series: Any = self.series.get(name)
        if series is None:
            series = self.series[name] = make()
        return series


def decode_1553(packet: Packet, decoded: Decoded) -> None:
    """Sort messages by remote terminal, direction and subaddress.

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
            decoded.not_decoded["1553 mode codes"] += 1
        elif status & ERRORS_1553 or len(data) < 2 * n_words:
            decoded.not_decoded["1553 messages with errors"] += 1
        else:
            way = "from" if sends else "to"
            name = f"1553 {decoded.channel(packet)} {way} RT{terminal:02d} SA{address:02d}"
            decoded.of(name, Words).add(decoded.ticks(time), data)


def decode_429(packet: Packet, decoded: Decoded) -> None:
    """Sort words by bus, label and source; all data bits become one signed number."""
    from chapter10.arinc429 import ARINC429F0

    time = packet.time
    for number, word in enumerate(packet.opened(ARINC429F0)):
        time += word.gap_time if number else 0
        if word.format_error or word.parity_error or len(word.data) < 4:
            decoded.not_decoded["ARINC 429 words with errors"] += 1
            continue
        bits = int.from_bytes(word.data, "little")
        label = int(f"{bits & 0xFF:08b}"[::-1], 2)
        data = bits >> 10 & (1 << DATA_BITS_429) - 1
        signed = data - (data >> DATA_BITS_429 - 1 << DATA_BITS_429)
        of_label = f"bus {word.bus} label {label:03o} source {bits >> 8 & 3}"
        name = f"429 {decoded.channel(packet)} {of_label}"
        series = decoded.of(name, lambda: Values(("data", "sign and status")))
        series.add(decoded.ticks(time), (signed, bits >> 29 & 3))


def decode_discrete(packet: Packet, decoded: Decoded) -> None:
    """Make one signal per bit."""
    from chapter10.discrete import DiscreteF1

    opened = packet.opened(DiscreteF1)
    n_bits = opened.length or 32
    name = f"discretes {decoded.channel(packet)}, {n_bits} bits"
    labels = tuple(f"bit {k:02d}" for k in range(n_bits))
    for message in opened:
        state = int.from_bytes(message.data, "little")
        series = decoded.of(name, lambda: Values(labels))
        series.add(decoded.ticks(message.ipts), tuple(state >> k & 1 for k in range(n_bits)))


def decode_analog(packet: Packet, decoded: Decoded) -> None:
    """Decode packets whose channels are sampled alike."""
    from chapter10.analog import AnalogF1

    opened = packet.opened(AnalogF1)
    samplings = {(s["length"], s["mode"], s["factor"]) for s in opened.subchannels}
    n_bits, mode, factor = next(iter(samplings))
    width = (opened.subchannel_count or 256) if opened.same else len(opened.subchannels)
    counts = (
        _counts(opened.data.bytes, n_bits, mode) if len(samplings) == 1 and not factor else None
    )
    if counts is None:
        decoded.not_decoded["analog packets with differently sampled channels"] += 1
        return
    name = f"analog {decoded.channel(packet)}, {width} of {n_bits} bits"
    block = counts[: len(counts) // width * width].reshape(-1, width)
    if len(block):
        decoded.of(name, lambda: Sampled(width)).add(decoded.ticks(packet.time), block)


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


DECODERS: dict[int, Callable[[Packet, Decoded], None]] = {
    0x19: decode_1553,
    0x21: decode_analog,
    0x29: decode_discrete,
    0x38: decode_429,
}
"""By data type of the packet."""
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
