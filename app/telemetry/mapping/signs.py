"""Which way recorded channels point, told from how the aircraft moves; with the evidence in words.

The convention: beta is positive with wind from the right, p right wing down, r nose right, N_y to
the right; positive rudder yaws the nose left (C_n,dr < 0) and positive aileron rolls to the left
(C_l,da < 0), as on the F-16 and the ATTAS. Published models agree on the rudder, not on the
aileron: `expected` says which way the aircraft at hand goes.

Nothing in the motion tells left from right if everything is mirrored: what is found is relative to
the attitude where it was recorded, else to the rates as they are.
"""

from dataclasses import dataclass
from math import radians

from app.telemetry.mapping.motion import Array, Motion, Share
from core.simulation.attitude import SurfaceSigns

CONVENTION = SurfaceSigns(aileron=-1, rudder=-1)
CLEAR = 0.5
"""Of what the other causes leave, a cause must explain this much to have a say."""
FOLLOWS = 0.7
"""The same for a rate that is the derivative of an angle."""
MOVED = radians(0.12)
"""Standard deviation below which a surface, or the sideslip, did not move enough to tell [rad]."""
RATE_MOVED = radians(0.15)
"""The same for a rate [rad/s]."""
MIX_UP = (40.0, 80.0)
"""A ratio of a rate to its angle's derivative in here is degrees taken for radians: 57.3."""


@dataclass(frozen=True)
class Evidence:
    """What the motion says of a channel's sign.

    sign: 1 as it should be, -1 reversed.   proven: whether the channel itself says so.
    times: by how much too large it seems, where its unit is another one; else 1.
    """

    sign: int
    text: str
    proven: bool = True
    times: float = 1.0


def find_signs(
    moves: Motion, expected: SurfaceSigns = CONVENTION, *, yaw_is_known: bool = False
) -> dict[str, Evidence]:
    """Return what can be told, by channel; channels of which nothing can be told are left out.

    yaw_is_known: the sign of r is settled otherwise.
    """
    found: dict[str, Evidence] = {}
    for key, angle in (("p", "phi"), ("r", "psi")):
        if evidence := _rate(moves, key, angle):
            found[key] = evidence
    roll, yaw = (_accelerations(moves, key, found) for key in ("p", "r"))
    if yaw is not None and (evidence := _sideslip(moves, yaw)):
        found["beta"] = evidence
    if evidence := _lateral(moves, "Ny", found):
        found["Ny"] = evidence
    rudder = _surface(moves, yaw, "delta_r", expected.rudder, ("yaws the nose", "yaw"))
    aileron = _surface(moves, roll, "delta_a", expected.aileron, ("rolls", "roll"))
    if rudder:
        found["delta_r"] = rudder
    if aileron:
        found["delta_a"] = aileron
    elif rudder and rudder.sign * expected.rudder > 0 and "delta_a" in moves.values:
        found["delta_a"] = _like_the_rudder(expected)
    return found if yaw_is_known else _fewest(found)


def _fewest(found: dict[str, Evidence]) -> dict[str, Evidence]:
    """Where all that is told against an unproven yaw rate is reversed, it is the yaw rate."""
    against = ("beta", "Ny", "delta_r")
    if "r" in found or any(key not in found or found[key].sign > 0 for key in against):
        return found
    text = "reversed, as sideslip, lateral acceleration and rudder would all have to be otherwise"
    agrees = Evidence(1, "its sign agrees with the motion once the yaw rate is reversed")
    return found | dict.fromkeys(against, agrees) | {"r": Evidence(-1, text)}


def _rate(moves: Motion, key: str, angle: str) -> Evidence | None:
    """A body rate against the derivative of the angle that it turns."""
    if key not in moves.values or angle not in moves.values or moves.spread(key) < RATE_MOVED:
        return None
    share = moves.shares(moves.values[key], {angle: moves.rates[angle]}).get(angle)
    if share is None or share.share < FOLLOWS:
        return None
    size = abs(share.slope)
    times = 1.0
    if MIX_UP[0] < size < MIX_UP[1] or MIX_UP[0] < 1.0 / size < MIX_UP[1]:
        times = size
    how = f"{share.slope:+.2f} times d({angle})/dt, by which {share.share:.0%} of it is explained"
    if share.slope > 0.0:
        return Evidence(1, f"its sign agrees with the attitude: {how}", times=times)
    return Evidence(-1, f"reversed, as it goes against the attitude: {how}", times=times)


