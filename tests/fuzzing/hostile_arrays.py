"""Hostile array files: endless nesting, cycles, declarations without data."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

MATLAB_HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
DEPTH = 10_000


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def variable(mat_class: int, shape: tuple[int, ...], *parts: bytes, name: bytes = b"x") -> bytes:
    head = element(6, struct.pack("<II", mat_class, 0))
    head += element(5, struct.pack(f"<{len(shape)}i", *shape)) + element(1, name)
    return element(14, head + b"".join(parts))


def structures_in_structures(path: Path) -> None:
    """Written from the inside, without copying what is inside each time."""
    field = struct.pack("<HHI", 5, 4, 8) + element(1, b"a".ljust(8, b"\0"))
    frame = variable(2, (1, 1), field, name=b"")
    sizes = [len(frame) * k for k in range(1, DEPTH)]
    content = b"".join(struct.pack("<II", 14, size - 8) + frame[8:] for size in reversed(sizes))
    path.write_bytes(MATLAB_HEAD + content)


def matlab_bomb(path: Path, declared: int = 3 << 30) -> None:
    packed = zlib.compress(struct.pack("<II", 14, declared) + bytes(1 << 25), 1)
    path.write_bytes(MATLAB_HEAD + struct.pack("<II", 15, len(packed)) + packed)


def matlab_declaration(path: Path) -> None:
    path.write_bytes(MATLAB_HEAD + variable(6, (2**31 - 1, 2**31 - 1), element(9, bytes(16))))


def numbers_of_no_type(path: Path) -> None:
    """The library looks up the type 200 behind the end of its table."""
    path.write_bytes(MATLAB_HEAD + variable(6, (1, 2), element(200, bytes(16))))


def numbers_outside(path: Path) -> None:
    """Numbers that are said to lie behind the end of the variable they are of."""
    inner = struct.pack("<II", 9, 1 << 20) + bytes(16)
    path.write_bytes(MATLAB_HEAD + variable(6, (1, 2), inner))


def cells_declared(path: Path) -> None:
    path.write_bytes(MATLAB_HEAD + variable(1, (2**31 - 1, 1), element(14, b"")))


def groups_in_groups(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.id
        for _ in range(DEPTH):
            group = h5py.h5g.create(group, b"g")
        h5py.Group(group)["beta"] = np.arange(9.0)


def groups_in_circles(path: Path) -> None:
    with h5py.File(path, "w") as file:
        here = file.create_group("a/b/c")
        here["up"], here["top"], file["a/self"] = file["a"], file["/"], file["a"]
        here["soft"] = h5py.SoftLink("/a/b/c/soft")
        here["one"], here["two"] = h5py.SoftLink("two"), h5py.SoftLink("one")
        here["other"] = h5py.ExternalLink(path.name, "/a/b/c/other")
        here["beta"] = np.arange(9.0)


def data_elsewhere(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["link"] = h5py.ExternalLink("/etc/hostname", "/x")
        elsewhere = [("/etc/hostname", 0, 4)]
        file.create_dataset("raw", (4,), "u1", external=elsewhere, track_times=False)
        layout = h5py.VirtualLayout((4,), "f8")
        layout[:] = h5py.VirtualSource("/etc/hostname", "x", (4,))
        file.create_virtual_dataset("virtual", layout)


def declared_only(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("chunked", (1 << 40,), "f8", chunks=(1 << 10,), compression="gzip")
        plain = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plain.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
        plain.set_obj_track_times(False)
        space = h5py.h5s.create_simple((1 << 40,))
        h5py.h5d.create(file.id, b"plain", h5py.h5t.NATIVE_DOUBLE, space, plain)
        file.create_dataset("wide", (2, 1 << 30), "f4", chunks=(1, 1 << 10))


def hdf5_bomb(path: Path) -> None:
    with h5py.File(path, "w") as file:
        packed = zlib.compress(bytes(8 << 22), 9)
        for name in "abcdefgh":
            file.create_dataset(name, (1 << 24,), "f8", chunks=(1 << 22,), compression="gzip")
            for first in range(0, 1 << 24, 1 << 22):
                file[name].id.write_direct_chunk((first,), packed)


def chunk_without_end(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("x", (1 << 28,), "f8", chunks=(1 << 28,), compression="gzip")
        file["x"].id.write_direct_chunk((0,), zlib.compress(bytes(1 << 20)))


def many_objects(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for k in range(400):
            file.create_group(f"{k}")
            file[f"x{k}"] = (0.0, 1.0)


def types_in_types(path: Path) -> None:
    kind = np.dtype("f8")
    for _ in range(40):
        kind = np.dtype([("in", kind), ("more", "i2")])
    with h5py.File(path, "w") as file:
        file["deep"] = np.zeros(5, kind)
        file["wide"] = np.zeros(5, [(f"x{k}", "f4") for k in range(800)])
        file["array"] = np.zeros(3, [("x", "f4", (5000,))])


def odd_names(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for k, name in enumerate((b"\xff\xfe", b"a\nb", b" ", b"\x1b[2J", b"..", b"x" * 5000)):
            space = h5py.h5s.create_simple((3,))
            made = h5py.h5d.create(file.id, name, h5py.h5t.NATIVE_DOUBLE, space)
            made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.arange(3.0) + k)
            h5py.Dataset(made).attrs["units"] = b"\xff\xfe\n"
            h5py.Dataset(made).attrs["description"] = "\u202e" * 500


def netcdf(n_records: int, length: int, name: bytes = b"x") -> bytes:
    """A variable of so many records, over a dimension of so much, and no numbers."""

    def text(content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + content + bytes(-len(content) % 4)

    dimensions = struct.pack(">II", 10, 2) + text(b"t") + struct.pack(">I", 0)
    dimensions += text(b"n") + struct.pack(">I", length)
    variable = text(name) + struct.pack(">III", 2, 0, 1) + bytes(8) + struct.pack(">III", 6, 8, 200)
    variables = struct.pack(">II", 11, 1) + variable
    return b"CDF\x01" + struct.pack(">I", n_records) + dimensions + bytes(8) + variables


NAMED: tuple[Callable[[Path], object], ...] = (
    structures_in_structures,
    matlab_bomb,
    matlab_declaration,
    numbers_of_no_type,
    numbers_outside,
    cells_declared,
    groups_in_groups,
    groups_in_circles,
    data_elsewhere,
    declared_only,
    hdf5_bomb,
    chunk_without_end,
    many_objects,
    types_in_types,
    odd_names,
)
ARRAYS: dict[str, Callable[[Path], object]] = {
    **{make.__name__: make for make in NAMED},
    "matlab_bomb_that_lies": lambda path: matlab_bomb(path, 64),
    "netcdf_records": lambda path: path.write_bytes(netcdf(2**31 - 1, 2**31 - 1)),
    "netcdf_no_records": lambda path: path.write_bytes(netcdf(2**32 - 1, 4)),
    "netcdf_odd_name": lambda path: path.write_bytes(netcdf(2, 3, b"\xff\0\n/..") + bytes(500)),
}
