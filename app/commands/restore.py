"""`forewarn restore`: a backup back in the data directory. The server must not run."""

import argparse
from dataclasses import asdict
from pathlib import Path

from app.commands.options.option import add_json, add_place, option, place_of
from app.commands.output.results import print_result


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "backup FILE", "file from `forewarn backup`", type=Path)
    option(parser, "--replace", "move existing data aside instead of refusing")
    add_place(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from app.upkeep.restore import restore  # slow to import, not needed for help

    settings = place_of(options)
    done = restore(options.backup, settings.data_dir, settings.url, replace=options.replace)
    counts = ", ".join(f"{n} {name}" for name, n in done.manifest.counts.items())
    text = f"restored {settings.data_dir} as of {done.manifest.created}: {counts}"
    if done.aside is not None:
        text = f"{text}\nthe data before are in {done.aside}: check the restore, then delete them"
    for line in done.manifest.damaged:
        text = f"{text}\n◆ damaged before the backup: {line}"
    aside = None if done.aside is None else str(done.aside)
    plain = {"data_dir": str(settings.data_dir), "aside": aside, "manifest": asdict(done.manifest)}
    print_result(options, text, plain)
    return 0
