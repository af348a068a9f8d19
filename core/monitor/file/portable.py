"""The portable monitor file: a line of text, a digest, and named sections; never pickle.

FOREWARN MONITOR 3\\n  SHA-256 of everything after it, hexadecimal\\n  an npz archive with
`sections` (JSON: name, version, required, header of each) and the arrays of each, `section/array`

A program refuses an unknown required section and ignores an unknown optional one. So later
additions break only programs that depend on them. Formats 1 and 2, one header with arrays, are
read as these sections.
"""

import hashlib
import io
import json
import math
import struct
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

MAGIC = b"FOREWARN MONITOR "
FORMAT = 3
VERSIONS = {
    "monitor": 1,
    "specification": 1,
    "dictionary": 1,
    "transduction": 1,
    "validity": 2,
    "input": 1,
    "card": 2,
    "peaks": 1,
    "ensemble": 2,
    "groups": 1,
    "members": 1,
    "evaluation": 1,
}
"""Newest supported version of each section."""
INDEX = "sections"
MONITOR_FIELDS = ("dt", "h", "n_early", "dataset_recipe", "dataset_digest", "seed", "version")
MONITOR_ARRAYS = (
    "scale",
    "training_max_abs",
    "unsafe_points",
    "unsafe_where",
    "safe_points",
    "safe_where",
    "theta_unsafe",
    "theta_safe",
    "alphas",
)
UNFOLDS_BY, UNFOLDS_TO = 8, 16 * 2**20
"""Largest size of the arrays: this multiple of the file's size, or this many bytes if more. Trained
monitors take less than twice the file's size."""
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
NO_DIGEST = b"0" * 64
"""Placeholder for the digest while the rest is written."""
SAMPLED, WORTH_SHRINKING = 2**16, 0.75
"""An array is compressed if a sample of this many bytes shrinks below this share."""
LONGEST_TEXT = 4 * 2**20
LONGEST_REASON = 300
DEEPEST = 32
"""Maximum nesting of a header."""
UNREADABLE = (
    *(ValueError, KeyError, TypeError, AttributeError, ArithmeticError, EOFError),
    *(OSError, RecursionError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
"""Errors that the libraries raise on an invalid archive."""
EXACT_ARRAYS = ("points", "unsafe", "safe", "start", "alphas")


class MonitorFileError(ValueError):
    """Not a complete, unaltered monitor in a format that this program reads."""


class Section(NamedTuple):
    """A part of the file.

    required: a program that does not support it must refuse the file.
    header: plain data.   arrays: by name.
    """

    name: str
    version: int
    required: bool
    header: Mapping[str, Any]
    arrays: Mapping[str, npt.NDArray[Any]]


def pack(sections: Iterable[Section]) -> bytes:
    file = io.BytesIO()
    write(file, sections)
    return file.getvalue()


def write(file: BinaryIO, sections: Iterable[Section]) -> None:
    """Write the sections to a seekable file, from its current position."""
    sections = list(sections)
    index = [{key: getattr(part, key) for key in Section._fields[:-1]} for part in sections]
    arrays = {
        f"{part.name}/{key}": array for part in sections for key, array in part.arrays.items()
    }
    arrays[INDEX] = np.frombuffer(json.dumps(index).encode(), np.uint8)
    file.write(MAGIC + str(FORMAT).encode() + b"\n")
    at = file.tell()
    file.write(NO_DIGEST + b"\n")
    body = _Digested(file)
    with zipfile.ZipFile(body, "w") as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, array, version=(1, 0), allow_pickle=False)
            archive.writestr(
                zipfile.ZipInfo(f"{name}.npy"),
                content.getvalue(),
                zipfile.ZIP_DEFLATED if _shrinks(array) else zipfile.ZIP_STORED,
                compresslevel=1,
            )
    file.seek(at)
    file.write(body.digest.hexdigest().encode())
    file.seek(0, io.SEEK_END)


class _Digested(io.RawIOBase):
    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.digest = hashlib.sha256()

    def writable(self) -> bool:
        return True

    def write(self, content: Any) -> int:
        self.digest.update(content)
        return self._file.write(content)


def _shrinks(array: npt.NDArray[Any]) -> bool:
    """Whether compression pays: measurements barely shrink, counts and text do."""
    flat = array.reshape(-1)
    n = max(1, SAMPLED // array.itemsize)
    sample = flat[(len(flat) - min(n, len(flat))) // 2 :][:n].tobytes()
    return len(zlib.compress(sample, 1)) < WORTH_SHRINKING * len(sample)


def unpack(blob: bytes, name: str) -> dict[str, Section]:
    """Check a packed monitor and return the supported sections.

    name: of the file, for error messages.   MonitorFileError.
    """
    title, _, rest = blob.partition(b"\n")
    digest, _, body = rest.partition(b"\n")
    number = title.removeprefix(MAGIC)
    if not title.startswith(MAGIC) or not number.isdigit() or number == b"0":
        raise _not_a_monitor(name)
    if int(number) > FORMAT:
        raise MonitorFileError(
            f"{name} has monitor format {int(number)}, this program reads up to {FORMAT}: "
            "upgrade forewarn or train the monitor again"
        )
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise MonitorFileError(
            f"{name} is cut off or altered (its digest does not match): copy it again from "
            "where it was trained"
        )
    try:
        arrays = _inflate(body)
        if int(number) < FORMAT:
            return _of_older_format(_plain(arrays.pop("header")), arrays)
        return _known([_section(entry, arrays) for entry in _plain(arrays.pop(INDEX))], name)
    except MonitorFileError:
        raise
    except UNREADABLE as error:
        raise MonitorFileError(
            f"{name} holds no monitor ({in_short(error)}): choose a file written by "
            "`forewarn train`"
        ) from error


def _inflate(body: bytes) -> dict[str, npt.NDArray[Any]]:
    """Arrays of an npz archive, whose sizes are checked before any is inflated."""
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        members = archive.infolist()
        most = max(UNFOLDS_TO, UNFOLDS_BY * len(body))
        if (size := sum(member.file_size for member in members)) > most:
            raise ValueError(f"its {len(body)} bytes unpack to {size}, more than {most}")
        if any(member.compress_type not in COMPRESSIONS for member in members):
            raise ValueError("it uses an unsupported compression")
        if len({member.filename for member in members}) < len(members):
            raise ValueError("it has two arrays with the same name")
        return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[Any]:
    """One array of numbers. ValueError if its declared size is wrong."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else None
        if header is None:
            raise ValueError(f"{member.filename} has an unsupported array format")
        shape, by_columns, dtype = header(file)
        if dtype.kind not in "biuf":
            raise ValueError(f"{member.filename} holds {dtype} instead of numbers")
        if math.prod(shape) * dtype.itemsize != member.file_size - file.tell():
            raise ValueError(f"{member.filename} does not have its declared shape {shape}")
        flat = np.frombuffer(file.read(), dtype)
    return flat.reshape(shape, order="F" if by_columns else "C").copy(order="K")


def _plain(text: npt.NDArray[Any]) -> Any:
    """Content of a JSON array. ValueError if it is too long or cannot be sent on."""
    if text.nbytes > LONGEST_TEXT:
        raise ValueError(f"its header has {text.nbytes} bytes")
    plain = json.loads(text.tobytes())
    _check_plain(plain)
    return plain


def _check_plain(value: object, depth: int = 0) -> None:
    """Refuse data that cannot be stored or sent on: non-finite, not text, or too deep."""
    if depth > DEEPEST:
        raise ValueError(f"its header nests deeper than {DEEPEST} levels")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"its header holds {value}, which is not finite")
    if isinstance(value, str):
        value.encode()
    if isinstance(value, Mapping):
        value = [*value, *value.values()]
    if isinstance(value, list):
        for part in value:
            _check_plain(part, depth + 1)


def in_short(error: BaseException) -> str:
    """Text of an error on one line, shortened."""
    text = " ".join(str(error).split())
    return text if len(text) <= LONGEST_REASON else f"{text[: LONGEST_REASON - 3]}..."


def _section(entry: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> Section:
    prefix = f"{entry['name']}/"
    section_arrays = {
        key.removeprefix(prefix): a for key, a in arrays.items() if key.startswith(prefix)
    }
    section = Section(**entry, arrays=section_arrays)
    kinds = {"name": str, "version": int, "required": bool, "header": dict}
    if wrong := [key for key, kind in kinds.items() if type(getattr(section, key)) is not kind]:
        raise ValueError(f"a section's {wrong[0]} is {getattr(section, wrong[0])!r}")
    return section


def _known(sections: Iterable[Section], name: str) -> dict[str, Section]:
    """Supported sections. MonitorFileError for an unsupported required one."""
    known = {}
    for section in sections:
        if section.name in known:
            raise ValueError(f"it has the section {section.name!r} twice")
        if section.version <= VERSIONS.get(section.name, 0):
            known[section.name] = section
        elif section.required:
            raise MonitorFileError(
                f"{name} needs section {section.name!r} version {section.version}, which this "
                "program does not support: upgrade forewarn or train the monitor again"
            )
    return known


def _of_older_format(
    header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]
) -> dict[str, Section]:
    """Sections of a file in format 1 or 2; its limits are in the recipe of its dataset."""
    renamed = {"training_max_abs": "reach"}
    monitor = {key: arrays[renamed.get(key, key)] for key in (*MONITOR_ARRAYS, "matrix", "offset")}
    specification = {"specification": header["dataset_recipe"].get("specification") or None}
    sections = [
        Section("monitor", 1, True, header, monitor),
        Section("specification", 1, True, specification, {}),
    ]
    exact = {key: arrays[f"exact_{key}"] for key in EXACT_ARRAYS}
    if len(exact["start"]):
        sections.append(Section("transduction", 1, True, header["exact"], exact))
    if header.get("support"):
        support = {key: arrays[f"support_{key}"] for key in ("sigma", "safe", "unsafe")}
        sections.append(Section("validity", 1, True, header["support"], support))
    return {section.name: section for section in sections}


def _not_a_monitor(name: str | Path) -> MonitorFileError:
    return MonitorFileError(
        f"{name} is not a Forewarn monitor: choose a file written by `forewarn train`"
    )


def read(path: str | Path) -> bytes:
    """Content of a file. MonitorFileError if missing, or if it does not start as a monitor."""
    try:
        with Path(path).open("rb") as file:
            start = file.read(len(MAGIC))
            if start != MAGIC:  # it may be a recording larger than memory
                raise _not_a_monitor(path)
            return start + file.read()
    except OSError as error:
        raise MonitorFileError(
            f"{path} cannot be read ({error.strerror}): give the path of a monitor file"
        ) from error
