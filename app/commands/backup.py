"""`forewarn backup`: the database and the recordings in one verified file."""

import argparse
from dataclasses import asdict
from pathlib import Path

from app.commands.options.option import add_json, add_place, option, place_of
from app.commands.output.results import print_result

MIB = 2**20


def add(parser: argparse.ArgumentParser) -> None:
    option(
        parser,
        "place FILE|DIR",
        "new file, or a directory for a file named after the time",
        type=Path,
    )
    add_place(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from app.upkeep.backup import back_up  # slow to import, not needed for help

    settings = place_of(options)
    backup = back_up(settings.url, settings.data_dir, options.place)
    counts = ", ".join(f"{n} {name}" for name, n in backup.manifest.counts.items())
    lines = [
        f"wrote and verified {backup.path}: {backup.size / MIB:,.1f} MiB; {counts}",
        *(f"◆ damaged before the backup: {line}" for line in backup.manifest.damaged),
    ]
    plain = {"path": str(backup.path), "size": backup.size, "damaged": backup.manifest.damaged}
    print_result(options, "\n".join(lines), plain | {"manifest": asdict(backup.manifest)})
    return 0
