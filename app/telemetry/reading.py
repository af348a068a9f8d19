"""Read a file into a folder of columns, safely: the reader runs in a separate process."""

import logging
import shutil
import stat
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.telemetry.contents import Columns, Contents, open_columns, printable
from app.telemetry.formats import FOLDER, ROLLOUTS, Format, files_of, format_of, head_of
from app.telemetry.readers import isolation
from app.telemetry.recording import TelemetryError

log = logging.getLogger(__name__)
MIB, GIB = 2**20, 2**30
LONGEST_SENTENCE = 1000


@dataclass(frozen=True)
class ReadLimits:
    """Limits for reading one file.

    most_bytes: most numbers that it may expand to, and at most `unfolds_by` times its size or
    `unfolds_to`, whichever is more.   memory: of the reading process [bytes].
    seconds: for a file of up to 1 GiB, in proportion for a larger one [s].
    bad_share: largest share of bad rows in a table.
    """

    most_bytes: int = 8 * GIB
    unfolds_by: int = 64
    unfolds_to: int = 64 * MIB
    seconds: float = 60.0
    memory: int = 2 * GIB
    bad_share: float = 0.01

    def numbers_of(self, size: int) -> int:
        """Most numbers of a file of a size [bytes]."""
        return min(self.most_bytes, max(self.unfolds_by * size, self.unfolds_to))


def read_file(
    path: Path,
    folder: Path,
    *,
    name: str | None = None,
    limits: ReadLimits = ReadLimits(),
    known: Format | None = None,
) -> Contents:
    """Read a file into the new directory `folder`. name: original name of the file.

    known: its format; None to find it.

    The reader runs in a separate process, within the limits. Safe in any thread.
    Raises TelemetryError with one sentence about the file, and OSError if there is no room for
    its columns; then `folder` does not exist.
    """
    name = str(path) if name is None else name
    try:
        size = _size(path)
        chosen = format_of(path, name) if known is None else (known, ())
        return _read(path, folder, *chosen, size, limits)
    except TelemetryError as error:
        raise TelemetryError(printable(f"{name}: {error}", LONGEST_SENTENCE)) from None


def _read(
    path: Path,
    folder: Path,
    known: Format,
    notes: Sequence[str],
    size: int,
    limits: ReadLimits,
) -> Contents:
    folder.mkdir()
    try:
        order = {
            "path": str(path.absolute()),
            "folder": str(folder.absolute()),
            "reader": known.reader,
            "extra": known.extra,
            "notes": notes,
            "seconds": limits.seconds * max(1.0, size / GIB),
            "memory": limits.memory,
            "most_bytes": limits.numbers_of(size),
            "bad_share": limits.bad_share,
        }
        _check(isolation.carry_out(order), known, order)
        return open_columns(folder).contents
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


@contextmanager
def columns_of(
    path: Path, *, rollouts: bool = False, name: str | None = None, place: Path | None = None
) -> Iterator[Columns]:
    """Open the columns of a file in a temporary folder; errors as in `read_file`.

    The files of a folder are read as one long table, see app.telemetry.readers.folder.
    rollouts: arrays of rollouts are read as such, see app.telemetry.readers.rollout_arrays.
    name: of the file, in messages.   place: where the temporary folder is made.
    """
    with tempfile.TemporaryDirectory(prefix="forewarn-", dir=place) as temporary:
        folder = Path(temporary) / "columns"
        if path.is_dir():
            size = sum(file.stat().st_size for file in files_of(path))
            _read(path, folder, FOLDER, (), size, ReadLimits())
        else:
            arrays = rollouts and path.is_file() and ROLLOUTS.looks_like(head_of(path))
            read_file(path, folder, name=name, known=ROLLOUTS if arrays else None)
        yield open_columns(folder)


def _size(path: Path) -> int:
    """Size of a readable file [bytes]; TelemetryError if it cannot be read."""
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode):
            with path.open("rb"):
                return status.st_size
    except FileNotFoundError:
        raise TelemetryError("no such file: give the path of recorded telemetry") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise TelemetryError(f"cannot be opened ({why}): give a readable file") from None
    kind = "a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
    raise TelemetryError(f"this is {kind}: give a file of recorded telemetry")


def _check(answer: dict[str, Any], known: Format, order: dict[str, Any]) -> None:
    """Raise the error in an answer, unless the file was read."""
    end = answer["end"]
    if end == "read":
        return
    if end == "refused":
        raise TelemetryError(answer["text"])
    if end == "no room":
        raise OSError(answer["errno"], "no room to store the signals", order["folder"])
    less = "export only the time range and signals of this test"
    if end == "slow":
        raise TelemetryError(f"reading took more than {order['seconds']:.3g} s: {less}")
    if end == "large":
        raise TelemetryError(
            f"reading took more than {order['memory'] / 2**20:.0f} MiB of memory: {less}"
        )
    if end == "lacking":
        raise TelemetryError(
            f"reading {known.title} needs an optional package ({answer['text']}): "
            f"pip install 'forewarn[{known.extra}]'"
        )
    log.info("the reader of %s ended with %s", known.key, answer)
    detail = f" ({answer['text']})" if answer.get("text") else ""
    raise TelemetryError(
        f"the file cannot be read{detail}: it is damaged or not a complete {known.title}, export "
        "it again"
    )
