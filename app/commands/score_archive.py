"""`forewarn score-archive`: score a folder of recordings into Parquet files."""

import argparse
import os
import sys
from dataclasses import asdict
from pathlib import Path

from app.commands.options.option import add_json, add_scheduler, option
from app.commands.options.scoring import add_scoring_options, request_of
from app.commands.output.results import print_result, progress_bar
from core.counted import counted

INTERRUPTED = 130


def add(parser: argparse.ArgumentParser) -> None:
    add_scoring_options(
        parser,
        "file SOURCE",
        "folder of recordings, those in its folders too; or a URL that fsspec opens, such as "
        "s3://bucket/folder",
        "of all recordings; the name of the first folder if absent",
        str,
    )
    option(parser, "--workers N", "processes; one for each core if absent", type=int)
    text = "folder of the results, which are continued if there are any"
    parser.add_argument("-o", "--out", metavar="DIR", help=text)
    add_json(parser)
    add_scheduler(parser)
    parser.set_defaults(aircraft=None)


def run(options: argparse.Namespace) -> int:
    """Returns 1 where no recording could be scored."""
    from app.jobs.cluster import executor_at  # slow to import
    from app.recordings.archive import ArchiveRequest, score_archive
    from app.recordings.remote_files import is_url, result_folder

    if options.out is None:
        raise ValueError("no folder for the results is given: give --out DIR")
    workers = os.cpu_count() or 1 if options.workers is None else options.workers
    if workers < 1:
        raise ValueError(f"workers={workers}: give 1 or more")
    if options.monitor_set or options.condition:
        raise ValueError(
            "score-archive scores by monitor files only, and a monitor set was given: give "
            "MONITOR files, or score each recording with forewarn score --monitor-set"
        )
    if options.file is None:
        raise ValueError(
            f"only {options.monitors[0]} was given: give a monitor and the folder to score"
        )
    aircraft, options.aircraft = options.aircraft, None
    options.file = options.file.removeprefix("file://")
    url = options.file if is_url(options.file) else ""
    options.file = Path() if url else Path(options.file)
    request, _ = request_of(options)
    out = result_folder(options.out)
    try:
        with executor_at(options.scheduler) as executor, progress_bar("recordings") as show:
            archive = ArchiveRequest(request, out, aircraft, workers, url)
            done = score_archive(archive, show, executor)
    except KeyboardInterrupt:
        print("forewarn: interrupted; the same command continues", file=sys.stderr)
        return INTERRUPTED
    for flight, reason in done.failed.items():
        print(f"not scored: {flight}: {reason}", file=sys.stderr)
    for flight, first in done.copies.items():
        print(f"not scored: {flight}: a copy of {first}", file=sys.stderr)
    if done.doubted:
        print(
            f"{counted(done.doubted, 'recording')} scored by a mapping that is a guess: see "
            "mapping_confidence in summary.parquet, or give --mapping",
            file=sys.stderr,
        )
    text = (
        f"{counted(done.scored, 'recording')} scored, {done.unchanged} unchanged, "
        f"{len(done.copies)} copies, {len(done.failed)} not scored; see "
        f"{out}/summary.parquet"
    )
    print_result(options, text, asdict(done))
    return 0 if done.is_done else 1
