"""What a signal can be by its name alone."""

from dataclasses import dataclass
from functools import cache

from app.telemetry.mapping.spelling import Spelling, spellings
from app.telemetry.mapping.vocabulary import (
    DOUBTFUL,
    HARMLESS,
    HARMLESS_LEAVES,
    IMPLIED,
    MEANINGS,
    OF_KIND,
    OTHER,
    PER_NUMBER,
    SIDES,
    UNKNOWN,
    UNKNOWN_BESIDE_LETTER,
)

LONGEST_STEM = 5
"""Words that make one name: angle, of, side, slip."""
LEAST = 0.1
SIDED = ("delta_a", "delta_r")


@dataclass(frozen=True)
class Reading:
    """A target that a name can mean: how surely, what of the name says so, the unit it says."""

    key: str
    certainty: float
    stem: str
    unit: str = ""


@cache
def readings(name: str, group: str = "") -> tuple[Reading, ...]:
    """Return what a name can mean, the surest first; at most one reading for each target.

    group: of the file, whose name is looked at too: vehicle_angular_velocity holds x, y and z.
    """
    best: dict[str, Reading] = {}
    for spelling in spellings(name, group):
        for reading in _of_spelling(spelling):
            known = best.get(reading.key)
            if known is None or reading.certainty > known.certainty:
                best[reading.key] = reading
    return tuple(sorted(best.values(), key=lambda reading: -reading.certainty))


def _of_spelling(spelling: Spelling) -> list[Reading]:
    words = (*spelling.path, *spelling.words)
    first = len(spelling.path)
    found = []
    for start in range(len(words)):
        for end in range(max(start, first) + 1, min(start + LONGEST_STEM, len(words)) + 1):
            stem = "".join(words[start:end])
            for key, certainty in MEANINGS.get(stem, {}).items():
                path, rest = words[: min(start, first)], (*words[first:start], *words[end:])
                found += _judged(key, certainty, stem, path, rest, spelling.unit)
    return found


def _judged(
    key: str, certainty: float, stem: str, path: tuple[str, ...], rest: tuple[str, ...], unit: str
) -> list[Reading]:
    """Weigh a stem by the words beside it."""
    sides = {SIDES[word] for word in rest if word in SIDES} if key in SIDED else set()
    if len(sides) == 1:
        key = f"{key}_{sides.pop()}"
        rest = tuple(word for word in rest if word not in SIDES)
    for word in rest:
        certainty *= _beside(word, key, stem)
    for word in path:
        # what a name lies in may make another quantity of it; else it says nothing
        certainty *= 0.0 if word in OTHER else OF_KIND.get(word, {}).get(key, 1.0)
    if certainty < LEAST:
        return []
    return [Reading(key, certainty, stem, unit or IMPLIED.get(stem, ""))]


def _beside(word: str, key: str, stem: str) -> float:
    """What a word that is not part of the name's stem leaves of its certainty."""
    if word in OTHER:
        return 0.0
    if word in OF_KIND:
        return OF_KIND[word].get(key, OF_KIND[word].get("", 0.0))
    if word in DOUBTFUL:
        return DOUBTFUL[word]
    if word in HARMLESS:
        return HARMLESS_LEAVES
    if word.isdigit():
        return PER_NUMBER
    # the name of another channel: roll beside rudder
    if word in MEANINGS and len(word) > 1:
        return 0.1
    return UNKNOWN if len(stem) > 1 else UNKNOWN_BESIDE_LETTER
