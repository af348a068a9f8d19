"""The motion of the aircraft in a recording: smoothed channels, derivatives and regressions.

It shows signs and units: rates against the attitude, accelerations against the surfaces. One window
and its derivative filter both channels and rates, so equations between them stay exact while sensor
noise averages out.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt
from weakref import WeakKeyDictionary

import numpy as np

from app.telemetry.mapping.derivations import values_at
from app.telemetry.mapping.magnitudes import extent_of
from app.telemetry.recording import Trace, Traces
from core.clearance.equation_error import (
    CORRELATED_S,
    WIDTH_S,
    EquationError,
    Estimate,
    SmoothedSignal,
    smoothing_window,
)
from core.clearance.sensors import NAMES, SensorCheck, SensorReadings, check_sensors
from core.types import Array, Indices

STEP = 0.05
"""Step of the common grid for channels of different rates [s]."""
SLOWEST = 0.25
"""Longest step that still shows accelerations [s]."""
LONG = 400.0
"""In longer recordings only the windows with most motion are used [s]."""
WINDOW = 40.0
LEADERS = ("delta_r", "delta_a", "r", "p")
"""These channels place the windows, where they move most."""
N_EACH = 2
LATERAL = ("beta", "p", "r", "Ny", "Ay", "delta_a", "delta_r", "phi", "theta", "psi")
ANGLE_OF = {"p": "phi", "r": "psi"}
"""The angle whose derivative a rate is."""
FULL_TURNS = {"phi": 2.0 * pi, "psi": 2.0 * pi}
SEGMENT_ROWS = 400
"""Rows of a segment in which a surface may show its sign: 20 s."""
FEWEST = 60
"""Fewest rows for a regression: 3 s."""


@dataclass(frozen=True)
class PartialEffect:
    """Effect of one cause on a response, beside all other causes.

    slope: response per cause.   share: explained part of what the others leave, 0 to 1.
    free: independent rows beyond the unknowns; the smoothing makes neighbours alike.
    """

    slope: float
    share: float
    free: float

    @property
    def size(self) -> float:
        """Magnitude of the slope, without its bias by noise in the cause."""
        return abs(self.slope) / sqrt(self.share)

    @property
    def sigmas(self) -> float:
        """The slope in multiples of its standard error."""
        return sqrt(max(self.free, 0.0) * self.share / max(1.0 - self.share, 1e-12))


@dataclass(frozen=True, eq=False)
class Motion:
    """values, rates: channel -> (n,) smoothed, and its derivative [1/s]; NaN if unknown.

    window: (n,) number of the window of each row.
    """

    values: dict[str, Array]
    rates: dict[str, Array]
    window: Indices

    def segments(self) -> Iterator[Indices]:
        """Rows of each part of SEGMENT_ROWS, within a window."""
        for number in np.unique(self.window):
            rows = np.flatnonzero(self.window == number)
            yield from (rows[k : k + SEGMENT_ROWS] for k in range(0, len(rows), SEGMENT_ROWS))

    def part(self, rows: Indices) -> "Motion":
        return Motion(
            {key: values[rows] for key, values in self.values.items()},
            {key: rates[rows] for key, rates in self.rates.items()},
            self.window[rows],
        )

    def spread(self, key: str) -> float:
        """Standard deviation of a channel about its mean in each window; 0 if absent."""
        if key not in self.values:
            return 0.0
        (values,) = self._centred([self.values[key]])
        return float(values.std()) if len(values) else 0.0

    def effect(self, response: str | Array, cause: str, *others: str) -> PartialEffect | None:
        """Effect of one cause on a response, by least squares on it and on other causes.

        All are relative to their means in each window. None if there are too few rows or the cause
        is unknown or does not move. A response is a channel or its values, "gravity" is a cause.
        """
        known = self.values | ({"gravity": self.gravity} if "phi" in self.values else {})
        causes = {key: known[key] for key in (cause, *others) if key in known}
        if cause not in causes or (isinstance(response, str) and response not in known):
            return None
        return self._regressed(known[response] if isinstance(response, str) else response, causes)

    def rate_effect(self, key: str) -> PartialEffect | None:
        if key not in self.values or ANGLE_OF[key] not in self.values:
            return None
        return self._regressed(self.values[key], {key: self.rates[ANGLE_OF[key]]})

    def _regressed(self, response: Array, causes: dict[str, Array]) -> PartialEffect | None:
        """Effect of the first of the causes."""
        y, *columns = self._centred([response, *causes.values()])
        scales = [float(column.std()) if len(column) else 0.0 for column in columns]
        moving = [k for k, scale in enumerate(scales) if scale > 1e-9]
        if len(y) < FEWEST or 0 not in moving:
            return None
        x = np.column_stack([columns[k] / scales[k] for k in moving])
        gram = x.T @ x
        if not np.isfinite(gram).all():
            return None
        inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
        slopes = inverse @ (x.T @ y)
        residual = y - x @ slopes
        explained = slopes[0] ** 2 / inverse[0, 0] if inverse[0, 0] > 0.0 else 0.0
        total = explained + float(residual @ residual)
        share = float(explained / total) if total > 0.0 else 0.0
        free = len(y) * STEP / WIDTH_S - len(moving)
        return PartialEffect(float(slopes[0] / scales[0]), share, free)

    def _centred(self, columns: list[Array]) -> list[Array]:
        known = np.isfinite(columns).all(axis=0)
        window = self.window[known]
        counts = np.bincount(window)
        centred = []
        for column in columns:
            means = np.bincount(window, column[known]) / np.maximum(counts, 1)
            centred.append(column[known] - means[window])
        return centred

    @cached_property
    def gravity(self) -> Array:
        """Gravity part sin(phi) cos(theta) of a lateral acceleration [g]; NaN without phi."""
        phi = self.values.get("phi", np.full(len(self.window), np.nan))
        theta = self.values.get("theta", np.zeros(1))
        return np.sin(phi) * np.cos(theta)


def motion(traces: Traces, turns: Mapping[str, float] = FULL_TURNS) -> Motion | None:
    """The motion; None if the sample rate is too low.

    turns: key -> full turn of an angle that may jump, in the unit of the trace.
    """
    channels = {key: traces.channels[key] for key in LATERAL if key in traces.channels}
    leader = next((channels[key] for key in ("r", "p", *LEADERS) if key in channels), None)
    if leader is None:
        return None
    smooth, slope = smoothing_window(STEP)
    parts: list[dict[str, Array]] = []
    rates: list[dict[str, Array]] = []
    for start, end in windows_of_motion(channels, leader):
        grid = np.arange(start, end, STEP)
        if len(grid) < len(smooth) + FEWEST:
            continue
        rows = {key: on_even_times(grid, trace, turns.get(key)) for key, trace in channels.items()}
        parts.append({key: np.convolve(x, smooth, "valid") for key, x in rows.items()})
        rates.append({key: np.convolve(x, slope, "valid") for key, x in rows.items()})
    if not parts:
        return None
    first = next(iter(channels))
    return Motion(
        {key: np.concatenate([part[key] for part in parts]) for key in channels},
        {key: np.concatenate([part[key] for part in rates]) for key in channels},
        np.repeat(np.arange(len(parts)), [len(part[first]) for part in parts]),
    )


def windows_of_motion(channels: Mapping[str, Trace], leader: Trace) -> list[tuple[float, float]]:
    """Intervals with motion [s]; a short recording is one interval."""
    known = leader.t[np.isfinite(leader.t)]
    if len(known) < 2 or not known[-1] > known[0]:
        return []
    if known[-1] - known[0] <= LONG:
        return [(float(known[0]), float(known[-1]))]
    starts = []
    for key in LEADERS:
        if key not in channels:
            continue
        t, extent = channels[key].t, extent_of(channels[key].values)
        variation = np.nan_to_num(extent.high - extent.low)
        rows = np.linspace(0, extent.n, len(variation), endpoint=False).astype(np.intp)
        for tile in np.argsort(-variation, kind="stable")[:N_EACH]:
            if np.isfinite(t[rows[tile]]):
                starts.append(float(t[rows[tile]]) - 0.5 * WINDOW)
    return _apart(sorted(starts))


def _apart(starts: list[float]) -> list[tuple[float, float]]:
    """Windows, merged where they touch."""
    merged: list[tuple[float, float]] = []
    for start in starts:
        if merged and start <= merged[-1][1]:
            merged[-1] = merged[-1][0], start + WINDOW
        else:
            merged.append((start, start + WINDOW))
    return merged


def on_even_times(grid: Array, trace: Trace, turn: float | None) -> Array:
    """Samples interpolated onto a grid; NaN in gaps and if the rate is too low."""
    t = trace.t
    if len(grid) * STEP < t[-1] - t[0]:
        first, last = np.searchsorted(t, (grid[0] - SLOWEST, grid[-1] + SLOWEST))
        t, values = t[first:last], trace.values[first:last]
    else:
        values = trace.values
    known = np.isfinite(values) & np.isfinite(t)
    t, values = t[known], values[known]
    if len(t) < 2 or float(np.median(np.diff(t))) > SLOWEST:
        return np.full(len(grid), np.nan)
    if turn is not None:
        values = np.unwrap(values, period=turn)
    return values_at(grid, t, values)


CAUSES = ("r", "Ny", "phi", "p")
BALANCED = 0.5
"""Least share of beta-dot that the causes must explain."""
LARGEST = 1e9
"""Larger numbers are not a motion in any unit."""


def sideslip_balance(moves: Motion) -> dict[str, Estimate]:
    """beta-dot per cause, in level flight; {} if unexplained or if a channel is missing.

    The fit allows for a delay of beta. Without it the delay of a vane would look like side force.
    """
    if not {"beta", "r", "Ny", "phi"} <= moves.values.keys():
        return {}
    rates = moves.rates["beta"]
    causes = [key for key in CAUSES if key in moves.values]
    for values in (rates, *(moves.values[key] for key in causes)):
        if np.fmax.reduce(np.abs(values), initial=0.0) > LARGEST:
            return {}
    apart = np.flatnonzero(np.diff(moves.window)) + 1  # separate the windows

    def parted(values: Array) -> Array:
        return np.insert(values, apart, np.nan)

    x = tuple(SmoothedSignal(parted(moves.values[key]), 0.0) for key in causes)
    fit = EquationError.fit(parted(rates), x, STEP)
    if fit is None or fit.share < BALANCED or not fit.delay_is_inside:
        return {}
    return {key: fit.coefficient(k) for k, key in enumerate(causes)}


RATES = ("p", "r")
"""Not compared where they were derived from the attitude."""

_COMPARED: WeakKeyDictionary[Traces, tuple[SensorCheck, ...]] = WeakKeyDictionary()
"""Results for recordings still in memory. They do not depend on the monitor."""


def compatibility(traces: Traces) -> tuple[SensorCheck, ...]:
    """Compare the sensors of a recording, once; in a long one, where it moves most.

    traces: repaired.
    """
    if (checks := _COMPARED.get(traces)) is None:
        checks = _COMPARED[traces] = _compared(traces)
    return checks


def _compared(traces: Traces) -> tuple[SensorCheck, ...]:
    channels = {
        key: trace
        for key in NAMES
        if (trace := traces.channels.get(key)) is not None
        and np.isfinite(trace.values).any()
        and not (key in RATES and trace.derived)
    }
    leader = next((channels[key] for key in LEADERS if key in channels), None)
    apart = np.full(round(CORRELATED_S / STEP), np.nan)
    rows: dict[str, list[Array]] = {key: [apart] for key in channels}
    for start, end in windows_of_motion(channels, leader) if leader else ():
        grid = np.arange(start, end, STEP)
        for key, trace in channels.items():
            rows[key] += [on_even_times(grid, trace, FULL_TURNS.get(key)), apart]
    joined = {key: np.concatenate(parts) for key, parts in rows.items()}
    return check_sensors(SensorReadings(STEP, joined))
