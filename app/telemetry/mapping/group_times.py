"""Which signal of a group is its time, and in which unit it counts."""

from dataclasses import dataclass

import numpy as np

from app.telemetry.contents import Columns, Signal
from app.telemetry.extent import FEW
from app.telemetry.mapping.mapping import TimeSource
from app.telemetry.mapping.names import readings
from app.telemetry.traces import Array
from app.telemetry.units import UNSAID, factor, fits, spelled

MOSTLY = 0.9
"""Share of the steps that must go forward; clocks repeat and step back now and then."""
EVEN = 0.2
"""Steps of a time that no name gives away scatter less than this, as a share of the median."""
SURE_NAME = 0.4
MOST_STEPS = 20_000
"""Steps that are sorted for their median."""
USUAL_STEP_S = (2e-5, 10.0)
"""A unit that puts the step outside of this is doubted."""
EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"), (5e8, "s"))
"""Times beyond this count from 1970, which says their unit."""
STEPS = ((2e6, "ns"), (2e3, "us"), (2.0, "ms"))
"""Median steps from here on are of this unit: recorders take 0.5 to 2000 samples a second."""
DAYS = (3e4, 1e6)
"""Spreadsheets and MATLAB count days, since 1900 and since the year 0."""


@dataclass(frozen=True)
class FoundTime:
    """The time of a group, how sure, and why."""

    source: TimeSource
    confidence: float
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class _Clock:
    """How a signal runs. forward: share of its steps that go on.   even: scatter of the steps."""

    forward: float
    known: float
    step: float
    scatter: float
    start: float

    @property
    def runs(self) -> bool:
        return self.forward >= MOSTLY and self.known >= 0.5 and self.step > 0.0

    @property
    def counts(self) -> bool:
        """Whether it numbers the rows instead of timing them."""
        return self.step == 1.0 and self.scatter == 0.0 and self.start in (0.0, 1.0)


def find_time(columns: Columns, group: int) -> FoundTime | None:
    """Return the time of a group: as the format declares it, else by name, else by its values."""
    contents = columns.contents
    members = [signal for signal in contents.signals if signal.group == group]
    if contents.groups[group].n_rows < 2:
        return None
    declared = contents.groups[group].time
    if declared and not no_clock(declared, columns.values(declared)):
        signal = columns.signal(declared)
        unit, sure, why = _unit(signal, _clock(columns.values(declared)))
        source = TimeSource(declared, unit)
        return FoundTime(source, 0.99 * sure, ("the format declares it to be the time", why))
    named = [(_time_certainty(signal, contents.groups[group].name), signal) for signal in members]
    found = [
        _judge(columns, signal, certainty, f"named as a time is: {signal.name}")
        for certainty, signal in sorted(named, key=lambda pair: -pair[0])
        if certainty >= SURE_NAME
    ]
    if not any(found):
        # a table's time is mostly its first column
        found = [_judge_unnamed(columns, signal) for signal in members]
    return max((time for time in found if time), key=lambda time: time.confidence, default=None)


def dead_time(columns: Columns, group: int) -> str:
    """Why what a group declares or names as its time is no clock; "" where nothing is to say."""
    contents = columns.contents
    if contents.groups[group].n_rows < 2:
        return ""
    name = contents.groups[group].name
    meant = [
        signal.name
        for signal in contents.signals
        if signal.group == group
        and (
            signal.name == contents.groups[group].time or _time_certainty(signal, name) >= SURE_NAME
        )
    ]
    reasons = (no_clock(signal, columns.values(signal)) for signal in meant)
    return next((why for why in reasons if why), "")


def no_clock(name: str, values: Array) -> str:
    """Why values cannot be times of several rows: they are all one, or none; "" if they can."""
    n = len(values)
    if n < 2:
        return ""
    finite = np.isfinite(values)
    if not finite.any():
        return f"{name} holds no number in all {n} rows: it is no clock; choose another time"
    known = values if finite.all() else values[finite]
    if len(known) > 1 and known.min() == known.max():
        where = f"all {n} rows" if len(known) == n else f"all of its {len(known)} values"
        return f"{name} is {known[0]:.10g} in {where}: it is no clock; choose another time"
    return ""


