"""Assesses a live source sample by sample; its journal gives the same assessments again."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from math import isfinite
from typing import Any, Literal, NamedTuple

import numpy as np

from app.assessment.batches import Batch, ChannelReader
from app.assessment.coverage import CoverageSoFar
from app.assessment.grid import (
    DELAY_INTERVALS,
    Angles,
    CausalGrid,
    Counts,
    IntegratedAngles,
    Sample,
)
from app.assessment.input_checks import Doubt, InputChecks, TrimCheck
from app.assessment.lag import Lag
from app.assessment.monitors_in_use import (
    MonitorRuling,
    MonitorsInUse,
    MonitorsRule,
    needs_beginning,
)
from app.assessment.planned_test import (
    input_of,
    known_test,
    needed_channels,
)
from app.assessment.rulings import ConditionHold, LimitsInForce, LimitsRule, Ruling
from app.assessment.trim import CausalTrim, of_earlier_rest
from app.telemetry.readers.journal import CALL
from core.channels import LATERAL
from core.conditions import Condition, ConditionKey
from core.flight_events import TrimChange
from core.limits.exceedance import NOT_PLAUSIBLE, Exceeded, exceeded_at
from core.limits.limits import Envelope
from core.monitor import Assessment, Monitor, State
from core.monitor.assessment import Cause, withdrawn
from core.monitor.monitor import Stream
from core.monitor.peak_forecast import Ahead
from core.monitor.status import FILLING, Level
from core.simulation.attitude import DisplayAttitude
from core.types import Array

TrimRule = Literal["detected", "none"]
P, R = LATERAL.index("p"), LATERAL.index("r")
NOT_FAR: Mapping[str, int] = {}
TIME_UNKNOWN = "time unknown: the source's clock jumped; dated by arrival"


class LiveAssessed(NamedTuple):
    """A sample on the monitor's grid, with its assessment.

    y: (n_channels,) from trim, as recorded where that is unknown.   judged: NaN there.
    recorded: the same including trim.   manoeuvre: 1, 2 ...; 0: none.   shown: arrival time at
    which it was settled [s].   display: assessments by the monitors for display.   ruling: limits
    in force or monitor in use; None for the monitor's own limits.   far: see TrimCheck.
    """

    y: Array
    judged: Array
    recorded: Array
    assessment: Assessment
    attitude: Angles
    manoeuvre: int
    shown: float
    display: tuple[Assessment, ...] = ()
    ruling: Ruling | None = None
    far: Mapping[str, int] = NOT_FAR

    def shown_attitude(self, display: DisplayAttitude | None) -> Angles:
        """As received; without bank or pitch all are integrated from the rates, given a display."""
        phi, theta, psi = self.attitude
        if display is None or (isfinite(phi) and isfinite(theta)):
            return phi, theta, psi
        rates = self.recorded.item(P), self.recorded.item(R)
        return IntegratedAngles(*display.update(self.assessment.t, *rates))


class ReceivedExceedance(NamedTuple):
    """A received sample beyond a limit, whatever the grid makes of it.

    t: flight time [s].   is_dated: False if the source's time is implausible; t is by arrival.
    y: (n_channels,) from trim, NaN where that is unknown.   recorded: the same including trim.
    limits: that it exceeds.   beyond: see Ruling.   is_plausible: False if `recorded` is a value
    that no aircraft can reach; y is then NaN there.   arrived: when it arrived, or would have
    without lag [s], on the clock of arrivals.
    """

    t: float
    is_dated: bool
    y: Array
    recorded: Array
    limits: Envelope
    beyond: str = ""
    is_plausible: bool = True
    arrived: float | None = None

    def exceeded(self, keys: Sequence[str]) -> Exceeded:
        """keys: of the channels."""
        exceeded = exceeded_at(self.t, keys, self.limits, self.y, self.recorded)
        assert exceeded is not None
        measured = exceeded.measured
        if not self.is_plausible:
            measured = replace(measured, doubt=NOT_PLAUSIBLE)
        return Exceeded(self.t, measured, self.arrived)

    def doubt_of(self, exceeded: Exceeded) -> str:
        """What is in doubt of its exceedance; empty for nothing."""
        unknown = "" if self.is_dated else TIME_UNKNOWN
        return "; ".join(filter(None, (unknown, self.beyond, exceeded.measured.doubt)))


class GridMonitor:
    """One monitor on the grid samples of a live source."""

    def __init__(self, monitor: Monitor, epsilon: float) -> None:
        self.monitor, self.epsilon = monitor, epsilon
        self.needed = needed_channels(monitor)
        self._needs_all = bool(self.needed.all())
        self._stream = self._new_stream()
        self._history: deque[Sample] = deque(maxlen=monitor.recipe.n_delay + 1)
        self._filling = self._unseen = ""

    def join(self, t: float, case: str, *, is_moving: bool) -> None:
        """Come into use at t [s], with no sample before it: the history fills first.

        is_moving: whether the input has begun. A monitor that forecasts the rest of a manoeuvre or
        checks its input from the beginning on is then not applicable until the next one.
        """
        unknown = np.full(len(self.monitor.dictionary), np.nan)
        self._stream.update(t - self.monitor.dt, unknown)
        self._filling = f"{FILLING}: its condition, {case}, holds since {t:.2f} s"
        self._unseen = needs_beginning(self.monitor, case, t) if is_moving else ""

    def restart(self, trim: Array) -> None:
        self._stream, self._filling, self._unseen = self._new_stream(), "", ""
        for sample in self._history:
            self._stream.update(sample.t, self._read(sample.y - trim))

    def assess(self, sample: Sample, y: Array) -> Assessment:
        """Assess a sample of a manoeuvre. y: (n_channels,) from trim, NaN where that is unknown."""
        self._history.append(sample)
        if self._unseen:
            return withdrawn(sample.t, self._unseen, Cause.NOT_APPLICABLE)
        return self._explained(self._stream.update(sample.t, self._read(y)), sample, y)

    def forecast_ahead(self) -> Ahead | None:
        return self._stream.forecast_ahead()

    def wait(self, sample: Sample, reason: str, cause: Cause) -> Assessment:
        """Assessment of a sample outside every manoeuvre. reason, cause: why there is none."""
        self._history.append(sample)
        if lost := self._lost(sample):
            reason, cause = lost
            return Assessment(sample.t, None, None, State.INVALID, reason, cause=cause)
        return Assessment(sample.t, None, None, State.WARMING_UP, reason, cause=cause)

    def _new_stream(self) -> Stream:
        """A stream without exemplars, which flights do not show."""
        return self.monitor.stream(self.epsilon, exemplars=False)

    def _read(self, y: Array) -> Array:
        """Input of the monitor: 0 for a missing channel that it does not need."""
        return y if self._needs_all else input_of(y, self.needed)

    def _explained(self, assessment: Assessment, sample: Sample, y: Array) -> Assessment:
        """Add to the reason which channels are missing or have no trim, or why all are."""
        if self._filling and assessment.state is State.WARMING_UP:
            return assessment._replace(reason=self._filling)
        if assessment.cause is not Cause.LOST:
            return assessment
        if lost := self._lost(sample):
            reason, cause = lost
            return assessment._replace(reason=reason, cause=cause)
        if without := self._missing(y, "has no trim", "have no trim"):
            limits = self.monitor.envelope
            is_limited = limits is not None and (np.isnan(y) & limits.limited).any()
            why = f"{without}: the aircraft moved before the manoeuvre"
            return withdrawn(sample.t, why, Cause.TRIM_UNKNOWN if is_limited else None)
        return assessment

    def _lost(self, sample: Sample) -> tuple[str, Cause] | None:
        """Why a sample cannot be assessed, in words and in one; None if it can."""
        if sample.reason:
            return sample.reason, Cause.LOST
        missing = self._missing(sample.y)
        return (missing, Cause.MISSING) if missing else None

    def _missing(self, y: Array, one: str = "is missing", several: str = "are missing") -> str:
        """Unknown channels that the monitor needs, in words; empty if there are none."""
        known = np.isfinite(y)
        if known.all():
            return ""
        wanted = zip(self.monitor.dictionary.keys, known, self.needed, strict=True)
        missing = [key for key, is_known, is_needed in wanted if is_needed and not is_known]
        return f"{' and '.join(missing)} {several if missing[1:] else one}" if missing else ""


class CausalScorer:
    """Assesses a live source: resampled, from trim, with validity.

    delay: longest wait of a sample for others [s]; DELAY_INTERVALS of the monitor if None.
    trim: `detected`: each manoeuvre is assessed by itself, from the trim before it; rest is not
    assessed. `none`: samples are already from trim, and all are assessed.
    display: further monitors with their epsilons, for the same samples and trim.
    monitors: a set, of which the one whose condition holds is used; `monitor` is its first one.
    ValueError unless 0 <= delay < lead of every monitor.
    """

    def __init__(
        self,
        monitor: Monitor,
        epsilon: float,
        delay: float | None = None,
        trim: TrimRule = "detected",
        display: Sequence[tuple[Monitor, float]] = (),
        monitors: MonitorsInUse | None = None,
    ) -> None:
        self.monitor, self.epsilon = monitor, epsilon
        self.delay = DELAY_INTERVALS * monitor.dt if delay is None else delay
        shortest = min(monitor.lead, *(shown.lead for shown, _ in display), np.inf)
        if not 0.0 <= self.delay < shortest:
            raise ValueError(
                f"delay {self.delay:g} s is subtracted from the lead of {shortest:g} s: give at "
                f"least 0 and less than {shortest:g} s"
            )
        self._grid = CausalGrid(monitor.dt, self.delay, len(monitor.dictionary))
        detected = trim == "detected"
        members = [monitor] if monitors is None else monitors.members
        self._trim = CausalTrim.of(*members) if detected else None
        planned = self._trim.planned if self._trim else known_test(monitor)
        about = monitor.training_max_abs, monitor.envelope, self._trim is not None
        self._checks = InputChecks(planned, *about)
        self._trim_check = TrimCheck(monitor.dictionary, monitor.envelope)
        self._rule: LimitsRule | MonitorsRule | None = None
        self.ruling: Ruling | None = None
        """of the newest sample; None for the monitor's own limits"""
        length = 0.0 if planned.duration is None else planned.duration - planned.trim_segment_s
        self._coverage = CoverageSoFar(monitor.dt, round(length / monitor.dt))
        self._conditions = ConditionHold()
        self._contradiction: tuple[Doubt, ...] = ()
        self._earlier_rest: tuple[Doubt, ...] = ()
        self._exceedances: list[ReceivedExceedance] = []
        self.lag = Lag(self.lead)
        self.zero = np.inf
        """arrival time less sample time of the fastest sample [s]"""
        self._authority = GridMonitor(monitor, epsilon)
        self._display = [GridMonitor(*shown) for shown in display]
        self.needed = self._needed([*members, *(shown for shown, _ in display)])
        """channels that at least one of the monitors needs"""
        self._used: int | None = None
        self._has_begun = self._has_moved = self._is_by_hand = False
        self._controls = list(planned.controls)
        if monitors is not None:
            self._departure = monitors.departure()
            self._rule = MonitorsRule(monitors)
            self.ruling = self._rule.at()

    @property
    def conditions(self) -> list[ConditionKey]:
        """Channels of the flight condition that the limits or the monitor in force depend on."""
        return [] if self._rule is None else self._rule.measured

    def condition_at(self, t: float) -> Condition:
        """The flight condition as sent, at t [s]."""
        return self._conditions.at(t)

    @property
    def lead(self) -> float:
        """Lead time of alerts [s]: the monitor's less the delay."""
        return self.monitor.lead - self.delay

    def _needed(self, monitors: Sequence[Monitor]) -> list[str]:
        needed = np.logical_or.reduce([needed_channels(monitor) for monitor in monitors])
        keys = self.monitor.dictionary.keys
        read = [key for key, is_needed in zip(keys, needed, strict=True) if is_needed]
        return [*self.monitor.dictionary.sources(read)]

    @property
    def counts(self) -> Counts:
        return self._grid.counts

    @property
    def n_accepted(self) -> int:
        """Received samples that were used."""
        return self._grid.n_accepted

    @property
    def interval(self) -> float:
        return self._grid.interval

    @property
    def deadline(self) -> float | None:
        """Arrival time at which `advance` settles a sample without further input; None: never."""
        return self._grid.deadline

    @property
    def manoeuvre(self) -> int:
        return self._trim.manoeuvre if self._trim else 0

    def forecast_ahead(self) -> Ahead | None:
        return self._authority.forecast_ahead()

    def put_in_force(self, in_force: LimitsInForce) -> Ruling:
        """Apply other limits to the samples settled from now on; return the current ruling."""
        monitors = self._authority, *self._display
        self._rule = LimitsRule(in_force, [grid.monitor.envelope for grid in monitors])
        self.ruling = self._rule.at(self._conditions.at(in_force.t))
        return self.ruling

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Why the newest received sample is no picture of the aircraft."""
        trim = self._earlier_rest or self._trim_check.doubts
        checks = self._checks.doubts, self._contradiction, trim
        return (*chain.from_iterable(checks), *self._coverage.doubts)

    @property
    def trims(self) -> list[TrimChange] | None:
        """Newest changes of the trim that is subtracted; None where samples are from trim."""
        return None if self._trim is None else list(self._trim_check.changes)

    def push(self, arrived: float, sample: Sample, source: str = "") -> list[LiveAssessed]:
        """Add a received sample; return the samples that it settles. source: its name."""
        if sample.condition is not None:
            self._conditions.note(sample.t, sample.condition)
        n_steps = self._grid.n_clock_steps
        settled = self._settled(self._grid.push(arrived, sample))
        t, is_dated = self._grid.pushed_at
        if is_dated:
            self.zero = min(self.zero, arrived - t)
        self._checks.push(arrived, t, sample.y, source, self.manoeuvre > 0)
        limits, beyond = self.monitor.envelope, ""
        if self._rule is not None:
            ruling = self._rule.ahead(self._conditions.ahead(sample.t))
            limits, beyond = ruling.limits, ruling.beyond
        if limits is not None:
            y = sample.y if self._trim is None else sample.y - self._trim.level
            due = self.lag.due(t, arrived) if is_dated else arrived
            if limits.exceeds(y) or (y is not sample.y and limits.exceeds(sample.y)):
                about = y, sample.y, limits, beyond, True, due
                self._exceedances.append(ReceivedExceedance(t, is_dated, *about))
            elif sample.sent is not None and limits.exceeds(sample.sent):
                about = y, sample.sent, limits, beyond, False, due
                self._exceedances.append(ReceivedExceedance(t, is_dated, *about))
        if self._grid.n_clock_steps > n_steps:
            self._checks.restart()
        return [*map(self._assess, settled)]

    def pop_exceedances(self) -> list[ReceivedExceedance]:
        """Samples beyond a limit that were received since the last call, in order of arrival."""
        exceedances, self._exceedances = self._exceedances, []
        return exceedances

    def advance(self, now: float) -> list[LiveAssessed]:
        """Return the samples settled at time `now` of the clock of arrivals."""
        return [*map(self._assess, self._settled(self._grid.advance(now)))]

    def _settled(self, samples: list[Sample]) -> list[Sample]:
        if samples:
            self.lag.note(samples[-1].shown, samples[-1].t)
        return samples

    def begin(self) -> bool:
        """Begin a manoeuvre with the next sample, by hand. Returns False during a manoeuvre."""
        if self._trim is None or not self._trim.begin():
            return False
        self._restart(self._trim.level)
        self._is_by_hand = True
        return True

    def _assess(self, sample: Sample) -> LiveAssessed:
        y = known = sample.y
        ruling = None
        if self._rule is not None:
            ruling = self.ruling = self._rule.at(self._conditions.at(sample.t))
            self._note_contradiction(sample.t, self._rule.contradiction)
            if self._trim is not None:
                self._trim.judge_by(ruling.limits)
        begins = self._trim is not None and self._trim.update(sample.y)
        if isinstance(ruling, MonitorRuling):
            self._use(ruling, sample, begins)
        if self._trim is not None:
            trim = self._trim.level
            if begins:
                self._restart(trim)
                self._note_earlier_rest(sample.t, trim, self._trim.rest)
            elif not self._trim.manoeuvre:
                self._earlier_rest = ()
            self._trim_check.note(sample.t, trim, by_hand=self._is_by_hand)
            self._is_by_hand = False
            known = sample.y - trim
            y = np.where(np.isnan(trim), sample.y, known)
        if self._trim is not None and not self._trim.manoeuvre:
            why = self._trim.waits
            assessment = self._authority.wait(sample, *why)
            display = tuple([shown.wait(sample, *why) for shown in self._display])
        else:
            assessment = self._authority.assess(sample, known)
            display = tuple([shown.assess(sample, known) for shown in self._display])
        if ruling is not None:
            assessment, display = ruling.apply(assessment, display)
        self._coverage.note(assessment, self.manoeuvre if self._trim else 1)
        about = assessment, sample.attitude, self.manoeuvre, sample.shown, display, ruling
        return LiveAssessed(y, known, sample.y, *about, self._trim_check.far)

    def _note_earlier_rest(self, t: float, trim: Array, rest: Array) -> None:
        """A manoeuvre begins."""
        key, why = of_earlier_rest(self._authority.monitor, trim, rest)
        about = "trim", Level.CAUTION, t, f"{why}: fly back to trim", (key,)
        self._earlier_rest = (Doubt(*about),) if key else ()

    def _note_contradiction(self, t: float, reason: str) -> None:
        if not reason:
            self._contradiction = ()
        elif not self._contradiction:
            about = "contradiction", Level.CAUTION, t, f"at {t:.2f} s {reason}"
            self._contradiction = (Doubt(*about),)

    def _use(self, ruling: MonitorRuling, sample: Sample, begins: bool) -> None:
        """Use the monitor of a ruling from this sample on, with an empty history.

        begins: whether a manoeuvre begins with it.
        """
        controls = sample.y[self._controls]
        self._has_moved |= not (np.abs(controls) <= self._departure).all()
        if ruling.used is not None and ruling.used != self._used:
            monitor = ruling.in_use.monitor(ruling.used)
            self._authority = GridMonitor(monitor, monitor.recipe.epsilon)
            is_at_rest = self._trim is not None and not self._trim.manoeuvre
            if self._has_begun and not begins and not is_at_rest:
                is_moving = self._trim is not None or self._has_moved
                self._authority.join(sample.t, ruling.case, is_moving=is_moving)
        self._used, self._has_begun = ruling.used, True

    def _restart(self, trim: Array) -> None:
        for monitor in (self._authority, *self._display):
            monitor.restart(trim)


def replay_line(
    line: dict[str, Any], scorer: CausalScorer, reader: ChannelReader
) -> list[LiveAssessed]:
    """Apply a line of a live flight's journal. Returns the samples that it settles."""
    if "b" in line:
        samples = reader.samples(Batch(line["s"], line["b"]))
        arrived, source = line["a"], line.get("v", "")
        return [settled for s in samples for settled in scorer.push(arrived, s, source)]
    if line.get("e") == CALL:
        return []
    settled = scorer.advance(line["a"])
    if line.get("e") == "manoeuvre":
        scorer.begin()
    if line.get("e") == "limits":
        scorer.put_in_force(LimitsInForce.from_plain(line["limits"]))
    return settled


def rescored(
    lines: Iterable[dict[str, Any]], scorer: CausalScorer, reader: ChannelReader
) -> Iterator[LiveAssessed]:
    """Each sample of a journal, assessed by a new scorer, as it was shown.

    Also those at the end of a journal without an `end` line: its server was killed.
    """
    is_ended = False
    for line in lines:
        yield from replay_line(line, scorer, reader)
        is_ended = line.get("e") == "end"
    if not is_ended:
        yield from scorer.advance(np.inf)
