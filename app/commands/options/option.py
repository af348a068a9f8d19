"""An option of a command, and those that many commands share."""

import argparse
from pathlib import Path
from typing import Any

from app.settings import Settings, read_settings


def option(
    parser: argparse._ActionsContainer, name: str, text: str, **settings: Any
) -> argparse.Action:
    """Add an option or argument.   name: with its metavar, if any.   text: its help.

    An option without a metavar and settings is a flag.
    """
    name, _, metavar = name.partition(" ")
    if metavar:
        settings["metavar"] = metavar
    elif name.startswith("-") and not settings:
        settings["action"] = "store_true"
    return parser.add_argument(name, help=text, **settings)


def add_json(parser: argparse.ArgumentParser) -> None:
    option(parser, "--json", "print the results as JSON")


def add_output(
    parser: argparse.ArgumentParser, metavar: str, text: str, default: Path | None = None
) -> None:
    text = text if default is None else f"{text}; {default} if absent"
    parser.add_argument("-o", "--out", type=Path, metavar=metavar, default=default, help=text)
    add_json(parser)


def add_place(parser: argparse._ActionsContainer, text: str = "directory of all data") -> None:
    option(parser, "--data-dir DIR", text, type=Path)
    option(parser, "--database-url URL", "database, instead of SQLite's")


def add_scheduler(parser: argparse._ActionsContainer) -> None:
    text = "Dask scheduler whose workers compute, such as tcp://host:8786; this machine if absent"
    option(parser, "--scheduler ADDRESS", text)


def place_of(options: argparse.Namespace) -> Settings:
    """Settings from these options and the environment, after an interrupted restore is completed.

    SettingsError, StoreError.
    """
    from app.upkeep.restore import finish  # slow to import, not needed for help

    settings = read_settings(data_dir=options.data_dir, database_url=options.database_url)
    finish(settings.data_dir)
    return settings
