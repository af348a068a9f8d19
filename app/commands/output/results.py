"""Where a command writes, its progress on a terminal, and its result as text or as JSON."""

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def print_result(options: argparse.Namespace, text: str, plain: Any) -> None:
    """plain: JSON types and arrays; numbers that are not finite become null."""
    if options.json:
        from app import json_codec  # slow to import, only needed here

        text = json_codec.encode(plain).decode()
    print(text)


@contextmanager
def stage_bar(label: str) -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar while the block runs. It yields a function to call with (stage, done, total)."""
    from rich.console import Console  # slow to import, not needed for help
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(label, total=None)
        yield lambda stage, done, total: bar.update(
            task, description=stage, completed=done, total=total
        )


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """A bar of one stage. It yields a function to call with (done, total)."""
    with stage_bar(label) as show:
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
