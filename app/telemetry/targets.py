"""The quantities that a recording can hold: what a signal of a file can be mapped to."""

from dataclasses import dataclass

from core.channels import CHANNELS


@dataclass(frozen=True)
class Target:
    """A quantity that a signal can be mapped to. unit: the one it is stored in."""

    key: str
    symbol: str
    unit: str
    label: str


ATTITUDE_TARGETS = (
    Target("phi", "φ", "rad", "bank angle"),
    Target("theta", "θ", "rad", "pitch angle"),
    Target("psi", "ψ", "rad", "heading"),
)
CONDITION_TARGETS = (
    Target("V", "V", "m/s", "true airspeed"),
    Target("h", "h", "m", "altitude"),
)
INGREDIENTS = (
    Target("v", "v", "m/s", "lateral velocity"),
    Target("Ay", "a_y", "g", "lateral acceleration, gravity included"),
    Target("delta_a_left", "δ_a,l", "rad", "left aileron"),
    Target("delta_a_right", "δ_a,r", "rad", "right aileron"),
    Target("delta_r_left", "δ_r,l", "rad", "left rudder"),
    Target("delta_r_right", "δ_r,r", "rad", "right rudder"),
    Target("q0", "q_0", "1", "attitude quaternion, scalar part"),
    Target("q1", "q_1", "1", "attitude quaternion, forward part"),
    Target("q2", "q_2", "1", "attitude quaternion, right part"),
    Target("q3", "q_3", "1", "attitude quaternion, down part"),
)
"""Only used to derive other channels."""
TARGETS: dict[str, Target] = {
    target.key: target
    for target in (
        *(Target(c.key, c.symbol, c.unit, c.label) for c in CHANNELS),
        *ATTITUDE_TARGETS,
        *CONDITION_TARGETS,
        *INGREDIENTS,
    )
}
