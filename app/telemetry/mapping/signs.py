"""Signs, gravity and bias of recorded channels by the motion, with evidence in words.

Convention: beta is positive with wind from the right, p right wing down, r nose right, N_y to the
right; positive rudder yaws the nose left (C_n,dr < 0) and positive aileron rolls left (C_l,da < 0),
as on the F-16 and the ATTAS. Published models agree on the rudder but not on the aileron:
`expected` gives the response of the aircraft at hand.

If everything is mirrored, the motion does not show it. So signs are relative to the attitude, or to
the rates if there is no attitude. A bank angle that contradicts all other channels is reversed.
"""

from dataclasses import dataclass, replace
from math import radians

import numpy as np

from app.telemetry.mapping.motion import ANGLE_OF, Motion, PartialEffect, sideslip_balance
from app.telemetry.recording import Trace
from core.simulation.attitude import SurfaceSigns
from core.types import Array

CONVENTION = SurfaceSigns(aileron=-1, rudder=-1)
CLEAR = 0.5
"""Share of the variation left by other causes that a cause must explain to show a sign."""
SIGNIFICANT = 3.0
"""Least multiple of its standard error of an effect that shows a sign."""
LEAST_SIZE = 0.05
"""The same for its size: [rad/s2] of angular acceleration or [g] of side force per rad. All
published aircraft have more; less, as in a stall, says nothing about a sign."""
FOLLOWS = 0.7
"""The same for a rate against the derivative of its angle."""
MOVED = radians(0.12)
"""Least standard deviation of a surface or the sideslip that shows a sign [rad]."""
RATE_MOVED = radians(0.15)
"""The same for a rate [rad/s]."""
SURFACES = {
    "delta_r": ("rudder", "yaws the nose", "yaw", "delta_a"),
    "delta_a": ("aileron", "rolls", "roll", "delta_r"),
}
"""By surface: its name, what it does, the axis, the other surface."""
WRONG_SCALE = {"p": 2.0, "r": 3.5}
"""A rate is in a wrong unit, or another quantity, if its ratio to the derivative of its angle is
beyond this or its inverse. In a bank r is smaller by cos(phi)."""


@dataclass(frozen=True)
class SignEvidence:
    """Sign of a channel according to the motion.

    sign: 1 correct, -1 reversed.   proven: by the channel itself.   times: ratio of a rate to the
    derivative of its angle if that shows a wrong unit or quantity; otherwise 1.
    """

    sign: int
    text: str
    proven: bool = True
    times: float = 1.0


def find_signs(
    moves: Motion, expected: SurfaceSigns = CONVENTION, *, yaw_is_known: bool = False
) -> dict[str, SignEvidence]:
    """Evidence by channel; channels without evidence are omitted.

    yaw_is_known: whether the sign of r is confirmed.
    """
    signs: dict[str, SignEvidence] = {}

    def add(key: str, evidence: SignEvidence | None) -> SignEvidence | None:
        if evidence:
            signs[key] = evidence
        return evidence

    for key in ANGLE_OF:
        add(key, _rate(moves, key))
    yaw = _accelerations(moves, "r", signs)
    add("beta", _sideslip(moves, yaw))
    add("Ny", _lateral(moves, signs))
    rudder = add("delta_r", _surface(moves, yaw, "delta_r", expected.rudder))
    roll = _accelerations(moves, "p", signs)
    aileron = _surface(moves, roll, "delta_a", expected.aileron)
    if aileron and aileron.sign < 0 and _bank_is_odd(moves, signs):
        # reverse the bank angle instead of roll rate and aileron
        text = "its sign agrees with the aileron, and with the attitude once the bank is reversed"
        signs["p"] = replace(signs["p"], sign=1, text=text)
        text = "reversed: otherwise roll rate and aileron would both be reversed"
        signs["phi"] = SignEvidence(-1, text)
        roll = _accelerations(moves, "p", signs)
        aileron = _surface(moves, roll, "delta_a", expected.aileron)
    if not add("delta_a", aileron) and rudder and rudder.sign * expected.rudder > 0:
        add("delta_a", _like_the_rudder(expected) if "delta_a" in moves.values else None)
    return signs if yaw_is_known else _fewest_reversals(signs)


def _bank_is_odd(moves: Motion, signs: dict[str, SignEvidence]) -> bool:
    """Whether only the bank angle contradicts a roll rate that agrees with the aileron."""
    against = [key for key in signs if signs[key].sign < 0]
    slope = sideslip_balance(moves).get("phi")
    return against == ["p"] and not (slope and slope.low > 0.0)


