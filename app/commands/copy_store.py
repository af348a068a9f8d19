"""`forewarn copy-store`: a store in another place or database. The server must not run."""

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

    url = store_address(options.target)
    numbers = copy_store(store_address(options.source), url)
    place = url.render_as_string(hide_password=True)
    text = (
        f"copied and verified {counted(sum(numbers.values()), 'row')} to {place}; recordings and "
        "journals are files: serve the copy with the same --data-dir, or copy its folders "
        "`recordings` and `live` to another one\n"
        "if it holds a forewarn.db, rename that once the copy is in use: without "
        "FOREWARN_DATABASE_URL it would be served as it was before the copy"
    )
    print_result(options, text, {"database": place, "rows": numbers})
    return 0
