"""Flights of a user's simulator, in the files that numpy, pandas, h5py and MATLAB write."""

import io
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from scipy.io import savemat

from core.types import Array
from tests.support import short_period
from tests.support.short_period import DT

KEYS, N = ("alpha", "q", "Nz", "delta_e"), 6
UNITS = ("deg", "deg/s", "g", "deg")
TO_FILE = np.array([np.degrees(1.0), np.degrees(1.0), 1.0, np.degrees(1.0)])
LABELS = np.array([-1, 40, -1, -1, 50, -1])


def flights(n: int = N, seed: int = 1) -> Array:
    return short_period.fly(np.random.default_rng(seed), n)[1]


def arrays(y: Array, **more: object) -> dict[str, object]:
    return {"y": y * TO_FILE, "dt": DT, "channels": KEYS, "units": UNITS, **more}


def npz(flown: Array, **more: object) -> bytes:
    file = io.BytesIO()
    np.savez(file, **(arrays(flown) | more))  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def as_npz(folder: Path, y: Array) -> Path:
    path = folder / "rollouts.npz"
    np.savez(path, **arrays(y, fail_index=LABELS))  # pyright: ignore[reportArgumentType]
    return path


def as_matlab(folder: Path, y: Array) -> Path:
    path = folder / "rollouts.mat"
    cells = {
        name: np.array(texts, object) for name, texts in (("channels", KEYS), ("units", UNITS))
    }
    savemat(path, arrays(y, fail_index=LABELS, **cells) | cells)
    return path


def as_hdf5(folder: Path, y: Array) -> Path:
    path = folder / "rollouts.h5"
    with h5py.File(path, "w") as file:
        for name, value in arrays(y, fail_index=LABELS).items():
            file[name] = list(value) if isinstance(value, tuple) else value
    return path


def table(y: Array, k: int) -> pd.DataFrame:
    names = [f"{key} [{unit}]" for key, unit in zip(KEYS, UNITS, strict=True)]
    frame = pd.DataFrame(y[k] * TO_FILE, columns=names)
    frame.insert(0, "t [s]", DT * np.arange(len(frame)))
    frame["unsafe"] = (LABELS[k] >= 0) & (np.arange(len(frame)) >= LABELS[k])
    return frame.astype({"unsafe": float})


def as_folder(folder: Path, y: Array) -> Path:
    place = folder / "flights"
    place.mkdir()
    for k in range(len(y)):
        table(y, k).to_csv(place / f"flight_{k:03}.csv", index=False)
    return place


def as_long_csv(folder: Path, y: Array) -> Path:
    path = folder / "all.csv"
    parts = [table(y, k).assign(flight=k) for k in range(len(y))]
    pd.concat(parts).to_csv(path, index=False)
    return path


def as_long_parquet(folder: Path, y: Array) -> Path:
    path = folder / "all.parquet"
    parts = [table(y, k).assign(flight=k) for k in range(len(y))]
    pd.concat(parts).to_parquet(path, index=False)
    return path


def as_matlab_7_3(folder: Path, y: Array) -> Path:
    """As `save -v7.3` writes it: dimensions last first, cells of text as references."""
    path = folder / "rollouts.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in arrays(y, fail_index=LABELS[:, np.newaxis]).items():
            if not isinstance(value, tuple):
                file[name] = np.atleast_2d(np.asarray(value)).T
                continue
            cells = file.create_dataset(name, (len(value), 1), h5py.ref_dtype)
            for k, text in enumerate(value):
                codes = np.array([[ord(letter)] for letter in text], np.uint16)
                cells[k, 0] = file.create_dataset(f"#refs#/{name}{k}", data=codes).ref
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    return path
