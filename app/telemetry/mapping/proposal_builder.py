"""A mapping being proposed: each entry with its confidence, and every reason for it."""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource

MOST_CONFIDENT = 0.99


@dataclass(frozen=True)
class Rationale:
    """Confidence in an entry, 0 to 1, and why; a channel without a source has confidence 0."""

    confidence: float
    reasons: tuple[str, ...] = ()


@dataclass(eq=False)
class ProposalBuilder:
    """What has been decided so far.

    confirmed: channels that a person has settled before; they are commented on, never changed.
    most_confident: of channels whose unit is inferred, which their signs do not support.
    """

    columns: Columns
    channels: dict[str, ChannelSource] = field(default_factory=dict)
    times: dict[str, TimeSource] = field(default_factory=dict)
    rationales: dict[str, Rationale] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    most_confident: dict[str, float] = field(default_factory=dict)

    @property
    def mapping(self) -> Mapping:
        """The mapping so far."""
        return Mapping(dict(self.channels), dict(self.times))

    def assign(self, key: str, source: ChannelSource, confidence: float, *reasons: str) -> None:
        """Give a channel its source."""
        self.channels[key] = source
        self.rationales[key] = Rationale(min(confidence, MOST_CONFIDENT), reasons)

    def change(self, key: str, **changes: object) -> None:
        """Change the source of a channel."""
        self.channels[key] = replace(self.channels[key], **changes)

    def comment(self, key: str, reason: str, factor: float = 1.0) -> None:
        """Add a reason, which multiplies the confidence by a factor."""
        before = self.rationales.get(key, Rationale(0.0))
        confidence = round(before.confidence * factor, 4)
        self.rationales[key] = Rationale(confidence, (*before.reasons, reason))

    def support(self, key: str, reason: str, factor: float) -> None:
        """Add a reason, which multiplies what the confidence lacks to 1 by a factor."""
        before = self.rationales[key]
        most = min(MOST_CONFIDENT, max(self.most_confident.get(key, 1.0), before.confidence))
        confidence = round(min(1.0 - factor * (1.0 - before.confidence), most), 4)
        self.rationales[key] = Rationale(confidence, (*before.reasons, reason))
