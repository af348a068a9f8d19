"""Descriptions and units of a recipe's parameters, read from its class's docstring.

A docstring describes parameters as `name: words [unit].`, several on a line where three spaces
part them, two sharing words as `a, b: words`.
"""

import re
from dataclasses import dataclass, fields
from functools import cache
from inspect import cleandoc

from core.channels import CHANNELS

NAME = r"[A-Za-z_]\w*(?: \[[^\]]*\]| \([^)]*\))*"
ENTRY = re.compile(rf"(?:^|\s{{3,}})({NAME}(?:, {NAME})*): ")
BRACKETS = re.compile(r"\[[^\]]*\]|\([^)]*\)")
UNIT = re.compile(r"\[([^\[\]]*[A-Za-z/%][^\[\]]*)\]")
SUFFIXES = {
    "_deg_s": "deg/s",
    "_rad_s": "rad/s",
    "_deg": "deg",
    "_hz": "Hz",
    "_s": "s",
}


@dataclass(frozen=True)
class FieldNote:
    """What a parameter means and its unit; the unit is empty for a count or a word."""

    description: str = ""
    unit: str = ""


@cache
def field_notes(kind: type) -> dict[str, FieldNote]:
    """Return the note of each field of a dataclass; its own docstring goes before its bases'."""
    described: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        described |= _entries(base.__doc__ or "")
    channels = {channel.key: channel for channel in CHANNELS}
    notes = {}
    for field in fields(kind):
        name, is_array = field.name, str(field.type).startswith("tuple")
        words = described.get(name, "")
        unit = _unit(name, "" if is_array else words)
        if name in channels:
            unit = unit or channels[name].unit
            words = words or f"{channels[name].label} {channels[name].symbol}"
        notes[name] = FieldNote(words, unit)
    return notes


def first_line(kind: type) -> str:
    """What a class is, in its docstring's first sentence."""
    return cleandoc(kind.__doc__ or "").partition("\n\n")[0].replace("\n", " ")


def _entries(docstring: str) -> dict[str, str]:
    """Parameter name -> words, of one docstring."""
    entries: dict[str, str] = {}
    for block in cleandoc(docstring).split("\n\n")[1:]:
        names: list[str] = []
        for line in block.splitlines():
            if line.startswith("Raises "):
                break
            parts = ENTRY.split(line)
            if names and parts[0].strip():
                for name in names:
                    entries[name] += " " + parts[0].strip()
            for head, words in zip(parts[1::2], parts[2::2], strict=True):
                names = BRACKETS.sub("", head).replace(" ", "").split(",")
                entries |= dict.fromkeys(names, words.strip())
    return entries


def _unit(name: str, words: str) -> str:
    for suffix, unit in SUFFIXES.items():
        if name.endswith(suffix):
            return unit
    found = UNIT.search(words)
    return found[1] if found else ""
