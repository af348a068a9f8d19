"""The command that restores a backup."""

import argparse
from dataclasses import asdict
from pathlib import Path

from app.commands.options.stored_data import add_place, place_of
from app.commands.output.results import add_json, print_result


def add(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("backup", type=Path, metavar="FILE", help="what `forewarn backup` wrote")
    parser.add_argument(
        "--replace", action="store_true", help="where something is there, keep it aside"
    )
    add_place(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Restore; the server must not run."""
    from app.upkeep.restore import restore  # slow to import, not needed for help

    settings = place_of(options)
    done = restore(options.backup, settings.data_dir, settings.url, replace=options.replace)
    counts = ", ".join(f"{n} {name}" for name, n in done.manifest.counts.items())
    text = f"restored {settings.data_dir} as of {done.manifest.created}: {counts}"
    if done.aside is not None:
        text = f"{text}\nwhat was there before is kept in {done.aside}: delete it when all is well"
    aside = None if done.aside is None else str(done.aside)
    plain = {"data_dir": str(settings.data_dir), "aside": aside, "manifest": asdict(done.manifest)}
    print_result(options, text, plain)
    return 0
