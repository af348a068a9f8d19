"""Restore an even clock whose times were rounded when written: milliseconds, float32, seconds.

Times are restored only if an even clock and one rounding explain all of them. Others, even if
nearly even, stay as recorded.
"""

import numpy as np

from core.types import Array, Indices

FEWEST = 20
"""Fewest times that show a pattern."""
FEWEST_ODD = 5
"""Fewest steps of the rarer length; fewer are a slip of the clock or lost or repeated rows."""
SHARE_ODD = 0.1
"""The same as a share, for rounding so coarse that it looks like lost or repeated rows."""
PROBE = 2_000
"""Steps that are checked first: rounded steps have few different lengths."""
MOST_LENGTHS = 100


def evened(t: Array) -> tuple[Array, float] | None:
    """The even clock behind rounded times and the unit of the rounding [s]; None if there is no
    such clock or nothing to restore.

    t: (n,) in order; neighbours may be equal, as coarse rounding makes them. After lost samples
    the clock continues in whole steps if that explains the times, otherwise it starts anew.
    """
    if len(t) < FEWEST:
        return None
    steps = np.diff(t)
    noise = max(8.0 * float(np.spacing(np.abs(t).max())), 1e-12)
    lengths = _lengths(steps[:PROBE], noise)
    if len(lengths) > MOST_LENGTHS:
        return None
    lengths = _lengths(steps, noise)
    if not 1 < len(lengths) <= 10 * MOST_LENGTHS:
        return None
    units = [float(np.diff(lengths).min())]
    if (t == t.astype(np.float32)).all():
        units.append(float(np.spacing(np.float32(np.abs(t).max()))))
    unit = max(units) + noise
    usual = max(float(np.median(steps)), float(steps[steps <= 1.5 * lengths[1]].mean()))
    short = int((steps <= lengths[0] + 2.0 * noise).sum())
    odd = short if lengths[0] <= noise else min(short, len(steps) - short)
    if odd < max(FEWEST_ODD, SHARE_ODD * len(steps) if unit > 0.5 * usual else 0.0):
        return None
    starts = np.flatnonzero(np.concatenate([[True], steps > 1.5 * usual + unit]))
    if 4 * len(starts) > len(t):
        return None
    clock = _clock(t, starts, unit)
    if clock is None or not (np.diff(clock) > 0.0).all():
        return None
    return clock, max(units)


def _lengths(steps: Array, noise: float) -> Array:
    """Different lengths of steps, beyond floating-point rounding."""
    units = np.unique(np.rint(steps / noise))
    return units[np.diff(units, prepend=-np.inf) > 2.0] * noise


def _clock(t: Array, starts: Indices, unit: float) -> Array | None:
    """Times on one even step, with whole steps between the parts if possible."""
    part = np.zeros(len(t), np.intp)
    part[starts[1:]] = 1
    part = np.cumsum(part)
    index = np.arange(len(t)) - starts[part]
    for step in _candidates(t, index, starts, part):
        rest = t - step * index
        middle = 0.5 * (np.maximum.reduceat(rest, starts) + np.minimum.reduceat(rest, starts))
        if np.abs(rest - middle[part]).max() > 0.5 * unit:
            continue
        place = index + np.rint((middle - middle[0]) / step)[part]
        rest = t - step * place
        origin, slack = 0.5 * (rest.max() + rest.min()), 0.5 * (unit - rest.max() + rest.min())
        if slack < 0.0:
            return middle[part] + step * index
        return (t[0] if abs(t[0] - origin) <= slack else origin) + step * place
    return None


def _candidates(t: Array, index: Indices, starts: Indices, part: Indices) -> list[float]:
    """Steps to try: round values near the least-squares step, then that step itself."""
    sizes = np.diff(np.append(starts, len(t)))
    i = index - (0.5 * (sizes - 1))[part]
    at = t - (np.add.reduceat(t - t[0], starts) / sizes)[part] - t[0]
    best = float((i * at).sum() / (i * i).sum())
    if not best > 0.0:
        return []
    rates = (np.rint(1.0 / best), np.rint(10.0 / best) / 10.0, np.rint(100.0 / best) / 100.0)
    steps = [*(1.0 / rate for rate in rates if rate > 0), float(np.round(best, 4)), best]
    return [step for step in steps if step > 0.0]
