"""A pilot in the loop: commands from the errors of tracked axes, as they were seen a moment ago.

One pilot at a time, at each sample, with the target from trim and the angle y that is seen:
u = K (1 + a / s) (1 + T_L s) / (1 + T_I s) / (1 + T_N s) e^(-tau s) (target - y - noise) (McRuer
and Krendel, AGARD-AG-188), with s = (1 - z^-1) / dt and the delay linear between samples. Addresses
replace arrays, as in `lanes`: numba would count references at each sample.
"""

import math
from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import WIDTH, address, read, read_integer, write, write_integer
from core.types import Array, Indices

SURFACE, OUTPUT, STEP, CAPTURES, LEAD, LAG, TRIM, PER_AXIS = range(8)
ARM, DELAY, GAIN = range(3)
(
    NOW,
    SEEN,
    LED,
    MOVED,
    HELD,
    ANGLE,
    RATE,
    BEYOND,
    SIDE,
    SINCE,
    SWINGS,
    TARGET,
    PENDING,
    REMEMBERED,
) = range(14)
"""What a pilot remembers of an axis before the errors of all samples: output now; error seen, the
equalised one, what the arm made of it, and what is trimmed away; integrated angle, and its rate;
samples beyond the bound; side, last sample and number of swings; target, and the side from which
it is still to be captured, 0 once it is."""
MOST_SWINGS = 4
"""Swings to alternate sides that make an oscillation: two cycles."""


class Pilots(NamedTuple):
    """Pilots who each track n_axes axes; n_axes = 0: no pilot is in the loop.

    axes: (n_axes, PER_AXIS) column of the command; number of the output seen; [s] of integration
    where that is a rate, else 0; 1 if the command is the axis's target [rad], 0 if the axis is kept
    at trim and the pilot adds to the command; T_L and T_I [samples]; a [1 / sample].
    own: (n, GAIN + n_axes) T_N and tau [samples], and the gain of each axis.
    noise: (n, n_axes, n_samples) [rad].
    accepts: (4,) error [rad], and samples beyond it after which a pilot gives up; the same for an
    oscillation with this amplitude [rad] and at most so many samples between opposite swings. A
    new target is judged once it is captured: its error reached the other side, or the bounds.
    gave_up: (n,) output, the sample at which a pilot gave up, n_samples for never.
    """

    axes: Array
    own: Array
    noise: Array
    accepts: Array
    gave_up: Indices

    def some(self, which: Indices | slice) -> "Pilots":
        if not len(self.axes):
            return self
        own, noise = self.own[which], self.noise[which]
        return Pilots(self.axes, own, noise, self.accepts, self.gave_up[which])


NOBODY = Pilots(
    np.empty((0, PER_AXIS)),
    np.empty((0, GAIN)),
    np.empty((0, 0, 0)),
    np.empty(4),
    np.empty(0, np.int64),
)


def memory_of(pilots: Pilots) -> int:
    """Memory of one pilot [numbers]."""
    return len(pilots.axes) * (REMEMBERED + pilots.noise.shape[2])


class Seats(NamedTuple):
    """Addresses of `Pilots`, and of the memory of those who fly now."""

    n_axes: int
    n_samples: int
    axes: int
    own: int
    noise: int
    accepts: int
    gave_up: int
    memory: int


@jit
def seats(pilots, memory):
    """memory: address of `memory_of` numbers of each pilot who flies at a time."""
    axes, own, noise, accepts, gave_up = pilots
    return Seats(
        noise.shape[1],
        noise.shape[2],
        address(axes),
        address(own),
        address(noise),
        address(accepts),
        address(gave_up),
        memory,
    )


@jit
def place_of(seat, number, axis):
    """Position of an axis in the memory of pilot `number` of those who fly now."""
    return (number * seat.n_axes + axis) * (REMEMBERED + seat.n_samples)


