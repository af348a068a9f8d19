"""Read the flights of somebody's own simulator: a folder, one long table, or arrays.

A folder holds one file per flight, in any format of recordings. A long table has a column that
names the flight of each row. Arrays are `y` (flights, samples, channels), `dt`, `channels`,
`units`, and `fail_index` or `unsafe`; `theta` where known, in npz, MATLAB or HDF5 files.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.contents import Columns
from app.telemetry.reading import columns_of
from app.telemetry.recording import TelemetryError
from app.telemetry.units import convert, si_unit, without_unit
from core.channels import Channel, Dictionary, channel, known_channels
from core.types import Array, Indices

ARRAYS = (".npz", ".mat", ".h5", ".hdf5")
TIMES = ("t", "time", "t_s", "time_s")
FLIGHTS = ("flight", "run", "rollout", "flight_id", "run_id")
LABELS = ("unsafe", "fail", "failed", "failure")
MOST_JITTER = 0.01
"""Largest deviation of a sample interval, as a share of it."""


@dataclass(frozen=True, eq=False)
class RolloutFile:
    """Flights as read, in SI units.

    y: (n, n_samples, n_measured), NaN after the end of a flight; without computed channels.
    dt: [s].
    fail_index: (n,) first failing sample, -1 for none; None without labels.
    theta: (n, n_parameters); None if unknown.
    """

    y: Array
    dt: float
    dictionary: Dictionary
    fail_index: Indices | None = None
    theta: Array | None = None


def read_rollouts(source: Path, dictionary: Dictionary | None = None) -> RolloutFile:
    """Read flights from a folder, a long table or a file of arrays. TelemetryError.

    dictionary: of the channels to use; without it all signals are, known ones by their keys.
    """
    if not source.exists():
        raise TelemetryError(f"{source}: no such file or folder: give the rollouts")
    if source.suffix.lower() in ARRAYS and (arrays := _arrays(source)) is not None:
        return _of_arrays(arrays, dictionary, f"{source}")
    with columns_of(source) as columns:
        return _of_flights(_long_table(columns, source), dictionary, f"{source}")


def read_dictionary(path: Path) -> Dictionary:
    """A dictionary from JSON, or from CSV with a row for each channel. TelemetryError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix.lower() == ".csv":
            rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
            channels = [{key: value for key, value in row.items() if value} for row in rows]
            return Dictionary.from_plain({"name": path.stem, "channels": channels})
        plain = json.loads(text)
        if isinstance(plain, list):
            plain = {"name": path.stem, "channels": plain}
        return Dictionary.from_plain(plain)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise TelemetryError(
            f"{path} is not a dictionary of channels ({error}): give key and unit of each"
        ) from error


# --- arrays ---------------------------------------------------------------------------------------


def _arrays(path: Path) -> dict[str, Any] | None:
    """The arrays of a file by name; None if it holds no array `y` of three dimensions."""
    try:
        with _opened(path) as arrays:
            if "y" not in arrays or np.ndim(arrays["y"]) != 3:
                return None
            return {name: np.asarray(arrays[name]) for name in arrays}
    except (OSError, ValueError, KeyError, TypeError, NotImplementedError) as error:
        raise TelemetryError(f"{path} cannot be read ({error}): export the arrays again") from error


@contextmanager
def _opened(path: Path) -> Iterator[Mapping[str, Any]]:
    if path.suffix.lower() == ".npz":
        with np.load(path, allow_pickle=False) as arrays:
            yield arrays
        return
    import h5py  # slow to import, as is scipy.io

    if path.suffix.lower() == ".mat" and not h5py.is_hdf5(path):
        from scipy.io import loadmat

        yield {k: v for k, v in loadmat(path).items() if not k.startswith("__")}
        return
    with h5py.File(path) as file:
        # MATLAB stores dimensions last first
        turned = path.suffix.lower() == ".mat"
        yield {k: file[k][()].T if turned else file[k][()] for k in file}  # pyright: ignore


def _of_arrays(arrays: Mapping[str, Any], dictionary: Dictionary | None, name: str) -> RolloutFile:
    for needed in ("dt", "channels"):
        if needed not in arrays:
            raise TelemetryError(f"{name} has no {needed}: give y, dt, channels and units")
    y, keys = np.asarray(arrays["y"], np.float64), _texts(arrays["channels"])
    units = _texts(arrays["units"]) if "units" in arrays else [""] * len(keys)
    if len(keys) != y.shape[2] or len(units) != len(keys):
        raise TelemetryError(
            f"{name} names {len(keys)} channels and {len(units)} units, and y has {y.shape[2]}: "
            "give one of each for each channel"
        )
    dictionary = dictionary or _own(keys, units)
    columns = [_chosen(keys, key, name) for key in dictionary.measured]
    y = y[..., columns]
    for c, known in enumerate(_measured(dictionary)):
        y[..., c] = _converted(y[..., c], units[columns[c]], known)
    theta = np.asarray(arrays["theta"], np.float64) if "theta" in arrays else None
    dt = float(np.ravel(arrays["dt"])[0])
    return RolloutFile(y, dt, dictionary, _labels(arrays, y.shape, name), theta)


def _labels(arrays: Mapping[str, Any], shape: tuple[int, ...], name: str) -> Indices | None:
    if "fail_index" in arrays:
        return np.ravel(arrays["fail_index"]).astype(np.int64)
    if "unsafe" not in arrays:
        return None
    unsafe = np.asarray(arrays["unsafe"]).astype(bool)
    if unsafe.ndim == 2 and unsafe.shape == shape[:2]:
        return np.where(unsafe.any(axis=1), unsafe.argmax(axis=1), -1)
    flights = unsafe.ravel()
    if len(flights) != shape[0]:
        raise TelemetryError(f"{name}: unsafe has {len(flights)} entries for {shape[0]} flights")
    # a label of the whole flight: it fails at its last sample
    missing = np.any(np.isnan(np.asarray(arrays["y"], np.float64)), axis=2)
    last = np.where(missing.any(axis=1), missing.argmax(axis=1), shape[1]) - 1
    return np.where(flights, last, -1)


