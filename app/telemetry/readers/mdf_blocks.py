"""Looking over the blocks of an MDF file before it is read: no circles, and none out of place.

A file is blocks that point to one another: data groups, their channel groups, their channels. The
library follows the pointers as they are. Reference: ASAM MDF 3.3 and 4.2, "Block structure".
"""

import mmap
import struct
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

HEADER = 64
"""Address of the block that all others hang on."""
FINISHED = b"MDF"
SMALLEST = 24
MOST_BLOCKS = 500_000
DATA = (b"##DT", b"##DV", b"##DI", b"##DZ", b"##SD", b"##RD", b"##RV", b"##RI")
DATA_4 = (*DATA, b"##HL", b"##DL", b"##LD")
COMPOSED = (b"##CN", b"##CA", b"##DS", b"##CL", b"##CU", b"##CV")
LINKS_3 = {
    b"HD": ((b"DG",),),
    b"DG": ((b"DG",), (b"CG",), (b"TR",)),
    b"CG": ((b"CG",), (b"CN",)),
    b"CN": ((b"CN",),),
}
LINKS_4 = {
    b"##HD": ((b"##DG",), (b"##FH",), (b"##CH",), (b"##AT",), (b"##EV",)),
    b"##DG": ((b"##DG",), (b"##CG",), DATA_4),
    b"##CG": ((b"##CG",), (b"##CN",)),
    b"##CN": ((b"##CN",), COMPOSED),
    b"##CA": (COMPOSED,),
    b"##FH": ((b"##FH",),),
    b"##AT": ((b"##AT",),),
    b"##EV": ((b"##EV",),),
    b"##HL": ((b"##DL", b"##LD"),),
}
"""Of a kind of block, the kinds that each of its pointers may lead to, from the first one."""
LISTS = (b"##DL", b"##LD")
"""Blocks of as many pointers as they say: to the next list, then to data."""

Kinds = tuple[bytes, ...]
Link = tuple[int, Kinds]
"""Address of a block, and the kinds that it may be of."""


def check_blocks(path: Path) -> bool:
    """ValueError where the pointers of an MDF file run in circles, out of it or astray.

    Returns whether the file was finished by its writer; if not, it may lack data at its end.
    """
    with path.open("rb") as file, closing(_mapped(file.fileno())) as blocks:
        newer = blocks[HEADER : HEADER + 2] == b"##"
        left: list[Link] = [(HEADER, (b"##HD",) if newer else (b"HD",))]
        n_blocks, most = 0, min(MOST_BLOCKS, len(blocks) // SMALLEST)
        while left:
            address, kinds = left.pop()
            if address + SMALLEST > len(blocks):
                raise ValueError("a block lies beyond its end")
            if not blocks[address : address + 4].startswith(kinds):
                raise ValueError("one of its blocks is not where it should be")
            n_blocks += 1
            if n_blocks > most:
                raise ValueError("its blocks point in circles")
            links = _links_4(blocks, address) if newer else _links_3(blocks, address)
            left += (link for link in links if link[0])
        return _finished(blocks)


def _mapped(handle: int) -> mmap.mmap:
    return mmap.mmap(handle, 0, access=mmap.ACCESS_READ)


def _finished(blocks: mmap.mmap) -> bool:
    return blocks[: len(FINISHED)] == FINISHED


def _links_4(blocks: mmap.mmap, address: int) -> Iterable[Link]:
    """Where a block of MDF 4 points to."""
    kind, length, n_links = struct.unpack_from("<4s4xQQ", blocks, address)
    if kind in DATA and address + length > len(blocks) and _finished(blocks):
        raise ValueError("it ends within its data")
    if kind in LISTS:
        n = min(n_links, (len(blocks) - address - SMALLEST) // 8)
        targets: Sequence[Kinds] = ((kind,), *((DATA,) * (n - 1)))[:n]
    else:
        targets = LINKS_4.get(kind, ())
    if n_links < len(targets) or address + SMALLEST + 8 * len(targets) > len(blocks):
        raise ValueError("a block has fewer pointers than one of its kind")
    return zip(
        struct.unpack_from(f"<{len(targets)}Q", blocks, address + SMALLEST), targets, strict=True
    )


def _links_3(blocks: mmap.mmap, address: int) -> Iterable[Link]:
    """Where a block of MDF 3 points to."""
    targets = LINKS_3.get(blocks[address : address + 2], ())
    return zip(struct.unpack_from(f"<{len(targets)}I", blocks, address + 4), targets, strict=True)