def _accelerations(moves: Motion, key: str, found: dict[str, Evidence]) -> Array | None:
    """Angular acceleration about an axis, in the convention's direction [rad/s2]."""
    if key not in moves.values:
        return None
    return moves.rates[key] * (found[key].sign if key in found else 1)


def _causes(moves: Motion, *keys: str) -> dict[str, Array]:
    return {key: moves.values[key] for key in keys if key in moves.values}


def _sideslip(moves: Motion, yaw: Array) -> Evidence | None:
    """Weathercock stability: wind from the right yaws the nose to the right."""
    if moves.spread("beta") < MOVED:
        return None
    causes = _causes(moves, "beta", "p", "r", "delta_a", "delta_r")
    share = moves.shares(yaw, causes).get("beta")
    if share is None or share.share < CLEAR:
        return None
    how = f"{share.slope:+.2g} rad/s^2 of yaw a rad, {share.share:.0%} of what the rest leaves"
    if share.slope > 0.0:
        return Evidence(1, f"its sign agrees with weathercock stability: {how}")
    return Evidence(-1, f"reversed, as the nose would turn out of the wind: {how}")


def _lateral(moves: Motion, key: str, found: dict[str, Evidence]) -> Evidence | None:
    """Side force: wind from the right pushes to the left."""
    if key not in moves.values or moves.spread("beta") < MOVED:
        return None
    causes = _causes(moves, "beta", "p", "r", "delta_a", "delta_r")
    if "phi" in moves.values:
        causes["gravity"] = moves.gravity
    share = moves.shares(moves.values[key], causes).get("beta")
    if share is None or share.share < CLEAR:
        return None
    slope = share.slope * (found["beta"].sign if "beta" in found else 1)
    how = f"{slope:+.2g} g a rad of sideslip, {share.share:.0%} of what the rest leaves"
    if slope < 0.0:
        return Evidence(1, f"its sign agrees with the sideslip: {how}")
    return Evidence(-1, f"reversed, as wind from the right would push to the right: {how}")


def _surface(
    moves: Motion, acceleration: Array | None, key: str, expected: int, words: tuple[str, str]
) -> Evidence | None:
    """A surface against the angular acceleration that it makes."""
    other = "delta_a" if key == "delta_r" else "delta_r"
    if acceleration is None or moves.spread(key) < MOVED:
        return None
    if "beta" not in moves.values and moves.spread(key) < moves.spread(other):
        # without the sideslip only the surface that leads the motion can be told from its answer
        return None
    causes = _causes(moves, key, "p", "r", other, "beta")
    share = moves.shares(acceleration, causes).get(key)
    if share is None or share.share < CLEAR:
        return None
    return _against(share, expected, words, {"delta_r": "rudder", "delta_a": "aileron"}[key])


def _against(share: Share, expected: int, words: tuple[str, str], name: str) -> Evidence:
    does, axis = words
    goes, should = (("right" if sign > 0 else "left") for sign in (share.slope, expected))
    how = (
        f"{share.slope:+.2g} rad/s^2 of {axis} a rad, {share.share:.0%} of what rates"
        " and the other channels leave"
    )
    if share.slope * expected > 0.0:
        return Evidence(
            1, f"its sign agrees with the convention: positive {name} {does} {goes} ({how})"
        )
    return Evidence(
        -1, f"reversed: positive {name} {does} {goes} here ({how}), and {should} by convention"
    )


def _like_the_rudder(expected: SurfaceSigns) -> Evidence:
    """A recorder that turns right at positive rudder counts moments, and so for the aileron."""
    sign = 1 if expected.aileron > 0 else -1
    what = "reversed like the rudder" if sign < 0 else "left as it is"
    return Evidence(
        sign,
        f"{what}: its own answer cannot be told here, but a recorder whose positive rudder yaws "
        "right counts deflections by the moment they make; check it on a record with aileron",
        proven=False,
    )
