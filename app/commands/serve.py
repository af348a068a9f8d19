"""The command that serves, and the options of all that do."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from app.commands.options.stored_data import add_place
from app.settings import Settings, read_settings

if TYPE_CHECKING:  # slow to import, and not needed for help
    from fastapi import FastAPI

    from app.http.people import People
    from app.http.sessions import Sessions


def add(parser: argparse.ArgumentParser) -> None:
    """Add the options of a server: where it keeps what it knows, where it listens."""
    add_place(parser)
    parser.add_argument("--host", help="address to listen on, 127.0.0.1 if absent")
    parser.add_argument("--port", type=int, help="port to listen on, 8000 if absent; 0: any")
    parser.epilog = "Settings come from FOREWARN_* too; the token only from FOREWARN_TOKEN."


def settings_of(options: argparse.Namespace) -> Settings:
    """The settings of a server by its options and the environment; SettingsError."""
    return read_settings(
        data_dir=options.data_dir,
        host=options.host,
        port=options.port,
        database_url=options.database_url,
    )


def say(text: str) -> None:
    """Print a line of a server, at once."""
    print(f"forewarn: {text}", flush=True)


def login_link(app: FastAPI, address: str) -> str | None:
    """An address that logs in once; None where the server asks for no token."""
    people: People = app.state.people
    sessions: Sessions = app.state.sessions
    return f"{address}/login?link={sessions.make_link()}" if people.needs_token else None


def say_link(app: FastAPI, address: str) -> None:
    """Print the link that logs in, where there is one."""
    from app.store.tokens import LINK_SECONDS  # slow to import, not needed for help

    if link := login_link(app, address):
        say(f"log in once, within {LINK_SECONDS / 60:.0f} minutes: {link}")


def run(options: argparse.Namespace) -> int:
    """Serve until it is interrupted."""
    from app import serving  # slow to import, not needed for help

    settings = settings_of(options)

    async def opened(app: FastAPI, address: str) -> None:
        say(f"serving {settings.data_dir} at {address} (stop with Ctrl+C)")
        say_link(app, address)

    serving.serve(settings, opened)
    return 0
