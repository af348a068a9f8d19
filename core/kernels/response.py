"""Response of closed loops to held pilot commands, eight rollouts side by side.

Exact where the surfaces have no limits, else by the classic fourth-order Runge-Kutta method at a
fixed step. The moment at which a limit starts to act is not located, which costs about 1e-5 rad at
two milliseconds.
"""

from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.closed_loop import (
    KINDS,
    N_FEEDBACK,
    clear,
    close_loop,
    discretise,
    product,
    scratch,
)
from core.kernels.compiled import inlined, jit
from core.kernels.lanes import (
    UNROLLED,
    WIDTH,
    add,
    address,
    advance,
    divide,
    fma,
    load,
    load_rows,
    magnitude,
    multiply,
    read,
    read_integer,
    splat,
    store,
    store_transposed,
    subtract,
    total,
    where_greater,
    write,
    write_integer,
)
from core.kernels.pilot import Pilots, memory_of, seats, steer_lanes
from core.types import Array

SAMPLES = 4
"""Samples per transposed store: 4 samples x 6 channels are three blocks of eight."""
MOST_INPUTS = 5
"""Of a step: two commands, the fading rests of earlier ones, the rate of a gust."""
LANES_IWORK = 2 * WIDTH + SAMPLES * N_CHANNELS
"""Integers per eight rollouts: their numbers, their positions in `out`, sources of channels."""


class Hold(NamedTuple):
    """How long a command is held. step: [s] between output samples, `substeps` per command.

    series, decays: `input_series` of that step; decays 0: no pedal lag.
    """

    step: float
    substeps: int
    series: Array
    decays: Array


class Surfaces(NamedTuple):
    """First-order actuators with limits. rate_limit [rad/s], position_limit [rad]: inf if none.

    parts: Runge-Kutta steps per output step.   half_fade: decay of the lag in half a part; 0: no
    lag.
    """

    bandwidth: float
    rate_limit: float
    position_limit: float
    parts: int
    half_fade: float


class Gusts(NamedTuple):
    """Sideslip (n, n_out) [rad] added by gusts, linear between output samples.

    state: plant state of the sideslip.   Without gusts: (0, 0) and -1.
    """

    sideslip: Array
    state: int


def work(nx: int, m: int, n_samples: int, n_out: int, in_loop: Pilots) -> int:
    """Workspace of a rollout kernel [numbers]."""
    at, own = places(nx, m), 2 * n_samples + n_out + memory_of(in_loop)
    return at.loop + scratch(at.n) + own * WIDTH


@jit
def place_lanes(which, base, n_rollouts, length):
    """Write the rollout numbers of the lanes, from `base`, and their positions in `out`."""
    for lane in range(WIDTH):
        rollout = min(base + lane, n_rollouts - 1)
        write_integer(which, lane, rollout)
        write_integer(which, WIDTH + lane, rollout * length)


@jit
def gather_commands(pilot, which, commands):
    """Copy pilot commands (shared or one per rollout) into (n_samples, 2) lanes."""
    count = 2 * pilot.shape[1]
    load_rows(address(pilot), which, count if pilot.shape[0] > 1 else 0, 0, count, commands)


@jit
def gather_gusts(gusts, which, step, rates):
    """Copy the rates of the gusts' sideslip [rad/s], one per step, into lanes."""
    count, step = gusts.sideslip.shape[1], splat(step)
    load_rows(address(gusts.sideslip), which, count, 0, count, rates)
    for at in range(0, (count - 1) * WIDTH, WIDTH):
        change = subtract(load(rates, at + WIDTH), load(rates, at))
        store(rates, at, divide(change, step))


@jit
def is_state(w, row, o, ny):
    """Whether a measured row equals state `o` in all eight lanes."""
    off = splat(0.0)
    for j in range(ny):
        unit = splat(1.0 if j == o else 0.0)
        off = add(off, magnitude(subtract(load(w, row + j * WIDTH), unit)))
    return total(off) == 0.0


