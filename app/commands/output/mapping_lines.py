"""The reader's notes on a file and its mapping of signals to channels, as lines to print."""

from collections.abc import Iterator
from pathlib import Path

from app.recipes.recipes import read_plain
from app.telemetry.contents import Contents
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.proposal import Proposal
from app.telemetry.targets import TARGETS
from core.channels import Channel

MOST_BAD_ROWS = 10
"""Most bad rows to list."""
EVIDENT = 0.9
"""A proposal with at least this confidence is printed without reasons."""


def read_mapping(path: Path) -> Mapping:
    """A mapping from a JSON file. RecipeError, TelemetryError."""
    return Mapping.from_plain(read_plain(path))


def contents_lines(contents: Contents) -> Iterator[str]:
    yield from contents.notes
    yield from (f"ignored: {item}" for item in contents.ignored)
    listed = contents.bad_rows[:MOST_BAD_ROWS]
    if contents.n_bad_rows:
        yield f"bad rows skipped: {contents.n_bad_rows}"
    yield from (f"  line {row.line}: {row.reason}: {row.text}" for row in listed)
    if contents.n_bad_rows > len(listed):
        yield f"  and {contents.n_bad_rows - len(listed)} more"


def mapping_lines(mapping: Mapping, proposal: Proposal | None) -> Iterator[str]:
    """One line for each channel, with the confidence of a proposal."""
    yield "proposed mapping:" if proposal else "given mapping:"
    for key in (key for key in TARGETS if key in mapping.channels):
        source = mapping.channels[key]
        rationale = proposal.rationales.get(key) if proposal else None
        confidence = ""
        if rationale is not None and not source.derivation:
            confidence = f", confidence {rationale.confidence:.0%}"
            if rationale.confidence < EVIDENT:
                confidence += f": {'; '.join(rationale.reasons)}"
        yield f"  {key:8} {_source(source, TARGETS[key])}{confidence}"


def _source(source: ChannelSource, target: Channel) -> str:
    if source.derivation:
        return f"derived: {source.derivation}"
    sign = "-" if source.sign < 0 else ""
    bias = f", bias removed: {target.read(source.bias)}" if source.bias else ""
    return f"{sign}{source.signal} [{source.unit or 'unit not given'}]{bias}"
