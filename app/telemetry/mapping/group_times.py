"""Find the time signal of a group, and its unit."""

from dataclasses import dataclass

import numpy as np

from app.telemetry.contents import Columns, Signal
from app.telemetry.mapping.magnitudes import FEW
from app.telemetry.mapping.mapping import TimeSource
from app.telemetry.mapping.names import name_matches
from app.telemetry.units import NOT_GIVEN, factor, fits, spelled
from core.types import Array

MOSTLY = 0.9
"""Share of the steps that must go forward; clocks sometimes repeat or step back."""
EVEN = 0.2
"""Largest scatter of the steps of an unnamed time, as a share of their median."""
TIME_NAME = 0.4
MOST_STEPS = 20_000
"""Steps used for their median."""
USUAL_STEP_S = (2e-5, 10.0)
"""A unit that puts the step outside this range is suspect."""
EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"), (5e8, "s"))
"""Larger times count from 1970 in this unit."""
STEPS = ((2e6, "ns"), (2e3, "us"), (2.0, "ms"))
"""Larger median steps are in this unit: recorders take 0.5 to 2000 samples per second."""
DAYS = (3e4, 1e6)
"""Spreadsheets count days since 1900, MATLAB since year 0."""

CHOOSE = "choose another signal as the time"
RATE_CONFIDENCE = 0.9
"""Confidence in a declared rate: lost rows leave no trace."""
DOUBTED = 0.6
"""A rate from the format or a person replaces a time of less confidence."""
BACKWARD = 0.3
"""Factor on the confidence in a declared time that does not run forward."""


@dataclass(frozen=True)
class TimeProposal:
    """A proposed time of a group; confidence: 0 to 1."""

    source: TimeSource
    confidence: float
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class _Steps:
    """Steps of a signal from row to row.

    forward: share above zero.   known: share that is finite.   step: median of positive steps.
    scatter: 10th to 90th percentile, over the median.   start: first value.
    """

    forward: float
    known: float
    step: float
    scatter: float
    start: float

    @property
    def run_forward(self) -> bool:
        return self.forward >= MOSTLY and self.known >= 0.5 and self.step > 0.0

    @property
    def count_rows(self) -> bool:
        """Whether the signal is a row number."""
        return self.step == 1.0 and self.scatter == 0.0 and self.start in (0.0, 1.0)


def find_time(columns: Columns, group: int) -> TimeProposal | None:
    """Find the time of a group: as the format declares it, else by name, else by its values.

    A signal whose steps fit its unit comes first; a declared rate comes before a doubtful signal.
    """
    contents = columns.contents
    members = [signal for signal in contents.signals if signal.group == group]
    if contents.groups[group].n_rows < 2:
        return None
    declared = _declared(columns, group)
    if declared and declared.confidence >= DOUBTED:
        return declared
    named = [(_time_certainty(signal, contents.groups[group].name), signal) for signal in members]
    proposals = [
        _named(columns, signal, certainty)
        for certainty, signal in sorted(named, key=lambda pair: -pair[0])
        if certainty >= TIME_NAME
    ]
    if declared or not any(proposals):
        # usually the first column is the time
        proposals += [_unnamed(columns, signal) for signal in members]
    proposals += [declared]
    best = max((time for time in proposals if time), key=lambda time: time.confidence, default=None)
    rate, start = contents.groups[group].rate, contents.groups[group].start
    if rate and (best is None or best.confidence < DOUBTED):
        reason = f"the format declares a sample rate of {rate:g} Hz"
        return TimeProposal(TimeSource(rate=rate, start=start), RATE_CONFIDENCE, (reason,))
    return best


def _declared(columns: Columns, group: int) -> TimeProposal | None:
    """The signal that the format declares, with little confidence if its values conflict."""
    declared = columns.contents.groups[group].time
    if not declared or no_clock(declared, columns.values(declared)):
        return None
    steps = _steps(columns.values(declared))
    unit, confidence, why = _unit(columns.signal(declared), steps)
    reasons = ("the format declares it as the time", why)
    if not steps.run_forward:
        confidence *= BACKWARD
        reasons += (f"only {steps.forward:.0%} of its steps go forward",)
    return TimeProposal(TimeSource(declared, unit), 0.99 * confidence, reasons)


def dead_time(columns: Columns, group: int) -> str:
    """Why the declared or named time of a group is unusable; "" if it is usable or absent."""
    times = (signal.name for signal in _named_times(columns, group))
    reasons = (no_clock(signal, columns.values(signal)) for signal in times)
    return next((why for why in reasons if why), "")


def repeated_time(columns: Columns, group: int) -> str:
    """How many rows share each time of a group; "" if times differ."""
    for signal in _named_times(columns, group):
        steps = np.diff(np.asarray(columns.values(signal.name)))
        forward = np.flatnonzero(steps > 0.0)
        if len(forward) < 2 or not (steps >= 0.0).all() or len(forward) > MOSTLY * len(steps):
            continue
        n_each = float(np.median(np.diff(forward)))
        unit = _unit(signal, _steps(columns.values(signal.name)))[0]
        step = float(np.median(steps[forward])) * factor(unit, "s")
        return (
            f"{n_each:.3g} rows share each time of {signal.name}: give the sample rate, about "
            f"{n_each / step:.3g} Hz, or {CHOOSE}"
        )
    return ""


