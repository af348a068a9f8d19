"""One watcher of a flight, and the newest frames that all watchers share.

A frame is encoded once, when it is flown. A watcher holds no frames, only the number of its next
one, so a slow or frozen watcher costs a few hundred bytes and delays no one. It receives frames
while it has credit, which the client returns as it draws. Frames without credit are sent
later, or skipped and counted if there are too many. Alarms and changes of state and transport need
no credit and are never skipped: a watcher that does not read them is closed, and gets them when it
reconnects.
"""

import logging
from collections import deque
from collections.abc import Callable

from app.flights.clock import Clock
from app.flights.transport import NotPossible
from app.messages import LimitsFrom, Reset, Screen, ScreensChange, Waiting, encode_frames

LOG = logging.getLogger("forewarn")
TICK_S = 0.004
"""Least time between two rounds [s], so also the longest that a frame waits for its round."""
CREDIT = 16
NEWEST = 16
"""Newest frames that a slow watcher receives of those that came while it had no credit."""
LARGEST = 250
"""Most frames per message: after a burst, a resume, or one delay."""
RARELY = 500
"""Frames since the last delay after which a watcher counts as delayed once, not as slow."""
KEPT = 3_600
"""Frames kept for watchers that join or reconnect: over a minute at 50 Hz."""
FEW_WAITING = 4
"""Most queued messages up to which frames before a reset are still queued for a watcher."""
NO_CREDIT = 'no credit left: send {"type": "credit", "n": 1} for each frames message processed'
MAX_WAITING = 256
"""Most queued messages other than frames for one watcher."""


class RecentFrames:
    """The newest encoded frames since the last reset, by seq.

    first: oldest one kept.   since: first one after the reset.   held: limits in force since then.
    """

    def __init__(self, kept: int = KEPT, held: Callable[[], list[LimitsFrom]] = list) -> None:
        self._kept, self._held = kept, held
        self._ring: list[str] = []
        self._messages: dict[tuple[int, int, int], str] = {}
        self.first = self.since = 0
        self.head = -1
        self.first_t = 0.0

    def append(self, frame: str) -> None:
        """Add the next frame; it replaces the oldest one if the ring is full."""
        self.head += 1
        slot = self.head % self._kept
        if slot < len(self._ring):
            self._ring[slot] = frame
        else:
            self._ring.append(frame)
        self.first = max(self.first, self.head + 1 - self._kept)
        self._messages.clear()

    def restart(self, t: float) -> str:
        """The next frame, at t [s], does not follow the last one. Returns the reset to send."""
        self.first = self.since = self.head + 1
        self.first_t = t
        self._messages.clear()
        return self.reset()

    def reset(self) -> str:
        about = {"seq": self.first, "t": self.first_t, "since": self.since}
        return Reset(**about, held=self._held()).encode()

    def message(self, first: int, last: int, conflated: int) -> str:
        """Frames first..last as one message, encoded once for all watchers that get the same."""
        key = first, last, conflated
        text = self._messages.get(key)
        if text is None:
            frames = [self._ring[seq % self._kept] for seq in range(first, last + 1)]
            text = self._messages[key] = encode_frames(last, frames, conflated)
        return text


