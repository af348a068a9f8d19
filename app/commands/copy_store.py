"""`forewarn copy-store`: a database of the other kind, or a second one. The server must not run."""

import argparse

from app.commands.options.option import add_json, option
from app.commands.output.results import print_result
from core.counted import counted


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "source FROM", "data directory, or database URL")
    option(parser, "target TO", "empty database: its URL, or a data directory for SQLite")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from app.upkeep.store_copy import copy_store, store_address  # slow to import, not for help

    source, target = store_address(options.source), store_address(options.target)
    numbers = copy_store(source, target)
    place = target.render_as_string(hide_password=True)
    text = (
        f"copied and verified {counted(sum(numbers.values()), 'row')} to {place}; recordings and "
        "journals stay in their data directory: serve both together"
    )
    print_result(options, text, {"database": place, "rows": numbers})
    return 0
