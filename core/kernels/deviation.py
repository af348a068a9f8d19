"""How far a flight deviates from what its monitor learned, sample by sample.

Two measures, each kept at its largest so far: how far the outputs are off their forecasts, and the
distance from the safe observations. A stream, a recording and a calibration share it.

Forecasts are those of the responses one step ahead, from past outputs and the surfaces as measured:
their innovations, whitened across the channels, over half a second. Monitors of older files compare
each output with the monitor's own forecast, h samples ahead.
"""

from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.assessing import INVALID, OK, STALE, states
from core.kernels.compiled import in_chunks, jit
from core.kernels.innovation import N_RESPONSES, Innovation, innovate, root_mean_square
from core.kernels.lanes import WIDTH, address
from core.kernels.mapping import map_observation
from core.kernels.nearest import Tree, locate, nearest_at, squared_distance_at
from core.types import Array, Indices

DISTANCE, INNOVATION = N_CHANNELS, N_CHANNELS + 1
"""Where distance and innovation lie behind the residuals of the channels."""
SIZE, AT, WHEN = range(3)
SAMPLES, FRESH, RUN, COMPARED, PLACED, NEAR = range(6)
FLIGHTS_A_TASK = 32


class Reference(NamedTuple):
    """What a monitor learned, as far as a deviation is measured from it.

    matrix, offset: of the predictor, in lanes.   safe: tree of the safe points.
    scale: (6,) of the channels.   sigma: (6,) of the residuals h samples ahead, in the channels'
    units; NaN where they are not tested.
    d: entries of a point.   h: lead in samples.   dt: [s].
    has_residuals: whether a point is a forecast of the outputs h samples ahead, which is tested.
    innovation: of the responses; without a window where it is not tested.
    """

    matrix: Array
    offset: Array
    safe: Tree
    scale: Array
    sigma: Array
    d: int
    h: int
    n_delay: int
    dt: float
    has_residuals: bool
    innovation: Innovation

    @property
    def has_forecasts(self) -> bool:
        """Whether outputs are compared with any forecast."""
        return self.has_residuals or self.innovation.window > 0


class Deviation(NamedTuple):
    """The farthest that a flight has deviated so far.

    peaks: (3, 8) largest residual of each channel [sigma], largest distance [scaled units], largest
        innovation over a window [sigma]; the number, and the time [s], of the sample that made
        each, -1 and NaN for none.
    counts: (6,) samples; those not stale; assessed ones in an unbroken row; those compared with
        their forecast; those whose distance was taken; the nearest safe point last looked up.
    clock: (2,) times of the first and of the last sample [s].
    points: (h, d) of the last h samples.
    innovations: (window, 8) of the last samples, in any order.
    responses: (4,) root mean square innovation of each response over the window of the largest.
    """

    peaks: Array
    counts: Indices
    clock: Array
    points: Array
    innovations: Array
    responses: Array

    @property
    def largest(self) -> Array:
        """(2,) largest residual or innovation [sigma], largest distance [scaled units]."""
        off = max(self.peaks[SIZE, :DISTANCE].max(), self.peaks[SIZE, INNOVATION])
        return np.array([off, self.peaks[SIZE, DISTANCE]])

    def n_due(self, dt: float) -> int:
        """Samples that there would be without a gap."""
        elapsed = (self.clock[1] - self.clock[0]) / dt
        counted = int(self.counts[FRESH])
        return max(counted, round(elapsed) + 1) if np.isfinite(elapsed) else counted


def n_before(reference: Reference) -> int:
    """Samples before the newest one that are looked at."""
    return max(reference.n_delay, reference.innovation.history)


@jit
def begin(reference):
    """Deviation of a flight before its first sample."""
    peaks = np.zeros((3, INNOVATION + 1))
    peaks[AT], peaks[WHEN] = -1.0, np.nan
    counts = np.array([0, 0, 0, 0, 0, -1])
    return Deviation(
        peaks,
        counts,
        np.full(2, np.nan),
        np.empty((reference.h, reference.d)),
        np.empty((reference.innovation.window, WIDTH)),
        np.zeros(N_RESPONSES),
    )


