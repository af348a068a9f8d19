"""Read the flights of a user's own simulator: a folder, one long table, or arrays.

A folder holds one file per flight, in any format of recordings. A long table has a column that
names the flight of each row. Arrays are `y` (flights, samples, channels), `dt`, `channels`,
`units`, and `fail_index` or `unsafe`; `theta` where known, in npz, MATLAB or HDF5 files. All are
read in a separate process, see app.telemetry.reading.
"""

import csv
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from app.telemetry.contents import Columns, Signal, release
from app.telemetry.formats import ROLLOUTS, UNNAMED
from app.telemetry.mapping.group_times import unit_of_time
from app.telemetry.mapping.spelling import unit_suffixes
from app.telemetry.reading import columns_of
from app.telemetry.recording import TelemetryError
from app.telemetry.units import convert, fits, si_unit, without_unit
from core.channels import Channel, Dictionary, channel, known_channels
from core.rollouts import FlownManoeuvre
from core.types import Array, Indices

TIMES = ("t", "time")
FLIGHTS = ("flight", "run", "rollout", "flight_id", "run_id")
LABELS = ("unsafe", "fail", "failed", "failure")
INDEX = re.compile(r"__index_level_\d+__|Unnamed: 0|column_1")
"""A column in which pandas writes the number of a row; in CSV the first one, without a name."""
SUFFIXES = ("deg", "degps", "dps", "rad", "radps", "kt", "kts", "mps", "mps2", "ft", "fps")
"""Ends of unknown names that can only be units."""
CONTROL = re.compile("d[aer]$|.*(delta|stick|pedal|throttle|elevator|aileron|rudder)", re.I)
"""Names of controls."""
MOST_JITTER = 0.01
"""Largest deviation of a sample interval, as a share of it."""
MOST_BYTES = 4 * 2**30
"""Largest array of flights, unless the caller allows another."""
NUMBERS = {"display_factor": float, "display_decimals": int, "largest": float}
"""Fields of a channel that are numbers."""


@dataclass(frozen=True, eq=False)
class RolloutFile:
    """Flights as read, in SI units.

    y: (n, n_samples, n_measured), NaN after the end of a flight; without computed channels, or
    with them.
    dt: [s].
    fail_index: (n,) first failing sample, -1 for none; None without labels.
    theta: (n, n_parameters), named by theta_names; None if unknown.
    flown: see LabelledFlights.   findings: what to check, for a person.
    """

    y: Array
    dt: float
    dictionary: Dictionary
    fail_index: Indices | None = None
    theta: Array | None = None
    theta_names: tuple[str, ...] = ()
    flown: tuple[FlownManoeuvre | None, ...] = ()
    findings: tuple[str, ...] = ()


class GivenDictionary(NamedTuple):
    """A dictionary as written.   units: by key, of signals without a unit in the files."""

    dictionary: Dictionary
    units: Mapping[str, str]


@dataclass(frozen=True)
class _Wanted:
    """Arguments of the caller, without the files.   name: of the source, in messages."""

    dictionary: Dictionary | None
    units: Mapping[str, str]
    dt: float | None
    name: str
    most_bytes: int

    def in_si(self, values: npt.NDArray[Any], unit: str, known: Channel) -> Array:
        """Values of a channel, recorded in `unit`, "" if the files give none. TelemetryError."""
        try:
            return convert(values, unit or self.units.get(known.key, known.unit), known.unit)
        except TelemetryError as error:
            raise TelemetryError(f"channel {known.key}: {error}") from error


def empty_flights(name: str, shape: tuple[int, int, int], most_bytes: int) -> Array:
    """An array of flights without values. TelemetryError if it would be too large.

    name: of the source.   shape: (n, n_samples, n_channels).
    """
    if (needed := 8 * prod(shape)) > most_bytes:
        raise TelemetryError(
            f"{name}: {shape[0]} flights of up to {shape[1]} samples and {shape[2]} channels need "
            f"{needed / 2**30:.3g} GiB, and {most_bytes / 2**30:.3g} are allowed: give fewer "
            "flights, or a longer sample interval"
        )
    return np.full(shape, np.nan)


def read_rollouts(
    source: Path,
    given: GivenDictionary | None = None,
    *,
    dt: float | None = None,
    name: str | None = None,
    most_bytes: int = MOST_BYTES,
    place: Path | None = None,
) -> RolloutFile:
    """Read flights from a folder, a long table or a file of arrays. TelemetryError.

    given: the channels to use; without it all signals are, known ones by their keys.
    dt: sample interval [s] of a source that does not give it.   name: of the source, in messages.
    place: of temporary files.
    """
    if not source.exists():
        raise TelemetryError(f"{source}: no such file or folder: give the rollouts")
    dictionary, units = given or (None, {})
    wanted = _Wanted(dictionary, units, dt, name or f"{source}", most_bytes)
    with columns_of(source, rollouts=True, name=name, place=place) as columns:
        if columns.contents.format == ROLLOUTS.key:
            return _of_arrays(columns, wanted)
        return _of_flights(_long_table(columns, wanted), wanted)


