"""Rescoring: the samples of a live flight's journal, as shown at each moment."""

from collections.abc import Iterable, Iterator
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from app.assessment.batches import Batch, ChannelReader
from app.assessment.limits_in_force import LimitsInForce
from app.assessment.scorer import CausalScorer, LiveAssessed
from app.telemetry.journal import lines_of


class ShownSample(NamedTuple):
    """A sample, and when it was shown: time since the flight began [s]."""

    shown: float
    assessed: LiveAssessed


def header_of(path: Path) -> dict[str, Any] | None:
    """First line of a journal, which describes its flight; None if it is empty. OSError."""
    return next(lines_of(path), None)


def replay_line(
    line: dict[str, Any], scorer: CausalScorer, reader: ChannelReader
) -> list[LiveAssessed]:
    """Apply a line of a journal. Returns the samples that it settles."""
    if "b" in line:
        samples = reader.samples(Batch(line["s"], line["b"]))
        arrived, source = line["a"], line.get("v", "")
        return [settled for s in samples for settled in scorer.push(arrived, s, source)]
    settled = scorer.advance(line["a"])
    if line.get("e") == "manoeuvre":
        scorer.begin()
    if line.get("e") == "limits":
        scorer.put_in_force(LimitsInForce.from_plain(line["limits"]))
    return settled


def rescored(
    lines: Iterable[dict[str, Any]], scorer: CausalScorer, reader: ChannelReader
) -> Iterator[ShownSample]:
    """Each sample of a journal, assessed by a new scorer.

    A sample that waited for others is shown at its deadline, not when the next batch came. This
    includes samples at the end of a journal without an `end` line: its server was killed.
    """
    is_ended = False
    for line in lines:
        yield from _settled_alone(scorer, line["a"])
        for assessed in replay_line(line, scorer, reader):
            yield ShownSample(line["a"], assessed)
        is_ended = line.get("e") == "end"
    if not is_ended:
        yield from _settled_alone(scorer, inf)


def _settled_alone(scorer: CausalScorer, until: float) -> Iterator[ShownSample]:
    """Samples that the clock alone settled before a time."""
    before = None
    while (deadline := scorer.deadline) is not None and before != deadline < until:
        yield from (ShownSample(deadline, settled) for settled in scorer.advance(deadline))
        before = deadline
