"""Response of closed loops with rate or position limits of the surfaces, by Runge-Kutta.

The classic fourth-order method at a fixed step. The moment at which a limit starts to act is not
located, which costs about 1e-5 rad at two milliseconds.
"""

from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.closed_loop import N_FEEDBACK, clear, close_loop, product
from core.kernels.compiled import inlined, jit
from core.kernels.lanes import (
    WIDTH,
    add,
    address,
    fma,
    load,
    multiply,
    splat,
    store,
    subtract,
    where_greater,
)
from core.kernels.pilot import Pilots, memory_of, seats, steer_lanes
from core.kernels.response import (
    SAMPLES,
    gather_commands,
    gather_gusts,
    locate_channels,
    place_lanes,
    take_command,
    write_samples,
)


class Surfaces(NamedTuple):
    """First-order actuators. rate_limit [rad/s], position_limit [rad]: inf if none."""

    bandwidth: float
    rate_limit: float
    position_limit: float


class TimeSteps(NamedTuple):
    """Time steps. step: [s] between output samples, `substeps` per command.

    parts: Runge-Kutta steps per step.   half_fade: decay of the lag in half a part; 0: no lag.
    """

    step: float
    substeps: int
    parts: int
    half_fade: float


class _LimitedPlaces(NamedTuple):
    """Positions in the workspace. line: length of a state of eight rollouts.

    outside: effect of a gust on each state.
    """

    n: int
    line: int
    loop: int
    outside: int
    state: int
    slope: int
    stage: int
    following: int
    z: int
    u: int
    e: int
    y: int
    rows: int
    commands: int


@jit
def _places(nx, m):
    n = nx + 2 + m
    line = n * WIDTH
    loop = n - n  # a literal compiles every callee again
    outside = n * line
    state = outside + line
    slope = state + line
    stage = slope + line
    following = stage + line
    z = following + line
    u = z + SAMPLES * line
    e = u + 2 * WIDTH
    y = e + 2 * WIDTH
    rows = y + SAMPLES * 4 * WIDTH
    commands = rows + N_FEEDBACK * (nx + 2) * WIDTH
    return _LimitedPlaces(
        n, line, loop, outside, state, slope, stage, following, z, u, e, y, rows, commands
    )


def limited_work(nx: int, m: int, n_samples: int, n_out: int, in_loop: Pilots) -> int:
    """Workspace of `roll_out_limited` [numbers]."""
    own = 2 * n_samples + n_out + memory_of(in_loop)
    return _places(nx, m).commands + own * WIDTH


@jit
def _clip(value, limit):
    """Limit a value to +-limit; NaN stays NaN."""
    high = splat(limit)
    low = splat(-limit)
    value = where_greater(value, high, high, value)
    return where_greater(low, value, low, value)


@inlined
def _derivative(w, at, z, out, fade, nx, surfaces):
    """out = z_dot, for the loop of unit bandwidth and pedals at u + fade e."""
    product(w, at.loop, z, at.outside, out, at.n, np.int64(1))
    for s in range(2):
        place = (nx + s) * WIDTH
        delta = load(w, z + place)
        pilot = fma(fade, load(w, at.e + s * WIDTH), load(w, at.u + s * WIDTH))
        command = _clip(add(add(load(w, out + place), delta), pilot), surfaces.position_limit)
        rate = multiply(splat(surfaces.bandwidth), subtract(command, delta))
        store(w, out + place, _clip(rate, surfaces.rate_limit))


@jit
def _add_slope(w, at, total, following, weight, ahead):
    """stage = state + ahead slope, then following = total + weight slope."""
    for i in range(0, at.line, WIDTH):
        slope = load(w, at.slope + i)
        store(w, at.stage + i, fma(splat(ahead), slope, load(w, at.state + i)))
        store(w, following + i, fma(splat(weight), slope, load(w, total + i)))


