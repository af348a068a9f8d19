"""Read MCAP of ROS 2 and Foxglove: a group is a topic, a signal is a numeric field of it.

Messages in JSON, Protobuf and CDR with ROS 2 definitions are decoded.
"""

from array import array
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import (
    Column,
    Pieces,
    SignalTable,
    library_errors,
    write_tables,
)
from app.telemetry.recording import TelemetryError

MOST_ELEMENTS, DEEPEST = 64, 8
"""Longest array in a message, and deepest nesting; beyond them a field is no signal."""
TIME = "log_time"
NANOSECONDS = 1e9


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read an MCAP file; the times of a topic are those of its records, in s since 1970."""
    with library_errors("MCAP"):
        topics: dict[str, _Topic] = {}
        ignored: dict[str, None] = {}
        n_numbers = 0
        for topic, t, message in _messages(path, ignored):
            known = topics.setdefault(topic, _Topic())
            n_numbers += known.add(t / NANOSECONDS, _numbers(message, topic, ignored))
            if 8 * n_numbers > writer.most_bytes:
                raise TelemetryError(
                    f"the file holds more than {writer.most_bytes / 2**20:.0f} MiB of numbers, the "
                    "limit for its size: export only the time range and topics of this test"
                )
        listed = [*ignored]
        write_tables([known.table(topic) for topic, known in topics.items()], writer, listed)
        return writer.finish("mcap", ignored=listed)


class _Topic:
    """The numbers of one topic so far, by field."""

    def __init__(self) -> None:
        self._t = array("d")
        self._fields: dict[str, array[float]] = {}

    def add(self, t: float, numbers: Mapping[str, float]) -> int:
        """Add a message at t [s]; return how many numbers are stored for it."""
        n_before = len(self._t)
        self._t.append(t)
        for name in numbers.keys() - self._fields.keys():
            self._fields[name] = array("d", [nan]) * n_before
        for name, values in self._fields.items():
            values.append(numbers.get(name, nan))
        return 1 + len(self._fields)

    def table(self, topic: str) -> SignalTable:
        names = sorted(self._fields)
        columns = (
            Column(f"{topic}/{TIME}", "s", time=True),
            *(Column(f"{topic}/{name}") for name in names),
        )
        every = [self._t, *(self._fields[name] for name in names)]
        return SignalTable((topic,), columns, len(self._t), partial(_pieces, every))


def _pieces(every: list["array[float]"]) -> Pieces:
    for number, values in enumerate(every):
        yield number, np.frombuffer(values)


def _messages(path: Path, ignored: dict[str, None]) -> Iterator[tuple[str, int, Any]]:
    """Topic, time [ns] and content of each message that can be decoded."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory as Protobuf
    from mcap_ros2.decoder import DecoderFactory as Ros2

    factories = Protobuf(), Ros2()
    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.id not in decoders:
                encoding = channel.message_encoding
                possible = (factory.decoder_for(encoding, schema) for factory in factories)
                decoders[channel.id] = (
                    msgspec.json.decode
                    if encoding == "json"
                    else next((decoder for decoder in possible if decoder), None)
                )
            decode = decoders[channel.id]
            if decode is None:
                ignored[
                    f"{channel.topic}: messages in {channel.message_encoding or 'no'} encoding"
                ] = None
                continue
            yield channel.topic, message.log_time, decode(message.data)


def _numbers(message: Any, topic: str, ignored: dict[str, None]) -> dict[str, float]:
    """The numbers of a message by the path of their field."""
    numbers: dict[str, float] = {}
    waiting = [("", message, 0)]
    while waiting:
        name, value, depth = waiting.pop()
        if isinstance(value, bool | int | float):
            numbers[name] = float(value)
        elif value is None:
            continue
        elif isinstance(value, str | bytes | bytearray | memoryview):
            ignored[f"{topic}/{name}: text or bytes"] = None
        elif depth == DEEPEST or (_is_sequence(value) and len(value) > MOST_ELEMENTS):
            ignored[f"{topic}/{name}: an array"] = None
        else:
            waiting += [
                (f"{name}.{key}" if name else key, part, depth + 1) for key, part in _parts(value)
            ]
    return numbers


def _is_sequence(value: Any) -> bool:
    return hasattr(value, "__len__") and not isinstance(value, Mapping)


def _parts(value: Any) -> list[tuple[str, Any]]:
    """Members of a JSON object, elements of an array, or fields of a Protobuf or ROS message."""
    if isinstance(value, Mapping):
        return [(str(key), part) for key, part in value.items()]
    if (descriptor := getattr(value, "DESCRIPTOR", None)) is not None:
        return [(field.name, getattr(value, field.name)) for field in descriptor.fields]
    if _is_sequence(value):
        return [(str(number), part) for number, part in enumerate(value)]
    return [(name, getattr(value, name)) for name in getattr(value, "__slots__", ())]
