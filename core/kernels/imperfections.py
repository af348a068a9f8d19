"""Imperfections of real flights in kernels: gusts, inexact pilots, instruments.

Random numbers come from one stream per rollout, by position. A stream is an integer. Its words are
those of splitmix64 (Steele, Lea and Flood, OOPSLA 2014). Each half word becomes a normal number by
the inverse distribution: linear between tabulated quantiles, and in the tails Wichura's rational
function (AS 241, Appl. Stat. 37, 1988). Eight rollouts are computed side by side, each lane with
its own stream, so a rollout's numbers depend only on its seed and number.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import (
    WIDTH,
    add,
    add_whole,
    address,
    at_most,
    both,
    divide,
    exclusive_or,
    floor,
    gather_pairs,
    load,
    load_rows,
    load_whole,
    lowest_bit,
    magnitude,
    multiply,
    multiply_whole,
    pick_whole,
    read,
    read_integer,
    real,
    shift_right,
    splat,
    splat_whole,
    store,
    store_rows,
    subtract,
    where_greater,
    write,
    write_integer,
)
from core.types import Array, Flags

ERRORS, MOVES, SOFTNESS = np.int64(0), np.int64(1), np.int64(2)
LAGS, NOISE = np.int64(1), np.int64(2)
"""Streams of a pilot, and of instruments. Not literals, because `stream_of` would be compiled again
for each."""
CELLS = 2048
"""Cells of equal probability for a normal number; the outermost TAIL cells on each side are the
tails, which use the rational function."""
TAIL = 8
MOST_TAILS = 128
"""Normal numbers in the tails that are computed together."""
QUANTILES = np.load(Path(__file__).with_name("quantiles.npy"))
"""(CELLS + 1,) scipy.special.ndtri(arange(CELLS + 1) / CELLS), stored to avoid a 0.2 s import."""
_BEYOND = float(QUANTILES[-1 - TAIL])
QUANTILES[[0, -1]] = QUANTILES[[1, -2]] + np.array([-1.0, 1.0])  # finite placeholders in the tails
_NUMERATOR = np.array(
    [7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
     1.27045825245236838258, 3.64784832476320460504, 5.76949722146069140550,
     4.63033784615654529590, 1.42343711074968357734]
)  # fmt: skip
_DENOMINATOR = np.array(
    [1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
     1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940,
     2.05319162663775882187, 1.0]
)  # fmt: skip

_STEP = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31, _S32 = (np.uint64(shift) for shift in (11, 27, 30, 31, 32))
_ONE, _LOW = np.uint64(1), np.uint64(2**32 - 1)
_BITS, _SHARE = np.uint64(21), np.uint64(2**21 - 1)
"""The last bits of a half word give the position within the cell."""


@jit
def _mixed(word):
    """64 bits, each dependent on all 64 bits of `word`."""
    word = (word ^ (word >> _S30)) * _MIX_1
    word = (word ^ (word >> _S27)) * _MIX_2
    return word ^ (word >> _S31)


@jit
def _word(stream, position):
    return _mixed(np.uint64(stream) + np.uint64(position + 1) * _STEP)


@jit
def stream_of(stream, number):
    """Stream `number` derived from a stream or a seed (uint64)."""
    return _mixed(np.uint64(stream) ^ _word(stream, number))


@jit
def uniform(stream, position):
    """Uniform number in [0, 1) at a position of a stream."""
    return float(np.int64(_word(stream, position) >> _S11)) * 2.0**-53


@jit
def _mixed_lanes(word):
    """`_mixed` of eight words."""
    for shift, factor in ((_S30, _MIX_1), (_S27, _MIX_2)):
        word = exclusive_or(word, shift_right(word, splat_whole(shift)))
        word = multiply_whole(word, splat_whole(factor))
    return exclusive_or(word, shift_right(word, splat_whole(_S31)))


@jit
def _in_tail(half):
    p = (float(np.int64(half)) + 0.5) * 2.0**-32
    r = math.sqrt(-math.log(min(p, 1.0 - p))) - 1.6
    above, below = 0.0, 0.0
    for i in range(len(_NUMERATOR)):
        above = above * r + _NUMERATOR[i]
        below = below * r + _DENOMINATOR[i]
    return math.copysign(above / below, p - 0.5)


@jit
def _write_inner(quantiles, halves, normals, tails, n):
    """Write the normal numbers of eight half words, 0 to 2^32 - 1; of those in the tails write the
    half word, and its place to `tails`, after n others. Returns how many it holds now.
    """
    cell = shift_right(halves, splat_whole(_BITS))
    share = add(real(both(halves, splat_whole(_SHARE))), splat(0.5))
    low, high = gather_pairs(quantiles, cell)
    x = add(low, multiply(multiply(share, splat(2.0**-21)), subtract(high, low)))
    store(normals, 0, x)
    beyond = at_most(splat(_BEYOND), magnitude(x))
    while beyond:
        lane = np.int64(lowest_bit(beyond))
        write_integer(normals, lane, np.int64(pick_whole(halves, lane)))
        write_integer(tails, n, normals + 8 * lane)
        n += 1
        beyond &= beyond - _ONE
    return n


@jit
def _write_tails(tails, n):
    """Replace the half words at n places; many together, because each one's steps must wait."""
    for i in range(n):
        place = read_integer(tails, i)
        write(place, 0, _in_tail(read_integer(place, 0)))


