"""Compiled assessment of a sample: buffer, predict, score, p-value; for streams and batches."""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import brief, in_chunks, inlined, jit
from core.kernels.lanes import WIDTH, add, address, fma, load, pick, read, splat, write
from core.kernels.nearest import Tree, locate, nearest_at, squared_distance_at
from core.kernels.p_value import Transduction, p_value_of
from core.types import Array, Flags, Indices

OK, WARMING_UP, STALE, INVALID = range(4)
SAMPLES_A_TASK = 8_192


class Affine(NamedTuple):
    """A fitted predictor: z = o @ matrix + offset.

    matrix: (n_channels * (n_delay + 1), d).   offset: (d,).
    """

    matrix: Array
    offset: Array

    def in_units(self, scale: Array) -> "Affine":
        """The same map for observations not yet divided by `scale`."""
        return Affine(np.ascontiguousarray(self.matrix / scale[:, None]), self.offset)

    def in_lanes(self) -> "Affine":
        """The same map padded with zero columns to whole SIMD lanes."""
        missing = -len(self.offset) % WIDTH
        return Affine(
            np.pad(self.matrix, ((0, 0), (0, missing))), np.pad(self.offset, (0, missing))
        )


@inlined
def map_observation(fitted, y, i, n_delay, z):
    """Map observation o_i of y (n, n_channels) into z (d,); row 0 stands for earlier ones."""
    map_rows(
        address(fitted.matrix),
        address(fitted.offset),
        address(y),
        address(z),
        z.shape[0],
        np.int64(i),  # a literal compiles `map_rows` again
        n_delay,
        np.int64(1),
        y.shape[1],
    )


@jit
def map_rows(matrix, offset, y, z, d, i, n_delay, spacing, n_channels):
    """Map n_delay + 1 rows of y, `spacing` apart, newest last. Arrays by address."""
    for block in range(0, d, WIDTH):
        width = (d + WIDTH - 1) // WIDTH * WIDTH
        even, odd = load(offset, block), splat(0.0)  # two sums halve the latency
        for row in range(n_delay + 1):
            at = row * n_channels * width + block
            sample = max(i - (n_delay - row) * spacing, 0) * n_channels
            for c in range(0, n_channels - 1, 2):
                left, right = splat(read(y, sample + c)), splat(read(y, sample + c + 1))
                even = fma(load(matrix, at + c * width), left, even)
                odd = fma(load(matrix, at + (c + 1) * width), right, odd)
            if n_channels % 2:
                left = splat(read(y, sample + n_channels - 1))
                even = fma(load(matrix, at + (n_channels - 1) * width), left, even)
        point = add(even, odd)
        for j in range(min(WIDTH, d - block)):
            write(z, block + j, pick(point, j))


@jit
def _map_some(affine, y, where, n_delay, start, stop, z):
    for i in range(start, stop):
        map_observation(affine, y[where[i, 0]], where[i, 1], n_delay, z[i])


def map_samples(affine: Affine, y: Array, where: Indices, n_delay: int) -> Array:
    """Mapped points of chosen samples, bit for bit like a flight through them.

    y: (n, n_samples, n_channels).   where: (m, 2) trajectory and sample.   Returns (m, d).
    """
    z = np.empty((len(where), len(affine.offset)))
    lanes = affine.in_lanes()
    in_chunks(
        len(where),
        SAMPLES_A_TASK,
        lambda a, b: _map_some(lanes, y, where, n_delay, a, b, z),
    )
    return z


class Fitted(NamedTuple):
    """Arrays for scoring one observation.

    matrix: (6 * (n_delay + 1), width), offset: (width,) the predictor's map from unscaled
    observations to the first `d` columns; see `in_lanes`.
    Score: unsafe_weight * min_u |z - y_u|^2 - safe_weight * min_s |z - y_s|^2, or -|z_channel| if
    `channel` is not negative.
    alphas: (n_unsafe,) sorted.
    """

    matrix: Array
    offset: Array
    d: int
    unsafe: Tree
    safe: Tree
    unsafe_weight: float
    safe_weight: float
    channel: int
    alphas: Array


@inlined
def rule_of(fitted):
    """Rule for `score_point`."""
    return fitted.unsafe_weight, fitted.safe_weight, fitted.channel


@inlined
def score_point(rule, unsafe_at, safe_at, z, skip, near_unsafe, near_safe):
    """Score of a mapped point, and its neighbours. Low means close to a failure.

    rule: (unsafe_weight, safe_weight, channel).   unsafe_at, safe_at: see `locate`.
    """
    if rule[2] >= 0:
        return -abs(z[rule[2]]), -1, -1
    unsafe, safe = 0.0, 0.0
    if rule[0] > 0.0:
        distance, near_unsafe = nearest_at(unsafe_at, z, skip, near_unsafe)
        unsafe = rule[0] * distance
    if rule[1] > 0.0:
        distance, near_safe = nearest_at(safe_at, z, -1, near_safe)
        safe = rule[1] * distance
    return unsafe - safe, near_unsafe, near_safe


@jit
def _follow(first, step, finite, dt, count, drift, n_delay):
    """State of a sample `step` seconds after the previous one, length of its history, and drift.

    drift: sum of the deviations of the steps from dt, recent ones weighted most [s]. Above half an
    interval, the source does not sample at the monitor's rate.
    """
    full = n_delay + 1
    if first:
        return (OK, full, 0.0) if finite else (INVALID, 0, 0.0)
    if step == 0.0:
        return STALE, count, drift
    if not (finite and step > 0.5 * dt):
        return INVALID, 0, 0.0
    if step >= 1.5 * dt:
        count, drift = 1, 0.0
    else:
        count, drift = min(count + 1, full), 0.8 * drift + step - dt
    if abs(drift) > 0.5 * dt:
        return INVALID, 0, 0.0
    return (OK if count == full else WARMING_UP), count, drift


