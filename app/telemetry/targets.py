"""The quantities that a recording can hold: what a signal of a file can be mapped to."""

from core.channels import CHANNELS, Channel

ATTITUDE_TARGETS = (
    Channel("phi", "φ", "rad", "bank angle"),
    Channel("theta", "θ", "rad", "pitch angle"),
    Channel("psi", "ψ", "rad", "heading"),
)
CONDITION_TARGETS = (
    Channel("V", "V", "m/s", "true airspeed"),
    Channel("h", "h", "m", "altitude"),
)
INGREDIENTS = (
    Channel("v", "v", "m/s", "lateral velocity"),
    Channel("Ay", "a_y", "g", "lateral acceleration, gravity included"),
    Channel("delta_a_left", "δ_a,l", "rad", "left aileron"),
    Channel("delta_a_right", "δ_a,r", "rad", "right aileron"),
    Channel("delta_r_left", "δ_r,l", "rad", "left rudder"),
    Channel("delta_r_right", "δ_r,r", "rad", "right rudder"),
    Channel("q0", "q_0", "1", "attitude quaternion, scalar part"),
    Channel("q1", "q_1", "1", "attitude quaternion, forward part"),
    Channel("q2", "q_2", "1", "attitude quaternion, right part"),
    Channel("q3", "q_3", "1", "attitude quaternion, down part"),
)
"""Only used to derive other channels."""
TARGETS: dict[str, Channel] = {
    target.key: target
    for target in (*CHANNELS, *ATTITUDE_TARGETS, *CONDITION_TARGETS, *INGREDIENTS)
}
"""By key; `unit` is the one that a target is stored in."""