@jit
def write_normals(quantiles, streams, count, tails, normals):
    """Write the first `count` standard normal numbers of eight streams side by side; one more if
    it is odd.

    quantiles: address of QUANTILES.   streams: address of eight integers.
    tails: address of MOST_TAILS integers, workspace.
    """
    n = np.int64(0)
    position, step, low = load_whole(streams, 0), splat_whole(_STEP), splat_whole(_LOW)
    for k in range(0, count, 2):
        position = add_whole(position, step)
        word = _mixed_lanes(position)
        at, high = normals + 8 * WIDTH * k, shift_right(word, splat_whole(_S32))
        n = _write_inner(quantiles, high, at, tails, n)
        n = _write_inner(quantiles, both(word, low), at + 8 * WIDTH, tails, n)
        if n > MOST_TAILS - 2 * WIDTH:
            _write_tails(tails, n)
            n = np.int64(0)
    _write_tails(tails, n)


@jit
def _set_lanes(seed, number, base, last, numbers, streams):
    """Write the rows of eight lanes from `base`, below `last`, and the streams of their rollouts,
    of which `number` is in the first of all rows."""
    for lane in range(WIDTH):
        i = min(base + lane, last - 1)
        write_integer(numbers, lane, i)
        write_integer(streams, lane, np.int64(stream_of(seed, number + i)))


@jit
def _set_streams(streams, number, below):
    """Write stream `number` derived from each of eight streams."""
    for lane in range(WIDTH):
        stream = stream_of(np.uint64(read_integer(streams, lane)), number)
        write_integer(below, lane, np.int64(stream))


IWORK = 3 * WIDTH + MOST_TAILS
"""Integers: rollouts' numbers, their streams, streams derived from them, tails."""


def even(count: int) -> int:
    """The count of normal numbers that are written."""
    return count + count % 2


def gusts_work(n_samples: int) -> int:
    """Workspace of `fill_gusts` [numbers]."""
    return 2 * n_samples * WIDTH


