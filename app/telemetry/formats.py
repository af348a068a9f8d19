"""The supported file formats; the content of a file decides its format, not the name.

A reader is a module with `read(path, writer) -> Contents`. It is imported in the process that runs
it (app.telemetry.reading).
"""

import codecs
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from app.telemetry.recording import TelemetryError

READERS = "app.telemetry.readers"
LIBRARIES = {
    "ulog": "pyulog",
    "mdf": "asammdf",
    "tdms": "nptdms",
    "mcap": "mcap",
    "ch10": "chapter10",
}
"""The module that an extra installs."""
HEAD_BYTES = 4096
TEXT = "csv"
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
ZIP = b"PK\x03\x04"
CONTROLS = bytes({*range(32), 127} - set(b"\t\n\v\f\r\x1a\x1b"))


@dataclass(frozen=True)
class Format:
    """A file format. names: endings of file names, the usual one first.

    reader: module in READERS.   looks_like: whether the first HEAD_BYTES have this format.
    extra: optional dependency of this package that the reader needs, "" for none.
    experimental: not tested on files of many recorders.
    """

    key: str
    title: str
    names: str
    looks_like: Callable[[bytes], bool] = field(repr=False)
    reader: str
    extra: str = ""
    experimental: bool = False

    @property
    def endings(self) -> tuple[str, ...]:
        return tuple(self.names.split())


def files_of(folder: Path) -> list[Path]:
    """The files of a folder in the order of their names, without hidden ones."""
    return sorted(path for path in folder.iterdir() if path.is_file() and path.name[0] != ".")


def head_of(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


def format_of(path: Path, name: str) -> tuple[Format, tuple[str, ...]]:
    """The format of a file with the original name `name`, and notes on the choice.

    Raises TelemetryError for archives, empty files and unknown formats.
    """
    head = head_of(path)
    if not head:
        raise TelemetryError("the file is empty: export or copy it again")
    if remedy := next((PACKED[magic] for magic in PACKED if head.startswith(magic)), ""):
        raise TelemetryError(remedy)
    ending = PurePath(name).suffix.lower()
    matches = [known for known in FORMATS.values() if known.looks_like(head)]
    matches.sort(key=lambda known: known.key == TEXT)  # other formats can look like text
    chosen = next((known for known in matches if ending in known.endings), None)
    if chosen:
        return chosen, ()
    expected = next((known for known in FORMATS.values() if ending in known.endings), None)
    if matches:
        note = f"Read as {matches[0].title} by its content, although its name ends in {ending}."
        return matches[0], (note,) if expected else ()
    if expected:
        raise TelemetryError(
            f"the name ends in {ending}, but the content is neither {expected.title} nor any "
            "other supported format: the file is damaged or misnamed, export it again"
        )
    titles = (f"{known.title} ({known.endings[0]})" for known in FORMATS.values())
    raise TelemetryError(f"unknown file format: export one of {', '.join(titles)}")


def _starts(*magics: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magics)


def _is_hdf5(head: bytes) -> bool:
    """HDF5's signature is at byte 0, or after a user block, as in MATLAB v7.3 files."""
    return any(head.startswith(HDF5_SIGNATURE, at) for at in (0, 512, 1024, 2048))


def _is_netcdf(head: bytes) -> bool:
    return head.startswith(b"CDF") or _is_hdf5(head)


def _is_matlab5(head: bytes) -> bool:
    return head[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def _has_arrays(head: bytes) -> bool:
    return head.startswith(ZIP) or _is_hdf5(head) or _is_matlab5(head)


def _is_ch10(head: bytes) -> bool:
    """Check the packet header: sync pattern, and the sum of its first 11 words at the end."""
    words = [int.from_bytes(head[at : at + 2], "little") for at in range(0, 24, 2)]
    return words[0] == 0xEB25 and sum(words[:11]) & 0xFFFF == words[11]


def _is_journal(head: bytes) -> bool:
    line = head.partition(b"\n")[0]
    return line.startswith(b'{"format":') and b'"flight":' in line and b'"began":' in line


def wide_encoding(head: bytes) -> str:
    """UTF-16 by its byte order mark, or by zeros in every other byte; else ""."""
    if head.startswith(codecs.BOM_UTF16_LE):
        return "utf-16-le"
    if head.startswith(codecs.BOM_UTF16_BE):
        return "utf-16-be"
    even, odd = head[::2].count(0), head[1::2].count(0)
    if max(even, odd) > 0.4 * len(head) and min(even, odd) == 0:
        return "utf-16-le" if odd else "utf-16-be"
    return ""


def _is_text(head: bytes) -> bool:
    """UTF-16, or almost no control characters; not a journal."""
    if wide_encoding(head):
        return True
    return not _is_journal(head) and len(head.translate(None, CONTROLS)) >= 0.99 * len(head)


PACKED = {
    ZIP: "this is a ZIP archive or an Excel workbook: unpack the archive, or save the "
    "sheet as CSV, and give that file",
    b"\xd0\xcf\x11\xe0": "this is an old Office document: save the sheet as CSV and give that file",
} | {
    magic: f"this is a {archive} archive: unpack it and give the file inside"
    for magic, archive in (
        (b"\x1f\x8b", "gzip"),
        (b"BZh", "bzip2"),
        (b"\xfd7zXZ\x00", "xz"),
        (b"\x28\xb5\x2f\xfd", "zstd"),
        (b"7z\xbc\xaf\x27\x1c", "7z"),
        (b"Rar!", "RAR"),
    )
}
"""Messages by the first bytes of a file."""
FOLDER = Format("folder", "folder of flights", "", lambda _: False, ".folder")
"""A folder with one file for each flight, read as one long table."""
UNNAMED = "channels"
"""Ignored part of a file of rollouts that does not name its channels."""
ROLLOUTS = Format("rollouts", "arrays of rollouts", ".npz", _has_arrays, ".rollout_arrays")
"""Arrays of many flights, read only where rollouts are expected."""
FORMATS: dict[str, Format] = {
    known.key: known
    for known in (
        Format(TEXT, "text table", ".csv .tsv .txt .dat .asc .tab .prn", _is_text, ".text"),
        Format("parquet", "Parquet table", ".parquet .pq", _starts(b"PAR1"), ".parquet"),
        Format("matlab5", "MATLAB v5 file", ".mat", _is_matlab5, ".matlab"),
        Format("hdf5", "HDF5 file (MATLAB v7.3 too)", ".h5 .hdf5 .hdf .mat", _is_hdf5, ".hdf5"),
        Format("netcdf", "NetCDF file", ".nc .nc4 .cdf", _is_netcdf, ".netcdf"),
        Format("ulog", "PX4 ULog", ".ulg .ulog", _starts(b"ULog\x01\x12\x35"), ".ulog", "ulog"),
        Format("mdf4", "ASAM MDF", ".mf4 .mdf", _starts(b"MDF     ", b"UnFinMF "), ".mdf", "mdf"),
        Format("tdms", "LabVIEW TDMS", ".tdms", _starts(b"TDSm"), ".tdms", "tdms"),
        Format("mcap", "MCAP of ROS 2", ".mcap", _starts(b"\x89MCAP0\r\n"), ".mcap", "mcap"),
        Format(
            "ch10", "IRIG 106 Chapter 10 recording", ".ch10 .c10 .i106", _is_ch10, ".ch10",
            extra="ch10", experimental=True,
        ),
        Format("journal", "journal of a live flight", ".jsonl", _is_journal, ".journal"),
    )
}  # fmt: skip
