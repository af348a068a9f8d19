"""How often an address was refused of late: one that is refused all the time is read slowly."""

import time
from collections import OrderedDict, deque

MOST, WITHIN_S = 100, 1.0
"""So many refusals of an address within so long [s] are many."""
MOST_ADDRESSES = 1_000
"""That are remembered, those refused last."""


class Refusals:
    """When each address was refused."""

    def __init__(self) -> None:
        self._times: OrderedDict[str, deque[float]] = OrderedDict()

    def note(self, address: str) -> None:
        """A request of this address was refused now."""
        self._times.setdefault(address, deque(maxlen=MOST)).append(time.monotonic())
        self._times.move_to_end(address)
        if len(self._times) > MOST_ADDRESSES:
            self._times.popitem(last=False)

    def are_many(self, address: str) -> bool:
        """Whether this address was refused too often."""
        times = self._times.get(address, ())
        return len(times) == MOST and time.monotonic() - times[0] < WITHIN_S
