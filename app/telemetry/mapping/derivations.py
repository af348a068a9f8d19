"""Derive channels that were not recorded from others. They are always marked as derived."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from app.telemetry.recording import GAP_RATIO, Trace
from app.telemetry.targets import TARGETS
from core.types import Array, Indices

HALF_WINDOW_S = 0.1
"""A slope uses samples this far to either side, at least one [s]."""
MOST_TERMS = 10
"""Most samples to either side for a slope, evenly spread."""


def slopes(t: Array, x: Array) -> Array:
    """dx/dt (n,): slope of the least-squares line through the samples within HALF_WINDOW_S.

    A sine of f [Hz] keeps 1 - (2 pi f HALF_WINDOW_S)^2 / 10 of its slope, without delay. White
    noise of sigma at n samples per second becomes sigma sqrt(12 / (n T^3)), T being the whole
    window; the difference of neighbours would give sigma n sqrt(2).
    t: (n,) in any order; the first of equal times counts.   x: (n,) NaN if missing. The slope is
    NaN there, and for a sample without a neighbour on its side of a gap.
    """
    slope = np.full(len(t), np.nan)
    order = _usable(t, x)
    if len(order) < 2:
        return slope
    slope[order] = _line_slopes(t[order], x[order])
    return slope


def _line_slopes(t: Array, x: Array) -> Array:
    """Slope of the line through the window of each sample, NaN if alone. t: increasing."""
    steps = np.diff(t)
    step = float(np.median(steps))
    segment = np.concatenate([[0], np.cumsum(steps > GAP_RATIO * step)])
    reach = max(1, int(HALF_WINDOW_S / step + 1e-6))
    offsets = np.unique(np.linspace(1, reach, min(reach, MOST_TERMS)).round().astype(int))
    # sums over the window, relative to its middle sample
    n, st, sx = np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))
    stt, stx = np.zeros(len(t)), np.zeros(len(t))
    for offset in (*-offsets[::-1], *offsets):
        base = slice(max(0, -offset), len(t) - max(0, offset))
        neighbour = slice(max(0, offset), len(t) - max(0, -offset))
        if base.start >= len(t) or neighbour.start >= len(t):
            continue
        within = segment[base] == segment[neighbour]
        dt = np.where(within, t[neighbour] - t[base], 0.0)
        dx = np.where(within, x[neighbour] - x[base], 0.0)
        for total, term in ((n, within), (st, dt), (sx, dx), (stt, dt * dt), (stx, dt * dx)):
            total[base] += term
    spread = stt - st * st / n
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(spread > 0.0, (stx - st * sx / n) / spread, np.nan)


def values_at(at: Array, t: Array, x: Array) -> Array:
    """Linear interpolation of (t, x) at times in any order: (n,).

    NaN before the first and after the last sample, in gaps and next to a missing value.
    """
    order = _usable(t, x, missing=True)
    if len(order) < 2:
        return np.full(len(at), np.nan)
    t, x = t[order], x[order]
    steps = np.diff(t)
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    values = np.interp(at, t, x, left=np.nan, right=np.nan)
    open_ = steps[after - 1] > GAP_RATIO * float(np.median(steps))
    on_sample = (at == t[after]) | (at == t[after - 1])
    values[open_ & ~on_sample] = np.nan
    values[~np.isfinite(at)] = np.nan
    return values


def unwrapped(t: Array, angle: Array) -> Array:
    """An angle [rad] without jumps of a full turn, in the order of its times."""
    order = _usable(t, angle)
    free = angle.copy()
    free[order] = np.unwrap(angle[order])
    return free


def _usable(t: Array, x: Array, *, missing: bool = False) -> Indices:
    """Samples with finite values in the order of time, the first of equal times."""
    usable = np.isfinite(t) if missing else np.isfinite(t) & np.isfinite(x)
    if usable.all() and bool((np.diff(t) > 0.0).all()):
        return np.arange(len(t))
    order = np.flatnonzero(usable)
    order = order[np.argsort(t[order], kind="stable")]
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(t[order]) > 0.0
    return order[first]


Inputs = dict[str, Array]
"""Key of TARGETS -> (n,) in its unit, all on the same times."""


@dataclass(frozen=True)
class Derivation:
    """A way to compute one channel from others.

    needs: required keys of TARGETS; the result is on the times of the first.
    helps: keys that make it more accurate; all are used, or none.
    title: in words.   apply: (times (n,) [s], inputs) -> (n,).
    """

    key: str
    target: str
    needs: tuple[str, ...]
    title: str
    apply: Callable[[Array, Inputs], Array] = field(repr=False)
    helps: tuple[str, ...] = ()


def ways(key: str) -> str:
    """Possible inputs of a channel in words: "v and V (...)"; "" if it has no derivation."""
    return ", or ".join(
        f"{' and '.join(way.needs)} ({way.title})"
        for way in DERIVATIONS.values()
        if way.target == key
    )


def derive(way: Derivation, traces: Mapping[str, Trace]) -> Trace:
    """Compute a channel from traces, which include all that it needs."""
    helps = way.helps if all(key in traces for key in way.helps) else ()
    first = traces[way.needs[0]]
    inputs = {key: on_times_of(first, traces[key], key) for key in (*way.needs, *helps)}
    sources = {key: traces[key].source for key in inputs}
    names = [key if source == key else f"{source} as {key}" for key, source in sources.items()]
    source = f"derived: {way.title}, from {', '.join(names)}"
    values, unit = way.apply(first.t, inputs), TARGETS[way.target].unit
    return Trace(first.t, values, first.group, source, derived=True, unit=unit)


def on_times_of(first: Trace, other: Trace, key: str) -> Array:
    """Values of another trace at the times of the first, NaN in gaps."""
    if other.t is first.t:
        return other.values
    if key not in ("phi", "psi"):
        return values_at(first.t, other.t, other.values)
    # do not interpolate across a jump of a full turn
    return values_at(first.t, other.t, unwrapped(other.t, other.values))


def _ratio(above: Array, below: Array) -> Array:
    """Quotient; NaN if undefined or above 1 in magnitude, which no sine can be."""
    with np.errstate(invalid="ignore", divide="ignore"):
        quotient = above / below
        return np.where(np.abs(quotient) <= 1.0, quotient, np.nan)


def _beta(t: Array, given: Inputs) -> Array:
    return np.arcsin(_ratio(given["v"], given["V"]))


def _p(t: Array, given: Inputs) -> Array:
    rate = slopes(t, unwrapped(t, given["phi"]))
    if "psi" not in given:
        return rate
    return rate - slopes(t, unwrapped(t, given["psi"])) * np.sin(given["theta"])


def _r(t: Array, given: Inputs) -> Array:
    turn = slopes(t, unwrapped(t, given["psi"]))
    if "phi" not in given:
        return turn
    phi, theta = given["phi"], given["theta"]
    return turn * np.cos(theta) * np.cos(phi) - slopes(t, theta) * np.sin(phi)


def _without_gravity(t: Array, given: Inputs) -> Array:
    level = np.cos(given["theta"]) if "theta" in given else 1.0
    return given["Ay"] - np.sin(given["phi"]) * level


def _quaternion(given: Inputs) -> tuple[Array, Array, Array, Array]:
    """Scalar first, normalised; NaN if the length is far from 1."""
    q = np.array([given[key] for key in ("q0", "q1", "q2", "q3")])
    length = np.sqrt((q * q).sum(axis=0))
    q0, q1, q2, q3 = q / np.where(np.abs(length - 1.0) < 0.1, length, np.nan)
    return q0, q1, q2, q3


def _phi_of_q(t: Array, given: Inputs) -> Array:
    q0, q1, q2, q3 = _quaternion(given)
    return np.arctan2(2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q1 * q1 + q2 * q2))


def _theta_of_q(t: Array, given: Inputs) -> Array:
    q0, q1, q2, q3 = _quaternion(given)
    return np.arcsin(np.clip(2.0 * (q0 * q2 - q3 * q1), -1.0, 1.0))


def _psi_of_q(t: Array, given: Inputs) -> Array:
    q0, q1, q2, q3 = _quaternion(given)
    return np.arctan2(2.0 * (q0 * q3 + q1 * q2), 1.0 - 2.0 * (q2 * q2 + q3 * q3))


_SLOPE = f"slopes over {2 * HALF_WINDOW_S:g} s, which use {HALF_WINDOW_S:g} s of future samples"
_Q = ("q0", "q1", "q2", "q3")
_A, _R = ("delta_a_right", "delta_a_left"), ("delta_r_left", "delta_r_right")
DERIVATIONS: dict[str, Derivation] = {
    way.key: way
    for way in (
        Derivation(
            "beta_from_velocity", "beta", ("v", "V"),
            "sideslip as the arc sine of lateral velocity over airspeed", _beta,
        ),
        Derivation(
            "p_from_attitude", "p", ("phi",),
            f"roll rate from attitude rates ({_SLOPE})", _p, ("theta", "psi"),
        ),
        Derivation(
            "r_from_attitude", "r", ("psi",),
            f"yaw rate from attitude rates ({_SLOPE})", _r, ("phi", "theta"),
        ),
        Derivation(
            "Ny_without_gravity", "Ny", ("Ay", "phi"),
            "lateral acceleration minus gravity's component sin(phi) cos(theta)", _without_gravity,
            ("theta",),
        ),
        Derivation(
            "delta_a_of_both", "delta_a", _A, "differential: half of right minus left aileron, "
            "each positive trailing edge down, so positive rolls left",
            lambda t, given: 0.5 * (given[_A[0]] - given[_A[1]]),
        ),
        Derivation(
            "delta_a_of_right", "delta_a", _A[:1], "right aileron used for both",
            lambda t, given: given[_A[0]].copy(),
        ),
        Derivation(
            "delta_a_of_left", "delta_a", _A[1:], "left aileron, reversed, used for both",
            lambda t, given: -given[_A[1]],
        ),
        Derivation(
            "delta_r_of_both", "delta_r", _R, "symmetric: mean of left and right rudder, each "
            "positive trailing edge left, so positive yaws left",
            lambda t, given: 0.5 * (given[_R[0]] + given[_R[1]]),
        ),
        Derivation(
            "delta_r_of_left", "delta_r", _R[:1], "left rudder used for both",
            lambda t, given: given[_R[0]].copy(),
        ),
        Derivation(
            "delta_r_of_right", "delta_r", _R[1:], "right rudder used for both",
            lambda t, given: given[_R[1]].copy(),
        ),
        Derivation("phi_from_quaternion", "phi", _Q, "bank angle from the quaternion", _phi_of_q),
        Derivation("theta_from_quaternion", "theta", _Q, "pitch from the quaternion", _theta_of_q),
        Derivation("psi_from_quaternion", "psi", _Q, "heading from the quaternion", _psi_of_q),
    )
}  # fmt: skip
assert all({way.target, *way.needs, *way.helps} <= TARGETS.keys() for way in DERIVATIONS.values())
