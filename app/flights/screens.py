"""The screens that show a flight. One of them leads a replay, and the others follow.

The first screen to steer leads. Another one is refused until it takes the lead, or until the
leading one is gone. A program that steers without a screen is not asked.
"""

from app.flights.transport import NotPossible
from app.messages import Screen, ScreensChange


class Screens:
    """Screens by the ids that they chose, numbered in order of their coming."""

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