@jit
def locate_channels(w, rows, z, spacing, y, nx, sources):
    """Find the positions of the channels of SAMPLES samples: states at z, or measured at y."""
    for o in range(N_CHANNELS):
        at = z + o * WIDTH
        gap = spacing
        if o >= 4:
            at = z + (nx + o - 4) * WIDTH
        elif o >= nx or not is_state(w, rows + o * (nx + 2) * WIDTH, o, nx + 2):
            at = y + o * WIDTH
            gap = 4 * WIDTH
        for sample in range(SAMPLES):
            write_integer(sources, sample * N_CHANNELS + o, at + sample * gap)


@jit
def measure(w, rows, z, spacing, y, nx, sources):
    """Compute y = C x + D delta of SAMPLES samples for channels that are not states."""
    for o in range(4):
        if read_integer(sources, o) != y + o * WIDTH:
            continue
        y0 = y1 = y2 = y3 = splat(0.0)
        for j in range(nx + 2):
            row = load(w, rows + (o * (nx + 2) + j) * WIDTH)
            at = z + j * WIDTH
            y0 = fma(row, load(w, at), y0)
            y1 = fma(row, load(w, at + spacing), y1)
            y2 = fma(row, load(w, at + 2 * spacing), y2)
            y3 = fma(row, load(w, at + 3 * spacing), y3)
        at = y + o * WIDTH
        store(w, at, y0)
        store(w, at + 4 * WIDTH, y1)
        store(w, at + 8 * WIDTH, y2)
        store(w, at + 12 * WIDTH, y3)


@inlined
def write_samples(w, rows, z, spacing, y, nx, which, samples, target, written):
    """Measure up to SAMPLES samples and append them to the output, unless `written` is negative."""
    if samples == 0 or written < 0:
        return
    measure(w, rows, z, spacing, y, nx, which + 16 * WIDTH)
    if samples == SAMPLES:
        write_block(w, which, target, written)
    else:
        write_rest(w, which, samples, target, written)


@jit
def write_block(w, which, target, written):
    """Append SAMPLES samples to the output."""
    places, sources = which + 8 * WIDTH, which + 16 * WIDTH
    for i in range(0, SAMPLES * N_CHANNELS, WIDTH):
        store_transposed(w, sources + 8 * i, target, places, written + i)


@jit
def write_rest(w, which, samples, target, written):
    """Append the last samples, fewer than SAMPLES."""
    for i in range(samples * N_CHANNELS):
        source = read_integer(which, 2 * WIDTH + i)
        for lane in range(WIDTH):
            write(target, read_integer(which, WIDTH + lane) + written + i, read(w, source + lane))


