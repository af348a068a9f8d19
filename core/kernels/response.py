"""Response of linear closed loops to held pilot commands, eight rollouts side by side."""

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.closed_loop import N_FEEDBACK, clear, close_loop
from core.kernels.compiled import jit
from core.kernels.lanes import (
    WIDTH,
    add,
    address,
    fma,
    load,
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
from core.kernels.zero_order_hold import discretise, product, scratch

SAMPLES = 4  # between two transposed stores: 4 samples x 6 channels are three blocks of eight
GROUPS = (
    2  # of eight rollouts that advance in turn: one computes while the other waits for its sums
)
LEDGER_EACH = (
    2 * WIDTH + SAMPLES * N_CHANNELS
)  # rollouts of the lanes, their places in `out`, sources of channels
LEDGER = GROUPS * LEDGER_EACH


def linear_room(nx: int, m: int, n_samples: int) -> int:
    """Scratch numbers that `roll_out_linear` needs."""
    n = nx + 2 + m
    return GROUPS * (
        (n * n + (7 + SAMPLES) * n + 4 + 4 * SAMPLES + N_FEEDBACK * (nx + 2) + 2 * n_samples)
        * WIDTH
        + scratch(n)
    )


@jit
def gather_commands(pilot, which, commands):
    """Copy pilot commands (one for all rollouts or one each) into (n_samples, 2) lanes."""
    for lane in range(WIDTH):
        n = read_integer(which, lane) if pilot.shape[0] > 1 else 0
        for k in range(pilot.shape[1]):
            for s in range(2):
                write(commands, (k * 2 + s) * WIDTH + lane, pilot[n, k, s])


@jit
def note_changes(commands, n_samples, changed, used):
    """Mark the samples at which any command changes, and the surfaces that are commanded at all."""
    for k in range(n_samples):
        for i in range(2 * WIDTH):
            at = k * 2 * WIDTH + i
            if read(commands, at) != (read(commands, at - 2 * WIDTH) if k > 0 else 0.0):
                changed[k] = True
                used[i // WIDTH] = True


@jit
def is_state(w, row, o, ny):
    """Whether a measured row is state `o` itself, in all eight lanes."""
    off = splat(0.0)
    for j in range(ny):
        unit = splat(1.0 if j == o else 0.0)
        off = add(off, magnitude(subtract(load(w, row + j * WIDTH), unit)))
    return total(off) == 0.0


@jit
def locate_channels(w, rows, z, spacing, y, nx, sources):
    """Find where the channels of SAMPLES samples lie: among the states at z, or measured at y."""
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
    """Write y = C x + D delta of SAMPLES samples for the channels that are not states."""
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


@jit
def write_block(w, which, target, written):
    """Write SAMPLES samples behind those that are written already."""
    places, sources = which + 8 * WIDTH, which + 16 * WIDTH
    for i in range(0, SAMPLES * N_CHANNELS, WIDTH):
        store_transposed(w, sources + 8 * i, target, places, written + i)


@jit
def write_rest(w, which, samples, target, written):
    """Write the last, fewer than SAMPLES, samples."""
    for i in range(samples * N_CHANNELS):
        source = read_integer(which, 2 * WIDTH + i)
        for lane in range(WIDTH):
            write(target, read_integer(which, WIDTH + lane) + written + i, read(w, source + lane))


@jit
def _drive(w, gains, inputs, aileron, rudder, n, start, out):
    """out = start + gains (n, 2) inputs (2), for the surfaces in use."""
    u0 = load(w, inputs)
    u1 = load(w, inputs + WIDTH)
    for i in range(n):
        v = load(w, start + i * WIDTH)
        if aileron:
            v = fma(load(w, gains + 2 * i * WIDTH), u0, v)
        if rudder:
            v = fma(load(w, gains + (2 * i + 1) * WIDTH), u1, v)
        store(w, out + i * WIDTH, v)


@jit
def _take_command(w, commands, at, u, e):
    """Move to the commands at `at`; what the pedals lack of a jump is left in e."""
    for s in (0, WIDTH):
        command = load(commands, at + s)
        jump = subtract(command, load(w, u + s))
        store(w, e + s, subtract(load(w, e + s), jump))
        store(w, u + s, command)


@jit
def roll_out_linear(
    plants, law, bandwidth, pilot, step, substeps, series, decays, room, ledger, out, first, last
):
    """Simulate rollouts first..last-1 into `out`; returns the first block that cannot be, or -1.

    series, decays: `input_series`.
    room: `linear_room` numbers of scratch, aligned; ledger: LEDGER integers.
    With a pedal lag (decays not 0) the surfaces follow u + e: the held command, and what is left of
    earlier jumps, which fades as exp(-t / lag). Both enter exactly, without more states.
    """
    nx = plants[0].shape[1]
    n = nx + 2 + law[0].shape[0]
    n_rollouts = plants[0].shape[0]
    n_samples = pilot.shape[1]
    length = ((n_samples - 1) * substeps + 1) * N_CHANNELS
    line = n * WIDTH
    phi = n - n  # a literal 0 would compile every callee once more
    held = n * line
    fading = held + 2 * line
    zero = fading + 2 * line
    constant = zero + line
    force = constant + line
    u = force + line
    e = u + 2 * WIDTH
    z = e + 2 * WIDTH
    y = z + SAMPLES * line
    rows = y + SAMPLES * 4 * WIDTH
    loop = rows + N_FEEDBACK * (nx + 2) * WIDTH
    w0 = address(room)
    w_bytes = 8 * (loop + scratch(n))
    commands0 = w0 + GROUPS * w_bytes
    commands_bytes = 8 * 2 * n_samples * WIDTH if pilot.shape[0] > 1 else 0
    which0 = address(ledger)
    ledger_bytes = 8 * LEDGER_EACH
    target = address(out)
    changed = np.zeros(n_samples, np.bool_)
    used = np.zeros(2, np.bool_)
    lagged = decays[0] != 0.0
    fade = splat(decays[0])
    kinds = 2 if lagged else 1
    for base in range(first, last, GROUPS * WIDTH):
        groups = min(GROUPS, (last - base + WIDTH - 1) // WIDTH)
        for g in range(groups):
            w, which = w0 + g * w_bytes, which0 + g * ledger_bytes
            for lane in range(WIDTH):
                rollout = min(base + g * WIDTH + lane, n_rollouts - 1)
                write_integer(which, lane, rollout)
                write_integer(which, WIDTH + lane, rollout * length)
            if not close_loop(plants, law, bandwidth, which, w, loop, rows):
                return base
            if not discretise(w, loop, n, nx, bandwidth, step, series, decays, kinds, phi, held):
                return base
            locate_channels(w, rows, z, line, y, nx, which + 16 * WIDTH)
            if base == first or commands_bytes > 0:
                gather_commands(pilot, which, commands0 + g * commands_bytes)
            clear(w, zero, n)
            clear(w, u, 4 + n)
        if base == first or commands_bytes > 0:
            changed[:] = False
            changed[0] = True
            for g in range(groups):
                note_changes(commands0 + g * commands_bytes, n_samples, changed, used)
        now = 0
        filled = 1
        written = 0
        start = force if lagged else constant
        for k in range(n_samples - 1):
            if changed[k]:
                for g in range(groups):
                    w = w0 + g * w_bytes
                    _take_command(w, commands0 + g * commands_bytes, 2 * k * WIDTH, u, e)
                    _drive(w, held, u, used[0], used[1], n, zero, constant)
            for _ in range(substeps):
                for g in range(groups):
                    w = w0 + g * w_bytes
                    if lagged:
                        _drive(w, fading, e, used[0], used[1], n, constant, force)
                        store(w, e, multiply(fade, load(w, e)))
                        store(w, e + WIDTH, multiply(fade, load(w, e + WIDTH)))
                    product(w, phi, z + now, start, z + filled * line, n, 1)
                now = filled * line
                filled += 1
                if filled == SAMPLES:
                    for g in range(groups):
                        w, which = w0 + g * w_bytes, which0 + g * ledger_bytes
                        measure(w, rows, z, line, y, nx, which + 16 * WIDTH)
                        write_block(w, which, target, written)
                    written += SAMPLES * N_CHANNELS
                    filled = 0
        for g in range(groups if filled > 0 else 0):
            w, which = w0 + g * w_bytes, which0 + g * ledger_bytes
            measure(w, rows, z, line, y, nx, which + 16 * WIDTH)
            write_rest(w, which, filled, target, written)
    return -1
