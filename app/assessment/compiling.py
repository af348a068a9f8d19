"""Compiles the kernels of a live sample before the first flight needs them."""

import logging
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from app.assessment.planned_test import known_test
from app.assessment.scorer import CausalScorer
from app.assessment.trim import CausalTrim
from core.kernels.compiled import cache_directory
from core.monitor import Monitor

LOG = logging.getLogger("forewarn")
COMPILED = "live"
"""File beside the compiled kernels: marks that those of a live sample exist."""
APART = """
import sys
from app.assessment.compiling import warm_up
from core.monitor.file.loading import from_bytes
warm_up(from_bytes(sys.stdin.buffer.read()))
"""


def make_ready(monitor: Monitor) -> None:
    """Compile and load all kernels of a live sample; for a thread.

    They are compiled once per machine, in a separate process: compiling holds the interpreter and
    would stop the flights in progress.
    """
    done = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_directory()) / COMPILED
    if not done.exists():
        apart = subprocess.run(
            [sys.executable, "-c", APART],
            input=monitor.to_bytes(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            check=False,
        )
        if apart.returncode:
            LOG.warning("kernels are compiled during flights: %s", apart.stderr.decode()[-500:])
        else:
            with suppress(OSError):
                done.touch()
    warm_up(monitor)


def warm_up(monitor: Monitor) -> None:
    """Assess a few samples of zeros; the grid, the trim and the checks compile when made."""
    CausalScorer(monitor, monitor.recipe.epsilon, delay=0.0, trim="none")
    CausalTrim(known_test(monitor))
    stream = monitor.stream(monitor.recipe.epsilon)
    nothing = np.zeros(len(monitor.dictionary))
    for k in range(monitor.recipe.n_delay + 2):
        stream.update(k * monitor.dt, nothing)
    if monitor.envelope is not None:
        monitor.envelope.exceeds(nothing)
