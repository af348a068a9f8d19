"""`forewarn audit`: the audit log of a server, oldest first, as CSV or as JSON lines."""

import argparse
import sys
from contextlib import closing

from app.commands.options.option import add_json, add_place, option, place_of


def add(parser: argparse.ArgumentParser) -> None:
    for name, text in (("since", "first"), ("until", "end")):
        help_ = f"{text} day or time in ISO 8601; UTC unless it names a zone"
        parser.add_argument(f"--{name}", metavar="TIME", help=help_)
    option(parser, "--who NAME", "only changes by this person")
    add_place(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from app.routes.dependencies import utc  # slow to import, not needed for help
    from app.routes.people import as_csv, as_json_lines
    from app.store.store import open_store

    with closing(open_store(place_of(options).url, recover=False)) as store:
        entries = store.audit.read(utc(options.since), utc(options.until), options.who)
        sys.stdout.writelines((as_json_lines if options.json else as_csv)(entries))
    return 0
