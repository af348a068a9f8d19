"""Options of commands that work on a server's stored data."""

import argparse
from pathlib import Path

from app.settings import Settings, read_settings


def add_place(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data-dir", type=Path, metavar="DIR", help="directory of all data")
    parser.add_argument("--database-url", metavar="URL", help="database, instead of SQLite's")


def place_of(options: argparse.Namespace) -> Settings:
    """Settings from these options and the environment, after an interrupted restore is completed.

    SettingsError, StoreError.
    """
    from app.upkeep.restore import finish  # slow to import, not needed for help

    settings = read_settings(data_dir=options.data_dir, database_url=options.database_url)
    finish(settings.data_dir)
    return settings
