"""What a live flight was shown, again: from its journal, by what had come at each moment."""

from collections.abc import Iterable, Iterator
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from app.live.batches import Batch, ChannelReader
from app.live.journal import lines_of
from app.live.scorer import CausalScorer, LiveAssessed
from app.scoring.limits_in_force import LimitsInForce


class ShownSample(NamedTuple):
    """A sample and when it was shown: time since the flight began [s]."""

    shown: float
    assessed: LiveAssessed


def header_of(path: Path) -> dict[str, Any] | None:
    """What a journal says that its flight is; None where it says nothing yet. OSError."""
    return next(lines_of(path), None)


def settled_by(
    line: dict[str, Any], scorer: CausalScorer, reader: ChannelReader
) -> list[LiveAssessed]:
    """What a line of a journal settles."""
    if "b" in line:
        samples = reader.samples(Batch(line["s"], line["b"]))
        return [one for each in samples for one in scorer.push(line["a"], each)]
    settled = scorer.advance(line["a"])
    if line.get("e") == "manoeuvre":
        scorer.begin()
    if line.get("e") == "limits":
        scorer.put_in_force(LimitsInForce.from_plain(line["limits"]))
    return settled


def shown_again(
    lines: Iterable[dict[str, Any]], scorer: CausalScorer, reader: ChannelReader
) -> Iterator[ShownSample]:
    """Each sample of a journal as a scorer of its flight's beginning assesses it.

    What waited for others is shown when its time was up, not when the next batch came; so is what
    waited at the end of a journal that says of no end: the server was killed.
    """
    is_ended = False
    for line in lines:
        yield from _settled_alone(scorer, line["a"])
        for assessed in settled_by(line, scorer, reader):
            yield ShownSample(line["a"], assessed)
        is_ended = line.get("e") == "end"
    if not is_ended:
        yield from _settled_alone(scorer, inf)


def _settled_alone(scorer: CausalScorer, until: float) -> Iterator[ShownSample]:
    """What the clock settled before a time."""
    before = None
    while (deadline := scorer.deadline) is not None and before != deadline < until:
        yield from (ShownSample(deadline, one) for one in scorer.advance(deadline))
        before = deadline