@inlined
def _runge_kutta(w, at, nx, surfaces, steps):
    """Advance the state and the lags by one part of a step."""
    h = steps.step / steps.parts
    half, full = splat(steps.half_fade), splat(steps.half_fade * steps.half_fade)
    for i, weight, ahead in ((0, 1.0, 0.5), (1, 2.0, 0.5), (2, 2.0, 1.0), (3, 1.0, 0.0)):
        fade = splat(1.0) if i == 0 else (full if i == 3 else half)
        _derivative(w, at, at.state if i == 0 else at.stage, at.slope, fade, nx, surfaces)
        total = at.state if i == 0 else at.following
        following = at.state if i == 3 else at.following
        _add_slope(w, at, total, following, weight * h / 6.0, ahead * h)
    for s in (0, WIDTH):
        store(w, at.e + s, multiply(full, load(w, at.e + s)))


@jit
def _begin(w, at, plants, law, pilot, which, same_commands):
    """Set eight rollouts to trim, before their first command. False if a loop is not finite."""
    if not close_loop(plants, law, 1.0, which, w, at.loop, at.rows):
        return False
    locate_channels(w, at.rows, at.z, at.line, at.y, plants[0].shape[1], which + 16 * WIDTH)
    if not same_commands:
        gather_commands(pilot, which, w + 8 * at.commands)
    clear(w, at.outside, (5 + SAMPLES) * at.n + 4)
    return True


@jit
def _follow_commands(
    w, at, nx, n_samples, surfaces, steps, gust_state, seat, which, target, written
):
    """Simulate eight rollouts and write their samples; the first is the trim."""
    rates = at.commands + 2 * n_samples * WIDTH
    filled, begun = np.int64(1), 0
    commands = w + 8 * at.commands
    for k in range(n_samples - 1):
        if seat.n_axes > 0:
            places = at.rows, at.state, nx + 2, which
            steer_lanes(seat, np.int64(0), w, *places, commands, k)
        take_command(w, commands, 2 * k * WIDTH, at.u, at.e)
        if steps.half_fade == 0.0:
            clear(w, at.e, 2)
        for _ in range(steps.substeps):
            if gust_state >= 0:
                store(w, at.outside + gust_state * WIDTH, load(w, rates + begun * WIDTH))
                begun += 1
            for _ in range(steps.parts):
                _runge_kutta(w, at, nx, surfaces, steps)
            for i in range(0, at.line, WIDTH):
                store(w, at.z + filled * at.line + i, load(w, at.state + i))
            filled += 1
            if filled == SAMPLES:
                write_samples(w, at.rows, at.z, at.line, at.y, nx, which, filled, target, written)
                written += SAMPLES * N_CHANNELS
                filled = 0
    write_samples(w, at.rows, at.z, at.line, at.y, nx, which, filled, target, written)


@jit
def roll_out_limited(
    plants, law, surfaces, pilot, steps, gusts, in_loop, work, iwork, out, first, last
):
    """Simulate rollouts first..last-1 into `out`; returns the first block that failed, or -1.

    surfaces, steps, gusts, in_loop: Surfaces, TimeSteps, Gusts and Pilots; with pilots in the loop,
    commands are not shared.   out: as in `roll_out_linear`.
    work: `limited_work` numbers, aligned; iwork: LANES_IWORK integers.
    """
    n_rollouts, nx = plants[0].shape[:2]
    n_samples = pilot.shape[1]
    length = out.shape[1] * N_CHANNELS
    missing = length - ((n_samples - 1) * steps.substeps + 1) * N_CHANNELS
    at = _places(nx, law[0].shape[0])
    w, which, target = address(work), address(iwork), address(out)
    rates = w + 8 * (at.commands + 2 * n_samples * WIDTH)
    seat = seats(in_loop, rates + 8 * gusts.sideslip.shape[1] * WIDTH)
    for base in range(first, last, WIDTH):
        place_lanes(which, base, n_rollouts, length)
        same_commands = base > first and pilot.shape[0] == 1
        if not _begin(w, at, plants, law, pilot, which, same_commands):
            return base
        if gusts.state >= 0:
            gather_gusts(gusts, which, steps.step, rates)
        about = w, at, nx, n_samples, surfaces, steps, gusts.state, seat, which, target, missing
        _follow_commands(*about)
    return -1
