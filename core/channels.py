"""The telemetry dictionary: what a sample y holds, in which order and in which units."""

from dataclasses import dataclass

from core.kernels import N_CHANNELS


@dataclass(frozen=True)
class Channel:
    """One quantity as control rooms name, draw and label it. unit: SI, or g."""

    key: str
    symbol: str
    unit: str
    label: str


CHANNELS: tuple[Channel, ...] = (
    Channel("beta", "β", "rad", "sideslip"),
    Channel("p", "p", "rad/s", "roll rate"),
    Channel("r", "r", "rad/s", "yaw rate"),
    Channel("Ny", "N_y", "g", "lateral acceleration"),
    Channel("delta_a", "δ_a", "rad", "aileron"),
    Channel("delta_r", "δ_r", "rad", "rudder"),
)
KEYS: tuple[str, ...] = tuple(channel.key for channel in CHANNELS)
if len(CHANNELS) != N_CHANNELS:
    raise AssertionError(f"{len(CHANNELS)} channels: the kernels compute with {N_CHANNELS}")
