"""The closed loop of aircraft, actuators and control law, and its exact discretisation by
zero-order hold, for eight rollouts at a time.

State z = (plant states, delta_a, delta_r, law states), n numbers; z_dot = F z + bandwidth pilot,
with the pilot on the rows of the surfaces. Measured: (beta, p, r, Ny, delta_a, delta_r, phi) = rows
(x, delta); the surface rows of C and D are not read. control_law.closed_loops is the same in numpy.
A matrix of lanes is flat: entry (i, j) is the eight numbers from 8 (i columns + j).

The discretisation is scaling and squaring with a Taylor polynomial of degree 16 in blocks of four
powers (Paterson and Stockmeyer 1973). The scale of each lane comes from the norms of M and M^4
(after Al-Mohy and Higham 2009). A lane that needs fewer squarings keeps its result, so its bits do
not depend on its neighbours.
"""

from functools import cache
from math import factorial
from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import (
    UNROLLED,
    WIDTH,
    add,
    fma,
    load,
    magnitude,
    multiply,
    multiply_column,
    multiply_column_pair,
    read,
    read_integer,
    splat,
    store,
    total,
    where_greater,
    write,
)
from core.types import Array

PHI = 3  # plant state of the bank angle, for laws that feed it back
N_FEEDBACK = 7


@jit
def clear(w, at, vectors):
    for i in range(vectors):
        store(w, at + i * WIDTH, splat(0.0))


@jit
def gather(source, rows, which, w, at, columns):
    """Copy the first rows of eight matrices into lanes, `columns` per row; 0 times their sum."""
    for lane in range(WIDTH):
        rollout = read_integer(which, lane)
        for i in range(rows):
            for j in range(source.shape[2]):
                write(w, at + (i * columns + j) * WIDTH + lane, source[rollout, i, j])
    check = splat(0.0)
    for i in range(rows):
        for j in range(source.shape[2]):
            check = fma(splat(0.0), load(w, at + (i * columns + j) * WIDTH), check)
    return total(check)


@jit
def close_loop(plants, law, bandwidth, which, w, loop, rows):
    """Write F (n, n) to w[loop:], measured rows (7, nx + 2) to w[rows:]. False if not finite.

    plants, law: see Plants and Controller.   which: address of the eight rollout indices.
    """
    a, b, c, d = plants
    law_a, law_b, law_c, law_d = law
    nx = a.shape[1]
    m = law_a.shape[0]
    ny = nx + 2
    n = ny + m
    clear(w, loop, n * n)
    clear(w, rows, N_FEEDBACK * ny)
    check = gather(a, nx, which, w, loop, n) + gather(b, nx, which, w, loop + nx * WIDTH, n)
    outputs = np.int64(4)
    check += gather(c, outputs, which, w, rows, ny)
    check += gather(d, outputs, which, w, rows + nx * WIDTH, ny)
    one = splat(1.0)
    store(w, rows + (4 * ny + nx) * WIDTH, one)
    store(w, rows + (5 * ny + nx + 1) * WIDTH, one)
    if nx > PHI:
        store(w, rows + (6 * ny + PHI) * WIDTH, one)
    for i in range(2 + m):  # delta rows, then controller rows
        row = loop + (nx + i) * n * WIDTH
        for o in range(N_FEEDBACK):
            gain = -bandwidth * law_d[i, o] if i < 2 else law_b[i - 2, o]
            if gain != 0.0:
                for j in range(ny):
                    at = row + j * WIDTH
                    measured = load(w, rows + (o * ny + j) * WIDTH)
                    store(w, at, fma(splat(gain), measured, load(w, at)))
        for j in range(m):
            gain = -bandwidth * law_c[i, j] if i < 2 else law_a[i - 2, j]
            store(w, row + (ny + j) * WIDTH, splat(gain))
        if i < 2:
            at = row + (nx + i) * WIDTH
            store(w, at, fma(splat(-bandwidth), one, load(w, at)))
    return check == 0.0


