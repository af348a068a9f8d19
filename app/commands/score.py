"""The command that scores a recorded flight, and writes its tables and figures."""

import argparse
from pathlib import Path

from app.commands.options.destinations import check_directory
from app.commands.options.scoring import SETTINGS, add_scoring_options, request_of
from app.commands.output.results import add_json, print_result


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    add_scoring_options(parser)
    parser.add_argument("-o", "--out", type=Path, help="directory written, FILE's name if absent")
    parser.add_argument("--png", action="store_true", help="write the figure as PNG too")
    add_json(parser)
    parser.epilog = SETTINGS


def run(options: argparse.Namespace) -> int:
    """Score the file; 1 where nothing could be assessed."""
    from app.commands.output.scores import write_scores  # slow to import, not needed for help

    out = check_directory(options.out or Path(f"{options.file.stem}-scored"))
    request, memory = request_of(options)
    report = write_scores(request, out, memory, options.png)
    print_result(options, report.text, report.plain)
    return 0 if report.assessed else 1
