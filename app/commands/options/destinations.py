"""Where results go: looked at before the work starts, so that none is done for nothing."""

import os
from pathlib import Path


class DestinationError(ValueError):
    """A place that results cannot be written to."""


def check_file(path: Path) -> Path:
    """Return a path that a file can be written to."""
    if path.is_dir() or not path.name:
        raise DestinationError(f"{path} is a directory: give the path of the file to write")
    if not path.parent.is_dir():
        raise DestinationError(f"{path.parent} is no directory: make it first")
    return _writable(path.parent, path)


def check_directory(path: Path) -> Path:
    """Return a path at which a directory of files is, or can be made with its parents."""
    existing = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not existing.is_dir():
        raise DestinationError(f"{existing} is a file: give a directory to write into")
    return _writable(existing, path)


def _writable(directory: Path, path: Path) -> Path:
    if not os.access(directory, os.W_OK | os.X_OK):
        raise DestinationError(
            f"{path} cannot be written: {directory} is not writable, choose another"
        )
    return path
