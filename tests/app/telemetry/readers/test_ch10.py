"""Read IRIG 106 Chapter 10: packets from the library and from the standard."""

import struct
from datetime import datetime

import numpy as np
import pytest

from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import ch10_packet, read

pytest.importorskip("chapter10")
from chapter10.arinc429 import ARINC429F0
from chapter10.computer import ComputerF1
from chapter10.discrete import DiscreteF1
from chapter10.ms1553 import MS1553F1
from chapter10.time import TimeF1

TICKS = 10_000_000
FIRST = 50_000_000


@pytest.fixture
def recorded(tmp_path):
    """Packets -> columns of a recording of them."""

    def _recorded(*packets):
        path = tmp_path / "recording.ch10"
        path.write_bytes(b"".join(map(bytes, packets)))
        return read("ch10", path)

    return _recorded


def bus(rtc, *messages, channel=5):
    """A 1553 packet of (ticks later, words, flags)."""
    packet = MS1553F1(data_type=0x19, channel_id=channel, rtc=rtc, count=len(messages))
    for later, words, flags in messages:
        content = struct.pack(f"<{len(words)}H", *(word & 0xFFFF for word in words))
        message = MS1553F1.Message(
            content, parent=packet, ipts=rtc + later, length=len(content), **flags
        )
        packet.append(message)
    return packet


def command(terminal, sends, address, n_words):
    return terminal << 11 | sends << 10 | address << 5 | n_words & 31


def test_words_of_a_bus_are_sorted_by_terminal_and_subaddress(recorded):
    status = 3 << 11
    columns = recorded(
        *(
            bus(
                FIRST + k * 200_000,
                (0, [command(3, 1, 2, 2), status, 10 * k, -k], {}),
                (500, [command(3, 0, 4, 1), 7 * k, status], {}),
                (900, [command(9, 0, 6, 1), command(3, 1, 5, 1), status, k, 0], {"rt2rt": 1}),
                (950, [command(3, 1, 0, 2), status], {}),
                (980, [command(3, 1, 2, 2), status, 99, 99], {"me": 1}),
            )
            for k in range(6)
        )
    )
    sent = "1553 channel 5 from RT03 SA02"
    np.testing.assert_array_equal(columns.values(f"{sent}/word 01"), 10 * np.arange(6))
    np.testing.assert_array_equal(columns.values(f"{sent}/word 02"), -np.arange(6))
    np.testing.assert_allclose(columns.values(f"{sent}/time"), 0.02 * np.arange(6))
    heard = "1553 channel 5 to RT03 SA04"
    np.testing.assert_array_equal(columns.values(f"{heard}/word 01"), 7 * np.arange(6))
    np.testing.assert_allclose(columns.values(f"{heard}/time"), 50e-6 + 0.02 * np.arange(6))
    between = "1553 channel 5 from RT03 SA05/word 01"
    np.testing.assert_array_equal(columns.values(between), np.arange(6))
    assert columns.contents.ignored == ("1553 messages with errors: 6", "1553 mode codes: 6")
    assert "experimental" in columns.contents.notes[0]


def test_short_messages_have_missing_words_and_a_count_of_0_means_32(recorded):
    columns = recorded(
        bus(FIRST, (0, [command(1, 0, 1, 1), 8, 0], {})),
        bus(FIRST + 9, (0, [command(1, 0, 1, 32), *range(32), 0], {})),
    )
    name = "1553 channel 5 to RT01 SA01"
    np.testing.assert_array_equal(columns.values(f"{name}/word 01"), [8, 0])
    np.testing.assert_array_equal(columns.values(f"{name}/word 32"), [np.nan, 31])


def test_labels_of_arinc_429_carry_their_signed_data(recorded):
    def words(rtc, *values):
        packet = ARINC429F0(data_type=0x38, channel_id=6, rtc=rtc, count=len(values))
        for number, value in enumerate(values):
            backwards = int(f"{0o325:08b}"[::-1], 2)
            word = backwards | 1 << 8 | (value & 0x7FFFF) << 10 | 3 << 29
            packet.append(
                ARINC429F0.Message(
                    struct.pack("<I", word), parent=packet, bus=2, gap_upper=0,
                    gap_time=3000 if number else 0,
                )
            )  # fmt: skip
        return packet

    columns = recorded(words(FIRST, 5, -5), words(FIRST + 200_000, 262143, -262144))
    name = "429 channel 6 bus 2 label 325 source 1"
    np.testing.assert_array_equal(columns.values(f"{name}/data"), [5, -5, 262143, -262144])
    np.testing.assert_allclose(columns.values(f"{name}/time"), [0, 3e-4, 0.02, 0.0203])


