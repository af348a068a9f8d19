"""Simple p-values of a trajectory, without its scores.

Most samples of most flights score above every calibration score and share the lowest p-value. A
bound on their score shows this, as in `core.kernels.peak_risk`, so few neighbours are searched.
"""

import numpy as np

from core.kernels.assessing import SAMPLES_A_TASK, Fitted, rule_of, score_point
from core.kernels.compiled import in_chunks, jit
from core.kernels.mapping import map_observation
from core.kernels.nearest import locate, nearest_at, squared_distance_at
from core.kernels.p_value import simple_p
from core.kernels.peak_risk import ROUNDING, distance_between
from core.types import Array, Flags


@jit
def _p_some(fitted, y, ok, n_delay, start, stop, p):
    z, anchor = np.empty(fitted.d), np.zeros(fitted.d)
    rule, unsafe_at, safe_at = rule_of(fitted), locate(fitted.unsafe), locate(fitted.safe)
    a, b, channel = rule
    bounded = channel < 0 and a > 0.0 and b > 0.0
    n_finite = np.searchsorted(fitted.alphas, np.inf)
    highest = fitted.alphas[n_finite - 1] if n_finite > 0 else -np.inf
    lowest_p = (fitted.alphas.shape[0] - n_finite + 1) / (fitted.alphas.shape[0] + 1)
    near_unsafe, near_safe = -1, -1
    to_unsafe, safe = 0.0, np.inf
    for i in range(start, stop):
        if not ok[i]:
            continue
        map_observation(fitted, y, i, n_delay, z)
        if not bounded:
            s, near_unsafe, near_safe = score_point(
                rule, unsafe_at, safe_at, z, -1, near_unsafe, near_safe
            )
            p[i] = simple_p(fitted.alphas, s)
            continue
        # Any safe point bounds the distance to the nearest one: use the last neighbour. A step
        # away from the anchor changes the distance to the nearest unsafe one by at most its length.
        safe = b * squared_distance_at(safe_at, z, near_safe) if near_safe >= 0 else np.inf
        at_least = (1.0 - ROUNDING) * to_unsafe - (1.0 + ROUNDING) * distance_between(z, anchor)
        if a * max(at_least, 0.0) ** 2 - safe > highest:
            p[i] = lowest_p
            continue
        distance, near_unsafe = nearest_at(unsafe_at, z, -1, near_unsafe)
        anchor[:] = z
        to_unsafe = np.sqrt(distance)
        if a * distance - safe > highest:
            p[i] = lowest_p
            continue
        safe, near_safe = nearest_at(safe_at, z, -1, near_safe)
        p[i] = simple_p(fitted.alphas, a * distance - b * safe)


def simple_p_values(fitted: Fitted, y: Array, ok: Flags, n_delay: int) -> Array:
    """Simple p-value of each sample, bit for bit that of its score; NaN unless ok.

    y: (n, 6).   ok: (n,) whether the sample has a full history.   Returns (n,).
    """
    p = np.full(len(y), np.nan)
    in_chunks(len(y), SAMPLES_A_TASK, lambda a, b: _p_some(fitted, y, ok, n_delay, a, b, p))
    return p
