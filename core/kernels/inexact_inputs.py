"""How pilots fly planned commands: uneven, out of trim and unsteady."""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.normals import fill_normals, stream_of

ERRORS, MOVES = np.int64(0), np.int64(1)
"""Streams of a rollout. Not literals, because `stream_of` would be compiled again for each."""


class InexactInputs(NamedTuple):
    """Errors of a pilot, 1 sigma. asymmetry: share of a command.   trim, unsteadiness: [rad].

    fade: remaining share of a small movement after one sample.
    """

    asymmetry: float
    trim: float
    unsteadiness: float
    fade: float


@jit
def fill_commands(seed, planned, before, most, inexact, out, rest, first, last):
    """Fill rows first..last-1 of `out` (n, before + n_samples, 2) with commands [rad] as flown.

    planned: (1 or n, n_samples, 2); trim before it.   rest: (n,) output, samples before the first
    planned input, from 1 to `most`.
    Small movements are stationary first-order processes, one per surface.
    """
    n_flown = out.shape[1]
    errors, moves = np.empty(4), np.zeros(2 * n_flown)
    gain = np.sqrt(1.0 - inexact.fade * inexact.fade)
    for i in range(first, last):
        row = i if len(planned) > 1 else 0
        stream = stream_of(seed, i)
        fill_normals(stream_of(stream, ERRORS), errors)
        if inexact.unsteadiness > 0.0:
            fill_normals(stream_of(stream, MOVES), moves)
        right = 1.0 + inexact.asymmetry * errors[2]
        onset = most
        for s in range(2):
            trim, move = inexact.trim * errors[s], moves[s]
            for k in range(n_flown):
                if k > 0:
                    move = inexact.fade * move + gain * moves[2 * k + s]
                command = trim + inexact.unsteadiness * move
                if k >= before:
                    due = planned[row, k - before, s]
                    if due != 0.0:
                        onset = min(onset, k - before)
                        command += due * (right if due > 0.0 else 2.0 - right)
                out[i, k, s] = command
        rest[i] = max(onset, 1)
