"""Damage to the bytes of a file: cut, flipped, doubled, lost, mixed up.

Each function returns the damaged bytes. The first MAGIC bytes are mostly kept, since a file of an
unrecognised format tests little.
"""

import struct
from collections.abc import Callable
from random import Random

MAGIC = 8
EXTREMES = (0, 1, 2, 7, 8, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 1 << 20, 1 << 24, 1 << 28)
EXTREMES += ((1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 40, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
FLOATS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, -0.0, 1e18, -1.0)


def place(rng: Random, content: bytes, room: int = 1) -> int:
    """Somewhere with so many bytes behind it; more often near one of the ends."""
    first = MAGIC if rng.random() < 0.95 else 0
    last = max(len(content) - room, first)
    near = min(last, first + 400)
    return rng.choice(
        (
            rng.randint(first, last),
            rng.randint(first, near),
            rng.randint(max(first, last - 400), last),
        )
    )


def block(rng: Random, content: bytes) -> tuple[int, int]:
    """Beginning and end of a stretch of 1 byte to a third of the file."""
    length = min(rng.choice((1, 2, 4, 8, 16, 64, 512, 4096)), max(len(content) // 3, 1))
    first = place(rng, content, length)
    return first, min(first + length, len(content))


def cut(rng: Random, content: bytes) -> bytes:
    return content[: rng.choice((place(rng, content), len(content) - rng.randint(1, 16)))]


def flipped_bits(rng: Random, content: bytes) -> bytes:
    damaged = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        at = place(rng, content)
        if at < len(damaged):
            damaged[at] ^= 1 << rng.randrange(8)
    return bytes(damaged)


def extreme_number(rng: Random, content: bytes) -> bytes:
    """A word becomes an extreme one, the size of the file, or nearly what it was."""
    width = rng.choice((1, 2, 4, 4, 8, 8))
    at = place(rng, content, width)
    at -= at % rng.choice((1, width))
    order = rng.choice(("little", "big"))
    was = int.from_bytes(content[at : at + width], order)
    chosen = rng.choice((*EXTREMES, len(content), was + 1, was - 1, 2 * was, was << 16, -was, ~was))
    word = (chosen % (1 << 8 * width)).to_bytes(width, order)
    return content[:at] + word + content[at + width :]


def extreme_float(rng: Random, content: bytes) -> bytes:
    at = place(rng, content, 8)
    word = struct.pack(rng.choice("<>") + "d", rng.choice(FLOATS))
    return content[:at] + word + content[at + 8 :]


def zeros(rng: Random, content: bytes) -> bytes:
    first, end = block(rng, content)
    return content[:first] + rng.choice((b"\0", b"\xff", b" ")) * (end - first) + content[end:]


def noise(rng: Random, content: bytes) -> bytes:
    first, end = block(rng, content)
    return content[:first] + rng.randbytes(end - first) + content[end:]


def noise_behind_the_head(rng: Random, content: bytes) -> bytes:
    return content[: rng.choice((8, 64, 128, 512))] + rng.randbytes(rng.choice((1, 100, 5000)))


def doubled(rng: Random, content: bytes) -> bytes:
    first, end = block(rng, content)
    times = rng.choice((1, 1, 2, 50))
    return content[:end] + times * content[first:end] + content[end:]


def lost(rng: Random, content: bytes) -> bytes:
    first, end = block(rng, content)
    return content[:first] + content[end:]


def moved(rng: Random, content: bytes) -> bytes:
    first, end = block(rng, content)
    left = content[:first] + content[end:]
    at = place(rng, left)
    return left[:at] + content[first:end] + left[at:]


def copied_over(rng: Random, content: bytes) -> bytes:
    """A stretch is overwritten by another one, as a pointer or a whole block."""
    first, end = block(rng, content)
    at = place(rng, content, end - first)
    return content[:at] + content[first:end] + content[at + end - first :]


def turned_words(rng: Random, content: bytes) -> bytes:
    """The words of a stretch in the other byte order."""
    first, end = block(rng, content)
    width = rng.choice((2, 4, 8))
    words = (content[at : at + width][::-1] for at in range(first, end, width))
    return content[:first] + b"".join(words)[: end - first] + content[end:]


def longer(rng: Random, content: bytes) -> bytes:
    return content + rng.choice((rng.randbytes(50), bytes(5000), content))


def spliced(rng: Random, content: bytes, other: bytes) -> bytes:
    """The beginning of one file with the end of another."""
    at = place(rng, content)
    return content[:at] + other[rng.choice((at, place(rng, other))) :]


DAMAGES: tuple[Callable[[Random, bytes], bytes], ...] = (
    cut,
    flipped_bits,
    flipped_bits,
    extreme_number,
    extreme_number,
    extreme_number,
    extreme_float,
    zeros,
    noise,
    noise_behind_the_head,
    doubled,
    lost,
    moved,
    copied_over,
    turned_words,
    longer,
)
