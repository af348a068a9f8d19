"""Withdrawal: once a flight is unlike those of training, nothing more is said of it.

It is one verdict a flight, the same live as of a track that is known whole: the flight is invalid
from the first sample by which it strays too far, to its end. Neither a gap nor a restart of the
history takes that back, so a live flight counts as one manoeuvre: the next one is another flight.

What counts ends with the first sample that reaches a limit, as it did for the flights behind the
bounds. The guarantee is about what comes before; so the verdict of that moment stays, and no
aircraft is called invalid for where it goes once it has left its envelope.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from app.recipes import from_plain
from core.monitor import Assessment, Assessments, Monitor, State
from core.monitor.validity import Running, first_stray
from core.specification import Limits
from core.types import Array, Flags


class Withdrawal(NamedTuple):
    """first: sample from which on nothing is said.   reason: why."""

    first: int
    reason: str


def limits_of(monitor: Monitor) -> Limits:
    """What a monitor's flights must not reach."""
    plain = monitor.dataset_recipe.get("specification", {})
    return from_plain(Limits(), plain, "specification")


def in_words(reasons: Sequence[str]) -> str:
    """The reasons of a verdict as one text."""
    return "; ".join(reasons)


def withdrawal(monitor: Monitor, t: Array, y: Array, said: Assessments) -> Withdrawal | None:
    """Where a whole track is withdrawn from; None for one that is not, or cannot be judged.

    t: (n,) [s].   y: (n, 6).   said: what monitor.assess(t, y) said.
    """
    past = _is_past(limits_of(monitor).magnitudes, y)
    end = int(past.argmax()) if past.any() else None
    found = first_stray(monitor, t, y, said, end=end)
    return None if found is None else Withdrawal(found[0], in_words(found[1].reasons))


class CheckedStream:
    """A monitor's stream that says nothing more once the flight has strayed.

    Of a monitor whose validity is not calibrated it is the stream, as it is.
    """

    def __init__(self, monitor: Monitor, epsilon: float) -> None:
        self._stream = monitor.stream(epsilon)
        self._running = None if monitor.support is None else Running(monitor)
        self._limits = limits_of(monitor).magnitudes
        self._reason = ""

    def update(self, t: float, y: npt.ArrayLike) -> Assessment:
        """Assess the next sample, as core.monitor's Stream."""
        y = np.ascontiguousarray(y, np.float64)
        said = self._stream.update(t, y)
        if self._running is not None and self._running.update(y, said):
            self._reason = in_words(self._running.verdict.reasons)
        if self._reason or _is_past(self._limits, y):
            self._running = None  # the verdict stays
        return withdrawn(said.t, self._reason) if self._reason else said


def withdrawn(t: float, reason: str) -> Assessment:
    """What is said of a sample of which nothing may be said."""
    return Assessment(t, None, None, State.INVALID, reason)


def _is_past(limits: Array, y: Array) -> Flags:
    """Whether a sample reaches a limit. A value that is missing does not: it says nothing."""
    return np.asarray((np.isfinite(y) & (np.abs(y) >= limits)).any(axis=-1))