@jit
def fill_gusts(seed, number, fade, share, begin, noise, quantiles, work, iwork, out, first, last):
    """Fill rows first..last-1 of `out` (n, n_samples) with gusts, each from its own stream.

    White noise passes the filter sqrt(3) / (1 + T s) + (1 - sqrt(3)) / (1 + T s)^2 with the states
    a = 1 / (1 + T s) and b = a / (1 + T s). In a step they become fade (a, b + share a) plus noise
    (3,) times two normal numbers. begin (3,): the same for the first, stationary sample. Both are
    lower triangles (11, 21, 22).   number: as in `record`.
    """
    direct, twice = splat(np.sqrt(3.0)), splat(1.0 - np.sqrt(3.0))
    n_samples, w, numbers = out.shape[1], address(work), address(iwork)
    streams, tails = numbers + 8 * WIDTH, numbers + 24 * WIDTH
    for base in range(first, last, WIDTH):
        _set_lanes(seed, number, base, last, numbers, streams)
        write_normals(address(quantiles), streams, 2 * n_samples, tails, w)
        z0, z1 = load(w, 0), load(w, WIDTH)
        a = multiply(splat(begin[0]), z0)
        b = add(multiply(splat(begin[1]), z0), multiply(splat(begin[2]), z1))
        store(w, 0, add(multiply(direct, a), multiply(twice, b)))
        for k in range(1, n_samples):
            z0, z1 = load(w, 2 * k * WIDTH), load(w, (2 * k + 1) * WIDTH)
            b = multiply(splat(fade), add(b, multiply(splat(share), a)))
            b = add(add(b, multiply(splat(noise[1]), z0)), multiply(splat(noise[2]), z1))
            a = add(multiply(splat(fade), a), multiply(splat(noise[0]), z0))
            store(w, k * WIDTH, add(multiply(direct, a), multiply(twice, b)))
        store_rows(address(out), numbers, n_samples, n_samples, w)


@jit
def levels_at(elapsed, begins, levels):
    """Level of the segment that is flown at each time, (n, n_samples).

    elapsed: (1 or n, n_samples), increasing.   levels: (n_segments + 2,), the first before and the
    last after the segments.   begins: (1 or n, n_segments + 1), increasing, the last one an end.
    """
    n, n_samples = max(len(elapsed), len(begins)), elapsed.shape[1]
    out = np.empty((n, n_samples))
    for i in range(n):
        now, begin, begun = min(i, len(elapsed) - 1), min(i, len(begins) - 1), 0
        for k in range(n_samples):
            while begun < begins.shape[1] and elapsed[now, k] >= begins[begin, begun]:
                begun += 1
            out[i, k] = levels[begun]
    return out


class InexactInputs(NamedTuple):
    """Errors of a pilot, 1 sigma. asymmetry: share of a command.   trim, unsteadiness: [rad].

    fade: remaining share of a small movement after one sample.
    softness: largest lag of the planned inputs [samples]; that of a rollout is uniform from 0.
    """

    asymmetry: float
    trim: float
    unsteadiness: float
    fade: float
    softness: float


@jit
def _onset(planned, most):
    """First of `most` samples of (n_samples, n_surfaces) with a command; `most` without one."""
    for k in range(min(most, planned.shape[0])):
        for s in range(planned.shape[1]):
            if planned[k, s] != 0.0:
                return k
    return most


def commands_work(n_flown: int, n_samples: int, n_surfaces: int) -> int:
    """Workspace of `fill_commands` [numbers]."""
    return (5 + even(n_surfaces * n_flown) + n_surfaces * n_samples) * WIDTH


