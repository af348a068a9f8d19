"""The targets that a signal can be by its name and its description in the file.

A description is a long_name in NetCDF, a description in HDF5 and Parquet, a comment in MDF, such as
"Sideslip angle from the nose boom [deg]".
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

from app.telemetry.contents import Signal
from app.telemetry.mapping.spelling import Spelling, spellings
from app.telemetry.mapping.vocabulary import (
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
from app.telemetry.units import NOT_GIVEN, spelled

LONGEST_STEM = 5
"""Most words of one stem: angle, of, side, slip."""
LEAST = 0.1
SIDED = ("delta_a", "delta_r")
IN_FILE = "in the file"
"""Where a unit is given."""


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


def given_unit(signal: Signal, of_name: str) -> tuple[str, str]:
    """(unit, where): of a signal that has one in the file, else in its name; "" for none."""
    if signal.unit.strip().lower() not in NOT_GIVEN:
        return signal.unit, IN_FILE
    return of_name, "in its name"


def is_derived(name: str) -> bool:
    return any(word in DERIVED for way in spellings(name) for word in way.words)


def _of_spelling(spelling: Spelling) -> list[NameMatch]:
    words = (*spelling.path, *spelling.words)
    first = len(spelling.path)
    matches = []
    for start in range(len(words)):
        for end in range(max(start, first) + 1, min(start + LONGEST_STEM, len(words)) + 1):
            stem = "".join(words[start:end])
            own = _meanings("".join(words[first:end])) if start < first else {}
            for key, certainty in _meanings(stem).items():
                if own and key not in own and end == first + 1 and len(words[first]) == 1:
                    continue  # r in a container rud is a yaw rate, not a rudder
                path, rest = words[: min(start, first)], (*words[first:start], *words[end:])
                matches += _weighed(key, certainty, stem, path, rest, spelling.unit)
    return matches


def _meanings(stem: str) -> dict[str, float]:
    """Targets of a stem and their certainties; VTASCG is VTAS at the centre of gravity."""
    return MEANINGS.get(stem) or MEANINGS.get(stem.removesuffix("cg"), {})


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


LONGEST = 8
"""Most words of a description; longer texts are prose."""
LESS_THAN_A_NAME = 0.97
"""Factor on the certainty of a description, which is less reliable than a name."""
ANOTHER = 0.3
"""Factor on the certainty of a name whose description means something else."""
CLEAR = 0.6
"""Least certainty of a description with a clear meaning."""
ARTICLES = frozenset(["a", "an", "the", "of", "about", "around", "along", "in", "at", "on", "its"])
BEHIND = re.compile(
    r"\b(?:from|for|about|around|by|using|with|via|as|relative|corrected|positive|measured|recorded)"
    r"\b|[;:,]|\. "
)
"""Text after these words describes the measurement or its sign, not the quantity."""

LETTER = re.compile(r"(.*?)([A-Za-z])$", re.DOTALL)
AXES_BY_LETTER = {"R": "roll_rate", "P": "pitch_rate", "Y": "yaw_rate"}


def rates_by_letter(signals: Iterable[Signal]) -> dict[str, Signal]:
    """Rename rates called R, P and Y to roll, pitch and yaw rate, as in ArduPilot's RATE.

    If there is a Q in the group, P and R are p and r instead.
    """
    letters: dict[tuple[int, str], dict[str, Signal]] = {}
    for signal in signals:
        if match := LETTER.fullmatch(signal.name):
            letters.setdefault((signal.group, match[1]), {})[match[2].upper()] = signal
    return {
        signal.name: replace(signal, name=f"{before}{AXES_BY_LETTER[letter]}")
        for (_, before), group in letters.items()
        if AXES_BY_LETTER.keys() <= group.keys() and "Q" not in group
        for letter, signal in group.items()
        if letter in AXES_BY_LETTER
    }


@cache
def signal_matches(signal: Signal, group: str = "") -> tuple[NameMatch, ...]:
    """The targets that a signal can be by name and description, the most certain first.

    A description supports a name, or replaces a name without a meaning. If the two disagree,
    neither is certain.
    """
    names = {match.key: match for match in name_matches(signal.name, group)}
    descriptions = {match.key: match for match in _described(signal.description)}
    if not descriptions and not _means_another(signal.description):
        return tuple(names.values())
    clear = max((match.certainty for match in descriptions.values()), default=0.0) >= CLEAR
    merged = []
    for key in names | descriptions:
        name, words = names.get(key), descriptions.get(key)
        if name is None and words is not None:
            of_name = max((match.certainty for match in names.values()), default=0.0)
            less = 1.0 - 0.3 * of_name  # if the name means another target
            merged.append(replace(words, certainty=less * words.certainty))
        elif name is not None and words is None:
            other = ANOTHER if clear or not descriptions else 1.0
            merged.append(replace(name, certainty=other * name.certainty))
        elif name is not None and words is not None:
            surest = max(name, words, key=lambda match: match.certainty)
            merged.append(replace(surest, unit=name.unit or words.unit))
    return tuple(sorted(merged, key=lambda match: -match.certainty))


def _described(description: str) -> tuple[NameMatch, ...]:
    """Targets that a description means; () if it is empty, prose or of something else."""
    words, unit = _clause(description)
    if not words:
        return ()
    text = f"{' '.join(words)} [{unit}]" if unit else " ".join(words)
    return tuple(
        replace(match, certainty=LESS_THAN_A_NAME * match.certainty)
        for match in name_matches(text)
        if match.key != "t"
    )


def _means_another(description: str) -> bool:
    """Whether a description is of another quantity: a command, a limit, a pitch rate."""
    words, _ = _clause(description)
    return any(word in OTHER or (word in MEANINGS and len(word) > 1) for word in words)


def _clause(description: str) -> tuple[list[str], str]:
    """The words that name the quantity, and the unit in brackets or after a comma."""
    ends = re.findall(r"[\[(]([^\])]*)[\])]", description) + description.rsplit(",", 1)[1:]
    units = [end.strip() for end in ends if spelled(end) and end.strip().lower() not in NOT_GIVEN]
    bare = re.sub(r"[\[(][^\])]*[\])]", " ", description)
    head = next((part for part in BEHIND.split(bare) if part.strip()), "")
    words = [word for word in re.findall(r"[^\W_]+", head.lower()) if word not in ARTICLES]
    return (words, units[0] if units else "") if len(words) <= LONGEST else ([], "")