@jit
def _pack(w, at, n_inputs):
    """Write (G Phi), the gains of the inputs and the transition of the state, by columns."""
    n = at.n
    for k in range(n_inputs):  # two of each kind
        for i in range(n):
            gain = load(w, at.inputs + (k // 2 * n + i) * 2 * WIDTH + k % 2 * WIDTH)
            store(w, at.step + (k * n + i) * WIDTH, gain)
    for k in range(n):
        for i in range(n):
            share = load(w, at.phi + (i * n + k) * WIDTH)
            store(w, at.step + ((n_inputs + k) * n + i) * WIDTH, share)


@jit
def _advance(w, at, n_inputs, z, out):
    """Advance a state by one output step: out = G (u, e, rate) + Phi z."""
    if at.n <= UNROLLED:
        advance(w, at.step, at.u, n_inputs, z, out, at.n)
        return
    for i in range(at.n):
        v, column = splat(0.0), at.step + i * WIDTH
        for k in range(n_inputs):
            v = fma(load(w, column + k * at.line), load(w, at.u + k * WIDTH), v)
        for k in range(at.n):
            v = fma(load(w, column + (n_inputs + k) * at.line), load(w, z + k * WIDTH), v)
        store(w, out + i * WIDTH, v)


@jit
def take_command(w, commands, at, u, e):
    """Apply the commands at `at`; e holds the part of a jump that the pedals still lag."""
    for s in (0, WIDTH):
        command = load(commands, at + s)
        jump = subtract(command, load(w, u + s))
        store(w, e + s, subtract(load(w, e + s), jump))
        store(w, u + s, command)


class Places(NamedTuple):
    """Positions in the workspace. line: length of a state of eight rollouts.

    inputs: for surfaces with limits the effect of a gust on each state, a slope, a stage, a sum.
    """

    n: int
    line: int
    phi: int
    inputs: int
    step: int
    u: int
    e: int
    rate: int
    z: int
    y: int
    rows: int
    loop: int


@jit
def places(nx, m):
    n = nx + 2 + m
    line = n * WIDTH
    phi = n - n  # a literal compiles every callee again
    inputs = n * line
    step = inputs + 2 * KINDS * line
    u = step + (MOST_INPUTS + n) * line
    e = u + 2 * WIDTH
    rate = e + 2 * WIDTH
    z = rate + WIDTH
    y = z + SAMPLES * line
    rows = y + SAMPLES * 4 * WIDTH
    loop = rows + N_FEEDBACK * (nx + 2) * WIDTH
    return Places(n, line, phi, inputs, step, u, e, rate, z, y, rows, loop)


@jit
def _clip(value, limit):
    """Limit a value to +-limit; NaN stays NaN."""
    high, low = splat(limit), splat(-limit)
    value = where_greater(value, high, high, value)
    return where_greater(low, value, low, value)


@inlined
def _derivative(w, at, z, out, fade, nx, surfaces):
    """out = z_dot, for the loop of unit bandwidth and pedals at u + fade e."""
    product(w, at.loop, z, at.inputs, out, at.n, np.int64(1))
    for s in range(2):
        place = (nx + s) * WIDTH
        delta = load(w, z + place)
        pilot = fma(fade, load(w, at.e + s * WIDTH), load(w, at.u + s * WIDTH))
        command = _clip(add(add(load(w, out + place), delta), pilot), surfaces.position_limit)
        rate = multiply(splat(surfaces.bandwidth), subtract(command, delta))
        store(w, out + place, _clip(rate, surfaces.rate_limit))


@jit
def _add_slope(w, at, state, total, following, weight, ahead):
    """stage = state + ahead slope, then following = total + weight slope."""
    for i in range(0, at.line, WIDTH):
        slope = load(w, at.inputs + at.line + i)
        stage = fma(splat(ahead), slope, load(w, state + i))
        store(w, at.inputs + 2 * at.line + i, stage)
        store(w, following + i, fma(splat(weight), slope, load(w, total + i)))


@jit
def _integrate(w, at, z, out, nx, surfaces, step):
    """Advance a state and the lags by one output step."""
    h = step / surfaces.parts
    half, full = splat(surfaces.half_fade), splat(surfaces.half_fade * surfaces.half_fade)
    slope = at.inputs + at.line
    stage, sums = slope + at.line, slope + 2 * at.line
    for i in range(0, at.line, WIDTH):
        store(w, out + i, load(w, z + i))
    for _ in range(surfaces.parts):
        for i, weight, ahead in ((0, 1.0, 0.5), (1, 2.0, 0.5), (2, 2.0, 1.0), (3, 1.0, 0.0)):
            fade = splat(1.0) if i == 0 else (full if i == 3 else half)
            _derivative(w, at, out if i == 0 else stage, slope, fade, nx, surfaces)
            total, following = out if i == 0 else sums, out if i == 3 else sums
            _add_slope(w, at, out, total, following, weight * h / 6.0, ahead * h)
        for s in (0, WIDTH):
            store(w, at.e + s, multiply(full, load(w, at.e + s)))


@jit
def _begin(w, at, plants, law, bandwidth, surfaces, hold, gust_state, n_inputs, which):
    """Set eight rollouts to trim, before their first command. False if a loop is not finite."""
    nx = plants[0].shape[1]
    in_loop = bandwidth if surfaces is None else 1.0
    if not close_loop(plants, law, in_loop, which, w, at.loop, at.rows):
        return False
    clear(w, at.inputs, 2 * KINDS * at.n)  # kinds that are not given change nothing
    if surfaces is None:
        if not discretise(
            w, at.loop, at.n, nx, bandwidth, hold.step, hold.series, hold.decays, gust_state,
            at.phi, at.inputs,
        ):  # fmt: skip
            return False
        _pack(w, at, n_inputs)
    locate_channels(w, at.rows, at.z, at.line, at.y, nx, which + 16 * WIDTH)
    clear(w, at.u, MOST_INPUTS + at.n)
    return True


@jit
def roll_out_lanes(
    plants, law, bandwidth, surfaces, pilot, hold, gusts, in_loop, work, iwork, out, first, last
):
    """Simulate rollouts first..last-1 into `out`; returns the first block that failed, or -1.

    surfaces: None if they have no limits; else bandwidth and the series of `hold` are not used.
    hold, gusts, in_loop: Hold, Gusts and Pilots; with pilots in the loop, commands are not shared.
    out: the first samples may be missing, a multiple of SAMPLES.
    work: `work` numbers, aligned; iwork: LANES_IWORK integers.
    Over a step h, z <- Phi z + G (u, e, rate) with Phi = exp(F h), see `discretise`. With a pedal
    lag the surfaces follow u + e: the held command u, and the rest e of earlier jumps, which fades
    as exp(-t / lag). The sideslip of gusts changes at a constant rate. All are exact, without
    additional states.
    """
    n_rollouts, nx = plants[0].shape[:2]
    n_samples = pilot.shape[1]
    length = out.shape[1] * N_CHANNELS
    at = places(nx, law[0].shape[0])
    w, which, target = address(work), address(iwork), address(out)
    commands = w + 8 * (at.loop + scratch(at.n))
    rates, is_gusty = commands + 8 * 2 * n_samples * WIDTH, gusts.state >= 0
    is_lagged, fade = hold.decays[0] != 0.0, splat(hold.decays[0])
    n_inputs = np.int64(5 if is_gusty else 4 if is_lagged else 2)
    seat = seats(in_loop, rates + 8 * gusts.sideslip.shape[1] * WIDTH)
    rate = at.rate if surfaces is None else at.inputs + gusts.state * WIDTH
    for base in range(first, last, WIDTH):
        place_lanes(which, base, n_rollouts, length)
        about = plants, law, bandwidth, surfaces, hold, gusts.state, n_inputs
        if not _begin(w, at, *about, which):
            return base
        if base == first or pilot.shape[0] > 1:
            gather_commands(pilot, which, commands)
        if is_gusty:
            gather_gusts(gusts, which, hold.step, rates)
        z, filled, begun = at.z, np.int64(1), 0
        written = np.int64(length - ((n_samples - 1) * hold.substeps + 1) * N_CHANNELS)
        for k in range(n_samples - 1):
            if seat.n_axes > 0:
                steer_lanes(seat, np.int64(0), w, at.rows, z, nx + 2, which, commands, k)
            take_command(w, commands, 2 * k * WIDTH, at.u, at.e)
            if surfaces is not None and surfaces.half_fade == 0.0:
                clear(w, at.e, 2)
            for _ in range(hold.substeps):
                if is_gusty:
                    store(w, rate, load(rates, begun * WIDTH))
                    begun += 1
                following = at.z + filled * at.line
                if surfaces is not None:
                    _integrate(w, at, z, following, nx, surfaces, hold.step)
                else:
                    _advance(w, at, n_inputs, z, following)
                    if is_lagged:
                        store(w, at.e, multiply(fade, load(w, at.e)))
                        store(w, at.e + WIDTH, multiply(fade, load(w, at.e + WIDTH)))
                z = following
                filled += 1
                if filled == SAMPLES:
                    write_samples(
                        w, at.rows, at.z, at.line, at.y, nx, which, filled, target, written
                    )
                    written += SAMPLES * N_CHANNELS
                    filled = 0
        write_samples(w, at.rows, at.z, at.line, at.y, nx, which, filled, target, written)
    return -1
