"""The command that reports a recorded flight: one file to read, print and keep."""

import argparse
from pathlib import Path
from typing import Any

from app.commands.destinations import check_file
from app.commands.score import SETTINGS, add_scoring_options, request_of

N_TEST = 2000


def add_report_command(commands: Any) -> None:
    """Add `report` to the command line's subcommands."""
    report = commands.add_parser(
        "report",
        help="score recorded telemetry and report it in one HTML file that prints to a clean PDF",
        epilog=f"Several monitors or epsilons make a report each. {SETTINGS}",
    )
    add_scoring_options(report)
    report.add_argument(
        "--export",
        default="",
        metavar="csv,parquet,mat",
        help="write every sample beside the report too, for other programs",
    )
    report.add_argument(
        "--n-test",
        type=int,
        default=N_TEST,
        metavar="NUMBER",
        help=f"fresh simulated flights that certify the monitor, {N_TEST} if absent, 0 for none",
    )
    report.add_argument("-o", "--out", type=Path, help="HTML file, FILE's name if absent")
    report.set_defaults(run=_report)


def _report(options: argparse.Namespace) -> int:
    out = check_file(options.out or Path(f"{options.file.stem}-report.html"))
    request, memory = request_of(options)

    from app.commands.report_files import ReportOrder, write_reports

    exports = tuple(dict.fromkeys(filter(None, options.export.split(","))))
    order = ReportOrder(out, exports, options.n_test, options.aircraft)
    report = write_reports(request, order, memory)
    print(report.text)
    return 0 if report.assessed else 1
