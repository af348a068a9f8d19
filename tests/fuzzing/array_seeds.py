"""Small files of arrays: MATLAB, HDF5 and NetCDF, with most features of each format."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
from scipy.io import netcdf_file, savemat
from scipy.sparse import csc_matrix

N = 30
T = 0.02 * np.arange(N)
BETA, P = 3 * np.sin(T), np.cos(2 * T)
MATLAB_HEAD = b"MATLAB 5.0 MAT-file, Platform: posix".ljust(116)
"""Without the time of writing."""


def matlab(path: Path, *, compressed: bool) -> None:
    simulink = {
        "time": T[:, None],
        "signals": np.array(
            [(BETA[:, None], "beta"), (P[:, None], "p")], [("values", "O"), ("label", "O")]
        ),
        "blockName": "model/scope",
    }
    held: dict[str, Any] = {
        "time": T,
        "beta": BETA[:, None],
        "units": {"beta": "deg", "time": "s"},
        "rates": np.column_stack([P, -P]).astype("f4"),
        "flag": T > 0.3,
        "scope": simulink,
        "cells": np.array([T[:3], "text"], dtype=object),
        "sparse": csc_matrix(np.eye(4)),
        "complex": T[:4] + 1j,
        "cube": np.arange(24, dtype="i2").reshape(2, 3, 4),
    }
    savemat(path, held, do_compression=compressed, oned_as="column")
    content = path.read_bytes()
    path.write_bytes(MATLAB_HEAD + content[len(MATLAB_HEAD) :])


def matlab73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(name: str, values: np.ndarray, kind: str = "double") -> None:
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_(kind.encode())

        put("time", T[None, :])
        put("beta", BETA[None, :])
        put("beta_unit", np.frombuffer("deg".encode("utf-16-le"), "<u2")[:, None], "char")
        put("air/p", P[None, :])
        references = np.array([[file["time"].ref, file["beta"].ref]], dtype=h5py.ref_dtype)
        put("cells", references, "cell")
        put("scope/signals/values", references, "struct")
        file["air"].attrs["MATLAB_class"] = np.bytes_(b"struct")
        put("none", np.zeros(2, "u8"))
        file["none"].attrs["MATLAB_empty"] = np.uint8(1)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def hdf5(path: Path, libver: str = "earliest") -> None:
    with h5py.File(path, "w", libver=libver) as file:
        air = file.create_group("air")
        for name, values, unit in (("time", T, "s"), ("beta", BETA, "deg")):
            air.create_dataset(name, data=values, chunks=(16,), compression="gzip", shuffle=True)
            air[name].attrs["units"] = unit
        air.create_dataset("rates", data=np.column_stack([P, -P]), fletcher32=True)
        air["loop"], air["soft"] = air, h5py.SoftLink("/air/soft")
        file["other"] = h5py.ExternalLink("other.h5", "/x")
        inner = [("x", "i2"), ("name", "S4")]
        rows = np.zeros(12, [("time", "f8"), ("q", "f4", (4,)), ("in", inner), ("c", "c8")])
        rows["time"] = np.arange(12)
        file["table"] = rows
        file["table"].attrs["units"] = ["s", "", "m", ""]
        file["text"], file["one"], file["complex"] = "hello", 3.0, np.ones(5, complex)
        scale = file.create_dataset("stamp", data=np.arange(12.0))
        scale.make_scale("stamp")
        counted = file.create_dataset("counted", data=np.arange(24).reshape(12, 2))
        counted.dims[0].attach_scale(scale)
        kinds = h5py.enum_dtype({"off": 0, "on": 1}, basetype="i1")
        file.create_dataset("mode", data=np.arange(12) % 2, dtype=kinds)
        file.create_dataset("rows", (3,), h5py.vlen_dtype("f8"))[0] = [1, 2]
        file.create_dataset("sparse", (1 << 12,), "f4", chunks=(64,))[:64] = 1
        file["cube"], file["empty"] = np.ones((2, 3, 4)), np.zeros((0, 3))


def netcdf3(path: Path, version: Any) -> None:
    with netcdf_file(path, "w", version=version) as file:
        file.createDimension("time", None)
        file.createDimension("fixed", 4)
        for name, kind, values, unit in (
            ("time", "f8", T, "seconds since 2024-05-01 09:30:00"),
            ("beta", "f4", BETA, "deg"),
            ("packed", "i2", np.arange(N), "m/s"),
            ("letter", "c", np.array([b"x"] * N), "1"),
        ):
            made = file.createVariable(name, kind, ("time",))
            made[:] = values
            made.units = unit
        packed = file.variables["packed"]
        packed.scale_factor, packed.add_offset, packed.missing_value = 0.5, 3.0, np.int16(7)
        file.createVariable("map", "i4", ("fixed", "fixed"))[:] = np.eye(4)
        file.title = "a flight"


def netcdf4(path: Path) -> None:
    with netCDF4.Dataset(path, "w") as file:
        air = file.createGroup("air")
        air.createDimension("time", None)
        for name, kind, values, unit in (
            ("time", "f8", T, "milliseconds since 2024-05-01"),
            ("beta", "f4", np.ma.masked_less(BETA, 0.1), "deg"),
            ("p", "i2", P, "deg/s"),
        ):
            made = air.createVariable(name, kind, ("time",), zlib=True, chunksizes=(16,))
            if name == "p":
                made.scale_factor, made.valid_range = 0.01, np.array([-90, 100], "i2")
            made[:] = values
            made.units = unit
        air.createVariable("name", str, ("time",))[0] = "text"
        air.createDimension("bare", 4)
        air.createVariable("map", "i4", ("time", "bare"))[:] = np.zeros((N, 4))


ARRAYS: dict[str, Callable[[Path], object]] = {
    "plain.mat": lambda path: matlab(path, compressed=False),
    "deflated.mat": lambda path: matlab(path, compressed=True),
    "v73.mat": matlab73,
    "old.h5": hdf5,
    "new.hdf5": lambda path: hdf5(path, "latest"),
    "classic.nc": lambda path: netcdf3(path, 1),
    "offset64.cdf": lambda path: netcdf3(path, 2),
    "four.nc": netcdf4,
}
