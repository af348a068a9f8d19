"""Transport: which sample of a source is due when. Arithmetic only, the clock's time is passed in.

Sample k is due at anchor + (t_k - t_anchor) / speed, always from the same anchor: late calls cause
no drift. Late samples follow one after the other, none skipped. A flight that is later than
CATCH_UP_S continues from its position, and `slipped` counts the time lost.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from core.types import Array

SLOWEST, FASTEST = 0.1, 10.0
CATCH_UP_S = 1.0
"""[s] A flight later than this, for example after a suspended machine, does not catch up."""
BURST = 512
"""Most samples per call; the rest follows in the next one."""


class TransportError(ValueError):
    """An invalid action."""


class NotPossible(TransportError):
    """A valid action that this flight cannot do now."""


class Due(NamedTuple):
    """A sample to fly now.

    sample: its number in the source.   due: clock time at which it was due [s].
    restarts: it does not follow the sample before it (seek, loop).
    """

    sample: int
    due: float
    restarts: bool


class Transport:
    """Plays the samples of a source."""

    def __init__(self, t: Array, dt: float, *, speed: float = 1.0, loop: bool = False) -> None:
        self._t, self._dt = t, dt
        self._next = 0
        self._restarts = False
        self._asked: list[int] = []
        self._anchor: tuple[float, float] | None = None
        self.index = -1
        self.playing = False
        self.loop = loop
        self.slipped = 0.0
        self.speed = _checked_speed(speed)

    @property
    def position(self) -> float:
        """Time in the source of the last sample flown [s]."""
        return float(self._t[max(self.index, 0)])

    @property
    def at_end(self) -> bool:
        return self._next >= len(self._t)

    def play(self, now: float) -> None:
        """Play from here; at the end, from the start."""
        if self.playing:
            return
        if self.at_end:
            self._go_to(0)
        self.playing = True
        wait = self._dt / self.speed if self.index >= 0 and not self._restarts else 0.0
        self._anchor = (now + wait, self._time(self._next))

    def pause(self) -> None:
        self.playing, self._anchor = False, None

    def set_speed(self, speed: float, now: float) -> None:
        """Play at `speed` times the source's rate; the progress towards the next sample is kept."""
        speed = _checked_speed(speed)
        if self._anchor is not None:
            due = self._due(self._next)
            wait = max(due - now, 0.0) * self.speed / speed
            self._anchor = (now + wait, self._time(self._next))
        self.speed = speed

    def seek(self, t: float, now: float) -> None:
        """Fly the first sample at or after t [s] at once; continue from there if playing."""
        if not np.isfinite(t):
            raise TransportError(f"seek to {t}: give a time in seconds")
        last = len(self._t) - 1
        self.jump(min(int(np.searchsorted(self._t, t - 1e-9)), last), now)

    def jump(self, index: int, now: float) -> None:
        """Fly this sample at once; continue from there if playing."""
        self._go_to(index)
        self._asked = [index]
        self._next = index + 1
        if self.playing:
            self._anchor = (now, self._time(index))

    def step(self, n: int, now: float) -> None:
        """Pause, then fly the next n samples at once; for n < 0, the sample n before this one."""
        if not 1 <= abs(n) <= BURST:
            raise TransportError(f"step of {n}: give 1 to {BURST} samples, negative for backwards")
        self.pause()
        if n < 0:
            self.jump(max(self.index + n, 0), now)
        else:
            stop = min(self._next + n, len(self._t))
            self._asked += range(self._next, stop)
            self._next = stop

    def next_due(self, now: float) -> float | None:
        """When to call `due_samples` again [s]; None until an action."""
        if self._asked:
            return now
        if not self.playing:
            return None
        return self._due(self._next)

    def due_samples(self, now: float) -> Iterator[Due]:
        """Yield the samples that are due. At the end of the source: loop or pause."""
        for index in self._asked:
            yield self._hand_out(index, now)
        self._asked = []
        if self.playing and now - self._due(self._next) > CATCH_UP_S:
            self.slipped += now - self._due(self._next)
            self._anchor = (now, self._time(self._next))
        for _ in range(BURST):
            if not self.playing or (due := self._due(self._next)) > now:
                return
            if self._next == len(self._t):
                if not self.loop:
                    self.pause()
                    return
                self._go_to(0)
                self._anchor = (due, self._time(0))
            self._next += 1
            yield self._hand_out(self._next - 1, due)

    def _hand_out(self, index: int, due: float) -> Due:
        restarts, self._restarts, self.index = self._restarts, False, index
        return Due(index, due, restarts)

    def _go_to(self, index: int) -> None:
        self._next = index
        self._restarts = self._restarts or self.index >= 0
        self._asked = []

    def _due(self, index: int) -> float:
        assert self._anchor is not None
        now, t = self._anchor
        return now + (self._time(index) - t) / self.speed

    def _time(self, index: int) -> float:
        """Time of a sample [s]; the source ends one interval after its last sample."""
        if index < len(self._t):
            return float(self._t[index])
        return float(self._t[-1]) + self._dt


def _checked_speed(speed: float) -> float:
    if not SLOWEST <= speed <= FASTEST:
        raise TransportError(f"speed {speed}: give a factor between {SLOWEST:g} and {FASTEST:g}")
    return float(speed)
