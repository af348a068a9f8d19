"""Build a proposed mapping: every entry has a confidence and reasons."""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource

MOST_CONFIDENT = 0.99


@dataclass(frozen=True)
class Rationale:
    """Confidence in an entry, 0 to 1, and reasons; 0 for a channel without a source."""

    confidence: float
    reasons: tuple[str, ...] = ()


@dataclass(eq=False)
class ProposalBuilder:
    """The proposal so far.

    confirmed: channels that a person has confirmed; they get comments but are never changed.
    most_confident: upper limit of the confidence in channels with an inferred unit.
    """

    columns: Columns
    channels: dict[str, ChannelSource] = field(default_factory=dict)
    times: dict[str, TimeSource] = field(default_factory=dict)
    rationales: dict[str, Rationale] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    most_confident: dict[str, float] = field(default_factory=dict)

    @property
    def mapping(self) -> Mapping:
        return Mapping(dict(self.channels), dict(self.times))

    def assign(self, key: str, source: ChannelSource, confidence: float, *reasons: str) -> None:
        self.channels[key] = source
        self.rationales[key] = Rationale(min(confidence, MOST_CONFIDENT), reasons)

    def change(self, key: str, **changes: object) -> None:
        self.channels[key] = replace(self.channels[key], **changes)

    def comment(self, key: str, reason: str, factor: float = 1.0) -> None:
        """Add a reason and multiply the confidence by a factor."""
        before = self.rationales.get(key, Rationale(0.0))
        confidence = round(before.confidence * factor, 4)
        self.rationales[key] = Rationale(confidence, (*before.reasons, reason))

    def support(self, key: str, reason: str, factor: float) -> None:
        """Add a reason and multiply the doubt, 1 - confidence, by a factor."""
        before = self.rationales[key]
        most = min(MOST_CONFIDENT, max(self.most_confident.get(key, 1.0), before.confidence))
        confidence = round(min(1.0 - factor * (1.0 - before.confidence), most), 4)
        self.rationales[key] = Rationale(confidence, (*before.reasons, reason))
