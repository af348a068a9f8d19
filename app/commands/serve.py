"""The commands that serve: their options, and what they print."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from app.settings import Settings, read_settings


def add_serving_commands(commands: Any) -> None:
    """Add serve, demo and doctor to the command line's subcommands."""
    serve = commands.add_parser("serve", help="serve the page and the API")
    serve.set_defaults(run=_serve)
    demo = commands.add_parser("demo", help="train a small monitor, serve, and fly it")
    demo.add_argument("--no-browser", action="store_true", help="print the address only")
    demo.set_defaults(run=_demo)
    doctor = commands.add_parser("doctor", help="check this installation")
    doctor.set_defaults(run=_doctor)
    for parser in (serve, demo, doctor):
        parser.add_argument("--data-dir", type=Path, metavar="DIR", help="where everything is kept")
        parser.add_argument("--host", help="address to listen on, 127.0.0.1 if absent")
        parser.add_argument("--port", type=int, help="port to listen on, 8000 if absent; 0: any")
        parser.add_argument("--database-url", metavar="URL", help="database in place of SQLite's")
        parser.epilog = "Settings come from FOREWARN_* too; the token only from FOREWARN_TOKEN."


def _settings(options: argparse.Namespace) -> Settings:
    return read_settings(
        data_dir=options.data_dir,
        host=options.host,
        port=options.port,
        database_url=options.database_url,
    )


def _say(text: str) -> None:
    print(f"forewarn: {text}", flush=True)


def _serve(options: argparse.Namespace) -> int:
    from app.serving import serve

    settings = _settings(options)

    async def opened(app: object, address: str) -> None:
        _say(f"serving {settings.data_dir} at {address} (stop with Ctrl+C)")

    serve(settings, opened)
    return 0


def _demo(options: argparse.Namespace) -> int:
    from app.commands.demo import demonstrate

    has_display = sys.platform != "linux" or "DISPLAY" in os.environ
    has_display = has_display or "WAYLAND_DISPLAY" in os.environ
    demonstrate(_settings(options), _say, browser=has_display and not options.no_browser)
    return 0


def _doctor(options: argparse.Namespace) -> int:
    from app.commands.doctor import examine

    well = True
    for finding in examine(_settings(options)):
        print(finding, flush=True)
        well = well and finding.is_well
    return 0 if well else 1
