"""Recordings in MCAP, as its libraries write them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.wrappers_pb2 import DoubleValue
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

from app.telemetry.contents import Columns
from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import read

SECOND = 1_000_000_000
IMU = """\
float64[3] rate
std_msgs/Header header
================================================================================
MSG: std_msgs/Header
string frame
uint32 number
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "recording.mcap"


def in_json(path: Path, *messages: Any, most_bytes: int = 1 << 30) -> Columns:
    """A topic `air` with a message each second."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("air", "json", 0)
        for second, message in enumerate(messages):
            writer.add_message(channel, second * SECOND, json.dumps(message).encode(), 0)
        writer.finish()
    return read("mcap", path, most_bytes=most_bytes)


def test_nested_fields_and_short_arrays_are_signals(path: Path) -> None:
    columns = in_json(path, *({"at": {"p": k}, "rates": [k, 2 * k]} for k in range(3)))
    for name, values in (("at.p", [0, 1, 2]), ("rates.0", [0, 1, 2]), ("rates.1", [0, 2, 4])):
        np.testing.assert_array_equal(columns.values(f"air/{name}"), values)
    np.testing.assert_array_equal(columns.values("air/log_time"), [0, 1, 2])


def test_a_field_that_a_message_lacks_is_missing(path: Path) -> None:
    columns = in_json(path, {"p": 1}, {"p": 2, "r": 3}, {"p": None, "r": 4})
    assert columns.contents.ignored == ()
    np.testing.assert_array_equal(columns.values("air/p"), [1, 2, np.nan])
    np.testing.assert_array_equal(columns.values("air/r"), [np.nan, 3, 4])


def test_texts_and_long_arrays_are_named(path: Path) -> None:
    columns = in_json(path, *({"p": 1, "note": "calm", "map": [0] * 65} for _ in range(2)))
    assert set(columns.contents.ignored) == {"air/note: text or bytes", "air/map: an array"}


def test_more_numbers_than_may_be_written_are_refused(path: Path) -> None:
    with pytest.raises(TelemetryError, match="export only the time range"):
        in_json(path, *({"p": k} for k in range(100)), most_bytes=1000)


def test_protobuf_is_decoded_by_its_own_definition(path: Path) -> None:
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for second in range(3):
            writer.write_message("alpha", DoubleValue(value=0.1 * second), second * SECOND)
    np.testing.assert_allclose(read("mcap", path).values("alpha/value"), [0, 0.1, 0.2])


def test_ros_2_is_decoded_by_its_own_definition(path: Path) -> None:
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef("test/Imu", IMU)
        for second in range(3):
            message = {"rate": [second, 0, 0], "header": {"frame": "body", "number": second}}
            writer.write_message("imu", schema, message, second * SECOND)
        writer.finish()
    columns = read("mcap", path)
    np.testing.assert_array_equal(columns.values("imu/rate.0"), [0, 1, 2])
    np.testing.assert_array_equal(columns.values("imu/header.number"), [0, 1, 2])


def test_an_unknown_encoding_is_named(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, encoding in (("air", "json"), ("odd", "x")):
            channel = writer.register_channel(topic, encoding, 0)
            for k in range(2):
                writer.add_message(channel, k, b'{"p": 1}', k)
        writer.finish()
    assert read("mcap", path).contents.ignored == ("odd: messages in x encoding",)