DEGREE = 16
MAX_SCALE = 40
_TRUNCATION = (
    factorial(DEGREE + 1) * 2.0**-53
)  # |M^17| below this: the remainder is below half an ulp
_LARGEST_NORM = 3.0  # of the scaled matrix: keeps the polynomial's rounding within e^3 ulp
HELD, FADING, GUST = 0, 1, 2
"""Kinds of inputs: a held command, the fading rest of earlier ones, the rate of a gust."""
KINDS = 3
_EXP = np.array([0.0] + [1.0 / factorial(k) for k in range(1, DEGREE + 1)])  # exp(M) - I


@jit
def scratch(n):
    """Workspace of `discretise` at `loop`: F, five more matrices, and twenty vectors."""
    return (6 * n * n + DEGREE + 4) * WIDTH


@cache
def input_series(step: float, lag_s: float) -> tuple[Array, Array]:
    """Coefficients d of h sum_j d_j (F h)^j B, the effect of inputs 1 and exp(-t / lag) in a step.

    Row s is for the step h = step / 2^s. Returns d (2, MAX_SCALE + 1, DEGREE + 1) with
    d_j = phi_{j+1}(-h / lag), 1/(j+1)! for the constant input, and exp(-h / lag) (MAX_SCALE + 1,).
    lag_s = 0: no lag, the second input is zero.
    """
    halves = step * 0.5 ** np.arange(MAX_SCALE + 1)
    order = np.arange(1, DEGREE + 2)
    factorials = np.array([float(factorial(k)) for k in order])
    held = np.tile(1.0 / factorials, (MAX_SCALE + 1, 1))
    if lag_s == 0.0:
        return np.stack([held, np.zeros_like(held)]), np.zeros(MAX_SCALE + 1)
    from scipy.special import hyp1f1  # slow to import, and only needed here

    fading = hyp1f1(1, order + 1, -halves[:, None] / lag_s) / factorials
    return np.stack([held, fading]), np.exp(-halves / lag_s)


@jit
def product(w, left, right, start, out, n, columns):
    """out = start + left right: left (n, n), the others (n, columns), at these positions of `w`."""
    stride = columns * WIDTH
    if n > UNROLLED:
        for j in range(0, stride, WIDTH):
            for i in range(n):
                v = load(w, start + i * stride + j)
                for k in range(n):
                    v = fma(load(w, left + (i * n + k) * WIDTH), load(w, right + k * stride + j), v)
                store(w, out + i * stride + j, v)
        return
    for j in range(0, stride - WIDTH, 2 * WIDTH):
        multiply_column_pair(w, left, right + j, start + j, out + j, n, columns)
    if columns % 2 == 1:
        j = stride - WIDTH
        multiply_column(w, left, right + j, start + j, out + j, n, columns)


@jit
def _norm(w, matrix, n):
    """Largest row sum of magnitudes, per lane."""
    largest = splat(0.0)
    for i in range(n):
        row = splat(0.0)
        for j in range(n):
            row = add(row, magnitude(load(w, matrix + (i * n + j) * WIDTH)))
        largest = where_greater(row, largest, row, largest)
    return largest


@jit
def _halvings(w, norm, norm4, scale):
    """Write the number of halvings of each lane's step; returns the largest."""
    most = 0
    for lane in range(WIDTH):
        n1 = read(w, norm + lane)
        n4 = read(w, norm4 + lane)
        s = 0
        while s <= MAX_SCALE and (n1 > _LARGEST_NORM or n4 * n4 * n4 * n4 * n1 > _TRUNCATION):
            s += 1
            n1 *= 0.5
            n4 *= 0.0625
        write(w, scale + lane, float(s))
        most = max(most, s)
    return most


