"""Ask for a mapping where the program cannot map a file's signals to channels."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.recordings.scored_file import UnmappedFile
from app.telemetry.contents import Contents
from app.telemetry.recording import TelemetryError
from core.whole_file import write_whole

MOST_SIGNALS = 400
"""Most signals to list."""


@contextmanager
def asking_for_mapping(path: Path) -> Iterator[None]:
    """If the block cannot map a file, list its signals and write a mapping to complete.

    path: of the mapping to write. If it exists, the next free name is used.   TelemetryError.
    """
    try:
        yield
    except UnmappedFile as error:
        print("\n".join(signal_lines(error.contents)), file=sys.stderr)
        path = _free(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(error.template, indent=2, ensure_ascii=False)
        write_whole(path, f"{text}\n".encode())
        raise TelemetryError(
            f"{error}; the signals are listed above: complete {path} and give it with --mapping"
        ) from None


def signal_lines(contents: Contents) -> Iterator[str]:
    yield f"signals of the file: {len(contents.signals)}"
    n_shown = 0
    for number, group in enumerate(contents.groups):
        if group.name:
            yield f"  {group.name}, {group.n_rows} rows:"
        members = [signal for signal in contents.signals if signal.group == number]
        for signal in members[: max(0, MOST_SIGNALS - n_shown)]:
            unit = f" [{signal.unit}]" if signal.unit else ""
            description = f"  {signal.description}" if signal.description else ""
            yield f"    {signal.name}{unit}{description}"
        n_shown += len(members)
    if n_shown > MOST_SIGNALS:
        yield f"  and {n_shown - MOST_SIGNALS} more"


def _free(path: Path) -> Path:
    """The path, or the first free one with a number after its stem."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_stem(f"{path.stem}-{number}")
    return free
