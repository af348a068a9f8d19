"""The same telemetry in a file of every format, as the usual programs write it."""

import json
import struct
import warnings
from collections.abc import Callable
from datetime import datetime
from importlib import import_module
from pathlib import Path

import numpy as np

from app.telemetry.contents import Columns, ColumnWriter, open_columns

N = 400
T = 0.02 * np.arange(N)
BETA = np.where(np.arange(N) == 7, np.nan, 3 * np.sin(T))
"""[deg], one sample missing."""
P = np.cos(2 * T)
"""[deg/s]"""


def read(reader: str, path: Path, *, most_bytes: int = 1 << 30) -> Columns:
    """The columns of a file, which a reader writes beside it."""
    folder = path.with_name(f"{path.name}.columns")
    folder.mkdir()
    module = import_module(f"app.telemetry.readers.{reader}")
    module.read(path, ColumnWriter(folder, most_bytes))
    return open_columns(folder)


def parquet(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    beta = pa.field("beta", pa.float64(), metadata={"unit": "deg"})
    table = pa.table(
        [pa.array(T), pa.array(BETA, from_pandas=True), pa.array(P)],
        schema=pa.schema([pa.field("time [s]", pa.float64()), beta, ("p [deg/s]", pa.float64())]),
    )
    pq.write_table(table, path, row_group_size=150)


def matlab5(path: Path) -> None:
    from scipy.io import savemat

    units = {"beta": "deg", "p": "deg/s", "time": "s"}
    savemat(path, {"time": T, "beta": BETA[:, None], "p": P, "units": units}, do_compression=True)


def matlab73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time", T), ("beta", BETA), ("p", P)):
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_(b"double")
        for name, unit in (("beta_unit", "deg"), ("p_unit", "deg/s"), ("time_unit", "s")):
            file[name] = np.frombuffer(unit.encode("utf-16-le"), "<u2")[:, None]
            file[name].attrs["MATLAB_class"] = np.bytes_(b"char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values, unit in (("time", T, "s"), ("beta", BETA, "deg"), ("p", P, "deg/s")):
            made = file.create_dataset(f"air/{name}", data=values, chunks=(64,), compression="gzip")
            made.attrs["units"] = unit


def netcdf3(path: Path) -> None:
    from scipy.io import netcdf_file

    with netcdf_file(path, "w") as file:
        file.createDimension("time", N)
        for name, values, unit in (
            ("time", T, b"seconds since 2024-05-01 09:30:00"),
            ("beta", BETA, b"deg"),
            ("p", P, b"deg/s"),
        ):
            made = file.createVariable(name, "f8", ("time",))
            made[:] = values
            made.units = unit


def netcdf4(path: Path) -> None:
    import netCDF4

    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", None)
        for name, values, unit in (
            ("time", T, "seconds since 2024-05-01 09:30:00"),
            ("beta", np.ma.masked_invalid(BETA), "deg"),
            ("p", P, "deg/s"),
        ):
            made = file.createVariable(name, "f8", ("time",), zlib=True)
            made[:] = values
            made.units = unit


def mdf(path: Path, version: str, compression: int = 0) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from asammdf import MDF, Signal

        with MDF(version=version) as file:  # pyright: ignore[reportArgumentType]
            beta, p = (
                Signal(values, T, name=name, unit=unit)
                for name, values, unit in (("beta", BETA, "deg"), ("p", P, "deg/s"))
            )
            file.append([beta, p], comment="air")
            file.header.start_time = datetime.fromisoformat("2024-05-01T09:30:00+00:00")
            file.save(path, overwrite=True, compression=compression)  # pyright: ignore


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        file.write_segment(
            [
                ChannelObject("air", name, values, {"unit_string": unit})
                for name, values, unit in (
                    ("Time", T, "s"),
                    ("beta", BETA, "deg"),
                    ("p", P, "deg/s"),
                )
            ]
        )


def mcap(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Air", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("air", "json", schema)
        for t, beta, p in zip(T, BETA, P, strict=True):
            at = round(1e9 * t)
            plain = {"beta": None if np.isnan(beta) else beta, "p": p, "note": "calm"}
            writer.add_message(channel, at, json.dumps(plain).encode(), at)
        writer.finish()


def ulog(path: Path) -> None:
    messages = [
        ulog_message("B", bytes(40)),
        ulog_message("F", b"air:uint64_t timestamp;float beta;float p;"),
        ulog_message("A", struct.pack("<BH", 0, 0) + b"air"),
    ]
    messages += [
        ulog_message("D", struct.pack("<HQff", 0, round(1e6 * t), beta, p))
        for t, beta, p in zip(T, BETA, P, strict=True)
    ]
    path.write_bytes(ULOG_START + b"".join(messages))


ULOG_START = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)


def ulog_message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def ch10(path: Path) -> None:
    """Messages of two words, 100 times beta and p, which is what a bus knows of them."""
    words = np.nan_to_num(100 * np.column_stack([BETA, P])).round().astype("<i2")
    command = 3 << 11 | 1 << 10 | 2 << 5 | 2
    packets = b""
    for t, row in zip(T, words, strict=True):
        rtc = 5_000_000 + round(1e7 * t)
        data = struct.pack("<HH", command, 3 << 11) + row.tobytes()
        body = struct.pack("<IQHHH", 1, rtc, 0, 0, len(data)) + data
        packets += ch10_packet(0x19, 5, rtc, body)
    path.write_bytes(packets)


def ch10_packet(kind: int, channel: int, rtc: int, body: bytes) -> bytes:
    whole = body + bytes(-len(body) % 4)
    header = struct.pack("<HHIIBBBB", 0xEB25, channel, 24 + len(whole), len(body), 6, 0, 0, kind)
    header += rtc.to_bytes(6, "little")
    return header + struct.pack("<H", sum(struct.unpack("<11H", header)) & 0xFFFF) + whole


FILES: dict[str, tuple[str, str, Callable[[Path], None]]] = {
    "parquet": ("parquet", ".parquet", parquet),
    "matlab 5": ("matlab", ".mat", matlab5),
    "matlab 7.3": ("hdf5", ".mat", matlab73),
    "hdf5": ("hdf5", ".h5", hdf5),
    "netcdf 3": ("netcdf", ".nc", netcdf3),
    "netcdf 4": ("netcdf", ".nc", netcdf4),
    "tdms": ("tdms", ".tdms", tdms),
    "mcap": ("mcap", ".mcap", mcap),
    "ulog": ("ulog", ".ulg", ulog),
    "mdf 4": ("mdf", ".mf4", lambda path: mdf(path, "4.10")),
    "mdf 4 deflated": ("mdf", ".mf4", lambda path: mdf(path, "4.11", 2)),
    "ch10": ("ch10", ".ch10", ch10),
}
"""Reader, ending and writer of each kind of file."""
