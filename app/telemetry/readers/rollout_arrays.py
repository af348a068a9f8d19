"""Read arrays of rollouts from npz, MATLAB or HDF5 files; other files of these kinds are tables.

Group 0 has a signal for each channel, flight after flight. Group 1 has a row for each flight:
dt [s], the first failing sample (-1 for none, NaN without labels), then the parameters.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.formats import READERS, ROLLOUTS, UNNAMED, ZIP, format_of, head_of
from app.telemetry.readers import matlab
from app.telemetry.readers.signal_tables import library_errors
from app.telemetry.recording import TelemetryError
from core.types import real_numbers

NAMES = ("y", "dt", "channels", "units", "fail_index", "unsafe", "theta", "theta_names")


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read arrays, else the tables of a file."""
    with library_errors(ROLLOUTS.title), _opened(path) as arrays:
        if "y" in arrays and np.ndim(arrays["y"]) > 2:
            return _write({name: arrays[name] for name in NAMES if name in arrays}, writer)
    if head_of(path).startswith(ZIP):
        raise TelemetryError(
            "there is no array y of flights, samples and channels: give y with these three axes, "
            "dt, channels and units"
        )
    known, _ = format_of(path, path.name)
    return import_module(known.reader, READERS).read(path, writer)


@contextmanager
def _opened(path: Path) -> Iterator[Mapping[str, Any]]:
    if head_of(path).startswith(ZIP):
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            yield {name: _of_archive(arrays, name) for name in NAMES if name in arrays}
    elif not h5py.is_hdf5(path):
        from scipy.io import loadmat, whosmat

        wanted = [name for name, *_ in whosmat(path, appendmat=False) if name in NAMES]
        yield loadmat(path, appendmat=False, variable_names=wanted) if wanted else {}
    else:
        with h5py.File(path) as file:
            yield {
                name: _hdf5(file, name, matlab.wrote(file))
                for name in NAMES
                if isinstance(file.get(name), h5py.Dataset)
            }


def _of_archive(arrays: Mapping[str, Any], name: str) -> npt.NDArray[Any]:
    try:
        return arrays[name]
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        raise TelemetryError(f"{name} holds objects: save it as numbers or text") from None


def _numbers(arrays: Mapping[str, Any], name: str) -> npt.NDArray[Any]:
    """An array of real numbers. TelemetryError."""
    try:
        return real_numbers(arrays[name], name)
    except ValueError as error:
        raise TelemetryError(str(error)) from None


def _hdf5(file: h5py.File, name: str, is_matlab: bool) -> npt.NDArray[Any]:
    """An array of a file; MATLAB stores dimensions last first, and cells of text as references."""
    values = np.asarray(file[name][()])  # pyright: ignore
    if h5py.check_ref_dtype(file[name].dtype):  # pyright: ignore
        texts = [np.ravel(file[reference][()]) for reference in np.ravel(values)]  # pyright: ignore
        return np.array(["".join(map(chr, codes)) for codes in texts])
    return values.T if is_matlab else values


def _write(arrays: Mapping[str, Any], writer: ColumnWriter) -> Contents:
    y = _numbers(arrays, "y")
    if y.ndim != 3:
        raise TelemetryError(
            f"y has shape {y.shape}: give three axes, for flights, samples and channels"
        )
    n, _, n_channels = y.shape
    keys, units = _texts(arrays.get("channels", ())), _texts(arrays.get("units", ()))
    for given, name in ((keys, "channels"), (units, "units")):
        if given and len(given) != n_channels:
            raise TelemetryError(
                f"it names {len(given)} {name}, and y has {n_channels}: give one of each for each "
                "channel"
            )
    if twice := [key for key in keys if keys.count(key) > 1]:
        raise TelemetryError(f"two channels have the name {twice[0]!r}: give each its own")
    group = writer.add_group("samples")
    for c in range(n_channels):
        key, unit = keys[c] if keys else f"{c + 1}", units[c] if units else ""
        writer.append(writer.add_signal(group, key, unit), y[..., c].ravel())
    flights = writer.add_group("flights")
    theta = _numbers(arrays, "theta") if "theta" in arrays else np.empty((n, 0))
    if theta.ndim != 2 or len(theta) != n:
        raise TelemetryError(f"theta has shape {theta.shape}: give one row for each of {n} flights")
    names = _texts(arrays.get("theta_names", ()))
    if len(names) != theta.shape[1]:
        names = [f"theta_{k + 1}" for k in range(theta.shape[1])]
    dt = np.unique(_numbers(arrays, "dt")) if "dt" in arrays else np.full(1, np.nan)
    if len(dt) != 1 or dt[0] <= 0:
        raise TelemetryError(
            f"dt is {', '.join(f'{each:g}' for each in dt[:3])}: give one sample interval in "
            "seconds, and resample flights of another"
        )
    columns = {"dt": np.full(n, dt[0]), "fail_index": _labels(arrays, y)}
    for name, values in (*columns.items(), *zip(names, theta.T, strict=True)):
        writer.append(writer.add_signal(flights, name), values)
    return writer.finish(ROLLOUTS.key, ignored=() if keys else (UNNAMED,))


def _labels(arrays: Mapping[str, Any], y: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(n,) first failing sample of each flight, -1 for none; NaN without labels."""
    n, n_samples = y.shape[:2]
    if "fail_index" in arrays:
        labels = np.ravel(_numbers(arrays, "fail_index")).astype(float)
        if wrong := labels[labels != np.rint(labels)].tolist():  # NaN too
            raise TelemetryError(
                f"fail_index has the value {wrong[0]:g}: give the number of the first failing "
                "sample, or -1 for none"
            )
    elif "unsafe" not in arrays:
        return np.full(n, np.nan)
    else:
        unsafe = _numbers(arrays, "unsafe")
        if wrong := unsafe[(unsafe != 0) & (unsafe != 1)].ravel().tolist():
            raise TelemetryError(f"unsafe has the value {wrong[0]:g}: give 0 or 1")
        unsafe = unsafe.astype(bool)
        if unsafe.shape == (n, n_samples):
            return np.where(unsafe.any(axis=1), unsafe.argmax(axis=1), -1)
        # a label of the whole flight: it fails at its last sample
        missing = np.any(np.isnan(y), axis=2)
        last = np.where(missing.any(axis=1), missing.argmax(axis=1), n_samples) - 1
        labels = unsafe.ravel()
        if len(labels) == n:
            return np.where(labels, last, -1)
    if len(labels) != n:
        raise TelemetryError(f"{len(labels)} labels were given for {n} flights: give one for each")
    return labels


def _texts(values: Any) -> list[str]:
    items = np.asarray(values).ravel().tolist()
    return [
        (item.decode() if isinstance(item, bytes) else str(np.ravel(item)[0])).strip()
        if not isinstance(item, str)
        else item.strip()
        for item in items
    ]