@jit
def steer(seat, number, i, k, commands, at, stride):
    """Replace the planned commands of pilot i at sample k; sample 0 clears the memory.

    The memory holds the outputs NOW, from trim.   at, stride: position of the commands, and
    between those of two surfaces.
    """
    n, m = seat.n_samples, seat.memory
    bound, patience = read(seat.accepts, 0), read(seat.accepts, 1)
    swing, within = read(seat.accepts, 2), read(seat.accepts, 3)
    own = i * (GAIN + seat.n_axes)
    arm, delay = read(seat.own, own + ARM), read(seat.own, own + DELAY)
    whole = int(delay)
    between = delay - whole
    if k == 0:
        write_integer(seat.gave_up, i, n)
    for a in range(seat.n_axes):
        about, errors = a * PER_AXIS, place_of(seat, number, a) + REMEMBERED
        last = errors - REMEMBERED
        if k == 0:
            for j in range(SEEN, REMEMBERED):
                write(m, last + j, 0.0)
        angle, step = read(m, last + NOW), read(seat.axes, about + STEP)
        if step > 0.0:
            rate = angle
            angle = read(m, last + ANGLE) + 0.5 * step * (read(m, last + RATE) + rate)
            write(m, last + ANGLE, angle)
            write(m, last + RATE, rate)
        place = at + stride * int(read(seat.axes, about + SURFACE))
        command, error = read(commands, place), -angle
        if read(seat.axes, about + CAPTURES) > 0.0:
            target, command, error = command, 0.0, command - angle
            if abs(target - read(m, last + TARGET)) > min(bound, swing):
                write(m, last + TARGET, target)
                write(m, last + PENDING, math.copysign(1.0, error))
            if abs(error) <= min(bound, swing) or error * read(m, last + PENDING) < 0.0:
                write(m, last + PENDING, 0.0)
        write(m, errors + k, error - read(seat.noise, (i * seat.n_axes + a) * n + k))
        now = read(m, errors + k - whole) if k >= whole else 0.0
        earlier = read(m, errors + k - whole - 1) if k > whole else 0.0
        now += between * (earlier - now)
        lead, lag = read(seat.axes, about + LEAD), read(seat.axes, about + LAG)
        led = (lead + 1.0) * now - lead * read(m, last + SEEN) + lag * read(m, last + LED)
        led /= lag + 1.0
        moved = (led + arm * read(m, last + MOVED)) / (arm + 1.0)
        write(m, last + SEEN, now)
        write(m, last + LED, led)
        write(m, last + MOVED, moved)
        held = read(m, last + HELD) + read(seat.axes, about + TRIM) * moved
        write(m, last + HELD, held)
        write(commands, place, command + read(seat.own, own + GAIN + a) * (moved + held))
        if read(m, last + PENDING) != 0.0:
            write(m, last + BEYOND, 0.0)
            write(m, last + SIDE, 0.0)
            write(m, last + SWINGS, 0.0)
            continue
        beyond = 0.0 if abs(error) <= bound else read(m, last + BEYOND) + 1.0
        write(m, last + BEYOND, beyond)
        swings = read(m, last + SWINGS)
        if abs(error) >= swing:
            if error * read(m, last + SIDE) <= 0.0:
                swings = swings + 1.0 if k - read(m, last + SINCE) <= within else 1.0
                write(m, last + SWINGS, swings)
                write(m, last + SIDE, math.copysign(1.0, error))
            write(m, last + SINCE, float(k))
        if beyond >= patience or swings >= MOST_SWINGS:
            write_integer(seat.gave_up, i, min(read_integer(seat.gave_up, i), k))


@jit
def steer_lanes(seat, first, w, rows, z, n_measured, which, commands, k):
    """The same for eight pilots, numbers from `first`, with outputs and commands in lanes.

    rows, z: positions of the measured rows (n_measured,) each, and of the state.
    """
    for lane in range(WIDTH):
        for a in range(seat.n_axes):
            output = int(read(seat.axes, a * PER_AXIS + OUTPUT))
            row, seen = rows + output * n_measured * WIDTH + lane, 0.0
            for j in range(n_measured):
                seen += read(w, row + j * WIDTH) * read(w, z + j * WIDTH + lane)
            write(seat.memory, place_of(seat, first + lane, a) + NOW, seen)
        at = 2 * k * WIDTH + lane
        steer(seat, first + lane, read_integer(which, lane), k, commands, at, WIDTH)
