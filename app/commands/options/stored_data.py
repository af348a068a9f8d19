"""Options of commands that work on what a server keeps."""

import argparse
from pathlib import Path

from app.settings import Settings, read_settings


def add_place(parser: argparse.ArgumentParser) -> None:
    """Add where it is kept."""
    parser.add_argument("--data-dir", type=Path, metavar="DIR", help="where everything is kept")
    parser.add_argument("--database-url", metavar="URL", help="database in place of SQLite's")


def place_of(options: argparse.Namespace) -> Settings:
    """The settings by these options and the environment; SettingsError.

    A restore that died half-way is completed first. StoreError.
    """
    from app.upkeep.restore import finish  # slow to import, not needed for help

    settings = read_settings(data_dir=options.data_dir, database_url=options.database_url)
    finish(settings.data_dir)
    return settings
