"""Looking over a MATLAB 5 file before it is read: how much it unfolds to, and how deep it nests.

The file is a row of elements, each with a tag of type and length; one may be deflated, and one may
hold others. Reference: "MAT-File Format", chapter 1, The MathWorks.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from app.telemetry.readers.library_errors import too_deep
from app.telemetry.recording import TelemetryError

HEADER = 128
MATRIX, COMPRESSED, INT32, UINT32 = 14, 15, 5, 6
KINDS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13, MATRIX, 16, 17, 18))
"""Types of the elements within others; the library crashes over any other type of numbers."""
CONTAINERS = (1, 2, 3)
"""Classes of cell, structure and object."""
NEEDED = {4: 4, 5: 6} | dict.fromkeys(range(6, 16), 4)
"""Elements of texts, sparse and full matrices by their class, one more if COMPLEX."""
COMPLEX = 1 << 11
FLAGS = 8
"""Of what a variable begins with: its class and flags [bytes]."""
MOST_DEPTH = 32
MOST_ELEMENTS = 1_000_000
FEW = 1024
STEP = 1 << 20

Element = tuple[int, int, int]
"""Type, first byte and number of bytes."""


def check_elements(path: Path, most_bytes: int) -> None:
    """TelemetryError where a file unfolds to more than most_bytes, nests too deeply or lies."""
    total = 0
    with path.open("rb") as file:
        order = _byte_order(file)
        while tag := file.read(8):
            kind, length = struct.unpack(f"{order}II", tag)
            if kind == COMPRESSED:
                content = _inflated(file, length, most_bytes - total, order)
            else:
                content = tag + file.read(min(length, most_bytes - total + 1))
            total += len(content)
            if total > most_bytes:
                raise _too_large(most_bytes)
            _check_nesting(content, order)


def _byte_order(file: BinaryIO) -> str:
    mark = file.read(HEADER)[-2:]
    if mark not in (b"IM", b"MI"):
        raise ValueError("its header has no mark of byte order")
    return "<" if mark == b"IM" else ">"


def _inflated(file: BinaryIO, length: int, most_bytes: int, order: str) -> bytes:
    """The content of a deflated element, which is an element of the length that it says."""
    inflater = zlib.decompressobj()
    content, declared = bytearray(), 0
    while length > 0 and not inflater.eof:
        deflated = file.read(min(STEP, length))
        if not deflated:
            raise ValueError("it ends within a variable")
        length -= len(deflated)
        while deflated and not inflater.eof:
            content += inflater.decompress(deflated, STEP)
            deflated = inflater.unconsumed_tail
            if not declared and len(content) >= 8:
                declared = 8 + struct.unpack_from(f"{order}I", content, 4)[0]
            if declared > most_bytes:
                raise _too_large(most_bytes)
            if declared and len(content) > declared:
                raise ValueError("a variable is longer than it says")
    file.seek(length, 1)
    return bytes(content)


def _check_nesting(content: bytes, order: str) -> None:
    """Walk the elements within one another, without recursion."""
    n_elements = 0
    stack = [(0, len(content), 0)]
    while stack:
        first, end, depth = stack.pop()
        if depth > MOST_DEPTH:
            raise TelemetryError(too_deep("MATLAB"))
        elements = list(_elements(content, first, end, order))
        if depth and elements:
            _check_variable(content, elements, end, order)
        inner = [(at, min(at + n, end), depth + 1) for kind, at, n in elements if kind == MATRIX]
        if _declared(content, elements, order) > max(FEW, len(inner)):
            raise ValueError("it declares more elements than it has")
        n_elements += len(elements)
        if n_elements > MOST_ELEMENTS:
            raise TelemetryError(
                f"the MATLAB file holds more than {MOST_ELEMENTS} elements: export the signals of "
                "this test as plain vectors"
            )
        stack += inner


def _check_variable(content: bytes, elements: list[Element], end: int, order: str) -> None:
    """ValueError where a variable is not made up as the library takes it to be without a look."""
    kinds = [kind for kind, _, _ in elements]
    (kind, flags, length), (_, last, n_last) = elements[0], elements[-1]
    if not KINDS.issuperset(kinds) or last + n_last > end:
        raise ValueError("it holds elements of no known type or length")
    if kind != UINT32 or length != FLAGS:
        raise ValueError("a variable does not begin with its class")
    said = struct.unpack_from(f"{order}I", content, flags)[0]
    needed = NEEDED.get(said & 0xFF, 0)
    needed += bool(needed and said & COMPLEX)
    if len(kinds) < needed or MATRIX in kinds[:needed]:
        raise ValueError("a variable lacks its numbers")


def _elements(content: bytes, first: int, end: int, order: str) -> Iterator[Element]:
    """The elements of a stretch; the last one may reach beyond it."""
    while first + 8 <= end:
        kind, length = struct.unpack_from(f"{order}II", content, first)
        if kind >> 16:
            yield kind & 0xFFFF, first + 4, min(kind >> 16, 4)
            first += 8
        else:
            yield kind, first + 8, length
            first += 8 + length + -length % 8


def _declared(content: bytes, elements: list[Element], order: str) -> int:
    """How many elements a cell array or an array of structures declares, 0 of other classes."""
    if [kind for kind, _, _ in elements[:2]] != [UINT32, INT32] or elements[0][2] < 4:
        return 0
    flags, (_, at, length) = elements[0][1], elements[1]
    if struct.unpack_from(f"{order}I", content, flags)[0] & 0xFF not in CONTAINERS:
        return 0
    return math.prod(struct.unpack_from(f"{order}{length // 4}I", content, at))


def _too_large(most_bytes: int) -> TelemetryError:
    return TelemetryError(
        f"the MATLAB file unfolds to more than {most_bytes / 2**20:.0f} MiB: export the stretch "
        "and the signals of this test, or save it with -v7.3"
    )