@jit
def states(t, y, dt, n_delay):
    """State code of each sample. The first sample fills the whole history."""
    codes = np.empty(t.shape[0], np.int64)
    count, drift = np.int64(0), 0.0
    for i in range(t.shape[0]):
        finite = np.isfinite(t[i])
        for c in range(y.shape[1]):
            finite &= np.isfinite(y[i, c])
        step = t[i] - t[i - 1]
        codes[i], count, drift = _follow(i == 0, step, finite, dt, count, drift, n_delay)
    return codes


@brief
def update(fitted, exact, buffer, status, clock, dt, t, y, z):
    """Assess the next sample of a stream.

    buffer: (n_delay + 1, 6).   status: (4,) history length, sample count, last neighbours.
    clock: (5,) last time, lowest score so far, distances to the neighbours, drift.
    z: (d,) output, the mapped point.
    Returns (state code, p-value, score); both NaN unless the state is OK.
    """
    finite = np.isfinite(t)
    for c in range(y.shape[0]):
        finite &= np.isfinite(y[c])
    first = status[1] == 0
    newest = buffer.shape[0] - 1
    code, status[0], clock[4] = _follow(
        first, t - clock[0], finite, dt, status[0], clock[4], newest
    )
    if code == STALE:
        return code, np.nan, np.nan
    status[1] += 1
    clock[0] = t
    if code == INVALID:
        return code, np.nan, np.nan
    for row in range(newest):
        buffer[row] = y if first else buffer[row + 1]
    buffer[newest] = y
    if code != OK:
        return code, np.nan, np.nan
    map_observation(fitted, buffer, newest, newest, z)
    rule, unsafe, safe = rule_of(fitted), locate(fitted.unsafe), locate(fitted.safe)
    s, status[2], status[3] = score_point(rule, unsafe, safe, z, -1, status[2], status[3])
    clock[1] = min(clock[1], s)
    if status[2] >= 0:
        clock[2] = np.sqrt(squared_distance_at(unsafe, z, status[2]))
    if status[3] >= 0:
        clock[3] = np.sqrt(squared_distance_at(safe, z, status[3]))
    return code, p_value_of(fitted, exact, z, s, clock[1]), s


@jit
def _score_some(fitted, y, ok, n_delay, start, stop, z, s, unsafe, safe):
    near_unsafe, near_safe = -1, -1
    rule, unsafe_at, safe_at = rule_of(fitted), locate(fitted.unsafe), locate(fitted.safe)
    point = np.empty(fitted.d)
    for i in range(start, stop):
        if ok[i]:
            map_observation(fitted, y, i, n_delay, point)
            s[i], near_unsafe, near_safe = score_point(
                rule, unsafe_at, safe_at, point, -1, near_unsafe, near_safe
            )
            for k in range(point.shape[0]):
                z[i, k] = point[k]
            unsafe[i], safe[i] = near_unsafe, near_safe


@jit
def _p_some(fitted, exact, ok, start, stop, z, s, lowest, p):
    for i in range(start, stop):
        if ok[i]:
            p[i] = p_value_of(fitted, exact, z[i], s[i], lowest[i])


def score_all(
    fitted: Fitted, exact: Transduction, y: Array, ok: Flags, n_delay: int
) -> tuple[Array, Array, Array, Indices, Indices]:
    """Mapped points, scores, p-values and neighbours of one trajectory; NaN and -1 unless ok.

    y: (n, 6).   ok: (n,) whether the sample has a full history.
    """
    n = len(y)
    z = np.full((n, fitted.d), np.nan)
    s = np.full(n, np.nan)
    unsafe, safe = np.full(n, -1), np.full(n, -1)
    in_chunks(
        n,
        SAMPLES_A_TASK,
        lambda a, b: _score_some(fitted, y, ok, n_delay, a, b, z, s, unsafe, safe),
    )
    p, lowest = np.full(n, np.nan), np.fmin.accumulate(s)
    in_chunks(n, SAMPLES_A_TASK, lambda a, b: _p_some(fitted, exact, ok, a, b, z, s, lowest, p))
    return z, s, p, unsafe, safe


@jit
def _distances_some(fitted, z, left_out, start, stop, unsafe, safe):
    near_unsafe, near_safe = -1, -1
    unsafe_at, safe_at = locate(fitted.unsafe), locate(fitted.safe)
    for i in range(start, stop):
        point = z[i]
        distance, near_unsafe = nearest_at(unsafe_at, point, left_out[i], near_unsafe)
        unsafe[i] = fitted.unsafe_weight * distance
        distance, near_safe = nearest_at(safe_at, point, -1, near_safe)
        safe[i] = fitted.safe_weight * distance


def weighted_distances(fitted: Fitted, z: Array, left_out: Indices) -> tuple[Array, Array]:
    """Weighted squared distances to the nearest unsafe and the nearest safe point.

    z: (n, d).   left_out: (n,) unsafe point to leave out.   Returns (n,), (n,).
    """
    unsafe, safe = np.empty(len(z)), np.empty(len(z))
    in_chunks(
        len(z),
        SAMPLES_A_TASK,
        lambda a, b: _distances_some(fitted, z, left_out, a, b, unsafe, safe),
    )
    return unsafe, safe
