"""Hostile Parquet, ULog, MDF, Chapter 10 and compressed files."""

import gzip
import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.recorded_files import ULOG_START, ch10_packet, mdf, ulog_message


def nulls_without_end(path: Path) -> None:
    nulls = pa.nulls(5_000_000, pa.float64())
    pq.write_table(pa.table({f"x{k}": nulls for k in range(14)}), path)


def fields_without_end(path: Path) -> None:
    pq.write_table(pa.table({f"x{k}": [0.0, 1.0] for k in range(5000)}), path)


def lists_in_lists(path: Path) -> None:
    column = pa.array([[1.0]])
    for _ in range(60):
        column = pa.ListArray.from_arrays([0, 1], column)
    pq.write_table(pa.table({"x": column}), path)


def odd_names(path: Path) -> None:
    names = ["\0", "a\nb", " ", "\u202ebeta", "x" * 5000, "", "\x1b[2J", "t"]
    pq.write_table(pa.table([[0.0, 1.0]] * len(names), names=names), path)


def message_of_itself(path: Path) -> None:
    words = ulog_message("F", b"a:uint64_t timestamp;a inner;")
    path.write_bytes(ULOG_START + words + ulog_message("A", b"\0\0\0a"))


def messages_of_messages(path: Path) -> None:
    words = [ulog_message("F", b"m0:uint64_t timestamp;float x;")]
    words += [ulog_message("F", f"m{k}:m{k - 1}[9] a;".encode()) for k in range(1, 12)]
    path.write_bytes(ULOG_START + b"".join(words) + ulog_message("A", b"\0\0\0m11"))


def definitions_cut_short(path: Path) -> None:
    """The library steps back over what it could not read, each time to the same place."""
    words = ulog_message("F", b"a:uint64_t timestamp;float x;")
    path.write_bytes(ULOG_START + words + struct.pack("<HB", len(words) + 3, 0) + b"xx")


def messages_without_end(path: Path) -> None:
    path.write_bytes(ULOG_START + b"\0\0\xff" * 20_000 + b"\xff\xff\xff" * 30)


def recorded(path: Path) -> bytearray:
    """An MDF file."""
    whole = path.with_suffix(".mf4")
    mdf(whole, "4.10")
    content = bytearray(whole.read_bytes())
    whole.unlink()
    return content


def blocks_in_circles(path: Path) -> None:
    content = recorded(path)
    first = content.index(b"##CN")
    struct.pack_into("<Q", content, first + 24, first)
    path.write_bytes(content)


def records_without_end(path: Path) -> None:
    content = recorded(path)
    first = content.index(b"##CG")
    struct.pack_into("<Q", content, first + 24 + 8 * 6 + 8, 1 << 50)
    path.write_bytes(content)


def channel_outside(path: Path) -> None:
    """A channel far behind the end of its records, which the library writes out of bounds for."""
    content = recorded(path)
    at = content.rindex(b"##CN")
    struct.pack_into("<I", content, at + 24 + 8 * 8 + 4, 1 << 20)
    path.write_bytes(content)


def packets_of_all_kinds(path: Path) -> None:
    packets = (ch10_packet(k, k, 1000 * k, bytes(range(200))) for k in range(256))
    path.write_bytes(b"".join(packets))


def packets_of_all_times(path: Path) -> None:
    body = struct.pack("<IQHHH", 1, 0, 0, 0, 4) + struct.pack("<HH", 3 << 11 | 2 << 5 | 1, 7)
    times = (0, (1 << 48) - 1, 1 << 47, 5, 0)
    path.write_bytes(b"".join(ch10_packet(0x19, 5, time, body) for time in times))


def zip_bomb(path: Path) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("flight.csv", "0,0\n" * 2_000_000)
    path.write_bytes(packed.getvalue())


NAMED: tuple[Callable[[Path], object], ...] = (
    nulls_without_end,
    fields_without_end,
    lists_in_lists,
    message_of_itself,
    messages_of_messages,
    definitions_cut_short,
    messages_without_end,
    blocks_in_circles,
    records_without_end,
    channel_outside,
    packets_of_all_kinds,
    packets_of_all_times,
    zip_bomb,
)
RECORDS: dict[str, Callable[[Path], object]] = {
    **{make.__name__: make for make in NAMED},
    "odd_names_of_columns": odd_names,
    "gzip_bomb": lambda path: path.write_bytes(gzip.compress(b"0,0\n" * 2_000_000)),
    "empty": lambda path: path.write_bytes(b""),
    "one_byte": lambda path: path.write_bytes(b"P"),
    "zeros": lambda path: path.write_bytes(bytes(5000)),
}
