"""MATLAB's conventions: fields of a structure that are time, data, unit and name of a signal."""

from collections.abc import Collection, Mapping
from dataclasses import replace

from app.telemetry.readers.matrices import Matrix
from app.telemetry.readers.signal_tables import DESCRIPTION_NAMES, Column, is_time_name

VALUE_NAMES = ("data", "values", "value")
UNIT_NAMES = ("unit", "units")
SIGNALS = "signals"

Path = tuple[str, ...]


def as_signals(arrays: Mapping[Path, Matrix], texts: Mapping[Path, str]) -> list[Matrix]:
    """Name the arrays of a file; find their times and units. Both arguments are by path of a field.

    A structure of time and data is a signal with the structure's name. The `signals` of a
    "Structure with time" are signals named by their labels. A structure of data without a time
    belongs to the group of its neighbours, and may be their time. Others have their MATLAB names.
    """
    lowered = {tuple(part.lower() for part in path): text for path, text in texts.items()}
    with_time = {path[:-1] for path in arrays if is_time_name(path[-1])}
    return [_signal(path, array, lowered, with_time) for path, array in arrays.items()]


def _signal(
    path: Path, array: Matrix, texts: Mapping[Path, str], with_time: Collection[Path]
) -> Matrix:
    within, field = path[:-1], path[-1]
    low = tuple(part.lower() for part in path)
    name = ".".join(path)
    unit, description = (_beside(low, texts, names) for names in (UNIT_NAMES, DESCRIPTION_NAMES))
    if within and low[-1] in VALUE_NAMES:
        name = ".".join(within)
        unit = _within(low[:-1], texts, UNIT_NAMES) or unit
        description = _within(low[:-1], texts, DESCRIPTION_NAMES) or description
        if low[-2].startswith(SIGNALS):
            name = texts.get((*low[:-1], "label"), "") or name
        elif within not in with_time:
            within, field = within[:-1], within[-1]
    time = is_time_name(field)
    return replace(array, within=within, column=Column(name, unit, description, time))


def _within(low: Path, texts: Mapping[Path, str], names: tuple[str, ...]) -> str:
    """Text in a structure about its data, or in the DataInfo of a timeseries."""
    places = [(*low, *more, name) for more in ((), ("datainfo",)) for name in names]
    return next((texts[place] for place in places if place in texts), "")


def _beside(low: Path, texts: Mapping[Path, str], names: tuple[str, ...]) -> str:
    """Text in a neighbouring field: `beta_unit`, or `units.beta`."""
    within, field = low[:-1], low[-1]
    places = [
        place for name in names for place in ((*within, f"{field}_{name}"), (*within, name, field))
    ]
    return next((texts[place] for place in places if place in texts), "")
