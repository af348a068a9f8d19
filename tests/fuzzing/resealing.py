"""Damage below compression and checksums, which are then made valid again."""

import struct
import zlib
from collections.abc import Callable
from random import Random

Damage = Callable[[Random, bytes], bytes]
MATLAB_HEAD, DEFLATED = 128, 15
SYNC = b"\x25\xeb"


def within_deflated(rng: Random, damage: Damage, content: bytes) -> bytes:
    """Damage one of the deflated variables of a MATLAB file; the whole where there is none."""
    at, found = MATLAB_HEAD, []
    while at + 8 <= len(content):
        kind, length = struct.unpack_from("<II", content, at)
        if kind == DEFLATED:
            found.append((at, length))
        at += 8 + length
    if not found:
        return damage(rng, content)
    at, length = rng.choice(found)
    try:
        inner = zlib.decompress(content[at + 8 : at + 8 + length])
    except zlib.error:
        return damage(rng, content)
    packed = zlib.compress(damage(rng, inner))
    element = struct.pack("<II", DEFLATED, len(packed)) + packed
    return content[:at] + element + content[at + 8 + length :]


def sealed(content: bytes) -> bytes:
    """A Chapter 10 recording whose headers all have the right checksum."""
    whole, at = bytearray(content), content.find(SYNC)
    while 0 <= at <= len(whole) - 24:
        words = struct.unpack_from("<11H", whole, at)
        struct.pack_into("<H", whole, at + 22, sum(words) & 0xFFFF)
        at = whole.find(SYNC, at + 24)
    return bytes(whole)
