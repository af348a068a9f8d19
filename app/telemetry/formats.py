"""The file formats that are read, and which of them a file is: its content decides, not its name.

A reader is a module with `read(path, writer) -> Contents`; it is imported where it runs, which is
a process of its own (app.telemetry.reading).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path, PurePath

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.text_tables.blocks import wide_encoding
from app.telemetry.recording import TelemetryError

READERS = "app.telemetry.readers"
HEAD_BYTES = 4096
TEXT = "csv"
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
CONTROLS = bytes({*range(32), 127} - set(b"\t\n\v\f\r\x1a\x1b"))


@dataclass(frozen=True)
class Format:
    """A file format. endings: of names, the usual one first.   reader: its module in READERS.

    looks_like: whether the first HEAD_BYTES of a file are of this format.
    extra: of this package, which the reader needs; "" for none.
    experimental: not proven on files of many recorders.
    """

    key: str
    title: str
    endings: tuple[str, ...]
    looks_like: Callable[[bytes], bool] = field(repr=False)
    reader: str
    extra: str = ""
    experimental: bool = False

    def read(self, path: Path, writer: ColumnWriter) -> Contents:
        """Pour a file into columns. TelemetryError where it cannot be used."""
        return import_module(self.reader, READERS).read(path, writer)


def format_of(path: Path, name: str) -> tuple[Format, tuple[str, ...]]:
    """Return the format of a file that its user calls `name`, and notes on the choice.

    TelemetryError for what is packed, empty or no known format.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise TelemetryError("the file is empty: export or copy it again")
    for magic, what in PACKED.items():
        if head.startswith(magic):
            raise TelemetryError(what)
    ending = PurePath(name).suffix.lower()
    alike = [known for known in FORMATS.values() if known.looks_like(head)]
    alike.sort(key=lambda known: known.key == TEXT)  # which much else looks like
    chosen = next((known for known in alike if ending in known.endings), None)
    if chosen:
        return chosen, ()
    expected = [known for known in FORMATS.values() if ending in known.endings]
    if alike:
        if not expected:
            return alike[0], ()
        return alike[0], (
            f"Read by its content ({alike[0].title}), not by the ending of its name ({ending}).",
        )
    if expected:
        raise TelemetryError(
            f"the name ends in {ending} but the content is not that of a {expected[0].title}, nor "
            "of any other format that is read: it is damaged or misnamed, export it again"
        )
    raise TelemetryError(f"the format is not known: export one of {titles(FORMATS.values())}")


def titles(formats: Iterable[Format]) -> str:
    """The formats with the usual endings of their names, for a sentence."""
    return ", ".join(f"{known.title} ({known.endings[0]})" for known in formats)


def _starts(*magics: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magics)


def _is_hdf5(head: bytes) -> bool:
    """HDF5's signature is at byte 0, or behind a block of the user, as in MATLAB's v7.3 files."""
    return any(head.startswith(HDF5_SIGNATURE, at) for at in (0, 512, 1024, 2048))


def _is_matlab5(head: bytes) -> bool:
    return head[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def _is_ch10(head: bytes) -> bool:
    """A packet's header: its sync pattern, and at its end the sum of its 11 words before."""
    words = [int.from_bytes(head[at : at + 2], "little") for at in range(0, 24, 2)]
    return words[0] == 0xEB25 and sum(words[:11]) & 0xFFFF == words[11]


def _is_journal(head: bytes) -> bool:
    """A line of JSON whose beginning is that of Forewarn's journals."""
    line = head.partition(b"\n")[0]
    return line.startswith(b'{"format":') and b'"flight":' in line and b'"began":' in line


def _is_text(head: bytes) -> bool:
    """UTF-16, or hardly any control characters, in UTF-8 or an 8-bit code; no journal."""
    if wide_encoding(head):
        return True
    return not _is_journal(head) and len(head.translate(None, CONTROLS)) >= 0.99 * len(head)


PACKED = {
    b"PK\x03\x04": "this is a ZIP archive or an Excel workbook: unpack it, or save the sheet as "
    "CSV, and give the file itself",
    b"\x1f\x8b": "this is packed by gzip: unpack it and give the file itself",
    b"BZh": "this is packed by bzip2: unpack it and give the file itself",
    b"\xfd7zXZ\x00": "this is packed by xz: unpack it and give the file itself",
    b"\x28\xb5\x2f\xfd": "this is packed by zstd: unpack it and give the file itself",
    b"7z\xbc\xaf\x27\x1c": "this is a 7z archive: unpack it and give the file itself",
    b"Rar!": "this is a RAR archive: unpack it and give the file itself",
    b"\xd0\xcf\x11\xe0": "this is an old Office document: save the sheet as CSV and give that",
}
FORMATS: dict[str, Format] = {
    known.key: known
    for known in (
        Format(
            TEXT,
            "text table",
            (".csv", ".tsv", ".txt", ".dat", ".asc", ".tab", ".prn"),
            _is_text,
            ".text",
        ),
        Format(
            "parquet",
            "Parquet table",
            (".parquet", ".pq"),
            _starts(b"PAR1"),
            ".parquet",
        ),
        Format(
            "matlab5",
            "MATLAB v5 file",
            (".mat",),
            _is_matlab5,
            ".matlab",
        ),
        Format(
            "hdf5",
            "HDF5 file (MATLAB v7.3 too)",
            (".h5", ".hdf5", ".hdf", ".mat"),
            _is_hdf5,
            ".hdf5",
        ),
        Format(
            "netcdf",
            "NetCDF file",
            (".nc", ".nc4", ".cdf"),
            lambda head: head.startswith(b"CDF") or _is_hdf5(head),
            ".netcdf",
        ),
        Format(
            "ulog",
            "PX4 ULog",
            (".ulg", ".ulog"),
            _starts(b"ULog\x01\x12\x35"),
            ".ulog",
            extra="ulog",
        ),
        Format(
            "mdf4",
            "ASAM MDF",
            (".mf4", ".mdf"),
            _starts(b"MDF     ", b"UnFinMF "),
            ".mdf",
            extra="mdf",
        ),
        Format(
            "ch10",
            "IRIG 106 Chapter 10 recording",
            (".ch10", ".c10", ".i106"),
            _is_ch10,
            ".ch10",
            extra="ch10",
            experimental=True,
        ),
        Format(
            "journal",
            "journal of a live flight",
            (".jsonl",),
            _is_journal,
            ".journal",
        ),
    )
}
