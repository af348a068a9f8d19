"""Suggest the word that a mistyped one most likely meant."""

from collections.abc import Iterable
from difflib import SequenceMatcher

CLOSE = 0.6
"""Similarity from which a word counts as mistyped."""
HEAD = 0.95
"""Weight of a match with only the beginning of a longer word."""


def instead_of(word: str, known: Iterable[str]) -> str:
    """`did you mean train?`, or a list of all known words."""
    known = tuple(known)
    closest = max(known, key=lambda each: _similarity(word, each), default="")
    if closest and _similarity(word, closest) >= CLOSE:
        return f"did you mean {closest}?"
    return f"choose {', '.join(known)}"


def _similarity(word: str, known: str) -> float:
    """Share of letters in common, 0 to 1; with only the beginning if `known` is longer."""
    given, whole = word.lower(), known.lower()
    head = whole[: len(given)]
    return max(
        SequenceMatcher(None, given, whole).ratio(),
        HEAD * SequenceMatcher(None, given, head).ratio(),
    )
