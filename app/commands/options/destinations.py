"""Checks of output paths, made before the work starts."""

import os
from pathlib import Path


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