@jit
def fill_commands(
    seed, number, planned, before, most, inexact, quantiles, work, iwork, out, rest, first, last
):
    """Fill rows first..last-1 of `out` (n, before + n_samples, n_surfaces) with commands [rad] as
    flown.

    planned: (1 or n, n_samples, n_surfaces), 2 or 3; trim before it.   rest: (n,) output, samples
    before the first planned input, from 1 to `most`.   number: as in `record`.
    Small movements are stationary first-order processes, one per surface.
    """
    n_flown, n_surfaces = out.shape[1:]
    count, n_due, is_shared = n_surfaces * n_flown, n_surfaces * planned.shape[1], len(planned) == 1
    table, numbers, errors = address(quantiles), address(iwork), address(work)
    streams, below, tails = numbers + 8 * WIDTH, numbers + 16 * WIDTH, numbers + 24 * WIDTH
    moves = errors + 8 * 4 * WIDTH
    due = moves + 8 * (count + count % 2) * WIDTH
    gain, zero, two = np.sqrt(1.0 - inexact.fade * inexact.fade), splat(0.0), splat(2.0)
    softness = due + 8 * n_due * WIDTH
    for base in range(first, last, WIDTH):
        _set_lanes(seed, number, base, last, numbers, streams)
        _set_streams(streams, ERRORS, below)
        write_normals(table, below, np.int64(4), tails, errors)
        if inexact.unsteadiness > 0.0:
            _set_streams(streams, MOVES, below)
            write_normals(table, below, count, tails, moves)
        else:
            for k in range(count):
                store(moves, k * WIDTH, zero)
        load_rows(address(planned), numbers, 0 if is_shared else n_due, 0, n_due, due)
        for lane in range(WIDTH):
            i = read_integer(numbers, lane)
            own = np.uint64(read_integer(streams, lane))
            lag = inexact.softness * uniform(stream_of(own, SOFTNESS), np.int64(0))
            write(softness, lane, np.exp(-1.0 / lag) if lag > 0.0 else 0.0)
            rest[i] = max(_onset(planned[0 if is_shared else i], most), 1)
        soft = load(softness, 0)
        sharp = subtract(splat(1.0), soft)
        asymmetry = multiply(splat(inexact.asymmetry), load(errors, n_surfaces * WIDTH))
        right = add(splat(1.0), asymmetry)
        left = subtract(two, right)
        for s in range(n_surfaces):
            trim = multiply(splat(inexact.trim), load(errors, s * WIDTH))
            move, held = load(moves, s * WIDTH), zero
            for k in range(n_flown):
                at = (n_surfaces * k + s) * WIDTH
                if k > 0:
                    own_part = multiply(splat(gain), load(moves, at))
                    move = add(multiply(splat(inexact.fade), move), own_part)
                command = add(trim, multiply(splat(inexact.unsteadiness), move))
                if k >= before:
                    now = load(due, at - n_surfaces * before * WIDTH)
                    held = add(multiply(soft, held), multiply(sharp, now))
                    factor = where_greater(held, zero, right, left)
                    command = add(command, multiply(held, factor))
                store(moves, at, command)
        store_rows(address(out), numbers, count, count, moves)


class Instruments(NamedTuple):
    """Errors of the channels, (n_channels,) each.

    from_trim: whether a channel counts from trim; else it is absolute, and its gain error is of the
    change since the first sample.
    gain, bias, noise: 1 sigma; bias and noise in the channel's unit.   lag: largest [steps].
    step: of the recorded value, in the channel's unit; 0: no quantisation.
    """

    gain: Array
    bias: Array
    noise: Array
    lag: Array
    step: Array
    from_trim: Flags


@jit
def means_at_rest(y, start, every, rest, which):
    """Mean of channels over the samples at rest, (n, n_channels); 0 for channels not in `which`.

    y: (n, n_steps, n_channels); one sample every `every` steps from `start`.   rest: (n,) samples.
    which: (n_channels,).
    """
    means = np.zeros((y.shape[0], y.shape[2]))
    for i in range(y.shape[0]):
        for k in range(rest[i]):
            for c in range(y.shape[2]):
                means[i, c] += y[i, start + k * every, c]
        for c in range(y.shape[2]):
            means[i, c] = means[i, c] / rest[i] if which[c] else 0.0
    return means


def record_work(n_steps: int, n_samples: int, n_channels: int) -> int:
    """Workspace of `record` [numbers]."""
    return (n_steps * n_channels + even(n_samples * n_channels) + 5 * n_channels + 3) * WIDTH


