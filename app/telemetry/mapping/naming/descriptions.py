"""Find the targets that a signal can be by its name and its description in the file.

A description is a long_name in NetCDF, a description in HDF5 and Parquet, a comment in MDF, such as
"Sideslip angle from the nose boom [deg]".
"""

import re
from collections.abc import Iterable
from dataclasses import replace
from functools import cache

from app.telemetry.contents import Signal
from app.telemetry.mapping.naming.names import NameMatch, name_matches
from app.telemetry.mapping.naming.vocabulary import MEANINGS, OTHER
from app.telemetry.units import NOT_GIVEN, spelled

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
            merged.append(replace(words, certainty=_less(words, of_name)))
        elif name is not None and words is None:
            other = ANOTHER if clear or not descriptions else 1.0
            merged.append(replace(name, certainty=other * name.certainty))
        elif name is not None and words is not None:
            surest = max(name, words, key=lambda match: match.certainty)
            merged.append(replace(surest, unit=name.unit or words.unit))
    return tuple(sorted(merged, key=lambda match: -match.certainty))


def _less(words: NameMatch, of_name: float) -> float:
    """Certainty of a description if the name means another target."""
    return words.certainty * (1.0 - 0.3 * of_name)


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
