"""How far a flight deviates from its monitor's training, sample by sample.

Two measures, each the largest so far: the forecast error of the outputs, and the distance from the
safe observations. Streams, recordings and calibration share this code.

The forecast is of the responses one step ahead, from past outputs and measured surfaces. Its
innovations are whitened across the channels and summed over half a second. Monitors in older files
instead compare each output with the monitor's forecast, h samples ahead.
"""

from typing import NamedTuple

import numpy as np

from core.kernels.assessing import INVALID, OK, STALE, map_observation, map_rows, states
from core.kernels.compiled import in_chunks, jit
from core.kernels.lanes import WIDTH, address, read
from core.kernels.nearest import Tree, locate, nearest_at, squared_distance_at
from core.types import Array, Indices

N_BYTES = 8
"""Size of a number."""
DISTANCE, INNOVATION = -2, -1
"""Columns of distance and innovation, after the residuals of the channels."""
SIZE, AT, WHEN = range(3)
SAMPLES, FRESH, RUN, COMPARED, PLACED, NEAR = range(6)
FLIGHTS_A_TASK = 32


class Innovation(NamedTuple):
    """The affine map from a sample and past outputs to its innovations.

    matrix: (n_channels * (n_past + 1), width) of outputs, oldest first.   offset: (width,), whole
    lanes.   The first results are the innovations whitened to unit covariance in training, one for
    each response, the next ones those of each response in its unit, the rest zeros.
    sigma: (n_responses,) their deviation in training.
    n_past: past outputs, `spacing` samples apart.   window: samples to sum over; 0 without a
    forecast.
    """

    matrix: Array
    offset: Array
    sigma: Array
    n_past: int
    spacing: int
    window: int

    @property
    def history(self) -> int:
        """Samples of history that a forecast needs."""
        return self.n_past * self.spacing


