"""What a mistyped word was most likely meant to be."""

from collections.abc import Iterable
from difflib import SequenceMatcher

CLOSE = 0.6
"""Similarity from which a word is taken for a mistyped one."""
HEAD = 0.95
"""Weight of agreeing with the beginning of a longer word alone."""


def instead_of(word: str, known: Iterable[str]) -> str:
    """`did you mean train?`, or all that there is to choose from."""
    known = tuple(known)
    closest = max(known, key=lambda one: _similarity(word, one), default="")
    if closest and _similarity(word, closest) >= CLOSE:
        return f"did you mean {closest}?"
    return f"choose {', '.join(known)}"


def _similarity(word: str, known: str) -> float:
    """Share of letters in common, from 0 to 1; of the beginning, where `known` is longer."""
    given, whole = word.lower(), known.lower()
    head = whole[: len(given)]
    return max(
        SequenceMatcher(None, given, whole).ratio(),
        HEAD * SequenceMatcher(None, given, head).ratio(),
    )
