"""Why nothing is said of a stored sample of a scoring, in words: the same wherever it is shown."""

from collections.abc import Mapping, Sequence
from typing import Any

from app.flights.withdrawal import in_words
from core.monitor import State
from core.monitor.assessment import REASONS, STATES

BETWEEN = "between manoeuvres"


def reason(code: int, stretch: int, stretches: Sequence[Mapping[str, Any]]) -> str:
    """The reason of a sample; empty where its state needs none.

    code, stretch: as stored, see app.scoring.   stretches: plain, as stored with them.
    """
    if STATES[code] is not State.INVALID:
        return REASONS[code]
    if stretch < 0:
        return BETWEEN
    validity = stretches[stretch]["validity"]
    withdrawn = in_words(validity["reasons"]) if validity["valid"] is False else ""
    return withdrawn or REASONS[code]
