"""Uploaded portable monitors: a separate process reads each file first.

A hostile file can only harm that process. Only a file it read completely is read here.
"""

import tempfile
from pathlib import Path
from typing import Any

from app.telemetry.contents import ColumnWriter
from app.telemetry.readers import isolation
from app.telemetry.recording import TelemetryError
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import MonitorFileError

SECONDS, MEMORY = 60.0, 2**30
"""Limits for reading a file: time [s] and memory of the reader [bytes]."""


def check(content: bytes, name: str) -> None:
    """Read a file in a separate process. MonitorFileError if it is not a monitor or costs too much.

    name: of the file, for error messages.
    """
    with tempfile.TemporaryDirectory(prefix="forewarn-") as place:
        path = Path(place) / "monitor.fwm"
        path.write_bytes(content)
        answer = isolation.carry_out(_request(path))
    if answer["end"] == "read":
        return
    if answer["end"] == "refused":
        raise MonitorFileError(f"{name}{answer['text']}")
    problem = {
        "slow": f"took more than {SECONDS:g} s to read",
        "large": f"took more than {MEMORY / 2**20:.0f} MiB of memory to read",
    }.get(answer["end"], f"ended its reader ({answer.get('text', answer['end'])})")
    raise MonitorFileError(f"{name} {problem}: choose a file written by `forewarn train`")


def read(path: Path, writer: ColumnWriter) -> None:
    """Read a file in the reader's process, discarding the result. TelemetryError if refused."""
    try:
        from_bytes(path.read_bytes(), "")
    except MonitorFileError as error:
        raise TelemetryError(str(error)) from None


def _request(path: Path) -> dict[str, Any]:
    return {
        "path": str(path),
        "folder": str(path.parent),
        "reader": __name__,
        "extra": "",
        "notes": (),
        "seconds": SECONDS,
        "memory": MEMORY,
        "most_bytes": 0,
        "bad_share": 0.0,
    }