def _time_certainty(signal: Signal, group: str) -> float:
    certainty = max((r.certainty for r in readings(signal.name, group) if r.key == "t"), default=0)
    if signal.unit.lower() in UNSAID or not spelled(signal.unit) or fits(signal.unit, "s"):
        return certainty
    return 0.0


def _judge(columns: Columns, signal: Signal, certainty: float, why: str) -> FoundTime | None:
    clock = _clock(columns.values(signal.name))
    if not clock.runs:
        return None
    unit, sure, because = _unit(signal, clock)
    confidence = (1.0 - 0.4 * (1.0 - certainty)) * sure
    return FoundTime(TimeSource(signal.name, unit), confidence, (why, because))


def _judge_unnamed(columns: Columns, signal: Signal) -> FoundTime | None:
    """A signal that runs on evenly, is no channel by its name and no mere count of rows."""
    values = columns.values(signal.name)
    if len(values) < FEW or readings(signal.name):
        return None
    few = values[np.linspace(0, len(values) - 1, min(len(values), 64)).astype(np.intp)]
    if not (np.diff(few) > 0.0).all():
        return None
    clock = _clock(values)
    if not clock.runs or clock.scatter > EVEN or clock.counts:
        return None
    unit, sure, because = _unit(signal, clock)
    why = "no signal is named as a time is, and this one goes on in even steps"
    return FoundTime(TimeSource(signal.name, unit), 0.5 * sure, (why, because))


def _clock(values: Array) -> _Clock:
    steps = np.diff(np.asarray(values))
    known = np.isfinite(steps)
    if not known.all():
        steps = steps[known]
    if not len(steps):
        return _Clock(0.0, 0.0, 0.0, 0.0, 0.0)
    forward = float(np.count_nonzero(steps > 0.0)) / len(steps)
    ahead = steps[:: 1 + len(steps) // MOST_STEPS]
    ahead = ahead[ahead > 0.0]
    step = float(np.median(ahead)) if len(ahead) else 0.0
    low, high = np.percentile(ahead, (10.0, 90.0)) if len(ahead) else (0.0, 0.0)
    return _Clock(
        forward=forward,
        known=len(steps) / max(1, len(values) - 1),
        step=step,
        scatter=float(high - low) / step if step else 0.0,
        start=float(values[0]),
    )


def _unit(signal: Signal, clock: _Clock) -> tuple[str, float, str]:
    """Unit of a time, how sure, and why: said by the file or the name, or told by the steps."""
    said = signal.unit if spelled(signal.unit) else _said_by_name(signal)
    if said and fits(said, "s"):
        step = clock.step * factor(said, "s")
        usual = USUAL_STEP_S[0] <= step <= USUAL_STEP_S[1]
        doubt = "" if usual else f", though that makes a sample every {step:.3g} s"
        return (
            spelled(said),
            1.0 if usual else 0.5,
            f"counted in {spelled(said)}, as is said{doubt}",
        )
    for beyond, unit in EPOCHS:
        step = clock.step * factor(unit, "s")
        if clock.start >= beyond and USUAL_STEP_S[0] <= step <= USUAL_STEP_S[1]:
            return unit, 0.97, f"no unit is said: {clock.start:.4g} is {unit} since 1970"
    if DAYS[0] < clock.start < DAYS[1] and clock.step < 1e-3:
        return (
            "day",
            0.9,
            f"no unit is said: {clock.start:.6g} in steps of {clock.step:.2g} is days",
        )
    for at_least, unit in STEPS:
        if clock.step > at_least:
            return unit, 0.85, f"no unit is said: steps of {clock.step:.4g} are {unit}"
    sure = 0.95 if clock.step < 0.5 else 0.6
    return "s", sure, f"no unit is said: steps of {clock.step:.4g} are s"


def _said_by_name(signal: Signal) -> str:
    return next((r.unit for r in readings(signal.name) if r.key == "t"), "")
