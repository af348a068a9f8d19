"""A mapping in the making: each entry with how sure it is, and every reason for it."""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource


@dataclass(frozen=True)
class Guess:
    """How sure an entry is, 0 to 1, and why; a channel that has none is 0 sure."""

    confidence: float
    reasons: tuple[str, ...] = ()


@dataclass(eq=False)
class Draft:
    """What has been decided so far.

    confirmed: channels that a person has settled before; they are commented on, never changed.
    unsaid: channels whose unit neither file nor name says.
    """

    columns: Columns
    channels: dict[str, ChannelSource] = field(default_factory=dict)
    times: dict[str, TimeSource] = field(default_factory=dict)
    guesses: dict[str, Guess] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    unsaid: set[str] = field(default_factory=set)

    @property
    def mapping(self) -> Mapping:
        """What the draft comes to."""
        return Mapping(dict(self.channels), dict(self.times))

    def take(self, key: str, source: ChannelSource, confidence: float, *reasons: str) -> None:
        """Give a channel its source."""
        self.channels[key] = source
        self.guesses[key] = Guess(min(confidence, 0.99), reasons)

    def comment(self, key: str, reason: str, times: float = 1.0) -> None:
        """Add a reason to a guess, which leaves `times` of its confidence."""
        guess = self.guesses.get(key, Guess(0.0))
        confidence = round(guess.confidence * times, 4)
        self.guesses[key] = Guess(confidence, (*guess.reasons, reason))

    def bear_out(self, key: str, reason: str, doubt: float) -> None:
        """Add a reason to a guess, which leaves `doubt` of the doubts about it."""
        guess = self.guesses[key]
        confidence = round(min(1.0 - doubt * (1.0 - guess.confidence), 0.99), 4)
        self.guesses[key] = Guess(confidence, (*guess.reasons, reason))

    def change(self, key: str, **changes: object) -> None:
        """Change the source of a channel."""
        self.channels[key] = replace(self.channels[key], **changes)
