"""The closed loop of aircraft, actuators and control law, for eight rollouts at a time.

State z = (plant states, delta_a, delta_r, law states), n numbers; z_dot = F z + bandwidth pilot,
with the pilot on the rows of the surfaces. Measured: (beta, p, r, Ny, delta_a, delta_r, phi) = rows
(x, delta); the surface rows of C and D are not read. control_law.closed_loops is the same in numpy.
A matrix of lanes is flat: entry (i, j) is the eight numbers from 8 (i columns + j).
"""

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import WIDTH, fma, load, read_integer, splat, store, total, write

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
