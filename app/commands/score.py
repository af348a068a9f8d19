"""`forewarn score`: score a recorded flight; write its tables and figures."""

import argparse
from pathlib import Path

from app.commands.options.option import add_output, option
from app.commands.options.scoring import SETTINGS, add_scoring_options, request_of
from app.commands.output.results import check_directory, print_result


def add(parser: argparse.ArgumentParser) -> None:
    add_scoring_options(parser)
    option(parser, "--png", "also write the figure as PNG")
    add_output(parser, "DIR", "directory to write to; named after FILE if absent")
    parser.epilog = SETTINGS


def run(options: argparse.Namespace) -> int:
    """Returns 1 where no sample could be assessed."""
    from app.commands.output.scores import write_scores  # slow to import, not needed for help

    request, memory = request_of(options)
    out = check_directory(options.out or Path(f"{request.file.stem}-scored"))
    outcome = write_scores(request, out, memory, options.png)
    print_result(options, outcome.text, outcome.plain)
    return 0 if outcome.is_assessed else 1
