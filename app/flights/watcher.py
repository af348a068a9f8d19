"""One watcher of a flight, and the newest frames that all of them share.

A frame is encoded once, when it is flown. A watcher holds no frames, only the number of the next
one: a slow or frozen one costs a few hundred bytes and nobody any time. It is sent frames while it
has credit, which it gives back as it draws; what it could not take meanwhile is left out but for
the newest, and counted. Alarms, changes of state and of transport need no credit and are never left
out: a watcher that does not take them is closed, and finds them again when it reconnects.
"""

from collections import deque
from collections.abc import Callable

from app.messages import LimitsFrom, Reset, Waiting, encode_frames

CREDIT = 16
NEWEST = 16
"""Frames that a watcher that is always slow is sent of those that came while it had no credit."""
LARGEST = 250
"""Frames a message: after a burst, for a watcher that resumes or that was held up once."""
RARELY = 500
"""Frames between two times without credit that make a watcher held up, not slow."""
KEPT = 3_600
"""Frames kept for those who reconnect: over a minute at 50 Hz."""
FEW_WAITING = 4
"""A watcher that takes nothing is kept no frames of before a reset beyond this."""
NO_CREDIT = 'no credit is left: send {"type": "credit", "n": 1} for each message of frames taken'
MAX_WAITING = 256
"""Messages other than frames that may wait for one watcher."""


class RecentFrames:
    """The newest encoded frames since the last reset, by seq.

    held: which limits held since then.
    """

    def __init__(self, kept: int = KEPT, held: Callable[[], list[LimitsFrom]] = list) -> None:
        self._kept, self._held = kept, held
        self._ring: list[str] = []
        self._messages: dict[tuple[int, int, int], str] = {}
        self._newest = ""
        self.first = self.since = 0
        self.head = -1
        self.first_t = 0.0

    def append(self, frame: str) -> None:
        """Keep the next frame; the oldest one goes where there is no room."""
        self.head += 1
        slot = self.head % self._kept
        if slot < len(self._ring):
            self._ring[slot] = frame
        else:
            self._ring.append(frame)
        self.first = max(self.first, self.head + 1 - self._kept)
        self._messages.clear()
        self._newest = ""

    def restart(self, t: float) -> str:
        """What comes next, at t [s], does not follow what is kept. Returns the reset to send."""
        self.first = self.since = self.head + 1
        self.first_t = t
        self._messages.clear()
        return self.reset()

    def reset(self) -> str:
        """Return the message that says where the kept frames start."""
        about = {"seq": self.first, "t": self.first_t, "since": self.since}
        return Reset(**about, held=self._held()).encode()

    @property
    def newest(self) -> str:
        """The newest frame as one message: what nearly everybody gets."""
        if not self._newest:
            self._newest = self.message(self.head, self.head, 0)
        return self._newest

    def message(self, first: int, last: int, conflated: int) -> str:
        """Return frames first..last as one message, encoded once for all who get the same."""
        key = first, last, conflated
        text = self._messages.get(key)
        if text is None:
            frames = [self._ring[seq % self._kept] for seq in range(first, last + 1)]
            text = self._messages[key] = encode_frames(last, frames, conflated)
        return text


