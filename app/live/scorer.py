"""What a monitor says of a live source, sample by sample, and the same again from its record."""

from collections import deque
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from app.live.resampling import DELAY_INTERVALS, Angles, CausalResampler, Counts, Sample
from app.live.trim import CausalTrim
from app.scoring.planned_test import limits_of, needed_channels, planned_test
from core.channels import KEYS
from core.kernels import assessing
from core.monitor import Assessment, Monitor, State
from core.monitor.assessment import REASONS
from core.types import Array

TrimRule = Literal["detected", "none"]
NOT_FINITE = REASONS[assessing.INVALID]


class LiveAssessed(NamedTuple):
    """A sample on the monitor's grid and what is said of it.

    y: (6,) from trim.   recorded: (6,) trim included.   manoeuvre: 1, 2 ...; 0 for none.
    """

    y: Array
    recorded: Array
    assessment: Assessment
    attitude: Angles | None
    manoeuvre: int


class CausalScorer:
    """Assesses a live source through a monitor: resampled, from trim, with its validity.

    delay: most that a sample waits for others [s]; DELAY_INTERVALS of the monitor's if None.
    trim: `detected`: nothing is said at rest, each manoeuvre has the trim before it and is judged
    as a flight of its own; `none`: the samples are from trim as they come, and all are assessed.
    ValueError for a delay that is negative or not below the monitor's lead.
    """

    def __init__(
        self,
        monitor: Monitor,
        epsilon: float,
        delay: float | None = None,
        trim: TrimRule = "detected",
    ) -> None:
        self.monitor, self.epsilon = monitor, epsilon
        self.delay = DELAY_INTERVALS * monitor.dt if delay is None else delay
        if not 0.0 <= self.delay < monitor.lead:
            raise ValueError(
                f"a delay of {self.delay:g} s was given: it is subtracted from the lead of "
                f"{monitor.lead:g} s, so give 0 or more, and less than that"
            )
        self._resampler = CausalResampler(monitor.dt, self.delay)
        self._trim = CausalTrim(planned_test(monitor)) if trim == "detected" else None
        self._needed = needed_channels(monitor, limits_of(monitor))
        self._needs_all = bool(self._needed.all())
        self._stream = monitor.stream(epsilon)
        self._history: deque[Sample] = deque(maxlen=monitor.recipe.n_delay + 1)

    @property
    def lead(self) -> float:
        """How far ahead an alert is shown [s]: the monitor's lead less the delay."""
        return self.monitor.lead - self.delay

    @property
    def counts(self) -> Counts:
        """What came, by kind."""
        return self._resampler.counts

    @property
    def interval(self) -> float:
        """Interval at which the source has been sampling [s]."""
        return self._resampler.interval

    @property
    def deadline(self) -> float | None:
        """When `advance` has something to do although nothing came; None for never."""
        return self._resampler.deadline

    @property
    def manoeuvre(self) -> int:
        """1, 2, 3 ... of the manoeuvre under way; 0 for none."""
        return self._trim.manoeuvre if self._trim else 0

    def push(self, arrived: float, sample: Sample) -> list[LiveAssessed]:
        """Take a sample as it arrives; return what is settled by it."""
        return [*map(self._assess, self._resampler.push(arrived, sample))]

    def advance(self, now: float) -> list[LiveAssessed]:
        """Return what is settled at `now`, of the clock of arrivals."""
        return [*map(self._assess, self._resampler.advance(now))]

    def begin(self) -> bool:
        """A manoeuvre begins with the next sample: somebody says so. False if one is under way."""
        if self._trim is None or not self._trim.begin():
            return False
        self._restart(self._trim.level)
        return True

    def _assess(self, sample: Sample) -> LiveAssessed:
        y = sample.y
        if self._trim is not None:
            begins = self._trim.update(sample.y)
            trim = self._trim.level
            if begins:
                self._restart(trim)
            y = sample.y - trim
        self._history.append(sample)
        if self._trim is not None and not self._trim.manoeuvre:
            reason = sample.reason or self._trim.reason
            assessment = Assessment(sample.t, None, None, State.WARMING_UP, reason)
        else:
            assessment = self._explained(self._stream.update(sample.t, self._read(y)), sample)
        return LiveAssessed(y, sample.y, assessment, sample.attitude, self.manoeuvre)

    def _restart(self, trim: Array) -> None:
        """Judge what comes as a flight of its own, which has a history."""
        self._stream = self.monitor.stream(self.epsilon)
        for sample in self._history:
            self._stream.update(sample.t, self._read(sample.y - trim))

    def _read(self, y: Array) -> Array:
        """What the monitor is given: 0 for a channel that it can do without and that is missing."""
        return y if self._needs_all else np.where(self._needed | np.isfinite(y), y, 0.0)

    def _explained(self, assessment: Assessment, sample: Sample) -> Assessment:
        """Say which channels are missing, or why all are."""
        if assessment.reason != NOT_FINITE:
            return assessment
        missing = [
            key
            for key, value, needed in zip(KEYS, sample.y, self._needed, strict=True)
            if needed and not np.isfinite(value)
        ]
        if not missing:
            return assessment
        verb = "is" if len(missing) == 1 else "are"
        return replace(
            assessment, reason=sample.reason or f"{' and '.join(missing)} {verb} missing"
        )