@jit
def follow(reference, so_far, t, y, row, codes, near, distance, largest):
    """Take samples of a flight, one after the other.

    y: (m, 6) those not stale, beginning with y[row], their history in the rows before.
    t, codes, near: (n,) all of them, near -1 where the nearest safe point is not known.
    distance: from that point, if it is known already; else NaN.   largest: (n, 2) out.
    """
    # Taken apart and written out: by calls, and through the tuples, it takes five times as long.
    peaks, counts, clock, points, innovations, responses = so_far
    scale, sigma, h, dt = reference.scale, reference.sigma, reference.h, reference.dt
    n_past, spacing = reference.innovation.n_past, reference.innovation.spacing
    matrix, offset = address(reference.innovation.matrix), address(reference.innovation.offset)
    window, last, samples = reference.innovation.window, address(innovations), address(y)
    safe_at, z = locate(reference.safe), np.empty(reference.d)
    for i in range(codes.shape[0]):
        if codes[i] != STALE:
            if counts[FRESH] == 0:
                clock[0] = t[i]
            follows = not t[i] - clock[1] >= 1.5 * dt
            clock[1] = t[i]
            slot = counts[FRESH] % h
            counts[FRESH] += 1
            if codes[i] == OK:
                counts[RUN] = counts[RUN] + 1 if follows else 1
                n = counts[RUN] - n_past * spacing
                if window > 0 and n > 0:
                    counts[COMPARED] += 1
                    innovate(matrix, offset, samples, row, n_past, spacing, last, (n - 1) % window)
                    n = min(n, window)
                    off = root_mean_square(last, n, window, np.int64(0), np.int64(N_RESPONSES))
                    if off > peaks[SIZE, INNOVATION]:
                        peaks[SIZE, INNOVATION] = off
                        peaks[AT, INNOVATION], peaks[WHEN, INNOVATION] = counts[SAMPLES], t[i]
                        for c in range(N_RESPONSES):
                            own = N_RESPONSES + c
                            responses[c] = root_mean_square(last, n, window, own, own + 1)
                if reference.has_residuals and counts[RUN] > h:
                    # This slot's point is of h samples ago; each one since was assessed in turn.
                    counts[COMPARED] += 1
                    for c in range(N_CHANNELS):
                        off = abs(y[row, c] - points[slot, c] * scale[c]) / sigma[c]
                        if not off <= peaks[SIZE, c]:
                            peaks[SIZE, c] = off if off == off else np.inf
                            peaks[AT, c], peaks[WHEN, c] = counts[SAMPLES], t[i]
                map_observation(reference, y, row, reference.n_delay, z)
                for k in range(z.shape[0]):
                    points[slot, k] = z[k]
                far = distance
                if np.isnan(far):
                    if near[i] >= 0:
                        far = np.sqrt(squared_distance_at(safe_at, z, near[i]))
                    else:
                        # Only the largest counts, and the last neighbour bounds this one.
                        last_near = counts[NEAR]
                        if last_near >= 0:
                            far = np.sqrt(squared_distance_at(safe_at, z, last_near))
                        if not far <= peaks[SIZE, DISTANCE]:
                            squared, counts[NEAR] = nearest_at(safe_at, z, -1, last_near)
                            far = np.sqrt(squared)
                counts[PLACED] += 1
                if not far <= peaks[SIZE, DISTANCE]:
                    peaks[SIZE, DISTANCE] = far if far == far else np.inf
                    peaks[AT, DISTANCE], peaks[WHEN, DISTANCE] = counts[SAMPLES], t[i]
            else:
                counts[RUN] = 0
            row += 1
        counts[SAMPLES] += 1
        largest[i, 0], largest[i, 1] = peaks[SIZE, INNOVATION], peaks[SIZE, DISTANCE]
        for c in range(N_CHANNELS):
            largest[i, 0] = max(largest[i, 0], peaks[SIZE, c])


@jit
def take(reference, so_far, history, y, t, code, distance):
    """Take the next sample of a stream. Returns the largest off a forecast and distance so far.

    history: (n, 6) that this keeps, `n_before` samples and the newest.   code: its state.
    distance: from the nearest safe point; NaN where it is not known.
    """
    newest = history.shape[0] - 1
    if code != STALE and code != INVALID:
        for row in range(newest):
            history[row] = y if so_far.counts[FRESH] == 0 else history[row + 1]
        history[newest] = y
    largest, near = np.empty((1, 2)), np.array([-1])
    follow(
        reference,
        so_far,
        np.array([t]),
        history,
        newest,
        np.array([code]),
        near,
        distance,
        largest,
    )
    return largest[0, 0], largest[0, 1]


@jit
def _farthest_some(reference, t, y, last, start, stop, farthest):
    unknown, largest = np.full(t.shape[0], -1), np.empty((t.shape[0], 2))
    for i in range(start, stop):
        n = last[i] + 1
        codes = states(t[:n], y[i, :n], reference.dt, reference.n_delay)
        follow(
            reference, begin(reference), t[:n], y[i], np.int64(0), codes, unknown, np.nan, largest
        )
        farthest[i] = largest[n - 1]


def farthest(reference: Reference, y: Array, last: Indices) -> Array:
    """Largest off a forecast and distance of each trajectory over its samples 0..last.

    y: (n, n_samples, 6).   last: (n,) 0 or more.   Returns (n, 2).
    """
    farthest_of = np.empty((len(y), 2))
    t = np.arange(y.shape[1]) * reference.dt
    y = np.ascontiguousarray(y, np.float64)
    in_chunks(
        len(y),
        FLIGHTS_A_TASK,
        lambda a, b: _farthest_some(reference, t, y, last, a, b, farthest_of),
    )
    return farthest_of


@jit
def _first_beyond_some(reference, t, y, last, bounds, start, stop, first):
    unknown, largest = np.full(t.shape[0], -1), np.empty((t.shape[0], 2))
    for i in range(start, stop):
        n = last[i] + 1
        codes = states(t[:n], y[i, :n], reference.dt, reference.n_delay)
        follow(
            reference, begin(reference), t[:n], y[i], np.int64(0), codes, unknown, np.nan, largest
        )
        for k in range(n):
            if largest[k, 0] > bounds[0] or largest[k, 1] > bounds[1]:
                first[i] = k
                break


def first_beyond(reference: Reference, y: Array, last: Indices, bounds: Array) -> Indices:
    """First sample of each trajectory, of 0..last, by which it deviates more than the bounds allow.

    y: (n, n_samples, 6).   last: (n,) 0 or more.   bounds: (2,) of both.
    Returns (n,); n_samples where there is none.
    """
    first = np.full(len(y), y.shape[1])
    t = np.arange(y.shape[1]) * reference.dt
    y = np.ascontiguousarray(y, np.float64)
    in_chunks(
        len(y),
        FLIGHTS_A_TASK,
        lambda a, b: _first_beyond_some(reference, t, y, last, bounds, a, b, first),
    )
    return first