def _texts(values: Any) -> list[str]:
    items = np.asarray(values).ravel().tolist()
    return [
        (item.decode() if isinstance(item, bytes) else str(np.ravel(item)[0])).strip()
        if not isinstance(item, str)
        else item.strip()
        for item in items
    ]


# --- flights as tables ----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Flight:
    """One flight: t (n,) [s], columns by name as recorded, their units, and its label."""

    t: Array
    columns: Mapping[str, Array]
    units: Mapping[str, str]
    unsafe: Array | None


def _long_table(columns: Columns, path: Path) -> Iterator[_Flight]:
    table = _table(columns, path)
    flight = _named(table, FLIGHTS)
    if flight is None:
        raise TelemetryError(
            f"{path} has no column that names the flight of a row: call it {FLIGHTS[0]}, or give a "
            "folder with one file for each flight"
        )
    numbers = np.array(columns.values(table.pop(flight)))
    order = np.argsort(numbers, kind="stable")
    ends = np.flatnonzero(np.diff(numbers[order])) + 1
    for rows in np.split(order, ends):
        yield _flight(table, columns, rows, path)


def _table(columns: Columns, path: Path) -> dict[str, str]:
    """Signals of the only group of a file, by their names without units."""
    signals = columns.contents.signals
    if len({signal.group for signal in signals}) != 1:
        raise TelemetryError(f"{path} has several tables: give one for each flight")
    return {without_unit(signal.name): signal.name for signal in signals}


def _flight(
    table: Mapping[str, str], columns: Columns, rows: slice | Indices, path: Path
) -> _Flight:
    time, label = _named(table, TIMES), _named(table, LABELS)
    if time is None:
        raise TelemetryError(f"{path} has no column of times: call it t [s]")

    def values(name: str) -> Array:
        return np.array(columns.values(table[name])[rows])

    rest = [name for name in table if name not in (time, label)]
    return _Flight(
        convert(values(time), columns.signal(table[time]).unit or "s", "s"),
        {name: values(name) for name in rest},
        {name: columns.signal(table[name]).unit for name in rest},
        None if label is None else values(label),
    )


def _named(names: Iterable[str], among: Sequence[str]) -> str | None:
    return next((name for name in names if name.lower() in among), None)


def _of_flights(
    flights: Iterator[_Flight], dictionary: Dictionary | None, name: str
) -> RolloutFile:
    read = list(flights)
    first = read[0]
    dictionary = dictionary or _own(list(first.columns), list(first.units.values()))
    steps = np.array([np.median(np.diff(flight.t)) if len(flight.t) > 1 else 0 for flight in read])
    dt = float(np.median(steps))
    off = np.flatnonzero(np.abs(steps - dt) > MOST_JITTER * dt)
    if len(off) or not dt > 0:
        raise TelemetryError(
            f"{name}: {len(off)} of {len(read)} flights are not sampled every {dt:g} s: resample "
            "them to one interval"
        )
    measured = _measured(dictionary)
    y = np.full((len(read), max(len(flight.t) for flight in read), len(measured)), np.nan)
    for k, flight in enumerate(read):
        steps = np.diff(flight.t)
        if (np.abs(steps - dt) > 0.5 * dt).any():
            raise TelemetryError(
                f"{name}: flight {k + 1} has gaps or times out of order: export it again"
            )
        for c, known in enumerate(measured):
            _chosen(list(flight.columns), known.key, f"{name}, flight {k + 1}")
            values, unit = flight.columns[known.key], flight.units[known.key]
            y[k, : len(flight.t), c] = _converted(values, unit, known)
    return RolloutFile(y, dt, dictionary, _table_labels(read))


def _table_labels(flights: Sequence[_Flight]) -> Indices | None:
    """First labelled sample of each flight, -1 for none; None without labels."""
    if all(flight.unsafe is None for flight in flights):
        return None
    fail = np.full(len(flights), -1)
    for k, flight in enumerate(flights):
        if flight.unsafe is not None and (unsafe := np.nan_to_num(flight.unsafe) != 0).any():
            fail[k] = unsafe.argmax()
    return fail


# --- channels -------------------------------------------------------------------------------------


def _own(keys: Sequence[str], units: Sequence[str]) -> Dictionary:
    """A dictionary of a file's own names and units, known channels with their roles."""
    known = known_channels()
    channels = []
    for key, unit in zip(keys, units, strict=True):
        if key in known:
            channels.append(known[key])
            continue
        control = any(word in key.lower() for word in ("delta", "stick", "pedal", "throttle"))
        role = "control" if control else "output"
        channels.append(channel(key, key, si_unit(unit), key, role, "absolute"))
    try:
        return Dictionary("own", tuple(channels))
    except ValueError as error:
        raise TelemetryError(str(error)) from error


def _measured(dictionary: Dictionary) -> list[Channel]:
    return [known for known in dictionary.channels if not known.formula]


def _chosen(keys: Sequence[str], key: str, name: str) -> int:
    if key not in keys:
        raise TelemetryError(f"{name} has no channel {key}: it has {', '.join(keys)}")
    return list(keys).index(key)


def _converted(values: npt.NDArray[Any], unit: str, known: Channel) -> Array:
    try:
        return convert(values, unit or known.unit, known.unit)
    except TelemetryError as error:
        raise TelemetryError(f"channel {known.key}: {error}") from error