@jit
def _block(w, powers, coefficients, first, last, n, out):
    """out = sum of c_k M^k, k = 0..last, c = coefficients[first:], with M to M^4 at `powers`."""
    size = n * n * WIDTH
    c1 = splat(coefficients[first + 1])
    c2 = splat(coefficients[first + 2])
    c3 = splat(coefficients[first + 3])
    for at in range(0, size, WIDTH):
        v = multiply(c1, load(w, powers + at))
        v = fma(c2, load(w, powers + size + at), v)
        v = fma(c3, load(w, powers + 2 * size + at), v)
        if last == 4:
            v = fma(splat(coefficients[first + 4]), load(w, powers + 3 * size + at), v)
        store(w, out + at, v)
    c0 = splat(coefficients[first])
    for i in range(n):
        at = out + (i * n + i) * WIDTH
        store(w, at, add(c0, load(w, at)))


@jit
def _column_block(w, powers, series, first, last, n, surface, out):
    """Columns `surface` and `surface` + 1 of `_block`, with coefficients per lane."""
    size = n * n * WIDTH
    for i in range(n):
        for j in range(2):
            v = load(w, series + first * WIDTH) if i == surface + j else splat(0.0)
            at = powers + (i * n + surface + j) * WIDTH
            for k in range(last):
                v = fma(load(w, series + (first + k + 1) * WIDTH), load(w, at + k * size), v)
            store(w, out + (i * 2 + j) * WIDTH, v)


class _HoldPlaces(NamedTuple):
    """Positions in the workspace of `discretise`: four powers of M, sums, lane vectors."""

    size: int
    narrow: int
    powers: int
    p2: int
    p3: int
    p4: int
    start: int
    total: int
    scale: int
    decay: int
    half_step: int
    coefficients: int


@jit
def _places(loop, n):
    size = n * n * WIDTH
    scale = loop + 6 * size
    return _HoldPlaces(
        size, 2 * n * WIDTH, loop, loop + size, loop + 2 * size, loop + 3 * size, loop + 4 * size,
        loop + 5 * size, scale, scale + WIDTH, scale + 2 * WIDTH, scale + 3 * WIDTH,
    )  # fmt: skip


@jit
def _scale_down(w, at, n, step, decays):
    """Powers M to M^4 of the halved M = F h. Returns the largest number of halvings, -1: too many.

    Writes the halvings, the lag's decay in the halved step, and the share of the step, per lane.
    """
    h = splat(step)
    for i in range(at.powers, at.powers + at.size, WIDTH):
        store(w, i, multiply(h, load(w, i)))
    clear(w, at.start, n * n)
    product(w, at.powers, at.powers, at.start, at.p2, n, n)
    product(w, at.p2, at.p2, at.start, at.p4, n, n)
    store(w, at.decay, _norm(w, at.powers, n))
    store(w, at.half_step, _norm(w, at.p4, n))
    most = _halvings(w, at.decay, at.half_step, at.scale)
    if most > MAX_SCALE:
        return -1
    product(w, at.p2, at.powers, at.start, at.p3, n, n)
    for lane in range(WIDTH):
        s = int(read(w, at.scale + lane))
        write(w, at.decay + lane, decays[s])
        write(w, at.half_step + lane, 0.5**s)
    if most > 0:
        half = load(w, at.half_step)
        factor = half
        for k in range(4):
            for i in range(at.powers + k * at.size, at.powers + (k + 1) * at.size, WIDTH):
                store(w, i, multiply(factor, load(w, i)))
            factor = multiply(factor, half)
    return most


@jit
def _exponential(w, at, n, phi):
    """exp(M) - I by Horner's rule in M^4; adding I would cost slow modes their digits."""
    _block(w, at.powers, _EXP, np.int64(12), np.int64(4), n, at.total)
    _block(w, at.powers, _EXP, np.int64(8), np.int64(3), n, at.start)
    product(w, at.p4, at.total, at.start, phi, n, n)
    _block(w, at.powers, _EXP, np.int64(4), np.int64(3), n, at.start)
    product(w, at.p4, phi, at.start, at.total, n, n)
    _block(w, at.powers, _EXP, np.int64(0), np.int64(3), n, at.start)
    product(w, at.p4, at.total, at.start, phi, n, n)


