"""Recordings of PX4 autopilots, written here by the ULog specification."""

import struct

import numpy as np
import pytest

from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import ULOG_START, read, ulog_message

pytest.importorskip("pyulog")


@pytest.fixture
def logged(tmp_path):
    """Formats and later messages -> columns of a log of them."""

    def _logged(formats, *messages):
        path = tmp_path / "log.ulg"
        defined = b"".join(ulog_message("F", text.encode()) for text in formats)
        path.write_bytes(ULOG_START + ulog_message("B", bytes(40)) + defined + b"".join(messages))
        return read("ulog", path)

    return _logged


def subscribed(number, topic, instance=0):
    return ulog_message("A", struct.pack("<BH", instance, number) + topic.encode())


def data(number, layout, *values):
    return ulog_message("D", struct.pack(f"<H{layout}", number, *values))


def test_each_instance_of_a_topic_is_a_group_with_its_times(logged):
    columns = logged(
        ["gyro:uint64_t timestamp;float x;", "air:uint64_t timestamp;float beta;"],
        subscribed(0, "gyro"),
        subscribed(1, "gyro", 1),
        subscribed(2, "air"),
        *(data(0, "Qf", 1_000_000 + 2500 * k, k) for k in range(8)),
        *(data(1, "Qf", 2_000_000 + 2500 * k, -k) for k in range(4)),
        *(data(2, "Qf", 500_000 * k, k) for k in range(3)),
    )
    groups = {group.name: (group.n_rows, group.time) for group in columns.contents.groups}
    assert groups == {
        "gyro_0": (8, "gyro_0/timestamp"),
        "gyro_1": (4, "gyro_1/timestamp"),
        "air": (3, "air/timestamp"),
    }
    np.testing.assert_allclose(columns.values("gyro_1/timestamp"), 2 + 0.0025 * np.arange(4))
    np.testing.assert_array_equal(columns.values("gyro_1/x"), -np.arange(4))


def test_nested_messages_arrays_texts_and_padding(logged):
    columns = logged(
        [
            "rotor:int16_t rpm;bool on;",
            "esc:uint64_t timestamp;rotor[2] motor;float[4] q;char[2] who;uint8_t[70] map;"
            "uint8_t[2] _padding0;",
        ],
        subscribed(0, "esc"),
        *(
            data(0, "Qh?h?4f2s70B", 1000 * k, k, 1, -k, 0, 1, 2, 3, k, b"ab", *range(70))
            for k in range(3)
        ),
    )
    names = [signal.name.removeprefix("esc/") for signal in columns.contents.signals]
    assert names == [
        "timestamp", "motor[0].rpm", "motor[0].on", "motor[1].rpm", "motor[1].on",
        "q[0]", "q[1]", "q[2]", "q[3]",
    ]  # fmt: skip
    np.testing.assert_array_equal(columns.values("esc/motor[1].rpm"), [0, -1, -2])
    np.testing.assert_array_equal(columns.values("esc/q[3]"), [0, 1, 2])
    assert columns.contents.ignored == ("esc/map: an array", "esc/who: text")


def test_dropouts_are_noted(logged):
    samples = [data(0, "Qf", 1000 * k, k) for k in range(4)]
    dropouts = [ulog_message("O", struct.pack("<H", ms)) for ms in (250, 1500)]
    columns = logged(
        ["air:uint64_t timestamp;float beta;"], subscribed(0, "air"), *samples, *dropouts
    )
    assert columns.contents.notes == (
        "The logger dropped data: 2 dropouts, 1.75 s in total, the longest 1.5 s.",
    )


def test_damaged_parts_are_dropped_with_a_note(logged):
    columns = logged(
        ["air:uint64_t timestamp;float beta;"],
        subscribed(0, "air"),
        *(data(0, "Qf", 1000 * k, k) for k in range(4)),
        data(0, "B", 7),
        data(9, "Qf", 1, 1),
        *(data(0, "Qf", 1000 * k, k) for k in range(4, 6)),
    )
    np.testing.assert_array_equal(columns.values("air/beta"), np.arange(6))
    assert columns.contents.notes == ("Dropped damaged parts of the file.",)


def test_a_message_of_itself_is_refused(logged):
    with pytest.raises(TelemetryError, match="ULog file is damaged"):
        logged(["a:uint64_t timestamp;b x;", "b:a y;"], subscribed(0, "a"))
