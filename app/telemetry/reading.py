"""From a file to a folder of columns, whatever the file does to its reader."""

import logging
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.telemetry.contents import Columns, Contents, open_columns, printable
from app.telemetry.formats import Format, format_of
from app.telemetry.readers import isolation
from app.telemetry.recording import TelemetryError

log = logging.getLogger(__name__)
MIB, GIB = 2**20, 2**30
LONGEST_SENTENCE = 1000


@dataclass(frozen=True)
class ReadLimits:
    """What the reading of one file may cost.

    most_bytes: of numbers that it may unfold to, at most `unfolds_by` times its size, or
    `unfolds_to` where that is more.   memory: of the process that reads it [bytes].
    seconds: for a file of up to 1 GiB, and in proportion for a larger one [s].
    bad_share: of the rows of a table that may be bad and are left out.
    """

    most_bytes: int = 8 * GIB
    unfolds_by: int = 64
    unfolds_to: int = 64 * MIB
    seconds: float = 60.0
    memory: int = 2 * GIB
    bad_share: float = 0.01


def read_file(
    path: Path, folder: Path, *, name: str | None = None, limits: ReadLimits = ReadLimits()
) -> Contents:
    """Read a file, called `name` by its user, into the new directory `folder`, by its content.

    The reader runs in a process of its own, within the limits. May be called from any thread.
    Raises TelemetryError with one sentence about the file, and OSError where there is no room for
    its columns; `folder` does not exist then.
    """
    name = str(path) if name is None else name
    try:
        size = _size(path)
        known, notes = format_of(path, name)
        folder.mkdir()
        try:
            order = _order(path, folder, known, notes, size, limits)
            _check(isolation.carry_out(order), known, order)
            return open_columns(folder).contents
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    except TelemetryError as error:
        raise TelemetryError(printable(f"{name}: {error}", LONGEST_SENTENCE)) from None


@contextmanager
def columns_of(path: Path) -> Iterator[Columns]:
    """The columns of a file, for as long as they are looked at; as `read_file` otherwise."""
    with tempfile.TemporaryDirectory(prefix="forewarn-") as place:
        folder = Path(place) / "columns"
        read_file(path, folder)
        yield open_columns(folder)


def warm_up() -> None:
    """Start what read_file needs, in the background."""
    isolation.warm_up()


def _size(path: Path) -> int:
    """Size of a file that can be read [bytes]; TelemetryError where it cannot."""
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise TelemetryError("this is a directory: give a file of recorded telemetry")
        if not stat.S_ISREG(status.st_mode):
            raise TelemetryError("this is no file on disk: save the telemetry and give its file")
        with path.open("rb"):
            return status.st_size
    except FileNotFoundError:
        raise TelemetryError("there is no such file: give the path of recorded telemetry") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise TelemetryError(f"cannot be opened ({why}): give a file that can be read") from None


def _order(
    path: Path,
    folder: Path,
    known: Format,
    notes: tuple[str, ...],
    size: int,
    limits: ReadLimits,
) -> dict[str, Any]:
    return {
        "path": str(path.absolute()),
        "folder": str(folder.absolute()),
        "reader": known.reader,
        "extra": known.extra,
        "notes": notes,
        "seconds": limits.seconds * max(1.0, size / GIB),
        "memory": limits.memory,
        "most_bytes": min(limits.most_bytes, max(limits.unfolds_by * size, limits.unfolds_to)),
        "bad_share": limits.bad_share,
    }


def _check(answer: dict[str, Any], known: Format, order: dict[str, Any]) -> None:
    """Raise what an answer says, unless the file was read."""
    end = answer["end"]
    if end == "read":
        return
    if end == "refused":
        raise TelemetryError(answer["text"])
    if end == "no room":
        raise OSError(answer["errno"], "no room to store what the file holds", order["folder"])
    less = "export the time range and the signals of this test"
    if end == "slow":
        raise TelemetryError(f"took more than {order['seconds']:.3g} s to read: {less}")
    if end == "large":
        raise TelemetryError(
            f"took more than {order['memory'] / 2**20:.0f} MiB of memory to read: {less}"
        )
    if end == "lacking":
        raise TelemetryError(
            f"{answer['text']}, which reading {known.title} needs: "
            f"pip install 'forewarn[{known.extra}]'"
        )
    log.info("the reader of %s ended with %s", known.key, answer)
    detail = f" ({answer['text']})" if answer.get("text") else ""
    raise TelemetryError(
        f"the reader failed on it{detail}: it is damaged or no complete {known.title}, export it "
        "again"
    )
