"""Waits in tests, with a time limit long enough for a busy machine."""

import time
from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")
PATIENCE = 120
"""[s] Who takes longer hangs; the first call of a machine compiles kernels."""


def until(find: Callable[[], Found]) -> Found:
    """What a server does by itself, as soon as it is found."""
    end = time.monotonic() + PATIENCE
    while not (found := find()):
        assert time.monotonic() < end
        time.sleep(0.01)  # between two questions to another thread or process
    return found
