"""What a signal is by its name and by what the file says of it in words.

NetCDF has a long_name, HDF5 and Parquet a description, MDF a comment: "Sideslip angle from the
nose boom [deg]".
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
"""Words; more are prose."""
LESS_THAN_A_NAME = 0.97
"""Factor on the certainty of a description, which is no name."""
ANOTHER = 0.3
"""Factor on what a name means where the description means something else."""
CLEAR = 0.6
"""Certainty from which a description means something."""
ARTICLES = frozenset(["a", "an", "the", "of", "about", "around", "along", "in", "at", "on", "its"])
BEHIND = re.compile(
    r"\b(?:from|for|about|around|by|using|with|via|as|relative|corrected|positive|measured|recorded)"
    r"\b|[;:,]|\. "
)
"""What stands behind these says how it was measured or counted, not what it is."""


LETTER = re.compile(r"(.*?)([A-Za-z])$", re.DOTALL)
AXES_BY_LETTER = {"R": "roll_rate", "P": "pitch_rate", "Y": "yaw_rate"}


def rates_by_letter(signals: Iterable[Signal]) -> dict[str, Signal]:
    """Rates named R, P and Y for roll, pitch and yaw, as ArduPilot's RATE: by a name that says so.

    A Q beside them makes P and R those of p, q and r.
    """
    letters: dict[tuple[int, str], dict[str, Signal]] = {}
    for signal in signals:
        if match := LETTER.fullmatch(signal.name):
            letters.setdefault((signal.group, match[1]), {})[match[2].upper()] = signal
    return {
        signal.name: replace(signal, name=f"{before}{AXES_BY_LETTER[letter]}")
        for (_, before), found in letters.items()
        if AXES_BY_LETTER.keys() <= found.keys() and "Q" not in found
        for letter, signal in found.items()
        if letter in AXES_BY_LETTER
    }


@cache
def signal_matches(signal: Signal, group: str = "") -> tuple[NameMatch, ...]:
    """Return the targets that a signal can be by its name and description, the surest first.

    A description makes a name surer, or stands for a name that means nothing; where the two mean
    different things neither is sure.
    """
    names = {match.key: match for match in name_matches(signal.name, group)}
    said = {match.key: match for match in _described(signal.description)}
    if not said and not _means_another(signal.description):
        return tuple(names.values())
    clear = max((match.certainty for match in said.values()), default=0.0) >= CLEAR
    merged = []
    for key in names | said:
        name, words = names.get(key), said.get(key)
        if name is None and words is not None:
            of_name = max((match.certainty for match in names.values()), default=0.0)
            merged.append(replace(words, certainty=_less(words, of_name)))
        elif name is not None and words is None:
            other = ANOTHER if clear or not said else 1.0
            merged.append(replace(name, certainty=other * name.certainty))
        elif name is not None and words is not None:
            surest = max(name, words, key=lambda match: match.certainty)
            merged.append(replace(surest, unit=name.unit or words.unit))
    return tuple(sorted(merged, key=lambda match: -match.certainty))


def _less(words: NameMatch, of_name: float) -> float:
    """Certainty of a description beside a name that means another target."""
    return words.certainty * (1.0 - 0.3 * of_name)


def _described(description: str) -> tuple[NameMatch, ...]:
    """What a description means; () where it is empty, prose or of something else."""
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
    """Whether a description is of another quantity: of a command, a limit, a pitch rate."""
    words, _ = _clause(description)
    return any(word in OTHER or (word in MEANINGS and len(word) > 1) for word in words)


def _clause(description: str) -> tuple[list[str], str]:
    """The words that say what a signal is, and the unit in brackets or behind a comma."""
    ends = re.findall(r"[\[(]([^\])]*)[\])]", description) + description.rsplit(",", 1)[1:]
    units = [end.strip() for end in ends if spelled(end) and end.strip().lower() not in NOT_GIVEN]
    bare = re.sub(r"[\[(][^\])]*[\])]", " ", description)
    head = next((part for part in BEHIND.split(bare) if part.strip()), "")
    words = [word for word in re.findall(r"[^\W_]+", head.lower()) if word not in ARTICLES]
    return (words, units[0] if units else "") if len(words) <= LONGEST else ([], "")