def _fewest_reversals(signs: dict[str, SignEvidence]) -> dict[str, SignEvidence]:
    """If all evidence that rests on the yaw rate is reversed, reverse the yaw rate instead."""
    dependent = ("beta", "Ny", "delta_r")
    if "r" in signs or any(key not in signs or signs[key].sign > 0 for key in dependent):
        return signs
    text = "reversed: otherwise sideslip, lateral acceleration and rudder would all be reversed"
    agrees = SignEvidence(1, "its sign agrees with the motion once the yaw rate is reversed")
    return signs | dict.fromkeys(dependent, agrees) | {"r": SignEvidence(-1, text)}


def _evidence(
    agrees: bool, with_what: str, otherwise: str, how: str, times: float = 1.0
) -> SignEvidence:
    if agrees:
        return SignEvidence(1, f"its sign agrees with {with_what}: {how}", times=times)
    return SignEvidence(-1, f"reversed, because {otherwise}: {how}", times=times)


def _is_shown(effect: PartialEffect) -> bool:
    """Whether an effect is clear, significant and of the size of an aircraft's."""
    is_clear = effect.share >= CLEAR and effect.sigmas >= SIGNIFICANT
    return is_clear and abs(effect.slope) >= LEAST_SIZE


def _rate(moves: Motion, key: str) -> SignEvidence | None:
    """Compare a body rate with the derivative of its angle."""
    effect = moves.rate_effect(key)
    if effect is None or effect.share < FOLLOWS or moves.spread(key) < RATE_MOVED:
        return None
    angle = ANGLE_OF[key]
    how = f"{effect.slope:+.2f} times d({angle})/dt, which explains {effect.share:.0%} of it"
    otherwise = "it is opposite to the attitude"
    times = effect.size if is_wrong_scale(key, effect.size) else 1.0
    return _evidence(effect.slope > 0.0, "the attitude", otherwise, how, times)


def is_wrong_scale(key: str, size: float) -> bool:
    return not 1.0 / WRONG_SCALE[key] < size < WRONG_SCALE[key]


def _accelerations(moves: Motion, key: str, signs: dict[str, SignEvidence]) -> Array | None:
    """Angular acceleration about an axis, in the direction of the convention [rad/s2]."""
    if key not in moves.values:
        return None
    return moves.rates[key] * (signs[key].sign if key in signs else 1)


def _sideslip(moves: Motion, yaw: Array | None) -> SignEvidence | None:
    """Weathercock stability: wind from the right yaws the nose right."""
    if yaw is None or moves.spread("beta") < MOVED:
        return None
    effect = moves.effect(yaw, "beta", "p", "r", "delta_a", "delta_r")
    if effect is None or not _is_shown(effect):
        return None
    how = f"{effect.slope:+.2g} rad/s^2 of yaw acceleration per rad{_explains(effect)}"
    stability = "weathercock stability"
    return _evidence(effect.slope > 0.0, stability, f"it contradicts {stability}", how)


def _lateral(moves: Motion, signs: dict[str, SignEvidence]) -> SignEvidence | None:
    """Side force: wind from the right pushes left."""
    if moves.spread("beta") < MOVED:
        return None
    effect = moves.effect("Ny", "beta", "p", "r", "delta_a", "delta_r", "gravity")
    if effect is None or not _is_shown(effect):
        return None
    slope = effect.slope * (signs["beta"].sign if "beta" in signs else 1)
    how = f"{slope:+.2g} g per rad of sideslip{_explains(effect)}"
    return _evidence(slope < 0.0, "the sideslip", "wind from the right must push left", how)


def _surface(
    moves: Motion, acceleration: Array | None, key: str, expected: int
) -> SignEvidence | None:
    """Compare a surface with the angular acceleration that it causes.

    The whole recording decides, else the segments that show an effect, if they agree.
    """
    if acceleration is None:
        return None
    effect, name, verb, axis = None, *SURFACES[key][:3]
    if moves.spread(key) >= MOVED:
        effect = _surface_effect(moves, acceleration, key)
    if effect:
        how = _explains(effect)
    else:
        parts = [(moves.part(rows), acceleration[rows]) for rows in moves.segments()]
        moving = [part for part in parts if part[0].spread(key) >= MOVED]
        effects = [effect for part in moving if (effect := _surface_effect(*part, key))]
        if len({effect.slope > 0.0 for effect in effects}) != 1:
            return None
        effect = max(effects, key=lambda effect: effect.sigmas)
        how = (
            f" at {effect.sigmas:.0f} standard errors, in {len(effects)} of {len(moving)} segments "
            "in which it moves"
        )
    measured, usual = (("right" if sign > 0 else "left") for sign in (effect.slope, expected))
    how = f"{effect.slope:+.2g} rad/s^2 of {axis} acceleration per rad{how}"
    if effect.slope * expected > 0.0:
        text = f"its sign agrees with the convention: positive {name} {verb} {measured} ({how})"
        return SignEvidence(1, text)
    text = f"reversed: positive {name} {verb} {measured} here ({how}), but {usual} by convention"
    return SignEvidence(-1, text)


