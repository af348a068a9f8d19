"""Waits in tests, with a time limit long enough for a busy machine."""

import time
from collections.abc import Callable

PATIENCE = 120
"""[s] Who takes longer hangs; the first call of a machine compiles kernels."""


def until(found: Callable[[], object]) -> None:
    """Wait for what the server does by itself."""
    end = time.monotonic() + PATIENCE
    while not found():
        assert time.monotonic() < end
        time.sleep(0.05)  # between two questions to another process
