"""MATLAB's habits: which fields of a structure are time, data, unit and name of one signal."""

from collections.abc import Mapping
from dataclasses import replace

from app.telemetry.readers.matrices import Matrix
from app.telemetry.readers.signal_tables import Column, is_time_name

VALUE_NAMES = ("data", "values", "value")
UNIT_NAMES = ("unit", "units")
SIGNALS = "signals"

Path = tuple[str, ...]


def as_signals(arrays: Mapping[Path, Matrix], texts: Mapping[Path, str]) -> list[Matrix]:
    """Name the arrays of a file and their times and units. Both are by the path to the field.

    A structure of time and data is a signal of the structure's name; so is each of the `signals`
    of a "Structure with time", which has a label of its own. Others are named as in MATLAB.
    """
    lowered = {tuple(part.lower() for part in path): text for path, text in texts.items()}
    return [_signal(path, array, lowered) for path, array in arrays.items()]


def _signal(path: Path, array: Matrix, texts: Mapping[Path, str]) -> Matrix:
    within, field = path[:-1], path[-1]
    low = tuple(part.lower() for part in path)
    name, beside = ".".join(path), _unit_beside(low, texts)
    if within and low[-1] in VALUE_NAMES:
        name = ".".join(within)
        beside = _unit_within(low[:-1], texts) or beside
        if low[-2].startswith(SIGNALS):
            name = texts.get((*low[:-1], "label"), "") or name
    time = is_time_name(field)
    return replace(array, within=within, column=Column(name, beside, "", time))


def _unit_within(low: Path, texts: Mapping[Path, str]) -> str:
    """The unit that a structure says of its data, as itself or in the DataInfo of a timeseries."""
    places = [(*low, *more, unit) for more in ((), ("datainfo",)) for unit in UNIT_NAMES]
    return next((texts[place] for place in places if place in texts), "")


def _unit_beside(low: Path, texts: Mapping[Path, str]) -> str:
    """The unit of a field by a field beside it: `beta_unit`, or `units.beta`."""
    within, field = low[:-1], low[-1]
    places = [
        place
        for unit in UNIT_NAMES
        for place in ((*within, f"{field}_{unit}"), (*within, unit, field))
    ]
    return next((texts[place] for place in places if place in texts), "")
