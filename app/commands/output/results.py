"""Where a command writes, its progress on a terminal, and its result as text or as JSON."""

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import Any

from core.counted import pace

LINE_S = 30.0
"""[s] From one line on the progress to the next, where there is no terminal."""


def print_result(options: argparse.Namespace, text: str, plain: Any) -> None:
    """plain: JSON types and arrays; numbers that are not finite become null."""
    if options.json:
        from app import json_codec  # slow to import, only needed here

        text = json_codec.encode(plain).decode()
    print(text)


def flights_in_words(
    counts: Mapping[str, int], clock: Callable[[], float] = monotonic
) -> Callable[[], str]:
    """What says how many flights were flown from now on, how fast, and when those asked for end.

    counts: of flights, "flown" and "asked" for.
    """
    begin, before = clock(), counts["flown"]

    def words() -> str:
        flown, asked = counts["flown"] - before, counts["asked"] - before
        told = f"{flown} of {max(flown, asked)} rollouts"
        if flown <= 0:
            return told * (asked > 0)
        rate = flown / max(clock() - begin, 1e-9)
        return f"{told}, {pace(rate, max(asked - flown, 0) / rate)}"

    return words


@contextmanager
def stage_bar(
    label: str, counts: Mapping[str, int] | None = None
) -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar while the block runs, or a line each LINE_S where there is no terminal.

    counts: see `flights_in_words`; they change while the block runs.
    It yields a function to call with (stage, done, total).
    """
    from rich.console import Console  # slow to import, not needed for help
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    flights = (lambda: "") if counts is None else flights_in_words(counts)

    class _Flights(ProgressColumn):
        def render(self, task: Any) -> Text:
            return Text(flights())

    console = Console(stderr=True)
    stage, done = TextColumn("{task.description}"), MofNCompleteColumn()
    columns = (stage, BarColumn(), done, TimeRemainingColumn())
    if counts is not None:
        columns = (stage, done, _Flights())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task, over = bar.add_task(label, total=None), Event()

    def tell() -> None:
        while not over.wait(LINE_S):
            shown = bar.tasks[0]
            done = "" if shown.total is None else f": {shown.completed:g} of {shown.total:g}"
            words = filter(None, (f"{shown.description}{done}", flights()))
            print("; ".join(words), file=sys.stderr, flush=True)

    if bar.disable:
        Thread(target=tell, daemon=True).start()
    try:
        with bar:
            yield lambda stage, done, total: bar.update(
                task, description=stage, completed=done, total=total
            )
    finally:
        over.set()


@contextmanager
def progress_bar(
    label: str, counts: Mapping[str, int] | None = None
) -> Iterator[Callable[[int, int], None]]:
    """A bar of one stage. It yields a function to call with (done, total)."""
    with stage_bar(label, counts) as show:
        yield lambda done, total: show(label, done, total)


class DestinationError(ValueError):
    """Results cannot be written to this path."""


def check_file(path: Path) -> Path:
    """Return the path if a file can be written there. DestinationError."""
    if path.is_dir() or not path.name:
        raise DestinationError(f"{path} is a directory: give the path of the file to write")
    if not path.parent.is_dir():
        raise DestinationError(f"{path.parent} is not a directory: create it first")
    return _writable(path.parent, path)


def check_directory(path: Path) -> Path:
    """Return the path if a directory is there or can be created. DestinationError."""
    existing = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise DestinationError(f"{existing} is a file: give a directory")
    return _writable(existing, path)


def _writable(directory: Path, path: Path) -> Path:
    if not os.access(directory, os.W_OK | os.X_OK):
        raise DestinationError(
            f"{path} cannot be written: {directory} is not writable; choose another directory"
        )
    return path
