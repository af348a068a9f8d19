"""The quantities that a signal of a file can be mapped to."""

from core.channels import CHANNELS, Channel, channel

ATTITUDE_TARGETS = (
    channel("phi", "φ", "rad", "bank angle"),
    channel("theta", "θ", "rad", "pitch angle"),
    channel("psi", "ψ", "rad", "heading"),
)
CONDITION_TARGETS = (
    channel("V", "V", "m/s", "true airspeed"),
    channel("h", "h", "m", "altitude"),
)
INGREDIENTS = (
    channel("v", "v", "m/s", "lateral velocity"),
    channel("Ay", "a_y", "g", "lateral acceleration, gravity included"),
    channel("delta_a_left", "δ_a,l", "rad", "left aileron"),
    channel("delta_a_right", "δ_a,r", "rad", "right aileron"),
    channel("delta_r_left", "δ_r,l", "rad", "left rudder"),
    channel("delta_r_right", "δ_r,r", "rad", "right rudder"),
    channel("q0", "q_0", "1", "attitude quaternion, scalar part"),
    channel("q1", "q_1", "1", "attitude quaternion, forward part"),
    channel("q2", "q_2", "1", "attitude quaternion, right part"),
    channel("q3", "q_3", "1", "attitude quaternion, down part"),
)
"""Only used to derive other channels."""
TARGETS: dict[str, Channel] = {
    target.key: target
    for target in (*CHANNELS, *ATTITUDE_TARGETS, *CONDITION_TARGETS, *INGREDIENTS)
}
"""By key; values are stored in `unit`."""
