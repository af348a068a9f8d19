"""The manoeuvres of a flight and their trim, from the samples so far."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from app.assessment.planned_test import SURFACES, PlannedTest, limits_of, needed_channels
from core.channels import KEYS, N_CHANNELS
from core.kernels import causal_trim as kernel
from core.kernels.causal_trim import TrimRule, TrimState
from core.kernels.compiled import entry
from core.monitor import Monitor
from core.types import Array

MEASURED_S = 0.1
"""Interval of trim measurements at rest [s]."""
GUARD_S = 0.2
"""The newest part of the rest does not count for trim [s]: a departure may have begun."""
CALM_S = 2.0
"""A channel that moves within this time has no trim [s]: half a swing looks like rest."""
USUAL_S = 20.0
"""Memory of how far the surfaces usually move at rest [s]."""
AFTERWARDS = 3.0
"""[s] A manoeuvre of unknown length continues this long after its last input."""
RESTED = 1.5
"""[s] Rest after which a manoeuvre of unknown length is over."""
SHARE = 0.25
"""Share of the planned amplitude that makes an input, small enough for a build-up."""
BEGINNING = 0.5
"""Share of the input at which a surface departs."""
OTHER = 2.0
"""Times the planned input: size of an input on a surface that should not move."""
SMALLEST = np.radians(0.1)
"""[rad] Smaller motion is never an input."""
TRIM_SHARE = 0.25
"""Share of a channel's largest in training; a response that moves further is not in trim."""
RESTS = 0.005
"""[rad, rad/s, g] Smaller motion always counts as rest."""
MOVING = "the surfaces move: trim is measured as soon as they rest"
RESTING = "no manoeuvre is under way: it begins with the first movement of a surface"
"""These reasons are stored: a journal that is rescored must give the same."""


class FollowedManoeuvre(NamedTuple):
    """Samples begin to stop - 1.   trim: (6,) NaN where unknown."""

    begin: int
    stop: int
    trim: Array


class CausalTrim:
    """Phases of a flight: rest, in which trim is measured, and manoeuvres.

    A manoeuvre begins when a surface first departs from rest; trim is the mean of the rest before
    it. A response that moves keeps the trim of an earlier rest; without one its trim is unknown.

    moving: (6,) a channel that moves further within CALM_S has no trim.   sizes: (2,) inputs of the
    surfaces [rad]; those of the planned test unless given.
    """

    def __init__(
        self, planned: PlannedTest, moving: Array | None = None, sizes: Array | None = None
    ) -> None:
        self.planned, dt = planned, planned.dt
        n_trim = max(2, round(planned.trim_segment_s / dt))
        n_rest = n_trim + round(GUARD_S / dt)
        if sizes is None:
            amplitudes = planned.amplitudes
            sizes = np.where(amplitudes > 0.0, amplitudes, OTHER * amplitudes.max())
        threshold = np.maximum(BEGINNING * SHARE * sizes, SMALLEST)
        length = planned.duration
        most = 0 if length is None else max(1, round((length - planned.trim_segment_s) / dt))
        self._rule = TrimRule(
            np.array(SURFACES),
            threshold,
            np.full(N_CHANNELS, np.inf) if moving is None else moving,
            n_trim,
            max(1, round(MEASURED_S / dt)),
            most,
            round(AFTERWARDS / dt),
            round(USUAL_S / dt),
        )
        self._state = TrimState(
            np.zeros(kernel.N_COUNT, np.int64),
            np.full(N_CHANNELS, np.nan),
            threshold.copy(),
            np.zeros(len(SURFACES)),
            np.empty((n_rest, N_CHANNELS)),
            np.empty((n_rest + round(CALM_S / dt), N_CHANNELS)),
            np.empty((round(RESTED / dt), len(SURFACES))),
        )
        compiled = self._rule, self._state
        self._follow_one = entry(kernel.follow, *compiled, np.empty((1, N_CHANNELS)), 0)
        self._begin = entry(kernel.begin, *compiled)

    @classmethod
    def of(cls, monitor: Monitor, planned: PlannedTest) -> "CausalTrim":
        """With what counts as motion of the monitor's responses.

        The next larger power of two, so that other monitors of the same test measure the same trim.
        """
        moving = largest_at_rest(monitor.training_max_abs)
        moving = 2.0 ** np.ceil(np.log2(moving))
        moving[SURFACES,] = np.inf
        moving[~needed_channels(monitor, limits_of(monitor))] = np.inf
        return cls(planned, moving)

    @property
    def manoeuvre(self) -> int:
        """Number of the current one; 0 at rest."""
        return int(self._state.counts[kernel.MANOEUVRE])

    @property
    def level(self) -> Array:
        """The last trim (6,), NaN where unknown."""
        return self._state.trim.copy()

    @property
    def reason(self) -> str:
        """Why there is no manoeuvre."""
        if self._state.counts[kernel.HAS_TRIM]:
            unknown = [
                key
                for key, trim, moves in zip(
                    KEYS, self._state.trim, np.isfinite(self._rule.moving), strict=True
                )
                if np.isnan(trim) and moves
            ]
            return moved(unknown) if unknown else RESTING
        n_rest = len(self._state.rest)
        if self._state.counts[kernel.N_REST] >= n_rest:
            return MOVING
        needed = n_rest * self.planned.dt
        return f"trim is measured: it needs {needed:.3g} s of rest before the manoeuvre"

    def update(self, y: Array) -> bool:
        """Add a sample (6,). Returns whether a manoeuvre begins with it."""
        before = self.manoeuvre
        self._follow_one(self._rule, self._state, np.array([y]), 0)
        return self.manoeuvre not in (0, before)

    def follow(self, y: Array, begun: Sequence[int] = ()) -> list[FollowedManoeuvre]:
        """Add samples (n, 6) of a whole recording; return its manoeuvres.

        begun: samples with which one is begun by hand.
        """
        y, at = np.ascontiguousarray(y), 0
        edges = list[tuple[int, int, Array]]()
        for stop in (*begun, len(y)):
            while at < stop:
                before = self.manoeuvre
                at = kernel.follow(self._rule, self._state, y[:stop], at)
                if self.manoeuvre != before:
                    edges.append((at - 1, self.manoeuvre, self.level))
            if stop < len(y) and self.begin():
                edges.append((stop, self.manoeuvre, self.level))
        ends = [at for at, *_ in edges[1:]] + [len(y)]
        return [
            FollowedManoeuvre(begin, stop, trim)
            for (begin, number, trim), stop in zip(edges, ends, strict=False)
            if number
        ]

    def begin(self) -> bool:
        """Begin a manoeuvre with the current trim. Returns False during a manoeuvre."""
        return bool(self._begin(self._rule, self._state))


def largest_at_rest(usual: Array) -> Array:
    """Extent of each channel that still counts as rest. usual: its largest in training."""
    return np.maximum(TRIM_SHARE * usual, RESTS)


def moved(keys: list[str]) -> str:
    """Why a trim is unknown."""
    return f"the aircraft moves: the trim of {', '.join(keys)} is unknown until it rests"
