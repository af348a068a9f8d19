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
"""Less confidence is a guess; a rate from the format or a person replaces such a time."""
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


def find_time(columns: Columns, group: int) -> TimeProposal | None:
    """Find the time of a group: as the format declares it, else by name, else by its values.

    A signal whose steps fit its unit comes first; a declared rate comes before a doubtful signal.
    """
    contents = columns.contents
    of_group = contents.groups[group]
    members = [signal for signal in contents.signals if signal.group == group]
    if of_group.n_rows < 2:
        return None
    declared = _declared(columns, of_group.time) if of_group.time else None
    if declared and declared.confidence >= DOUBTED:
        return declared
    named = [(_time_certainty(signal, of_group.name), signal) for signal in members]
    named.sort(key=lambda pair: -pair[0])
    proposals = [
        _named(columns, signal, certainty) for certainty, signal in named if certainty >= TIME_NAME
    ]
    if declared or not any(proposals):
        # usually the first column is the time
        proposals += [_unnamed(columns, signal) for signal in members]
    proposals += [declared]
    best = max((time for time in proposals if time), key=lambda time: time.confidence, default=None)
    if of_group.rate and (best is None or best.confidence < DOUBTED):
        source = TimeSource(rate=of_group.rate, start=of_group.start)
        reason = f"the format declares a sample rate of {of_group.rate:g} Hz"
        return TimeProposal(source, RATE_CONFIDENCE, (reason,))
    return best


def _declared(columns: Columns, name: str) -> TimeProposal | None:
    """The signal that the format declares, with little confidence if its values conflict."""
    if no_clock(name, columns.values(name)):
        return None
    steps = _steps(columns.values(name))
    reasons, share = ["the format declares it as the time"], 0.99
    if not steps.run_forward:
        share *= BACKWARD
        reasons.append(f"only {steps.forward:.0%} of its steps go forward")
    return _proposed(columns.signal(name), steps, share, *reasons)


def _named(columns: Columns, signal: Signal, certainty: float) -> TimeProposal | None:
    """A signal whose name suggests a time, if it runs forward."""
    steps, share = _steps(columns.values(signal.name)), 1.0 - 0.4 * (1.0 - certainty)
    reason = f"the name {signal.name} suggests a time"
    return _proposed(signal, steps, share, reason) if steps.run_forward else None


def _unnamed(columns: Columns, signal: Signal) -> TimeProposal | None:
    """A signal that increases evenly, is not a channel by name and not a row number."""
    values = columns.values(signal.name)
    if len(values) < FEW or name_matches(signal.name):
        return None
    few = values[np.linspace(0, len(values) - 1, min(len(values), 64)).astype(np.intp)]
    if not (np.diff(few) > 0.0).all():
        return None
    steps = _steps(values)
    if not steps.run_forward or steps.scatter > EVEN:
        return None
    if steps.step == 1.0 and steps.scatter == 0.0 and steps.start in (0.0, 1.0):
        return None  # it counts rows
    reason = "no signal name suggests a time, and this signal increases in even steps"
    return _proposed(signal, steps, 0.5, reason)


def _proposed(signal: Signal, steps: _Steps, share: float, *reasons: str) -> TimeProposal:
    """share: of the confidence in its unit."""
    unit, confidence, why = _unit(signal, steps)
    return TimeProposal(TimeSource(signal.name, unit), share * confidence, (*reasons, why))


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
        unit = unit_of_time(signal, columns.values(signal.name))
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


def _steps(values: Array) -> _Steps:
    steps = np.diff(np.asarray(values))
    known = np.isfinite(steps)
    if not known.all():
        steps = steps[known]
    if not len(steps):
        return _Steps(0.0, 0.0, 0.0, 0.0, 0.0)
    ahead = steps[:: 1 + len(steps) // MOST_STEPS]
    ahead = ahead[ahead > 0.0]
    low, step, high = np.percentile(ahead, (10.0, 50.0, 90.0)) if len(ahead) else (0.0, 0.0, 0.0)
    return _Steps(
        forward=float(np.count_nonzero(steps > 0.0)) / len(steps),
        known=len(steps) / max(1, len(values) - 1),
        step=float(step),
        scatter=float((high - low) / step) if step else 0.0,
        start=float(values[0]),
    )


def unit_of_time(signal: Signal, values: Array) -> str:
    """Unit of a time, given or inferred from its steps.   values: (n,) as recorded."""
    return _unit(signal, _steps(values))[0]


def _unit(signal: Signal, steps: _Steps) -> tuple[str, float, str]:
    """Unit of a time, given or inferred; confidence in it, and the reason."""
    of_name = (match.unit for match in name_matches(signal.name) if match.key == "t")
    given = spelled(signal.unit) or spelled(next(of_name, ""))
    if given and fits(given, "s"):
        step, why = steps.step * factor(given, "s"), f"its unit is given as {given}"
        if _is_usual(step):
            return given, 1.0, why
        return given, 0.5, f"{why}, but that means one sample every {step:.3g} s"
    for beyond, unit in EPOCHS:
        if steps.start >= beyond and _is_usual(steps.step * factor(unit, "s")):
            why = f"unit not given: {steps.start:.4g} is taken as {unit} since 1970"
            return unit, 0.97, why
    unit, confidence = "s", 0.95 if steps.step < 0.5 else 0.6
    if DAYS[0] < steps.start < DAYS[1] and steps.step < 1e-3:
        unit, confidence = "day", 0.9
    elif larger := [unit for at_least, unit in STEPS if steps.step > at_least]:
        unit, confidence = larger[0], 0.85
    return unit, confidence, f"unit not given: steps of {steps.step:.4g} are taken as {unit}"


def _is_usual(step: float) -> bool:
    return USUAL_STEP_S[0] <= step <= USUAL_STEP_S[1]