@jit
def record(
    seed, number, y, trim, start, every, rest, instruments, quantiles, work, iwork, out, first, last
):
    """Record rollouts first..last-1 of true outputs `y` into `out`, each with its own errors.

    y, start, every, rest: as in `means_at_rest`.   trim: (n, n_channels), what it returns.
    out: (n, n_samples, n_channels), from trim or absolute.
    number: of the first of all rows among the rollouts of the seed.
    """
    n_steps, (n_samples, n_channels) = y.shape[1], out.shape[1:]
    count, line = n_samples * n_channels, n_channels * WIDTH
    table, numbers = address(quantiles), address(iwork)
    streams, below, tails = numbers + 8 * WIDTH, numbers + 16 * WIDTH, numbers + 24 * WIDTH
    earliest = max(start - 1 - int(instruments.lag.max()), 0)
    n_true = (start + (n_samples - 1) * every - earliest + 1) * n_channels
    true = address(work)
    seen = true + 8 * n_true * WIDTH
    errors = seen + 8 * (count + count % 2) * WIDTH
    parts, between, late = errors + 16 * line, errors + 24 * line, errors + 32 * line
    at_rest, trims = late + 16 * WIDTH, late + 24 * WIDTH
    whole = np.empty((n_channels, WIDTH), np.int64)
    zero, half = splat(0.0), splat(0.5)
    for base in range(first, last, WIDTH):
        _set_lanes(seed, number, base, last, numbers, streams)
        load_rows(address(y), numbers, n_steps * n_channels, earliest * n_channels, n_true, true)
        _set_streams(streams, ERRORS, below)
        write_normals(table, below, 2 * n_channels, tails, errors)
        _set_streams(streams, NOISE, below)
        write_normals(table, below, count, tails, seen)
        most = 0
        for lane in range(WIDTH):
            lags = stream_of(np.uint64(read_integer(streams, lane)), LAGS)
            most = max(most, rest[read_integer(numbers, lane)])
            for c in range(n_channels):
                lag = instruments.lag[c] * uniform(lags, c)
                whole[c, lane] = int(lag)
                write(parts, c * WIDTH + lane, lag - int(lag))
                write(between, c * WIDTH + lane, uniform(lags, n_channels + c))
            write(at_rest, lane, float(rest[read_integer(numbers, lane)]))
        load_rows(address(trim), numbers, n_channels, 0, n_channels, trims)
        is_late, n_rest = whole.any(), load(at_rest, 0)
        for c in range(n_channels):
            lane_c = c * WIDTH
            error = multiply(splat(instruments.gain[c]), load(errors, lane_c))
            gain, part, apart = add(splat(1.0), error), load(parts, lane_c), load(between, lane_c)
            noise, step = splat(instruments.noise[c]), splat(instruments.step[c])
            from_zero, mean = load(trims, lane_c), zero
            origin = subtract(load(true, (start - earliest) * line + lane_c), from_zero)
            from_trim, is_rounded = instruments.from_trim[c], instruments.step[c] > 0.0
            for k in range(n_samples):
                row = start + k * every - earliest
                at = row * line + lane_c
                if is_late:
                    for lane in range(WIDTH):
                        then = max(row - whole[c, lane], 0)
                        write(late, lane, read(true, then * line + lane_c + lane))
                        then = max(then - 1, 0)
                        write(late, WIDTH + lane, read(true, then * line + lane_c + lane))
                    now, earlier = load(late, 0), load(late, WIDTH)
                else:
                    now, earlier = load(true, at), load(true, at - line if row > 0 else at)
                now, earlier = subtract(now, from_zero), subtract(earlier, from_zero)
                value = add(now, multiply(part, subtract(earlier, now)))
                if from_trim:
                    value = multiply(value, gain)
                else:
                    value = add(origin, multiply(gain, subtract(value, origin)))
                place = k * line + lane_c
                value = add(value, multiply(noise, load(seen, place)))
                if is_rounded:
                    steps = floor(add(divide(value, step), apart))
                    value = multiply(step, add(subtract(steps, apart), half))
                store(seen, place, value)
                if from_trim and k < most:
                    mean = where_greater(n_rest, splat(float(k)), add(mean, value), mean)
            bias = multiply(splat(instruments.bias[c]), load(errors, line + lane_c))
            mean = subtract(divide(mean, n_rest), bias)
            for at in range(lane_c, n_samples * line, line):
                store(seen, at, subtract(load(seen, at), mean))
        store_rows(address(out), numbers, count, count, seen)
