"""Validity: whether a flight is within a monitor's training, one verdict per manoeuvre.

A flight like the simulated ones, safe or failing, is called invalid with a probability of at most
the level, over the whole manoeuvre and so at any moment, because its statistics only grow. A flight
longer than the training flights has more samples that may deviate, so its probability is higher.
A flight is also invalid if its input begins in another direction, or holds longer, than in almost
all fresh flights.

An invalid flight stays invalid to its end. Samples count up to the first that exceeds a limit, as
for the flights behind the bounds. The guarantee concerns the time before, so the verdict at that
moment is final: an aircraft is not called invalid for what it does outside its envelope.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.kernels.assessing import OK, STALE
from core.kernels.compiled import entry
from core.kernels.deviation import (
    AT,
    DISTANCE,
    INNOVATION,
    SAMPLES,
    SIZE,
    WHEN,
    Deviation,
    begin,
    follow,
    n_before,
)
from core.kernels.live_call import deviation_at, deviation_call
from core.monitor.assessment import Assessment, code_of
from core.monitor.validity.input_shape import WrongInput
from core.monitor.validity.reasons import outside_training, too_little
from core.monitor.validity.support import ValidityBasis
from core.types import Array, Indices


@dataclass(frozen=True)
class ValidityVerdict:
    """Whether a manoeuvre is within its monitor's training.

    valid: False if it deviates more than all but a share `level` of the safe, or of the failing,
    fresh flights; None if it cannot be judged: not calibrated, or less than half could be used.
    p_value: of both statistics, by Bonferroni's rule.   residual_p, distance_p: of each.
    residual: largest forecast error [sigma]: of the responses one step ahead, root mean square over
    half a second; in older files of one channel, the monitor's lead ahead.
    distance: largest [scaled units].
    sample, t, channel: largest deviation: sample number, time [s] and channel key; no channel if it
    is the distance.
    reasons: why `valid` is not True.
    None: not tested or not available.
    """

    valid: bool | None
    level: float | None = None
    p_value: float | None = None
    residual_p: float | None = None
    distance_p: float | None = None
    residual: float | None = None
    distance: float | None = None
    sample: int | None = None
    t: float | None = None
    channel: str | None = None
    reasons: tuple[str, ...] = ()


class Comparison(NamedTuple):
    """A manoeuvre compared with training, up to the last sample that counts.

    deviation: the final one.   largest: (n, 2) both statistics up to each sample.
    wrong: the first wrong input, if any.
    """

    basis: ValidityBasis
    deviation: Deviation
    largest: Array
    wrong: WrongInput | None

    @property
    def first_outside(self) -> int | None:
        """First sample at which a statistic exceeds its bound or the input is wrong, if any.

        It is the sample at which `RunningValidity` becomes invalid.
        """
        beyond = (self.largest > self.basis.support.bounds()).any(axis=1)
        first = [int(beyond.argmax())] if beyond.any() else []
        return min(first + ([] if self.wrong is None else [self.wrong.sample]), default=None)

    def verdict(self, y_hat: Array) -> ValidityVerdict:
        """y_hat: (n, n_channels) forecasts."""
        at = int(self.deviation.peaks[AT, DISTANCE])
        outlier = y_hat[at] if at >= 0 else None
        return _verdict(self.basis, self.deviation, outlier, self.wrong)


def compare(
    basis: ValidityBasis,
    t: Array,
    y: Array,
    state: Indices,
    near: Indices | None = None,
    end: int | None = None,
) -> Comparison:
    """Compare a whole manoeuvre with training.

    t: (n,) [s].   y: (n, n_channels).   state: (n,) codes, not withdrawn.
    near: (n,) nearest safe points, -1 or None if unknown.
    end: last sample that counts, the first that exceeds a limit if one does, because failing
    flights are calibrated up to there.
    Samples that were not assessed add nothing. A forecast is checked only if its sample and all
    samples it uses were assessed.
    """
    n = len(state) if end is None else end + 1
    codes, near = state[:n], np.full(n, -1) if near is None else near[:n]
    t, y = np.ascontiguousarray(t, np.float64)[:n], np.ascontiguousarray(y, np.float64)[:n]
    fresh = codes != STALE
    deviation, largest = begin(basis.reference), np.empty((n, 2))
    read = y if fresh.all() else y[fresh]
    follow(basis.reference, deviation, t, read, 0, codes, near, np.nan, largest)
    shape = basis.input_shape
    wrong = None if shape is None else shape.first_wrong(t, y, codes == OK)
    return Comparison(basis, deviation, largest, wrong)


def in_words(reasons: Sequence[str]) -> str:
    return "; ".join(reasons)


class RunningValidity:
    """Validity of a flight in progress, sample by sample; once invalid, it stays invalid."""

    def __init__(self, basis: ValidityBasis) -> None:
        self.basis = basis
        self._residual_bound, self._distance_bound = basis.support.bounds().tolist()
        self._history = np.zeros((n_before(basis.reference) + 1, len(basis.dictionary)))
        self._deviation: Deviation = begin(basis.reference)
        self._outlier: Array | None = None
        self._call = deviation_call(basis.reference, self._deviation, self._history)
        self._update = entry(deviation_at, *self._call, self._history[0], 0.0, 0, 0.0)
        self._peaks, self._counts = self._deviation.peaks, self._deviation.counts
        self._shape = basis.input_shape and basis.input_shape.start()
        self._wrong: WrongInput | None = None

    def update(self, y: Array, assessment: Assessment, distance: float = np.nan) -> bool:
        """Judge the next sample. Returns whether the flight is invalid, now or earlier.

        y: (n_channels,) float64, contiguous.   assessment: of it, not withdrawn.
        distance: from the nearest safe point; NaN if unknown or given in the assessment.
        """
        if assessment.nearest_safe is not None:
            distance = assessment.nearest_safe.distance
        code = code_of(assessment.state)
        residual, distance = self._update(*self._call, y, assessment.t, code, distance)
        if self._peaks.item(AT, DISTANCE) == self._counts.item(SAMPLES) - 1:
            self._outlier = assessment.y_hat
        if self._shape is not None and assessment.state == "ok":
            sample = self._counts.item(SAMPLES) - 1
            self._wrong = self._wrong or self._shape.update(sample, assessment.t, y)
        return (
            residual > self._residual_bound
            or distance > self._distance_bound
            or self._wrong is not None
        )

    @property
    def verdict(self) -> ValidityVerdict:
        """The verdict so far."""
        return _verdict(self.basis, self._deviation, self._outlier, self._wrong)


def _verdict(
    basis: ValidityBasis,
    deviation: Deviation,
    outlier: Array | None,
    wrong: WrongInput | None,
) -> ValidityVerdict:
    support = basis.support
    bounds, largest = support.bounds(), deviation.largest
    p = support.p_values(largest[None])
    residual_p, distance_p = (None if np.isnan(value) else float(value) for value in p[0])
    outside = outside_training(basis, deviation, bounds, outlier)
    combined = float(support.combined(p)[0])
    if wrong is not None:
        outside, combined = [wrong.words, *outside], min(combined, wrong.p_value)
    unseen = too_little(basis, deviation)
    sample, t, channel = wrong[:3] if wrong else _worst(basis, deviation, bounds)
    return ValidityVerdict(
        valid=False if outside else None if unseen else True,
        level=support.level,
        p_value=combined,
        residual_p=residual_p,
        distance_p=distance_p,
        residual=None if residual_p is None else float(largest[0]),
        distance=float(largest[1]),
        sample=sample,
        t=t,
        channel=channel,
        reasons=tuple(outside or unseen),
    )


def _worst(
    basis: ValidityBasis, deviation: Deviation, bounds: Array
) -> tuple[int | None, float | None, str | None]:
    """Sample, time [s] and channel that are closest to a bound, or farthest beyond it."""
    row, channel = _worst_row(basis, deviation, bounds)
    if deviation.peaks[AT, row] < 0:
        return None, None, None
    return int(deviation.peaks[AT, row]), float(deviation.peaks[WHEN, row]), channel


def _worst_row(basis: ValidityBasis, deviation: Deviation, bounds: Array) -> tuple[int, str | None]:
    """Row of peaks, and its channel."""
    with np.errstate(divide="ignore", invalid="ignore"):
        residual_share, distance_share = np.nan_to_num(deviation.largest / bounds)
    if distance_share >= residual_share:
        return DISTANCE, None
    if basis.reference.innovation.window:
        shares = deviation.responses / basis.reference.innovation.sigma
        return INNOVATION, basis.dictionary.keys[basis.responses[int(shares.argmax())]]
    worst = int(deviation.peaks[SIZE, :DISTANCE].argmax())
    return worst, basis.dictionary.keys[worst]
