"""Find the targets that a signal's name can mean."""

from dataclasses import dataclass
from functools import cache

from app.telemetry.mapping.naming.spelling import Spelling, spellings
from app.telemetry.mapping.naming.vocabulary import (
    DERIVED,
    IMPLIED,
    MEANINGS,
    NEUTRAL,
    NEUTRAL_FACTOR,
    OF_KIND,
    OTHER,
    PER_NUMBER,
    SIDES,
    UNCERTAIN,
    UNKNOWN,
    UNKNOWN_BESIDE_LETTER,
)

LONGEST_STEM = 5
"""Most words of one stem: angle, of, side, slip."""
LEAST = 0.1
SIDED = ("delta_a", "delta_r")


@dataclass(frozen=True)
class NameMatch:
    """A target that a name can mean.

    certainty: 0 to 1.   stem: the matching part of the name.   unit: given by the name.
    """

    key: str
    certainty: float
    stem: str
    unit: str = ""


@cache
def name_matches(name: str, group: str = "") -> tuple[NameMatch, ...]:
    """The targets that a name can mean, each once, the most certain first.

    group: name of the signal's group, which may complete it: vehicle_angular_velocity, x.
    """
    best: dict[str, NameMatch] = {}
    for spelling in spellings(name, group):
        for match in _of_spelling(spelling):
            before = best.get(match.key)
            if before is None or match.certainty > before.certainty:
                best[match.key] = match
    return tuple(sorted(best.values(), key=lambda match: -match.certainty))


def is_derived(name: str) -> bool:
    """Whether the name indicates computed rather than measured values."""
    return any(word in DERIVED for way in spellings(name) for word in way.words)


def _of_spelling(spelling: Spelling) -> list[NameMatch]:
    words = (*spelling.path, *spelling.words)
    first = len(spelling.path)
    matches = []
    for start in range(len(words)):
        for end in range(max(start, first) + 1, min(start + LONGEST_STEM, len(words)) + 1):
            stem = "".join(words[start:end])
            for key, certainty in MEANINGS.get(stem, {}).items():
                path, rest = words[: min(start, first)], (*words[first:start], *words[end:])
                matches += _weighed(key, certainty, stem, path, rest, spelling.unit)
    return matches


def _weighed(
    key: str, certainty: float, stem: str, path: tuple[str, ...], rest: tuple[str, ...], unit: str
) -> list[NameMatch]:
    """Adjust the certainty of a stem by the words around it."""
    sides = {SIDES[word] for word in rest if word in SIDES} if key in SIDED else set()
    if len(sides) == 1:
        key = f"{key}_{sides.pop()}"
        rest = tuple(word for word in rest if word not in SIDES)
    for word in rest:
        certainty *= _beside(word, key, stem)
    for word in path:
        # a path can turn a name into another quantity; its other words do not matter
        certainty *= 0.0 if word in OTHER else OF_KIND.get(word, {}).get(key, 1.0)
    if certainty < LEAST:
        return []
    return [NameMatch(key, certainty, stem, unit or IMPLIED.get(stem, ""))]


def _beside(word: str, key: str, stem: str) -> float:
    """Factor on the certainty of a stem, for a neighbouring word of the name."""
    if word in OTHER:
        return 0.0
    if word in OF_KIND:
        return OF_KIND[word].get(key, OF_KIND[word].get("", 0.0))
    if word in UNCERTAIN:
        return UNCERTAIN[word]
    if word in NEUTRAL:
        return NEUTRAL_FACTOR
    if word.isdigit():
        return PER_NUMBER
    if key in MEANINGS.get(word, {}):  # the same meaning twice: ny and lateral
        return NEUTRAL_FACTOR
    # the name of another channel: roll and rudder
    if word in MEANINGS and len(word) > 1:
        return 0.1
    return UNKNOWN if len(stem) > 1 else UNKNOWN_BESIDE_LETTER
