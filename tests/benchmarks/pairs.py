"""Two ways of the same work, timed in turns: whatever slows the machine slows both."""

from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

ROUNDS = 5


class Pair(NamedTuple):
    """Times of each round [s], (rounds,) each."""

    ours: np.ndarray
    theirs: np.ndarray

    def per(self, ours: int, theirs: int | None = None) -> "Pair":
        """Return the times of one of so many things that each side did in a round."""
        return Pair(self.ours / ours, self.theirs / (theirs or ours))

    @property
    def ratio(self) -> float:
        """How many times as long they take: median of the rounds."""
        return float(np.median(self.theirs / self.ours))

    def __str__(self) -> str:
        """Return the median ratio of the rounds, and that of the shortest times."""
        return f"x{self.ratio:.3g} (shortest x{self.theirs.min() / self.ours.min():.3g})"


def in_turns(
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    rounds: int = ROUNDS,
    warm: bool = True,
    clock: Callable[[], float] = perf_counter,
) -> Pair:
    """Time both in turns, each round beginning with the other one.

    warm: call both once beforehand.   clock: [s], `process_time` on a loaded machine.
    ValueError for fewer than five rounds.
    """
    if rounds < ROUNDS:
        raise ValueError(f"{rounds} rounds were asked for: a ratio needs at least {ROUNDS}")
    for task in (ours, theirs) if warm else ():
        task()
    times = np.empty((rounds, 2))
    for k in range(rounds):
        for side in (0, 1) if k % 2 == 0 else (1, 0):
            begin = clock()
            (ours, theirs)[side]()
            times[k, side] = clock() - begin
    return Pair(times[:, 0], times[:, 1])
