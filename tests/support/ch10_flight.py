"""A flight as a Chapter 10 recorder writes it: bus, ARINC 429, analog and their set-up record."""

import struct

import numpy as np

from tests.support.recorded_files import ch10_packet

BUS, ARINC, ANALOG = 5, 6, 8
PER_PACKET = 10
"""Analog samples in a packet."""
FIRST = 50_000_000
SCALES = {"beta": 180 / 2**15, "r": 2**-7, "Ny": 1e-4, "delta_a": 0.02, "delta_r": 0.02, "p": 2**-9}
OFFSETS = {"Ny": -2.0}
UNITS = {"beta": "DEG", "p": "DEG/S", "r": "DEG/S", "Ny": "G", "delta_a": "DEG", "delta_r": "DEG"}
NAMES = {"beta": "BETA", "p": "ROLL_RATE", "r": "YAW_RATE", "Ny": "NY", "delta_a": "AILERON",
         "delta_r": "RUDDER"}  # fmt: skip
LABELS = {"beta": "sideslip angle", "p": "roll rate", "r": "yaw rate", "delta_r": "rudder position",
          "Ny": "lateral load factor", "delta_a": "aileron position"}  # fmt: skip
PLACES = {
    "beta": r"B-1\MWN-1-1-1-1:1;B-1\MBM-1-1-1-1:FW;B-1\MTO-1-1-1-1:MSB;",
    "r": r"B-1\MWN-1-1-2-1:2;B-1\MBM-1-1-2-1:1111111111111110;",
    "delta_a": r"B-1\MWN-1-1-3-1:3;B-1\MBM-1-1-3-1:0000111111111111;",
    "delta_r": r"B-1\MWN-1-1-4-1:3;B-1\MBM-1-1-4-1:1111000000000000;B-1\MFP-1-1-4-1:1;"
    r"B-1\MWN-1-1-4-2:4;B-1\MBM-1-1-4-2:1111111100000000;B-1\MFP-1-1-4-2:2;",
    "p": r"B-2\MWN-1-1-1-1:1;B-2\MBM-1-1-1-1:00011111111111111111110000000000;",
}
FORMATS = {"Ny": "UNS"}


def setup_record(*, changes: dict[str, str] | None = None) -> str:
    """TMATS of the recorder. changes: other texts for some of its parts."""
    lines = [
        r"G\PN:test;",
        *(rf"R-1\TK1-{n}:{channel};" for n, channel in enumerate((BUS, ARINC, ANALOG), 1)),
        r"R-1\DSI-1:NAV;R-1\CDLN-1:BUS A;R-1\CDLN-2:ADC;",
        rf"R-1\AMN-3-1:SPARE;R-1\AMN-3-2:{NAMES['Ny']};R-1\AMCN-3-2:2;",
        r"B-1\DLN:BUS A;B-1\BT-1:1553;B-1\TRA-1-1:00011;B-1\STA-1-1:00010;B-1\TRM-1-1:1;",
        r"B-2\DLN:ADC;B-2\BT-1:A429;B-2\LBL-1-1:11010101;B-2\SDI-1-1:ALL;",
        *(rf"B-1\MN-1-1-{n}:{NAMES[key]};" for n, key in enumerate(FIELDS, 1)),
        rf"B-2\MN-1-1-1:{NAMES['p']};",
        *PLACES.values(),
    ]
    for n, (key, name) in enumerate(NAMES.items(), 1):
        lines += [
            rf"C-{n}\DCN:{name};C-{n}\MN1:{LABELS[key]};C-{n}\MN3:{UNITS[key]};",
            rf"C-{n}\BFM:{FORMATS.get(key, 'TWO')};C-{n}\DCT:COE;C-{n}\CO\N:1;",
            rf"C-{n}\CO:{OFFSETS.get(key, 0.0)};C-{n}\CO-1:{SCALES[key]!r};",
        ]
    text = "\n".join(lines)
    for old, new in (changes or {}).items():
        assert old in text
        text = text.replace(old, new)
    return text


FIELDS = ("beta", "r", "delta_a", "delta_r")


def counts_of(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Counts of channels in UNITS, by key."""
    return {
        key: np.round((values[key] - OFFSETS.get(key, 0.0)) / SCALES[key]).astype(int)
        for key in NAMES
    }


def recorded(
    values: dict[str, np.ndarray], dt: float, setup: str | None = None
) -> tuple[bytes, dict[str, np.ndarray], np.ndarray]:
    """A file, the values that it stands for in UNITS, and their times [s].

    values: (n,) by key, in UNITS; n is a multiple of PER_PACKET.
    """
    counts = counts_of(values)
    n, step = len(values["beta"]), round(1e7 * dt)
    text = setup_record() if setup is None else setup
    packets = b"" if not text else ch10_packet(1, 0, 0, struct.pack("<I", 7) + text.encode())
    status = 3 << 11
    command = 3 << 11 | 1 << 10 | 2 << 5 | 4
    for k in range(n):
        rtc = FIRST + k * step
        c = {key: int(counts[key][k]) for key in counts}
        words = (
            command,
            status,
            c["beta"] & 0xFFFF,
            (c["r"] & 0x7FFF) << 1,
            c["delta_a"] & 0xFFF | (c["delta_r"] >> 8 & 0xF) << 12,
            (c["delta_r"] & 0xFF) << 8,
        )
        data = struct.pack("<6H", *words)
        body = struct.pack("<IQHHH", 1, rtc, 0, 0, len(data)) + data
        packets += ch10_packet(0x19, BUS, rtc, body)
        label = int(f"{0o325:08b}"[::-1], 2)
        word = label | 1 << 8 | (c["p"] & 0x7FFFF) << 10 | 3 << 29
        packets += ch10_packet(0x38, ARINC, rtc, struct.pack("<III", 1, 2 << 24, word))
        if k % PER_PACKET == 0:
            block = counts["Ny"][k : k + PER_PACKET]
            samples = np.column_stack([np.zeros(len(block)), block]).astype("<u2")
            channels = 3 | 16 << 2 | 2 << 16 | 1 << 28
            body = struct.pack("<I", channels) + samples.tobytes()
            packets += ch10_packet(0x21, ANALOG, rtc, body)
    exact = {key: counts[key] * SCALES[key] + OFFSETS.get(key, 0.0) for key in counts}
    return packets, exact, step * np.arange(n) / 1e7
