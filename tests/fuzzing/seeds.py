"""Small intact files of every format, from this and other programs, to be damaged."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from app.telemetry.formats import format_of
from app.telemetry.recording import TelemetryError
from tests.fuzzing.array_seeds import ARRAYS
from tests.fuzzing.bus_seeds import BUSES
from tests.fuzzing.hostile_arrays import ARRAYS as HOSTILE
from tests.fuzzing.table_seeds import TABLES
from tests.fuzzing.text_seeds import TEXTS

MOST_FOREIGN, LARGEST = 12, 14_000
"""Of each folder, so many files of up to so many bytes."""
FOREIGN = {
    "pyarrow": "tests/data/parquet/*.parquet",
    "scipy.io.matlab": "tests/data/*.mat",
    "scipy.io": "tests/data/*.nc",
    "h5py": "tests/data_files/*.h5",
    "sklearn.datasets": "data/*.csv",
    "scipy.stats": "tests/data/nist_anova/*.dat",
}
"""Where installed packages keep files of other programs."""
HURTFUL = (
    "cells_declared", "matlab_declaration", "groups_in_circles", "declared_only",
    "netcdf_records", "netcdf_no_records", "netcdf_odd_name",
)  # fmt: skip
"""Small hostile files that are damaged further."""


@dataclass(frozen=True)
class Seed:
    """A whole file. kind: key of its format."""

    kind: str
    path: Path


def write_seeds(folder: Path) -> list[Seed]:
    """Write a file of every sort into a folder."""
    for name, content in TEXTS.items():
        (folder / name).write_bytes(content)
    for name, write in (TABLES | ARRAYS | BUSES).items():
        write(folder / name)
    for name in HURTFUL:
        HOSTILE[name](folder / name)
    for package, pattern in FOREIGN.items():
        for path in _foreign(package, pattern):
            (folder / f"{package} {path.name}").write_bytes(path.read_bytes())
    return [Seed(kind, path) for path in sorted(folder.iterdir()) if (kind := _kind(path))]


def paths_of(seeds: Sequence[Seed], kind: str) -> list[Path]:
    """The whole files of a kind."""
    paths = [seed.path for seed in seeds if seed.kind == kind]
    assert paths, f"no file of the format {kind} is written: add one to TABLES, ARRAYS or BUSES"
    return paths


def _foreign(package: str, pattern: str) -> list[Path]:
    spec = find_spec(package)
    places = (spec and spec.submodule_search_locations) or ()
    found = [path for place in places for path in sorted(Path(place).glob(pattern))]
    small = [path for path in found if path.stat().st_size <= LARGEST]
    return small[:: -(-len(small) // MOST_FOREIGN) or 1]


def _kind(path: Path) -> str:
    try:
        return format_of(path, path.name)[0].key
    except TelemetryError:
        return ""