NO_INNOVATION = Innovation(
    np.zeros((0, WIDTH)), np.zeros(WIDTH), np.ones(WIDTH // 2), n_past=0, spacing=0, window=0
)


@jit
def innovate(matrix, offset, y, row, n_past, spacing, n_channels, last, width, slot):
    """Write the innovations of a sample to last[slot].

    row: of the sample in y (m, n_channels).   matrix, offset, y, last: addresses.
    """
    out = last + slot * width * N_BYTES
    map_rows(matrix, offset, y, out, width, row, n_past, spacing, n_channels)


@jit
def root_mean_square(last, width, n, window, first, stop):
    """Root mean square of innovations first..stop over a window; infinite for NaN.

    last: address of (window, width).   n: samples in it so far; missing ones count as zeros.
    """
    total = 0.0
    for k in range(n):
        for o in range(first, stop):
            value = read(last, k * width + o)
            total += value * value
    size = np.sqrt(total / ((stop - first) * window))
    return size if size == size else np.inf


class Reference(NamedTuple):
    """The part of a monitor's training from which deviations are measured.

    matrix, offset: of the predictor, in lanes.   safe: tree of the safe points.
    scale: (n_channels,).   sigma: (n_channels,) of the residuals h samples ahead, in the channels'
    units; NaN if not tested.
    d: entries of a point.   h: lead in samples.   dt: [s].
    has_residuals: whether a point is a forecast of the outputs h samples ahead, to be tested.
    innovation: of the responses; window 0 if not tested.
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
        """Whether any forecast is tested."""
        return self.has_residuals or self.innovation.window > 0


class Deviation(NamedTuple):
    """The largest deviation of a flight so far.

    peaks: (3, n_channels + 2) largest residual of each channel [sigma], largest distance [scaled
        units], largest innovation over a window [sigma]; number and time [s] of the sample of each,
        -1 and NaN for none.
    counts: (6,) samples; not stale; assessed without a break; compared with a forecast; with a
        distance; then the nearest safe point found last.
    clock: (2,) times of the first and last sample [s].
    points: (h, d) of the last h samples.
    innovations: (window, width) of the last samples, in any order.
    responses: (n_responses,) root mean square innovation of each response over the window of the
        largest.
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
        """Number of samples without gaps."""
        elapsed = (self.clock[1] - self.clock[0]) / dt
        counted = int(self.counts[FRESH])
        return max(counted, round(elapsed) + 1) if np.isfinite(elapsed) else counted


def n_before(reference: Reference) -> int:
    """Samples of history needed before the newest one."""
    return max(reference.n_delay, reference.innovation.history)


@jit
def begin(reference):
    """Deviation of a flight before its first sample."""
    peaks = np.zeros((3, reference.scale.shape[0] + 2))
    peaks[AT], peaks[WHEN] = -1.0, np.nan
    counts = np.array([0, 0, 0, 0, 0, -1])
    return Deviation(
        peaks,
        counts,
        np.full(2, np.nan),
        np.empty((reference.h, reference.d)),
        np.empty((reference.innovation.window, reference.innovation.offset.shape[0])),
        np.zeros(reference.innovation.sigma.shape[0]),
    )


@jit
def follow(reference, deviation, t, y, row, codes, near, distance, largest):
    """Process samples of a flight in order.

    y: (m, n_channels) those not stale, starting at y[row], with their history in the rows before.
    t, codes, near: (n,) all samples; near is -1 if the nearest safe point is unknown.
    distance: to that point if known, else NaN.   largest: (n, 2) output.
    """
    # Unpacked and inlined by hand: with calls and nested tuples it takes five times as long.
    peaks, counts, clock, points, innovations, responses = deviation
    scale, sigma, h, dt = reference.scale, reference.sigma, reference.h, reference.dt
    n_past, spacing = reference.innovation.n_past, reference.innovation.spacing
    matrix, offset = address(reference.innovation.matrix), address(reference.innovation.offset)
    window, last, samples = reference.innovation.window, address(innovations), address(y)
    n_channels, n_responses, width = scale.shape[0], responses.shape[0], innovations.shape[1]
    first = n_responses - n_responses  # a literal compiles the callee again
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
                    slot_of = (n - 1) % window
                    innovate(
                        matrix, offset, samples, row, n_past, spacing, n_channels, last, width,
                        slot_of,
                    )  # fmt: skip
                    n = min(n, window)
                    off = root_mean_square(last, width, n, window, first, n_responses)
                    if off > peaks[SIZE, INNOVATION]:
                        peaks[SIZE, INNOVATION] = off
                        peaks[AT, INNOVATION], peaks[WHEN, INNOVATION] = counts[SAMPLES], t[i]
                        for c in range(n_responses):
                            at = n_responses + c
                            responses[c] = root_mean_square(last, width, n, window, at, at + 1)
                if reference.has_residuals and counts[RUN] > h:
                    # The point in this slot is h samples old; all since were assessed.
                    counts[COMPARED] += 1
                    for c in range(n_channels):
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
                        # Only the largest counts, and the last neighbour gives a bound.
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
        for c in range(n_channels):
            largest[i, 0] = max(largest[i, 0], peaks[SIZE, c])


@jit
def update_deviation(reference, deviation, history, y, t, code, distance):
    """Process the next sample of a stream. Returns the largest forecast error and distance so far.

    history: (n, n_channels) kept here: `n_before` samples and the newest.
    code: state of the sample.   distance: to the nearest safe point; NaN if unknown.
    """
    newest = history.shape[0] - 1
    if code != STALE and code != INVALID:
        for row in range(newest):
            history[row] = y if deviation.counts[FRESH] == 0 else history[row + 1]
        history[newest] = y
    largest, near = np.empty((1, 2)), np.array([-1])
    follow(
        reference,
        deviation,
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
def _largest_some(reference, t, y, last, start, stop, largest):
    unknown = np.full(t.shape[0], -1)
    for i in range(start, stop):
        n = last[i] + 1
        codes = states(t[:n], y[i, :n], reference.dt, reference.n_delay)
        row, so_far = np.int64(0), largest[i, :n]
        follow(reference, begin(reference), t[:n], y[i], row, codes, unknown, np.nan, so_far)


def largest_so_far(reference: Reference, y: Array, last: Indices) -> Array:
    """Largest forecast error and distance of each trajectory up to each of its samples 0..last.

    y: (n, n_samples, n_channels).   last: (n,) 0 or more.
    Returns (n, n_samples, 2); 0 after `last`.
    """
    largest = np.zeros((*y.shape[:2], 2))
    t = np.arange(y.shape[1]) * reference.dt
    y = np.ascontiguousarray(y, np.float64)
    in_chunks(
        len(y), FLIGHTS_A_TASK, lambda a, b: _largest_some(reference, t, y, last, a, b, largest)
    )
    return largest
