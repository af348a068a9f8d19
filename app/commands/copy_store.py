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
    from app.upkeep import store_copy as copying  # slow to import, not for help
    from app.upkeep.integrity import inventory_of

    source, target = copying.folder_of(options.source), copying.folder_of(options.target)
    folders = (source, target) if source and target else None
    url = copying.store_address(options.target)
    numbers, n_files = copying.copy_store(copying.store_address(options.source), url, folders)
    place = url.render_as_string(hide_password=True)
    damaged: list[str] = []
    n_rows, files = counted(sum(numbers.values()), "row"), counted(n_files, "file")
    if folders is not None:
        text = f"copied and verified {n_rows} and {files} of recordings and journals to {target}"
        damaged = inventory_of(url.render_as_string(hide_password=False), folders[1]).damaged
        text = "\n".join([text, *(f"◆ damaged before the copy: {line}" for line in damaged)])
    elif source is not None:
        stay = counted(copying.n_files_of(source), "file")
        text = (
            f"copied and verified {n_rows} to {place}; {stay} of recordings and journals stay in "
            f"{source}: serve with --data-dir {source} and FOREWARN_DATABASE_URL, or copy its "
            "folders `recordings` and `live` to another --data-dir\n"
            f"rename {source}/forewarn.db once the copy is in use: without the URL it would be "
            "served as it was before the copy"
        )
    else:
        text = (
            f"copied and verified {n_rows} to {place}; recordings and journals are files: copy "
            "the folders `recordings` and `live` of the data directory served with "
            f"{options.source} to {target or 'that of the new server'}"
        )
    plain = {"database": place, "rows": numbers, "files": n_files, "damaged": damaged}
    print_result(options, text, plain)
    return 0
