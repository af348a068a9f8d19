"""Scores: how close a mapped point is to a failure; low means close."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from core.channels import KEYS
from core.recipe import family


@dataclass(frozen=True)
class Score:
    """A score s(z) = a min_u |z - y_u|^2 - b min_s |z - y_s|^2, or -|z_channel|.

    y_u, y_s: mapped unsafe and safe points. In calibration a point's own trajectory is left out.
    """

    unsafe_weight: ClassVar[float] = 0.0
    safe_weight: ClassVar[float] = 0.0

    @property
    def channel(self) -> int:
        """Index of the channel whose magnitude is the score; -1 for a score of distances."""
        return -1


@dataclass(frozen=True)
class NearestNeighbor(Score):
    """Nearest unsafe minus nearest safe squared distance (the paper's score)."""

    unsafe_weight: ClassVar[float] = 1.0
    safe_weight: ClassVar[float] = 1.0


@dataclass(frozen=True)
class UnsafeDistance(Score):
    """Nearest unsafe squared distance alone (ablation)."""

    unsafe_weight: ClassVar[float] = 1.0


@dataclass(frozen=True)
class SafeDistance(Score):
    """Minus the nearest safe squared distance (ablation): far from all that was safe."""

    safe_weight: ClassVar[float] = 1.0


@dataclass(frozen=True)
class NegativeMagnitude(Score):
    """Minus the magnitude of one output channel (the paper's -|N_y|)."""

    key: Literal["beta", "p", "r", "Ny", "delta_a", "delta_r"] = "Ny"
    """output channel."""

    @property
    def channel(self) -> int:
        """Index of the channel in y."""
        return KEYS.index(self.key)


SCORES = family(
    "score",
    Score,
    {
        "nearest_neighbor": NearestNeighbor(),
        "unsafe_distance": UnsafeDistance(),
        "safe_distance": SafeDistance(),
        "negative_magnitude": NegativeMagnitude(),
    },
)