def read_dictionary(path: Path) -> GivenDictionary:
    """A dictionary from a file, see `dictionary_of_text`. TelemetryError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise TelemetryError(f"{path} cannot be read ({error}): give a dictionary") from error
    return dictionary_of_text(text, path.stem)


def dictionary_of_text(text: str, name: str) -> GivenDictionary:
    """A dictionary from JSON, or from CSV with a row for each channel. TelemetryError.

    A unit that is not SI becomes the display unit.
    """
    try:
        if text.lstrip().startswith(("{", "[")):
            plain = json.loads(text)
        else:
            rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
            plain = [{key: value for key, value in row.items() if value} for row in rows]
            for row, (field, kind) in product(plain, NUMBERS.items()):
                if field in row:
                    row[field] = kind(row[field])
        if isinstance(plain, list):
            plain = {"name": name, "channels": plain}
        channels = [_in_si(channel) for channel in plain["channels"]]
        dictionary = Dictionary.from_plain({"name": plain["name"], "channels": channels})
        units = {each["key"]: each["unit"] for each in plain["channels"]}
        return GivenDictionary(dictionary, units)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise TelemetryError(
            f"{name} is not a dictionary of channels ({error}): give key and unit of each"
        ) from error


def _in_si(plain: dict[str, Any]) -> dict[str, Any]:
    """A channel with its unit in SI, displayed in the given one."""
    given = plain.get("unit")
    if not isinstance(given, str) or (unit := si_unit(given)) == given:
        return plain
    factor = float(convert(np.ones(1), unit, given)[0])
    shown = {"display_unit": given, "display_factor": factor}
    return shown | plain | {"unit": unit}


# --- arrays ---------------------------------------------------------------------------------------


def _of_arrays(columns: Columns, wanted: _Wanted) -> RolloutFile:
    samples, flights = columns.contents.groups
    signals = [signal for signal in columns.contents.signals if signal.group == 0]
    rows = [signal.name for signal in columns.contents.signals if signal.group == 1]
    keys, dictionary, name = [signal.name for signal in signals], wanted.dictionary, wanted.name
    if UNNAMED in columns.contents.ignored:
        if dictionary is None or len(dictionary.measured) != len(keys):
            raise TelemetryError(
                f"{name} does not name its {len(keys)} channels: give the array channels, or a "
                "dictionary of as many"
            )
        keys = list(dictionary.measured)
    units = [signal.unit for signal in signals]
    if dictionary is None:
        keys, units = zip(*_without_suffixes(keys, units), strict=True)
        dictionary = own_dictionary(keys, units)
    shape = flights.n_rows, samples.n_rows // flights.n_rows
    y = empty_flights(name, (*shape, len(dictionary.measured)), wanted.most_bytes)
    for c, known in enumerate(_measured(dictionary)):
        place = _chosen(keys, known.key, name)
        values = columns.values(signals[place].name).reshape(shape)
        y[..., c] = wanted.in_si(values, units[place], known)
        release(values)
    dt, labels, *theta = (np.array(columns.values(row)) for row in rows)
    if not dt[0] > 0 and wanted.dt is None:
        raise TelemetryError(f"{name} has no dt: give the sample interval in seconds")
    return RolloutFile(
        y,
        float(dt[0]) if dt[0] > 0 else float(wanted.dt or 0),
        dictionary,
        None if np.isnan(labels[0]) else labels.astype(np.int64),
        np.column_stack(theta) if theta else None,
        tuple(rows[2:]),
    )


# --- flights as tables ----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Flight:
    """One flight: t (n,) [s], columns by name as recorded, their units, and its label.

    inferred: unit of the recorded times if the file does not give it.
    """

    t: Array
    columns: Mapping[str, Array]
    units: Mapping[str, str]
    unsafe: Array | None
    inferred: str


def _long_table(columns: Columns, wanted: _Wanted) -> Iterator[_Flight]:
    table = _table(columns, wanted)
    flight = _named(table, FLIGHTS)
    if flight is None:
        raise TelemetryError(
            f"{wanted.name} has no column that names the flight of a row: call it {FLIGHTS[0]}, "
            "or give one file for each flight"
        )
    numbers = np.array(columns.values(table.pop(flight).name))
    order = np.argsort(numbers, kind="stable")
    ends = np.flatnonzero(np.diff(numbers[order])) + 1
    for rows in np.split(order, ends):
        yield _flight(table, columns, rows, wanted)


def _table(columns: Columns, wanted: _Wanted) -> dict[str, Signal]:
    """Signals of the only group of a file, by their names without units."""
    signals = [each for each in columns.contents.signals if not INDEX.fullmatch(each.name)]
    if len({signal.group for signal in signals}) != 1:
        raise TelemetryError(f"{wanted.name} has several tables: give one for each flight")
    keys = [without_unit(signal.name) for signal in signals]
    units = [signal.unit for signal in signals]
    if wanted.dictionary is None:
        named = _without_suffixes(keys, units)
    else:
        named = map(_time_without_suffix, keys, units)
    return {
        key: replace(signal, unit=unit) for (key, unit), signal in zip(named, signals, strict=True)
    }


def _flight(
    table: Mapping[str, Signal], columns: Columns, rows: Indices, wanted: _Wanted
) -> _Flight:
    time, label = _named(table, TIMES), _named(table, LABELS)
    if time is None and wanted.dt is None:
        raise TelemetryError(
            f"{wanted.name} has no column of times: call it t [s], or give the sample interval dt"
        )

    def values(name: str) -> Array:
        return np.array(columns.values(table[name].name)[rows])

    rest = [name for name in table if name not in (time, label)]
    inferred = ""
    if time is None:
        t = np.arange(float(len(rows))) * (wanted.dt or 0.0)
    else:
        t, unit = values(time), table[time].unit
        inferred = "" if unit else unit_of_time(table[time], t)
        t = convert(t, unit or inferred, "s")
    return _Flight(
        t,
        {name: values(name) for name in rest},
        {name: table[name].unit for name in rest},
        None if label is None else values(label),
        inferred,
    )


def _named(names: Iterable[str], among: Sequence[str]) -> str | None:
    return next((name for name in names if name.lower() in among), None)


def _of_flights(flights: Iterator[_Flight], wanted: _Wanted) -> RolloutFile:
    read, name = list(flights), wanted.name
    first = read[0]
    units = list(first.units.values())
    dictionary = wanted.dictionary or own_dictionary(list(first.columns), units)
    steps = np.array([np.median(np.diff(flight.t)) if len(flight.t) > 1 else 0 for flight in read])
    dt = float(np.median(steps))
    off = np.flatnonzero(np.abs(steps - dt) > MOST_JITTER * dt)
    if len(off) or not dt > 0:
        raise TelemetryError(
            f"{name}: {len(off)} of {len(read)} flights are not sampled every {dt:g} s: resample "
            "them to one interval"
        )
    measured = _measured(dictionary)
    shape = len(read), max(len(flight.t) for flight in read), len(measured)
    y = empty_flights(name, shape, wanted.most_bytes)
    for k, flight in enumerate(read):
        steps = np.diff(flight.t)
        if (np.abs(steps - dt) > 0.5 * dt).any():
            raise TelemetryError(
                f"{name}: flight {k + 1} has gaps or times out of order: export it again"
            )
        for c, known in enumerate(measured):
            _chosen(list(flight.columns), known.key, f"{name}, flight {k + 1}")
            values, unit = flight.columns[known.key], flight.units[known.key]
            y[k, : len(flight.t), c] = wanted.in_si(values, unit, known)
    findings = ()
    if (unit := first.inferred) not in ("", "s"):
        text = f"the times have no unit and are read as {unit}, one sample every {dt:g} s"
        findings = (f"{text}: if that is wrong, name their column t [s]",)
    return RolloutFile(y, dt, dictionary, _table_labels(read), findings=findings)


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


def _without_suffixes(keys: Sequence[str], units: Sequence[str]) -> list[tuple[str, str]]:
    """(key, unit) of each signal: alpha_deg without a unit is alpha in deg, unless alpha exists."""
    named = list(map(_without_suffix, keys, units))
    stems = [key for key, _ in named]
    return [
        new if new[0] == key or (stems.count(new[0]) == 1 and new[0] not in keys) else (key, unit)
        for new, key, unit in zip(named, keys, units, strict=True)
    ]


def _without_suffix(key: str, unit: str) -> tuple[str, str]:
    known = known_channels()
    if unit or key in known:
        return key, unit
    for stem, suffix in unit_suffixes(key):
        if fits(suffix, known[stem].unit) if stem in known else suffix.lower() in SUFFIXES:
            return stem, suffix
    return _time_without_suffix(key, unit)


def _time_without_suffix(key: str, unit: str) -> tuple[str, str]:
    """t_ms without a unit is t in ms; other names stay."""
    for stem, suffix in () if unit else unit_suffixes(key):
        if stem.lower() in TIMES and fits(suffix, "s"):
            return stem, suffix
    return key, unit


def own_dictionary(keys: Sequence[str], units: Sequence[str]) -> Dictionary:
    """A dictionary of a file's own names and units, known channels with their roles."""
    known = known_channels()
    channels = []
    for key, unit in zip(keys, units, strict=True):
        if key in known:
            channels.append(known[key])
            continue
        role = "control" if CONTROL.match(key) else "output"
        own = replace(channel(key, key, si_unit(unit), key, role, "absolute"), largest=None)
        if own.display_unit == own.unit != unit:  # people read it in the unit of the file
            factor = float(convert(np.ones(1), own.unit, unit)[0])
            own = replace(own, display_unit=unit, display_factor=factor)
        channels.append(own)
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
