"""Response of linear closed loops to held pilot commands, eight rollouts side by side."""

from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.closed_loop import KINDS, N_FEEDBACK, clear, close_loop, discretise, scratch
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


class Gusts(NamedTuple):
    """Sideslip (n, n_out) [rad] added by gusts, linear between output samples.

    state: plant state of the sideslip.   Without gusts: (0, 0) and -1.
    """

    sideslip: Array
    state: int


def linear_work(nx: int, m: int, n_samples: int, n_out: int, in_loop: Pilots) -> int:
    """Workspace of `roll_out_linear` [numbers]."""
    at, own = _places(nx, m), 2 * n_samples + n_out + memory_of(in_loop)
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


class _LinearPlaces(NamedTuple):
    """Positions in the workspace. line: length of a state of eight rollouts."""

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
def _places(nx, m):
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
    return _LinearPlaces(n, line, phi, inputs, step, u, e, rate, z, y, rows, loop)


@jit
def _begin(w, at, plants, law, bandwidth, hold, gust_state, n_inputs, which):
    """Set eight rollouts to trim, before their first command. False if a loop is not finite."""
    nx = plants[0].shape[1]
    if not close_loop(plants, law, bandwidth, which, w, at.loop, at.rows):
        return False
    clear(w, at.inputs, 2 * KINDS * at.n)  # kinds that are not given change nothing
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
def roll_out_linear(
    plants, law, bandwidth, pilot, hold, gusts, in_loop, work, iwork, out, first, last
):
    """Simulate rollouts first..last-1 into `out`; returns the first block that failed, or -1.

    hold, gusts, in_loop: Hold, Gusts and Pilots; with pilots in the loop, commands are not shared.
    out: the first samples may be missing, a multiple of SAMPLES.
    work: `linear_work` numbers, aligned; iwork: LANES_IWORK integers.
    Over a step h, z <- Phi z + G (u, e, rate) with Phi = exp(F h), see `discretise`. With a pedal
    lag the surfaces follow u + e: the held command u, and the rest e of earlier jumps, which fades
    as exp(-t / lag). The sideslip of gusts changes at a constant rate. All are exact, without
    additional states.
    """
    n_rollouts, nx = plants[0].shape[:2]
    n_samples = pilot.shape[1]
    length = out.shape[1] * N_CHANNELS
    at = _places(nx, law[0].shape[0])
    w, which, target = address(work), address(iwork), address(out)
    commands = w + 8 * (at.loop + scratch(at.n))
    rates, is_gusty = commands + 8 * 2 * n_samples * WIDTH, gusts.state >= 0
    is_lagged, fade = hold.decays[0] != 0.0, splat(hold.decays[0])
    n_inputs = np.int64(5 if is_gusty else 4 if is_lagged else 2)
    seat = seats(in_loop, rates + 8 * gusts.sideslip.shape[1] * WIDTH)
    for base in range(first, last, WIDTH):
        place_lanes(which, base, n_rollouts, length)
        if not _begin(w, at, plants, law, bandwidth, hold, gusts.state, n_inputs, which):
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
            for _ in range(hold.substeps):
                if is_gusty:
                    store(w, at.rate, load(rates, begun * WIDTH))
                    begun += 1
                following = at.z + filled * at.line
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