def test_discretes_are_read_bit_by_bit(recorded):
    def state(rtc, bits):
        packet = DiscreteF1(data_type=0x29, channel_id=7, rtc=rtc, length=3)
        packet.append(DiscreteF1.Message(struct.pack("<I", bits), parent=packet, ipts=rtc))
        return packet

    columns = recorded(*(state(FIRST + k, k) for k in range(8)))
    name = "discretes channel 7, 3 bits"
    for bit in range(3):
        expected = np.arange(8) >> bit & 1
        np.testing.assert_array_equal(columns.values(f"{name}/bit {bit:02d}"), expected)


def packed(samples, n_bits):
    """Samples one behind the other, the first bits high, in words of 16 bits."""
    bits = "".join(f"{sample:0{n_bits}b}" for sample in samples)
    bits += "0" * (-len(bits) % 16)
    return b"".join(struct.pack("<H", int(bits[k : k + 16], 2)) for k in range(0, len(bits), 16))


PACKINGS = {
    "packed 12": (12, 0, lambda samples: packed(samples, 12)),
    "packed 16": (16, 0, lambda samples: packed(samples, 16)),
    "high bits": (12, 1, lambda samples: (samples << 4).astype("<u2").tobytes()),
    "low bits": (12, 3, lambda samples: (samples | 0xF000).astype("<u2").tobytes()),
}


@pytest.mark.parametrize("packing", PACKINGS)
def test_analog_samples_are_spread_between_their_packets(packing, recorded):
    n_bits, mode, stored = PACKINGS[packing]
    samples = np.arange(64) * 50
    channels = mode | n_bits << 2 | 2 << 16 | 1 << 28  # two, sampled alike
    columns = recorded(
        *(
            ch10_packet(
                0x21, 8, FIRST + k * 80_000,
                struct.pack("<I", channels) + stored(samples[16 * k : 16 * k + 16]),
            )
            for k in range(4)
        )
    )  # fmt: skip
    name = f"analog channel 8, 2 of {n_bits} bits"
    np.testing.assert_array_equal(columns.values(f"{name}/analog 1"), samples[::2])
    np.testing.assert_array_equal(columns.values(f"{name}/analog 2"), samples[1::2])
    np.testing.assert_allclose(columns.values(f"{name}/time"), 0.001 * np.arange(32))
    assert any("spread evenly" in note for note in columns.contents.notes)


def test_set_up_and_clock_give_names_and_the_time_origin(recorded):
    setup = ComputerF1(data_type=1)
    setup.data = b"G\\PN:test;\nR-1\\TK1-2:5;\nR-1\\DSI-2:NAV BUS;\n"
    clock = TimeF1(data_type=0x11, rtc=FIRST - TICKS, date_format=1)
    clock.time = datetime(2024, 5, 1, 9, 30, 0, 250000)
    message = (0, [command(1, 0, 1, 1), 8, 0], {})
    columns = recorded(setup, clock, bus(FIRST, message), bus(FIRST + 9, message))
    assert columns.contents.start == "2024-05-01T09:30:01.250000"
    assert columns.contents.groups[0].name == "1553 channel 5 (NAV BUS) to RT01 SA01"


def test_the_counter_may_wrap_and_packets_may_have_a_second_header(recorded):
    last = (1 << 48) - 100_000
    message = (0, [command(1, 0, 1, 1), 8, 0], {})
    plain = bytes(bus(last, message))
    later = bytearray(bytes(bus(100_000, message)))
    header, body = later[:24], later[24:]
    struct.pack_into("<I", header, 4, len(later) + 12)
    header[14] |= 0x80
    struct.pack_into("<H", header, 22, sum(struct.unpack("<11H", header[:22])) & 0xFFFF)
    columns = recorded(plain, header + bytes(12) + body)
    time = columns.contents.groups[0].time
    np.testing.assert_allclose(columns.values(time), [0, 0.02])


def test_damage_between_packets_is_skipped_with_a_note(recorded):
    message = (0, [command(1, 0, 1, 1), 8, 0], {})
    columns = recorded(
        bus(FIRST, message), b"\x25\xeb noise", bus(FIRST + 9, message), b"\x25\xeb" * 3
    )
    assert columns.contents.groups[0].n_rows == 2
    assert columns.contents.notes[-1] == "Skipped 14 bytes that are not complete packets."


def test_a_recording_without_decodable_channels_is_refused(recorded):
    with pytest.raises(
        TelemetryError, match=r"PCM packets: 2, .* decommutator.*; video packets: 1\)"
    ):
        recorded(*(ch10_packet(kind, 9, FIRST, bytes(40)) for kind in (0x09, 0x09, 0x41)))
