"""`forewarn certificate`: a monitor's certificate as a page to print."""

import argparse
import hashlib
from pathlib import Path

from app.commands.options.option import add_output, option
from app.commands.output.results import check_file, print_result
from core.whole_file import write_whole


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "monitor MONITOR.fwm", "a trained monitor", type=Path)
    add_output(parser, "FILE", "HTML file to write; named after the monitor if absent")


def run(options: argparse.Namespace) -> int:
    from app.report.certificate import certificate_page  # slow to import, not needed for help
    from core.evaluation.certificate import with_power_of_quiet
    from core.monitor import load
    from core.monitor.file.portable import read

    out = check_file(options.out or Path(f"{options.monitor.stem}-certificate.html"))
    monitor = load(options.monitor)
    digest = hashlib.sha256(read(options.monitor)).hexdigest()
    write_whole(out, certificate_page(monitor, options.monitor.stem, digest).encode())
    evaluation = monitor.evaluation and with_power_of_quiet(monitor.evaluation)
    plain = {"file": str(out), "digest": digest, "evaluation": evaluation}
    print_result(options, f"written: {out}", plain)
    return 0