class Watcher:
    """What one connection is to be sent next; it pulls that with `take`.

    on_news: called when there may be something to take that is not to wait.
    on_frames: called when there are new frames.
    """

    def __init__(self, recent: RecentFrames) -> None:
        self._recent = recent
        self._next = recent.head + 1
        self._conflating = False
        self._started = False
        self._waiting: deque[str] = deque()
        self._heartbeat: Callable[[int], str] | None = None
        self._conflated = 0
        self._conflated_at = -RARELY
        self.on_news: Callable[[], object] | None = None
        self.on_frames: Callable[[], object] | None = None
        self.credit, self._is_told = CREDIT, False
        self.ended = False
        self.overrun = False

    @property
    def conflated(self) -> int:
        """Frames left out so far, those that will be when credit comes included."""
        behind = self._recent.head + 1 - self._next
        return self._conflated + (max(behind - self._most, 0) if self._conflating else 0)

    @property
    def _most(self) -> int:
        """Frames that are sent of those that came without credit."""
        return LARGEST if self._recent.head - self._conflated_at >= RARELY else NEWEST

    def wake(self) -> None:
        """There are new frames."""
        if not self.credit:
            self._conflating = True
        if self.on_frames is not None:
            self.on_frames()

    def grant(self, n: int) -> None:
        """The client took n messages of frames."""
        had_none = not self.credit
        self.credit, self._is_told = min(self.credit + n, CREDIT), False
        if had_none:
            self._tell_news()

    def resume(self, seq: int) -> None:
        """Send what followed seq; where that is not kept, or is too late to ask, reset and all."""
        recent, self._conflating = self._recent, False
        if self._started or not recent.first - 1 <= seq <= recent.head:
            self._next = recent.first
            self.tell(recent.reset())
        else:
            self._next = seq + 1
            self._tell_news()

    def tell(self, text: str) -> None:
        """Send this before any further frame; close a watcher that takes nothing."""
        if len(self._waiting) >= MAX_WAITING:
            self.overrun = self.ended = True
            self._waiting.clear()
        if not self.ended:
            self._waiting.append(text)
        self._tell_news()

    def beat(self, heartbeat: Callable[[int], str]) -> None:
        """Send a heartbeat, given the count of frames left out; the newest only."""
        self._heartbeat = heartbeat
        self._tell_news()

    def before_reset(self) -> None:
        """Frames are about to be forgotten: take those that this watcher can still be sent."""
        head = self._recent.head
        while self.credit and self._next <= head and len(self._waiting) < FEW_WAITING:
            self._waiting.append(self._frames())
        self._conflated += head + 1 - self._next
        self._next, self._conflating = head + 1, False

    def end(self, text: str) -> None:
        """Send the frames there is credit for, then this, and no more."""
        self.before_reset()
        self.tell(text)
        self._heartbeat, self.ended = None, True
        self._tell_news()

    @property
    def is_done(self) -> bool:
        """Whether nothing follows what was taken."""
        return self.ended and not self._waiting

    def take_newest(self) -> str | None:
        """The newest frame, where that is all there is to send; None where it is not."""
        recent = self._recent
        has_other = self._waiting or self._heartbeat is not None or self._conflating
        if has_other or self._next != recent.head or not self.credit:
            return None
        self._next, self._started = self._next + 1, True
        self.credit -= 1
        return recent.newest

    def take(self) -> str | None:
        """The next message; None where there is none yet, or none any more."""
        if self._waiting:
            return self._waiting.popleft()
        if self._heartbeat is not None:
            if self._must_be_told:
                return self._tell_of_credit()
            heartbeat, self._heartbeat = self._heartbeat, None
            return heartbeat(self.conflated)
        recent = self._recent
        if not self.credit or self._next > recent.head:
            return None
        return self.take_newest() or self._frames()

    def _tell_news(self) -> None:
        if self.on_news is not None:
            self.on_news()

    @property
    def _must_be_told(self) -> bool:
        """Whether frames wait for a client that gives no credit and was not told why."""
        return not (self.credit or self._is_told) and self._next <= self._recent.head

    def _tell_of_credit(self) -> str:
        self._is_told = True
        return Waiting(behind=self._recent.head + 1 - self._next, reason=NO_CREDIT).encode()

    def _frames(self) -> str:
        """Spend a credit on the next frames; of those that came without one, on the newest."""
        recent = self._recent
        oldest = max(recent.first, recent.head + 1 - self._most if self._conflating else 0)
        if self._conflating:
            self._conflated_at = recent.head
        first = max(self._next, oldest)
        last = min(first + LARGEST - 1, recent.head)
        left_out = first - self._next
        self._conflated += left_out
        self._next, self._conflating, self._started = last + 1, False, True
        self.credit -= 1
        return recent.message(first, last, left_out)