class Watcher:
    """The messages for one connection, which pulls them with `next_message`.

    on_news: called when there may be a message to send at once.
    on_frames: called when there are new frames.   screen: id of the one it is; empty for none.
    """

    def __init__(self, recent: RecentFrames, screen: str = "") -> None:
        self.screen = screen
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
        self.credit, self._was_asked = CREDIT, False
        self.ended = False
        self.overrun = False

    @property
    def conflated(self) -> int:
        """Frames skipped so far, including those that will be skipped when credit returns."""
        behind = self._recent.head + 1 - self._next
        return self._conflated + (max(behind - self._most, 0) if self._conflating else 0)

    @property
    def _most(self) -> int:
        return LARGEST if self._recent.head - self._conflated_at >= RARELY else NEWEST

    def wake(self) -> None:
        if not self.credit:
            self._conflating = True
        if self.on_frames is not None:
            self.on_frames()

    def grant(self, n: int) -> None:
        """The client processed n messages of frames."""
        had_none = not self.credit
        self.credit, self._was_asked = min(self.credit + n, CREDIT), False
        if had_none:
            self._notify()

    def resume(self, seq: int) -> None:
        """Send the frames after seq; a reset and all kept frames if these are not enough."""
        recent, self._conflating = self._recent, False
        if self._started or not recent.first - 1 <= seq <= recent.head:
            self._next = recent.first
            self.send(recent.reset())
        else:
            self._next = seq + 1
            self._notify()

    def send(self, text: str) -> None:
        """Queue a message before any further frame; close a watcher that reads none."""
        if len(self._waiting) >= MAX_WAITING:
            self.overrun = self.ended = True
            self._waiting.clear()
        if not self.ended:
            self._waiting.append(text)
        self._notify()

    def beat(self, heartbeat: Callable[[int], str]) -> None:
        """Queue a heartbeat, made from the count of skipped frames; only the newest is kept."""
        self._heartbeat = heartbeat
        self._notify()

    def before_reset(self) -> None:
        """Before the frames are dropped, queue those that this watcher has credit for."""
        head = self._recent.head
        while self.credit and self._next <= head and len(self._waiting) < FEW_WAITING:
            self._waiting.append(self._frames())
        self._conflated += head + 1 - self._next
        self._next, self._conflating = head + 1, False

    def end(self, text: str) -> None:
        """Send the frames there is credit for, then this last message."""
        self.before_reset()
        self.send(text)
        self._heartbeat, self.ended = None, True
        self._notify()

    @property
    def is_done(self) -> bool:
        return self.ended and not self._waiting

    def next_message(self) -> str | None:
        if self._waiting:
            return self._waiting.popleft()
        if self._heartbeat is not None:
            behind = self._recent.head + 1 - self._next
            if behind > 0 and not (self.credit or self._was_asked):
                self._was_asked = True
                return Waiting(behind=behind, reason=NO_CREDIT).encode()
            heartbeat, self._heartbeat = self._heartbeat, None
            return heartbeat(self.conflated)
        recent = self._recent
        if not self.credit or self._next > recent.head:
            return None
        return self._frames()

    def _notify(self) -> None:
        if self.on_news is not None:
            self.on_news()

    def _frames(self) -> str:
        """Spend a credit on the next frames, on the newest ones if too many came without credit."""
        recent = self._recent
        oldest = max(recent.first, recent.head + 1 - self._most if self._conflating else 0)
        if self._conflating:
            self._conflated_at = recent.head
        first = max(self._next, oldest)
        last = min(first + LARGEST - 1, recent.head)
        skipped = first - self._next
        self._conflated += skipped
        self._next, self._conflating, self._started = last + 1, False, True
        self.credit -= 1
        return recent.message(first, last, skipped)


class FrameTicks:
    """Sends new frames to all watchers in one round, TICK_S or more after the last round.

    Writes in a group cost half as much as single ones, and frames of one flight between two rounds
    become one message. Both save more the busier the server is.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due: dict[Callable[[], object], None] = {}
        self._next = clock.now()
        self._is_planned = False

    def ask(self, send: Callable[[], object]) -> None:
        self._due[send] = None
        if not self._is_planned:
            self._is_planned = True
            self._clock.call_at(self._next, self._send)

    def _send(self) -> None:
        due, self._due = self._due, {}
        self._is_planned = False
        for send in due:
            try:
                send()
            except Exception:
                LOG.exception("new frames were not sent to a watcher")
        self._next = self._clock.now() + TICK_S


class Screens:
    """Screens by the ids that they chose, numbered in order of their coming.

    One of them leads a replay, and the others follow: the first to steer. Another one is refused
    until it takes the lead, or until the leading one is gone. A program that steers without a
    screen is not asked.
    """

    def __init__(self) -> None:
        self._connections: dict[str, int] = {}
        self._known: dict[str, Screen] = {}
        self._n_seen = 0
        self._leader = ""

    def join(self, screen: str, by: str) -> None:
        """Add a connection of a screen. by: its person."""
        if screen not in self._known:
            self._n_seen += 1
            self._known[screen] = Screen(id=screen, number=self._n_seen, by=by)
        self._connections[screen] = self._connections.get(screen, 0) + 1

    def leave(self, screen: str) -> None:
        self._connections[screen] -= 1
        if not self._connections[screen]:
            del self._connections[screen]
            if screen != self._leader:
                del self._known[screen]

    def check(self, screen: str) -> None:
        """Refuse a screen that may not steer now. NotPossible."""
        if screen not in self._connections:
            raise NotPossible("this screen is not connected to the flight: reload it")
        if self._leader in self._connections and screen != self._leader:
            number = self._known[self._leader].number
            raise NotPossible(f"screen {number} leads this replay: take the lead first")

    def lead(self, screen: str) -> bool:
        """Let a connected screen lead. Returns whether it did not before. NotPossible."""
        if screen not in self._connections:
            raise NotPossible("only a screen that is connected to the flight can lead it")
        before, self._leader = self._leader, screen
        if before != screen and before not in self._connections:
            self._known.pop(before, None)
        return before != screen

    @property
    def message(self) -> ScreensChange:
        screens = [self._known[screen] for screen in self._connections]
        return ScreensChange(screens=screens, leader=self._known.get(self._leader))
