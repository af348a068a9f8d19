"""The portable monitor file: one line of text, a digest, and named sections; never pickle.

FOREWARN MONITOR 3\\n  sha-256 of all that follows, hexadecimal\\n  an npz archive with `sections`
(JSON: name, version, required, header of each) and the arrays of each, `section/array`

A program refuses a required section that it does not know and ignores an optional one, so that a
later program's additions break nothing that does not depend on them. Formats 1 and 2, one header
with arrays beside it, are read as these sections.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

MAGIC = b"FOREWARN MONITOR "
FORMAT = 3
VERSIONS = {"monitor": 1, "specification": 1, "transduction": 1, "validity": 1, "evaluation": 1}
"""Newest version of each section that this program knows."""
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
SUPPORT_ARRAYS = ("sigma", "safe", "unsafe")
SUPPORT_FIELDS = ("n_samples", "level")
EXACT_ARRAYS = ("points", "unsafe", "safe", "start", "alphas")


class MonitorFileError(ValueError):
    """A file that is not a whole, unaltered monitor of a version this program reads."""


class Section(NamedTuple):
    """A part of the file.

    required: whether a program that does not know it must refuse the file.
    header: plain data.   arrays: by name.
    """

    name: str
    version: int
    required: bool
    header: Mapping[str, Any]
    arrays: Mapping[str, npt.NDArray[Any]]


def pack(sections: Iterable[Section]) -> bytes:
    """Return the file of these sections."""
    sections = list(sections)
    index = [{key: getattr(part, key) for key in Section._fields[:-1]} for part in sections]
    arrays = {
        f"{part.name}/{key}": array for part in sections for key, array in part.arrays.items()
    }
    arrays[INDEX] = np.frombuffer(json.dumps(index).encode(), np.uint8)
    archive = io.BytesIO()
    np.savez_compressed(archive, allow_pickle=False, **arrays)
    body = archive.getvalue()
    digest = hashlib.sha256(body).hexdigest().encode()
    return MAGIC + str(FORMAT).encode() + b"\n" + digest + b"\n" + body


def unpack(blob: bytes, name: str) -> dict[str, Section]:
    """Check a packed monitor and return the sections that this program knows.

    name: what errors call the file.   MonitorFileError.
    """
    title, _, rest = blob.partition(b"\n")
    digest, _, body = rest.partition(b"\n")
    number = title.removeprefix(MAGIC)
    if not title.startswith(MAGIC) or not number.isdigit() or number == b"0":
        raise MonitorFileError(
            f"{name} is not a Forewarn monitor: choose a file written by `forewarn train`"
        )
    if int(number) > FORMAT:
        raise MonitorFileError(
            f"{name} has monitor format {int(number)}, this program reads up to {FORMAT}: "
            "upgrade forewarn or train the monitor again"
        )
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise MonitorFileError(
            f"{name} is cut off or was altered, its digest does not match: copy it again from "
            "where it was trained"
        )
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
        if int(number) < FORMAT:
            return _of_older_format(json.loads(arrays.pop("header").tobytes()), arrays)
        index = json.loads(arrays.pop(INDEX).tobytes())
        sections = [_section(entry, arrays) for entry in index]
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise MonitorFileError(
            f"{name} holds no monitor ({error}): choose a file written by `forewarn train`"
        ) from error
    return _known(sections, name)


def _section(entry: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> Section:
    prefix = f"{entry['name']}/"
    own = {key.removeprefix(prefix): a for key, a in arrays.items() if key.startswith(prefix)}
    return Section(**entry, arrays=own)


def _known(sections: Iterable[Section], name: str) -> dict[str, Section]:
    """The sections that are known here; MonitorFileError for a required one that is not."""
    known = {}
    for section in sections:
        if section.version <= VERSIONS.get(section.name, 0):
            known[section.name] = section
        elif section.required:
            raise MonitorFileError(
                f"{name} has a section {section.name!r}, version {section.version}, which this "
                "program does not know and must not ignore: upgrade forewarn or train the monitor "
                "again"
            )
    return known


def _of_older_format(
    header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]
) -> dict[str, Section]:
    """The sections of a file of format 1 or 2; its limits are those of its dataset's recipe."""
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
        support = {key: arrays[f"support_{key}"] for key in SUPPORT_ARRAYS}
        sections.append(Section("validity", 1, True, header["support"], support))
    return {section.name: section for section in sections}


def read(path: str | Path) -> bytes:
    """Read the file's bytes; MonitorFileError where there is no such file."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise MonitorFileError(
            f"{path} cannot be read ({error.strerror}): give the path of a monitor file"
        ) from error
