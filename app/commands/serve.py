"""`forewarn serve`: serve until interrupted. `demo` and `doctor` share its options."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from app.commands.options.option import add_place, add_scheduler, option
from app.settings import Settings, read_settings

if TYPE_CHECKING:  # slow to import, and not needed for help
    from fastapi import FastAPI


def add(parser: argparse.ArgumentParser) -> None:
    add_server(parser)
    option(
        parser,
        "--shared ADDRESS",
        "several servers share this database and data directory, and reach this one at ADDRESS, "
        "such as http://range-1:8000: one owns the flights, the others relay to it and take over "
        "when it ends",
    )
    option(
        parser,
        "--archive DIR",
        "folder with results of `forewarn score-archive` that the page shows; may be repeated",
        action="append",
    )
    option(
        parser,
        "--real-time",
        "live samples before every other program of this machine; the system must allow it (Linux)",
        action="store_true",
        default=None,
    )


def add_server(parser: argparse.ArgumentParser) -> None:
    """The options that `demo` and `doctor` have too."""
    add_place(parser)
    option(parser, "--host HOST", "address to listen on; 127.0.0.1 if absent")
    option(parser, "--port PORT", "port to listen on, 0 for any; 8000 if absent", type=int)
    add_scheduler(parser)
    parser.epilog = (
        "FOREWARN_* variables set the same options; the token comes only from FOREWARN_TOKEN."
    )


def settings_of(options: argparse.Namespace) -> Settings:
    """Settings from the options and the environment. SettingsError."""
    return read_settings(
        data_dir=options.data_dir,
        host=options.host,
        port=options.port,
        database_url=options.database_url,
        scheduler=options.scheduler,
        shared=getattr(options, "shared", None),
        archives=tuple(getattr(options, "archive", None) or ()) or None,
        real_time=getattr(options, "real_time", None),
    )


def say(text: str) -> None:
    print(f"forewarn: {text}", flush=True)


def run(options: argparse.Namespace) -> int:
    from app import serving  # slow to import, not needed for help

    settings = settings_of(options)

    async def opened(app: FastAPI, address: str) -> None:
        say(f"serving {settings.data_dir} at {address} (stop with Ctrl+C)")

    serving.serve(settings, opened)
    return 0