@jit
def _input_effect(w, at, n, surface, factor, series, out):
    """Effect (n, 2) of inputs on two rows over the halved step, by the same rule."""
    two_columns = np.int64(2)
    for lane in range(WIDTH):
        s = int(read(w, at.scale + lane))
        for k in range(DEGREE + 1):
            write(w, at.coefficients + k * WIDTH + lane, series[s, k])
    _column_block(w, at.powers, at.coefficients, np.int64(12), np.int64(4), n, surface, at.total)
    _column_block(w, at.powers, at.coefficients, np.int64(8), np.int64(3), n, surface, at.start)
    product(w, at.p4, at.total, at.start, out, n, two_columns)
    _column_block(w, at.powers, at.coefficients, np.int64(4), np.int64(3), n, surface, at.start)
    product(w, at.p4, out, at.start, at.total, n, two_columns)
    _column_block(w, at.powers, at.coefficients, np.int64(0), np.int64(3), n, surface, at.start)
    product(w, at.p4, at.total, at.start, out, n, two_columns)
    gain = multiply(splat(factor), load(w, at.half_step))
    for i in range(out, out + at.narrow, WIDTH):
        store(w, i, multiply(gain, load(w, i)))


@jit
def _take_doubled(w, at, level, out, length):
    """Copy the doubled matrix at `total` in lanes with more than `level` halvings."""
    active, now = load(w, at.scale), splat(float(level))
    for i in range(0, length, WIDTH):
        store(w, out + i, where_greater(active, now, load(w, at.total + i), load(w, out + i)))


@jit
def _double(w, at, n, level, is_given, phi, inputs):
    """From h to 2 h: E <- E E + 2 E, G <- E G + (1 + e(h)) G."""
    two_columns = np.int64(2)
    two = splat(2.0)
    for kind in range(KINDS):
        if not is_given[kind]:
            continue
        out = inputs + kind * at.narrow
        factor = add(load(w, at.decay), splat(1.0)) if kind == FADING else two
        for i in range(0, at.narrow, WIDTH):
            store(w, at.start + i, multiply(factor, load(w, out + i)))
        product(w, phi, out, at.start, at.total, n, two_columns)
        _take_doubled(w, at, level, out, at.narrow)
    rate = load(w, at.decay)
    active, now = load(w, at.scale), splat(float(level))
    store(w, at.decay, where_greater(active, now, multiply(rate, rate), rate))
    for i in range(0, at.size, WIDTH):
        store(w, at.start + i, multiply(two, load(w, phi + i)))
    product(w, phi, phi, at.start, at.total, n, n)
    _take_doubled(w, at, level, phi, at.size)


@jit
def discretise(w, loop, n, surface, bandwidth, step, series, decays, gust_state, phi, inputs):
    """phi = exp(F step) and the effect of inputs over one step; False if a loop is too fast.

    w: workspace; F (n, n) at `loop`, the start of `scratch(n)` numbers, is overwritten.
    inputs: KINDS matrices (n, 2): integral of exp(F (step - t)) B e(t) dt. HELD: e = 1, B =
    bandwidth on the rows of the two surfaces. FADING: e = exp(-t / lag), the same B; not written
    without lag. GUST: e = 1, B = 1 on the row of gust_state (first column; the second is unused);
    not written if that is negative.   series, decays: `input_series`.
    """
    at = _places(loop, n)
    most = _scale_down(w, at, n, step, decays)
    if most < 0:
        return False
    _exponential(w, at, n, phi)
    is_given = (True, decays[0] != 0.0, gust_state >= 0)
    for kind in range(KINDS):
        if is_given[kind]:
            row, gain = (gust_state, 1.0) if kind == GUST else (surface, bandwidth)
            out, own_series = inputs + kind * at.narrow, series[FADING if kind == FADING else HELD]
            _input_effect(w, at, n, row, gain * step, own_series, out)
    for level in range(most):
        _double(w, at, n, level, is_given, phi, inputs)
    for i in range(n):
        diagonal = phi + (i * n + i) * WIDTH
        store(w, diagonal, add(load(w, diagonal), splat(1.0)))
    return True
