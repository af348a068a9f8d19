"""Build a proposed mapping: every entry has a confidence and reasons.

Entries that a person confirmed for an earlier file of the same recorder come first.
"""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.magnitudes import Extent, extent_of
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from app.telemetry.scaling import AS_RECORDED
from app.telemetry.targets import label_of, target_of
from app.telemetry.units import fits, spelled

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
    notes: sentences about the mapping as a whole.
    """

    columns: Columns
    channels: dict[str, ChannelSource] = field(default_factory=dict)
    times: dict[str, TimeSource] = field(default_factory=dict)
    rationales: dict[str, Rationale] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    most_confident: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    _extents: dict[str, Extent] = field(default_factory=dict, init=False)

    @property
    def mapping(self) -> Mapping:
        return Mapping(dict(self.channels), dict(self.times))

    def extent(self, name: str) -> Extent:
        """Range of a signal, read once."""
        if name not in self._extents:
            self._extents[name] = extent_of(self.columns.values(name))
        return self._extents[name]

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


def as_scaled(source: ChannelSource) -> list[str]:
    """The reason for a scale and an offset, if there are any."""
    return [f"scaled as the file declares: {source.scaling}"] if str(source.scaling) else []


CONFIDENCE = 0.98


def recall(builder: ProposalBuilder, remembered: Mapping, aircraft: str) -> None:
    """Use each confirmed entry whose signals the file has; otherwise record the reason."""
    origin = f"as confirmed for {aircraft}" if aircraft else "as confirmed before"
    _times(builder, remembered, origin)
    for key, source in remembered.channels.items():
        if not source.signal:
            continue
        if obstacle := _obstacle(builder, key, source.signal, source.unit):
            builder.rationales[key] = Rationale(0.0, (f"not {origin}: {obstacle}",))
            continue
        builder.assign(key, source, CONFIDENCE, origin)
        builder.confirmed.add(key)
        unit = spelled(builder.columns.signal(source.signal).unit)
        target_unit = target_of(key, source.unit).unit
        if unit and fits(unit, target_unit) and unit != spelled(source.unit):
            reason = f"the file now gives {unit} where {source.unit} was confirmed: check the unit"
            builder.comment(key, reason, 0.5)
        if other := other_scaling(builder.columns, source):
            builder.comment(key, f"{other}: check the scale", 0.5)
    _derived(builder, remembered, origin)
    confirmed = (builder.channels[key] for key in builder.confirmed)
    scalings = {source.signal: source.scaling for source in confirmed if source.signal}
    builder.columns = replace(builder.columns, scalings=scalings)
    builder._extents.clear()


def other_scaling(columns: Columns, source: ChannelSource) -> str:
    """How the file declares the scale of a signal, "" if it declares none or the same."""
    declared = columns.scaling(source.signal)
    if source.bits or declared in (AS_RECORDED, source.scaling):
        return ""
    as_mapped = str(source.scaling) or "raw"
    return f"the file declares {declared} for {source.signal}, and the mapping has {as_mapped}"


def _times(builder: ProposalBuilder, remembered: Mapping, origin: str) -> None:
    contents = builder.columns.contents
    rows = {signal.name: contents.groups[signal.group].n_rows for signal in contents.signals}
    for group in contents.groups:
        source = remembered.times.get(group.name)
        if source and source.rate and not group.time:
            source = replace(source, start=group.start)  # of this file
        elif not source or rows.get(source.signal) != group.n_rows or not fits(source.unit, "s"):
            continue
        builder.times[group.name] = source
        builder.rationales[f"t:{group.name}"] = Rationale(CONFIDENCE, (origin,))


def _obstacle(builder: ProposalBuilder, key: str, name: str, unit: str) -> str:
    """Why a confirmed signal cannot be used in this file; "" if it can."""
    contents = builder.columns.contents
    try:
        signal = builder.columns.signal(name)
    except KeyError:
        return f"the file has no signal {name}"
    if not _has_unit(key, unit):
        return f"{unit!r} is not a unit of {label_of(key)}"
    if contents.groups[signal.group].name not in builder.times:
        return f"{name} has no time"
    extent = builder.extent(name)
    return f"all {extent.n} rows of {name} are empty" if extent.empty else ""


def _has_unit(key: str, unit: str) -> bool:
    try:
        return fits(unit, target_of(key, unit).unit)
    except TelemetryError:
        return False


def _derived(builder: ProposalBuilder, remembered: Mapping, origin: str) -> None:
    """Assign confirmed derivations, each as soon as its inputs are mapped."""

    def lacking(key: str, name: str) -> list[str]:
        way = DERIVATIONS.get(name)
        if way is None or way.target != key:
            return [f"a derivation {name!r}"]
        return [need for need in way.needs if need not in builder.channels]

    pending = {key: source for key, source in remembered.channels.items() if source.derivation}
    while ready := [key for key in pending if not lacking(key, pending[key].derivation)]:
        for key in ready:
            builder.assign(key, pending.pop(key), CONFIDENCE, f"{origin}: derived")
            builder.confirmed.add(key)
    for key, source in pending.items():
        why = f"not {origin}: missing {' and '.join(lacking(key, source.derivation))}"
        builder.rationales[key] = Rationale(0.0, (why,))
