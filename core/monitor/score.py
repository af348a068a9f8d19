"""Scores: how close a mapped point is to a failure; low means close."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from core.bounds import Bounds, check_bounds
from core.channels import KEYS
from core.recipe import family


@dataclass(frozen=True)
class Score:
    """A score s(z) = a min_u |z - y_u|^2 - b min_s |z - y_s|^2, or -|z_channel|.

    y_u, y_s: mapped unsafe and safe points. Calibration leaves out a point's own trajectory.
    """

    unsafe_weight: ClassVar[float] = 0.0
    safe_weight: ClassVar[float] = 0.0
    reads_card: ClassVar[bool] = False
    """whether it scores a forecast of the card; distances then only find similar rollouts"""
    of_members: ClassVar[bool] = False
    """whether it is the risk of several parts, of an ensemble or a combination"""

    @property
    def channel(self) -> int:
        """Index of the channel whose magnitude is the score; -1 for a score of distances."""
        return -1

    @property
    def looks_up_neighbors(self) -> bool:
        """Whether it scores distances to neighbours."""
        return self.channel < 0 and not self.reads_card

    def window(self, h: int) -> int:
        """Samples to look ahead, for a lead of h; 0 for the rest of the card."""
        return 0


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
    """Minus the nearest safe squared distance (ablation): far from all safe flights."""

    safe_weight: ClassVar[float] = 1.0


@dataclass(frozen=True)
class NegativeMagnitude(Score):
    """Minus the magnitude of one output channel (the paper's -|N_y|)."""

    key: Literal["beta", "p", "r", "Ny", "delta_a", "delta_r"] = "Ny"
    """output channel."""

    @property
    def channel(self) -> int:
        return KEYS.index(self.key)


@dataclass(frozen=True)
class RestOfCard(NearestNeighbor):
    """How certainly a limit is exceeded in the rest of the card, or of another manoeuvre.

    Minus the largest (|forecast| - limit) / deviation of the forecast; for a specification known
    only by its label, minus the log odds of a failure.
    """

    reads_card: ClassVar[bool] = True


@dataclass(frozen=True)
class CardWindow(RestOfCard):
    """How probably a limit is exceeded within the lead and a few more samples.

    Minus its log odds over the possible times of the pilot's next switch; for a forecast of the
    peak alone, minus (forecast - limit) / deviation.
    """

    n_after: Annotated[int, Bounds(least=0, words="it must be 0 or more")] = 4
    """samples after the lead: also looked ahead."""

    def __post_init__(self) -> None:
        check_bounds(self)

    def window(self, h: int) -> int:
        return h + self.n_after


@dataclass(frozen=True)
class HighestRisk(RestOfCard):
    """Minus the highest risk of the parts of an ensemble or a combination."""

    of_members: ClassVar[bool] = True


SCORES = family(
    "score",
    Score,
    {
        "nearest_neighbor": NearestNeighbor(),
        "unsafe_distance": UnsafeDistance(),
        "safe_distance": SafeDistance(),
        "negative_magnitude": NegativeMagnitude(),
        "rest_of_card": RestOfCard(),
        "card_window": CardWindow(),
        "highest_risk": HighestRisk(),
    },
)
