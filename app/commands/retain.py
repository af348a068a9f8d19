"""`forewarn retain`: delete flights and recordings by age and size. The server may run."""

import argparse
from dataclasses import asdict
from datetime import UTC, datetime

from app.commands.options.option import add_json, add_place, option, place_of
from app.commands.output.results import print_result


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "--older-than DAYS", "delete everything older than this", type=float)
    option(parser, "--above GB", "delete the oldest until no more than this is left", type=float)
    option(parser, "--dry-run", "list what would be deleted; delete nothing")
    add_place(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from app.recordings.recordings import Recordings
    from app.store.database import StoreError, address
    from app.store.schema import current_revision
    from app.store.store import open_store
    from app.telemetry.journal import Journals  # slow to import, not needed for help
    from app.upkeep.retention import GB, choose, everything, retain, retention_rule

    settings = place_of(options)
    days = settings.retain_days if options.older_than is None else options.older_than
    size = settings.retain_gb if options.above is None else options.above
    rule = retention_rule(days, size)
    if not rule:
        raise ValueError("no age or size given: give --older-than DAYS, --above GB, or both")
    if current_revision(address(settings.url)) is None:
        raise StoreError(f"{settings.data_dir} has no database: give another --data-dir")
    store = open_store(settings.url, recover=False)
    recordings = Recordings(store, settings.data_dir / "recordings")
    journals = Journals(settings.data_dir / "live")
    if options.dry_run:
        chosen = choose(everything(recordings, journals), rule, datetime.now(UTC))
    else:
        chosen = retain(recordings, journals, rule)
    store.close()
    verb = "would delete" if options.dry_run else "deleted"
    n_permanent = sum(item.keep for item in chosen.stays)
    left = sum(item.size for item in chosen.stays)
    lines = [
        *(
            f"{verb} {item.kind} {item.id} {item.name}, {item.since[:10]}, {item.size / GB:.3f} GB"
            for item in chosen.goes
        ),
        f"{verb} {len(chosen.goes)} ({chosen.freed / GB:.3f} GB); {len(chosen.stays)} left "
        f"({left / GB:.3f} GB), {n_permanent} kept permanently",
    ]
    plain = {"dry_run": options.dry_run, **asdict(chosen), "freed": chosen.freed}
    print_result(options, "\n".join(lines), plain)
    return 0