def _surface_effect(moves: Motion, acceleration: Array, key: str) -> PartialEffect | None:
    """Effect of a surface on an angular acceleration, if it is shown."""
    other = SURFACES[key][3]
    if "beta" not in moves.values and moves.spread(key) < moves.spread(other):
        # without sideslip only the surface that leads the motion can be separated from the response
        return None
    effect = moves.effect(acceleration, key, "p", "r", other, "beta")
    return effect if effect and _is_shown(effect) else None


def _explains(effect: PartialEffect) -> str:
    return f", which explains {effect.share:.0%} of the variation left by the other channels"


def _like_the_rudder(expected: SurfaceSigns) -> SignEvidence:
    """If positive rudder yaws right, signs follow moments, also that of the aileron."""
    sign = 1 if expected.aileron > 0 else -1
    change = "reversed like the rudder" if sign < 0 else "not reversed"
    return SignEvidence(
        sign,
        f"{change}: its sign cannot be verified from the motion here, but positive rudder yaws "
        "right, so this recorder seems to count deflections by their moment; check the sign on a "
        "recording with aileron inputs",
        proven=False,
    )


IN_FULL = (0.7, 1.3)
"""Slope on sin(phi) cos(theta) that is gravity, not an uncoordinated manoeuvre [g]."""
OF_GRAVITY = 0.7
"""Share of the variation left by the other channels that gravity must explain."""
BANKED = radians(0.8)
"""Least standard deviation of the bank angle that reveals gravity [rad]."""
QUIET_S = 2.0
"""Time before the manoeuvre [s]."""
QUIET = 0.3
"""Largest scatter of a quiet start, as a share of that of the whole recording."""
MOST_SAMPLES = 20_000
"""Samples used for the scatter of the whole recording."""
STILL = 0.01
"""Smaller scatter is always quiet [g]."""
LEAST_BIAS = 0.02
"""Smaller biases are trim: real aircraft have a side force [g]."""
BEYOND_NOISE = 3.0
ONE_G = (0.85, 1.15)


@dataclass(frozen=True)
class Bias:
    """A constant part of a channel in its unit, with the evidence in words.

    like_gravity: whether it is about 1 g.
    """

    value: float
    text: str
    like_gravity: bool = False


def gravity_effect(moves: Motion) -> PartialEffect | None:
    """Effect of sin(phi) cos(theta) on the lateral acceleration, if it is about 1 g.

    An accelerometer measures specific force, which does not depend on the bank in a coordinated
    turn. Inertial acceleration follows the bank with +1, and with -1 if reversed. In steady
    sideslips specific force also follows with -1.
    """
    if moves.spread("phi") < BANKED:
        return None
    effect = moves.effect("Ny", "gravity", "beta", "delta_r", "p", "r", "delta_a")
    if effect is None or effect.share < OF_GRAVITY:
        return None
    return effect if IN_FULL[0] < abs(effect.slope) < IN_FULL[1] else None


def quiet_bias(trace: Trace) -> Bias | None:
    """A constant value in the quiet first seconds, beyond their noise and any trim."""
    t, values = trace.t, trace.values
    known = np.flatnonzero(np.isfinite(t))
    if not len(known):
        return None
    last = int(np.searchsorted(t[known], t[known[0]] + QUIET_S))
    start = values[known[:last]]
    start = start[np.isfinite(start)]
    if len(start) < 8:
        return None
    mean, noise = float(start.mean()), float(start.std())
    scatter = float(np.nanstd(values[:: 1 + len(values) // MOST_SAMPLES]))
    half = len(start) // 2
    drift = abs(float(start[:half].mean() - start[half:].mean()))
    quiet = max(noise, drift) <= max(QUIET * scatter, STILL)
    if not quiet or abs(mean) <= max(LEAST_BIAS, BEYOND_NOISE * noise):
        return None
    like_gravity = ONE_G[0] < abs(mean) < ONE_G[1]
    text = (
        f"constant bias: its first {QUIET_S:g} s have a mean of {mean:.3g} g and a standard "
        f"deviation of {noise:.2g} g"
    )
    if like_gravity:
        text += ", as large as gravity: check for a normal acceleration or a tilted axis"
    return Bias(float(f"{mean:.6g}"), text, like_gravity)