def _named_times(columns: Columns, group: int) -> list[Signal]:
    """Signals of a group that the format declares or the name suggests as its time."""
    contents = columns.contents
    name, declared = contents.groups[group].name, contents.groups[group].time
    return [
        signal
        for signal in contents.signals
        if signal.group == group and contents.groups[group].n_rows > 1
        if signal.name == declared or _time_certainty(signal, name) >= TIME_NAME
    ]


def no_clock(name: str, values: Array) -> str:
    """Why values cannot be times of several rows; "" if they can."""
    n = len(values)
    if n < 2:
        return ""
    finite = np.isfinite(values)
    if not finite.any():
        return f"all {n} rows of {name} are empty, so it cannot be the time: {CHOOSE}"
    known = values if finite.all() else values[finite]
    if len(known) > 1 and known.min() == known.max():
        rows = f"all {n} rows" if len(known) == n else f"all of its {len(known)} values"
        return f"{name} is {known[0]:.10g} in {rows}, so it cannot be the time: {CHOOSE}"
    return ""


def _time_certainty(signal: Signal, group: str) -> float:
    matches = name_matches(signal.name, group)
    certainty = max((match.certainty for match in matches if match.key == "t"), default=0.0)
    if signal.unit.lower() in NOT_GIVEN or not spelled(signal.unit) or fits(signal.unit, "s"):
        return certainty
    return 0.0


def _named(columns: Columns, signal: Signal, certainty: float) -> TimeProposal | None:
    """A signal whose name suggests a time, if it runs forward."""
    steps = _steps(columns.values(signal.name))
    if not steps.run_forward:
        return None
    unit, confidence, why = _unit(signal, steps)
    confidence *= 1.0 - 0.4 * (1.0 - certainty)
    reasons = (f"the name {signal.name} suggests a time", why)
    return TimeProposal(TimeSource(signal.name, unit), confidence, reasons)


def _unnamed(columns: Columns, signal: Signal) -> TimeProposal | None:
    """A signal that increases evenly, is not a channel by name and not a row number."""
    values = columns.values(signal.name)
    if len(values) < FEW or name_matches(signal.name):
        return None
    few = values[np.linspace(0, len(values) - 1, min(len(values), 64)).astype(np.intp)]
    if not (np.diff(few) > 0.0).all():
        return None
    steps = _steps(values)
    if not steps.run_forward or steps.scatter > EVEN or steps.count_rows:
        return None
    unit, confidence, why = _unit(signal, steps)
    reasons = ("no signal name suggests a time, and this signal increases in even steps", why)
    return TimeProposal(TimeSource(signal.name, unit), 0.5 * confidence, reasons)


def _steps(values: Array) -> _Steps:
    steps = np.diff(np.asarray(values))
    known = np.isfinite(steps)
    if not known.all():
        steps = steps[known]
    if not len(steps):
        return _Steps(0.0, 0.0, 0.0, 0.0, 0.0)
    forward = float(np.count_nonzero(steps > 0.0)) / len(steps)
    ahead = steps[:: 1 + len(steps) // MOST_STEPS]
    ahead = ahead[ahead > 0.0]
    step = float(np.median(ahead)) if len(ahead) else 0.0
    low, high = np.percentile(ahead, (10.0, 90.0)) if len(ahead) else (0.0, 0.0)
    return _Steps(
        forward=forward,
        known=len(steps) / max(1, len(values) - 1),
        step=step,
        scatter=float(high - low) / step if step else 0.0,
        start=float(values[0]),
    )


def _unit(signal: Signal, steps: _Steps) -> tuple[str, float, str]:
    """Unit of a time, given or inferred; confidence in it, and the reason."""
    given = spelled(signal.unit) or spelled(_unit_of_name(signal))
    if given and fits(given, "s"):
        step = steps.step * factor(given, "s")
        if USUAL_STEP_S[0] <= step <= USUAL_STEP_S[1]:
            return given, 1.0, f"its unit is given as {given}"
        return (
            given,
            0.5,
            f"its unit is given as {given}, but that means one sample every {step:.3g} s",
        )
    unit, confidence, why = _inferred_unit(steps)
    return unit, confidence, f"unit not given: {why}"


def _inferred_unit(steps: _Steps) -> tuple[str, float, str]:
    for beyond, unit in EPOCHS:
        step = steps.step * factor(unit, "s")
        if steps.start >= beyond and USUAL_STEP_S[0] <= step <= USUAL_STEP_S[1]:
            return unit, 0.97, f"{steps.start:.4g} is taken as {unit} since 1970"
    if DAYS[0] < steps.start < DAYS[1] and steps.step < 1e-3:
        return "day", 0.9, f"{steps.start:.6g} in steps of {steps.step:.2g} is taken as days"
    for at_least, unit in STEPS:
        if steps.step > at_least:
            return unit, 0.85, f"steps of {steps.step:.4g} are taken as {unit}"
    confidence = 0.95 if steps.step < 0.5 else 0.6
    return "s", confidence, f"steps of {steps.step:.4g} are taken as s"


def _unit_of_name(signal: Signal) -> str:
    return next((match.unit for match in name_matches(signal.name) if match.key == "t"), "")
