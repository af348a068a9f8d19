"""Small recordings of instruments, with most features of each format."""

import json
import struct
import warnings
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType

from tests.support.ch10_flight import setup_record
from tests.support.recorded_files import ULOG_START, ch10_packet, ulog_message

N = 12
T = 0.02 * np.arange(N)
START = datetime.fromisoformat("2024-05-01T09:30:00+00:00")


def ulog(path: Path) -> None:
    def named(kind: str, key: bytes, value: bytes) -> bytes:
        return ulog_message(kind, struct.pack("<B", len(key)) + key + value)

    words = [
        ulog_message("B", bytes(40)),
        named("I", b"char[5] sys_name", b"plane"),
        ulog_message("M", b"\0\x0bchar[3] ver" + b"1.2"),
        named("P", b"float gain", struct.pack("<f", 0.5)),
        ulog_message("Q", b"\1\x0bint32_t one" + struct.pack("<i", 1)),
        ulog_message(
            "F",
            b"att:uint64_t timestamp;float[4] q;float p;char[3] who;bool ok;uint8_t[2] _padding0;",
        ),
        ulog_message("F", b"acc:uint64_t timestamp;inner[2] e;"),
        ulog_message("F", b"inner:int16_t x;float y;"),
    ]
    for number, (instance, name) in enumerate([(0, b"att"), (0, b"acc"), (1, b"acc")]):
        words.append(ulog_message("A", struct.pack("<BH", instance, number) + name))
    for k in range(N):
        at = 1_000_000 + 20_000 * k
        words.append(
            ulog_message("D", struct.pack("<HQ5f3s?", 0, at, 1, 0, 0, 0, k, b"abc", k % 2))
        )
        for number in (1, 2):
            words.append(ulog_message("D", struct.pack("<HQhfhf", number, at, k, k / 2, -k, -k)))
    words.insert(20, ulog_message("O", struct.pack("<H", 150)))
    words.insert(25, ulog_message("S", bytes.fromhex("2f73132025 0cbb12")))
    words.insert(30, ulog_message("L", b"6" + struct.pack("<Q", 1_100_000) + b"take-off"))
    words.append(ulog_message("R", struct.pack("<H", 2)))
    path.write_bytes(ULOG_START + b"".join(words))


def mdf(path: Path, version: Any, compression: Any = 0) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from asammdf import MDF, Signal

        newer = version >= "4"
        bad: dict[str, Any] = {"invalidation_bits": T > 0.15} if newer else {}
        first = [
            Signal(3 * np.sin(T), T, name="beta", unit="deg", **bad),
            Signal(np.arange(N, dtype="i2"), T, name="raw", conversion={"a": 0.5, "b": -1.0}),
            Signal(np.arange(N, dtype="u1") % 3, T, name="mode", conversion=TEXT),
        ]
        second = [Signal(np.cos(T).astype("f4"), T, name="p", unit="deg/s")]
        second += [Signal(np.array([b"one", b"two"] * (N // 2)), T, name="word", encoding="utf-8")]
        if newer:
            fields = np.rec.fromarrays([np.arange(3 * N).reshape(N, 3)], [("a", "<f4", (3,))])
            second.append(Signal(fields, T, name="field"))
        with MDF(version=version) as file:
            file.append(first, comment="air")
            file.append(second)
            file.header.start_time = START
            file.save(path, overwrite=True, compression=compression)
    content = path.read_bytes()  # without the time of writing
    at, n = (content.index(b"##FH") + 40, 8) if newer else (content.index(b": updated") - 24, 24)
    path.write_bytes(content[:at] + bytes(n) + content[at + n :])


TEXT = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"}


def ch10(path: Path) -> None:
    out = ch10_packet(0x01, 0, 0, struct.pack("<I", 0) + setup_record().encode())
    out += ch10_packet(0x11, 1, 1_000_000, bytes.fromhex("11000000 0025 3009 0105 2420"))
    command, answer = 3 << 11 | 1 << 10 | 2 << 5 | 2, 3 << 11
    for k in range(N):
        rtc = 2_000_000 + 200_000 * k
        data = struct.pack("<HHhh", command, answer, k, -k)
        message = struct.pack("<QHHH", rtc, 0, 0, len(data)) + data
        out += ch10_packet(0x19, 5, rtc, struct.pack("<I", 2) + 2 * message)
        words = [0xAB | (v & 0x7FFFF) << 10 | 3 << 29 for v in (k, -k)]
        body = struct.pack("<IIIII", 2, 2 << 24, words[0], 2 << 24 | 3000, words[1])
        out += ch10_packet(0x38, 6, rtc + 1000, body)
        out += ch10_packet(0x29, 7, rtc + 2000, struct.pack("<IQI", 4 << 3, rtc, k % 16))
        samples = np.arange(8 * k, 8 * k + 8, dtype="<u2").tobytes()
        out += ch10_packet(0x21, 8, rtc + 3000, struct.pack("<I", ANALOG) + samples)
        out += ch10_packet(0x09, 9, rtc + 4000, bytes(40))
    path.write_bytes(out)


ANALOG = 3 | 12 << 2 | 2 << 16 | 1 << 28
"""Two channels of 12 bits in words, alike."""


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    waveform = {"wf_increment": 0.02, "wf_start_offset": 0.1, "unit_string": "deg"}
    times = np.datetime64("2024-05-01T09:30:00") + np.arange(N) * np.timedelta64(20, "ms")
    with TdmsWriter(path) as file:
        for _ in range(2):
            file.write_segment(
                [
                    ChannelObject("air", "beta", np.sin(T), waveform),
                    ChannelObject("air", "n", np.arange(N, dtype=np.int16)),
                    ChannelObject("bus", "clock", times),
                    ChannelObject("bus", "note", ["calm"] * N),
                ]
            )


def mcap(path: Path, compression: Any) -> None:
    from google.protobuf.wrappers_pb2 import DoubleValue
    from mcap_protobuf.writer import Writer

    with path.open("wb") as file, Writer(file, compression=compression) as writer:
        plain = writer._writer.register_channel("air", "json", 0)
        for k in range(N):
            at = 20_000_000 * k
            text = json.dumps({"p": k, "rates": [k, None], "who": "us"}).encode()
            writer._writer.add_message(plain, at, text, at)
            writer.write_message("alpha", DoubleValue(value=0.1 * k), at, at)


BUSES: dict[str, Callable[[Path], object]] = {
    "autopilot.ulg": ulog,
    "new.mf4": lambda path: mdf(path, "4.10"),
    "deflated.mf4": lambda path: mdf(path, "4.11", 2),
    "waveforms.tdms": tdms,
    "messages.mcap": lambda path: mcap(path, CompressionType.NONE),
    "packed.mcap": lambda path: mcap(path, CompressionType.ZSTD),
    "recorder.ch10": ch10,
}
