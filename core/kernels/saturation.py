"""Response of closed loops whose surfaces reach rate or position limits, by Runge-Kutta.

The classic fourth-order method at a fixed step; the step at which a limit begins to act is crossed
without being located, which costs some 1e-5 rad at two milliseconds.
"""

from core.kernels import N_CHANNELS
from core.kernels.closed_loop import N_FEEDBACK, clear, close_loop
from core.kernels.compiled import jit
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
    write_integer,
)
from core.kernels.response import (
    LEDGER_EACH,
    SAMPLES,
    gather_commands,
    locate_channels,
    measure,
    write_block,
    write_rest,
)
from core.kernels.zero_order_hold import product

LIMITED_LEDGER = LEDGER_EACH


def limited_room(nx: int, m: int, n_samples: int) -> int:
    """Scratch numbers that `roll_out_limited` needs."""
    n = nx + 2 + m
    vectors = n * n + (5 + SAMPLES) * n + 4 + 4 * SAMPLES + N_FEEDBACK * (nx + 2) + 2 * n_samples
    return vectors * WIDTH


@jit
def _clip(value, limit):
    """Return value within +-limit; NaN stays NaN."""
    high = splat(limit)
    low = splat(-limit)
    value = where_greater(value, high, high, value)
    return where_greater(low, value, low, value)


@jit
def _rate(w, loop, z, zero, out, u, e, fade, nx, n, bandwidth, rate_limit, position_limit):
    """out = z_dot, with `loop` of unit bandwidth and the pedals at u + fade e."""
    product(w, loop, z, zero, out, n, 1)
    for s in range(2):
        at = (nx + s) * WIDTH
        delta = load(w, z + at)
        pilot = fma(fade, load(w, e + s * WIDTH), load(w, u + s * WIDTH))
        command = _clip(add(add(load(w, out + at), delta), pilot), position_limit)
        wish = multiply(splat(bandwidth), subtract(command, delta))
        store(w, out + at, _clip(wish, rate_limit))


@jit
def _combine(w, z, factor, slope, out, n):
    """out = z + factor slope."""
    for i in range(n):
        at = i * WIDTH
        store(w, out + at, fma(splat(factor), load(w, slope + at), load(w, z + at)))


@jit
def roll_out_limited(
    plants,
    law,
    bandwidth,
    rate_limit,
    position_limit,
    pilot,
    step,
    parts,
    substeps,
    half_fade,
    room,
    ledger,
    out,
    first,
    last,
):
    """Simulate rollouts first..last-1 into `out`; returns the first block that cannot be, or -1.

    Each step between two output samples is cut into `parts` Runge-Kutta steps; half_fade is what
    half of one leaves of a pedal that lags. rate_limit [rad/s], position_limit [rad]: inf if none.
    room: `limited_room` numbers, aligned; ledger: LIMITED_LEDGER integers.
    """
    nx = plants[0].shape[1]
    n = nx + 2 + law[0].shape[0]
    n_rollouts = plants[0].shape[0]
    n_samples = pilot.shape[1]
    length = ((n_samples - 1) * substeps + 1) * N_CHANNELS
    line = n * WIDTH
    loop = n - n  # a literal 0 would compile every callee once more
    zero = n * line
    state = zero + line
    slope = state + line
    stage = slope + line
    following = stage + line
    z = following + line
    u = z + SAMPLES * line
    e = u + 2 * WIDTH
    y = e + 2 * WIDTH
    rows = y + SAMPLES * 4 * WIDTH
    commands = rows + N_FEEDBACK * (nx + 2) * WIDTH
    w = address(room)
    which = address(ledger)
    sources = which + 16 * WIDTH
    target = address(out)
    h = step / parts
    whole = splat(1.0)
    half = splat(half_fade)
    full = splat(half_fade * half_fade)
    for base in range(first, last, WIDTH):
        for lane in range(WIDTH):
            rollout = min(base + lane, n_rollouts - 1)
            write_integer(which, lane, rollout)
            write_integer(which, WIDTH + lane, rollout * length)
        if not close_loop(plants, law, 1.0, which, w, loop, rows):
            return base
        locate_channels(w, rows, z, line, y, nx, sources)
        if base == first or pilot.shape[0] > 1:
            gather_commands(pilot, which, w + 8 * commands)
        clear(w, zero, (5 + SAMPLES) * n + 4)
        filled = 1
        written = 0
        for k in range(n_samples - 1):
            for s in (0, WIDTH):
                command = load(w, commands + 2 * k * WIDTH + s)
                rest = subtract(load(w, e + s), subtract(command, load(w, u + s)))
                store(w, e + s, rest if half_fade > 0.0 else splat(0.0))
                store(w, u + s, command)
            for part in range(substeps * parts):
                for i, weight, ahead in (
                    (0, 1.0, 0.5),
                    (1, 2.0, 0.5),
                    (2, 2.0, 1.0),
                    (3, 1.0, 0.0),
                ):
                    at = state if i == 0 else stage
                    fade = whole if i == 0 else (full if i == 3 else half)
                    _rate(
                        w, loop, at, zero, slope, u, e, fade, nx, n,
                        bandwidth, rate_limit, position_limit,
                    )  # fmt: skip
                    _combine(
                        w, state if i == 0 else following, weight * h / 6.0, slope, following, n
                    )
                    _combine(w, state, ahead * h, slope, stage, n)
                for i in range(0, line, WIDTH):
                    store(w, state + i, load(w, following + i))
                for s in (0, WIDTH):
                    store(w, e + s, multiply(full, load(w, e + s)))
                if (part + 1) % parts == 0:
                    for i in range(0, line, WIDTH):
                        store(w, z + filled * line + i, load(w, state + i))
                    filled += 1
                    if filled == SAMPLES:
                        measure(w, rows, z, line, y, nx, sources)
                        write_block(w, which, target, written)
                        written += SAMPLES * N_CHANNELS
                        filled = 0
        if filled > 0:
            measure(w, rows, z, line, y, nx, sources)
            write_rest(w, which, filled, target, written)
    return -1
