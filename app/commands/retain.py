"""The command that deletes flights and recordings by age and by size."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from app.commands.options.stored_data import add_place, place_of
from app.commands.output.results import add_json, print_result

if TYPE_CHECKING:  # slow to import, and not needed for help
    from app.upkeep.retention import Retained


def add(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--older-than", type=float, metavar="DAYS", help="what is older goes")
    parser.add_argument(
        "--above", type=float, metavar="GB", help="the oldest go until so much is left"
    )
    parser.add_argument("--dry-run", action="store_true", help="say what would go, delete nothing")
    add_place(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Delete, or say what would go; the server may run."""
    from app.live.journal import Journals  # slow to import, not needed for help
    from app.recordings.recordings import Recordings
    from app.store.database import StoreError, address
    from app.store.schema import current_revision
    from app.store.store import open_store
    from app.upkeep.retention import GB, choose, everything, retain, retention_rule

    settings = place_of(options)
    days = settings.retain_days if options.older_than is None else options.older_than
    size = settings.retain_gb if options.above is None else options.above
    rule = retention_rule(days, size)
    if not rule:
        raise ValueError("nothing says what goes: give --older-than DAYS, --above GB, or both")
    if current_revision(address(settings.url)) is None:
        raise StoreError(f"{settings.data_dir} holds no database yet: give --data-dir")
    store = open_store(settings.url, recover=False)
    recordings = Recordings(store, settings.data_dir / "recordings")
    journals = Journals(settings.data_dir / "live")
    if options.dry_run:
        chosen = choose(everything(recordings, journals), rule, datetime.now(UTC))
    else:
        chosen = retain(recordings, journals, rule)
    store.close()
    verb = "would delete" if options.dry_run else "deleted"
    n_kept = sum(one.keep for one in chosen.stays)
    left = sum(one.size for one in chosen.stays)
    lines = [
        *(f"{verb} {_words(one)}" for one in chosen.goes),
        f"{verb} {len(chosen.goes)} ({chosen.freed / GB:.3f} GB); {len(chosen.stays)} stay "
        f"({left / GB:.3f} GB), {n_kept} of them for ever",
    ]
    plain = {"dry_run": options.dry_run, **asdict(chosen), "freed": chosen.freed}
    print_result(options, "\n".join(lines), plain)
    return 0


def _words(one: Retained) -> str:
    from app.upkeep.retention import GB

    return f"{one.kind} {one.id} {one.name}, of {one.since[:10]}, {one.size / GB:.3f} GB"
