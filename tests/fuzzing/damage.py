"""Damaged files, reproducible from seed, kind and number on any machine."""

import codecs
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from app.telemetry.formats import FORMATS
from tests.fuzzing import byte_damage, text_damage
from tests.fuzzing.resealing import sealed, within_deflated

LARGEST = 1_000_000
"""A larger file is not damaged further: it would only grow."""
STEMS = ("flight", "flight.", "Flug β", ".hidden", "a.tar", "x" * 200)
CODES = ("utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "utf-32", "cp1252", "cp037", "utf-7")


@dataclass(frozen=True)
class Damaged:
    """A file as it would be uploaded. name: as its user calls it.   done: how it was damaged."""

    name: str
    content: bytes
    done: str


def damaged(seed: int, kind: str, number: int, paths: Sequence[Path]) -> Damaged:
    """One of the whole files of a kind, damaged once or a few times."""
    rng = Random(f"{seed} {kind} {number}")
    path = rng.choice(paths)
    content, done = path.read_bytes(), [path.name]
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        if len(content) > LARGEST:
            break
        if kind == "csv" and rng.random() < 0.7:
            damage_text = rng.choice(text_damage.DAMAGES)
            content = _encoded(rng, damage_text(rng, _decoded(content)), content)
            done.append(damage_text.__name__)
        elif rng.random() < 0.05:
            content = byte_damage.spliced(rng, content, rng.choice(paths).read_bytes())
            done.append("spliced")
        else:
            damage = rng.choice(byte_damage.DAMAGES)
            if kind == "matlab5" and rng.random() < 0.5:
                content = within_deflated(rng, damage, content)
            else:
                content = damage(rng, content)
            done.append(damage.__name__)
    if kind == "ch10" and rng.random() < 0.8:
        content = sealed(content)
    return Damaged(_name(rng, kind), content, ", ".join(done))


def _name(rng: Random, kind: str) -> str:
    """Mostly with an ending of its format, else with that of another, or with none."""
    right = FORMATS[kind].endings
    wrong = [ending for known in FORMATS.values() for ending in known.endings]
    return rng.choice(STEMS) + rng.choice((rng.choice(right), right[0], rng.choice(wrong), ""))


def _decoded(content: bytes) -> str:
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def _encoded(rng: Random, text: str, before: bytes) -> bytes:
    """As it was, mostly."""
    wide = before.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    usual = "utf-16" if wide else "utf-8"
    return text.encode(rng.choice(CODES) if rng.random() < 0.1 else usual, "replace")
