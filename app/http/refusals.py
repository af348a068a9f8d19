"""Counts recent refusals by address; a flooding address is read slowly."""

import time
from collections import OrderedDict, deque

MOST, WITHIN_S = 100, 1.0
"""An address with MOST refusals within WITHIN_S [s] is flooding."""
MOST_ADDRESSES = 1_000
"""Addresses remembered, those refused last."""


class Refusals:
    """Times of the last refusals of each address."""

    def __init__(self) -> None:
        self._times: OrderedDict[str, deque[float]] = OrderedDict()

    def note(self, address: str) -> None:
        self._times.setdefault(address, deque(maxlen=MOST)).append(time.monotonic())
        self._times.move_to_end(address)
        if len(self._times) > MOST_ADDRESSES:
            self._times.popitem(last=False)

    def is_flooding(self, address: str) -> bool:
        times = self._times.get(address, ())
        return len(times) == MOST and time.monotonic() - times[0] < WITHIN_S
