"""What the help of a command takes, against importing what the command works with."""

import resource
import subprocess
import sys

import numpy as np
import pytest

from tests.benchmarks.pairs import ROUNDS, Pair

pytestmark = pytest.mark.benchmark

HELP = """
from app.cli import main
main(["serve", "--help"])
"""
IMPORTS = "import app.serving, app.access.people, app.access.sessions, app.store.people\n"


def cpu_s(program: str) -> float:
    """Processor time of a program in a separate process [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], stdout=subprocess.DEVNULL, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def in_processes(ours: str, theirs: str) -> Pair:
    """Processor times of two programs in turns."""
    times = np.empty((ROUNDS, 2))
    for k in range(ROUNDS):
        for side in (0, 1) if k % 2 == 0 else (1, 0):
            times[k, side] = cpu_s((ours, theirs)[side])
    return Pair(times[:, 0], times[:, 1])


def test_help_against_importing_what_the_command_works_with():
    pair = in_processes(HELP, IMPORTS + HELP)
    print(f"\nserve --help: {pair} of {np.median(pair.ours):.2f} s with the imports of the server")
