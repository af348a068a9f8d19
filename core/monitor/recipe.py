"""The recipe of a monitor: every choice that training makes, and what the form shows."""

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from core.bounds import Bounds, check_bounds
from core.monitor.calibration import Guarantee
from core.monitor.group import GROUPINGS, Grouping, Pooled
from core.monitor.predictor import PREDICTORS, Predictor
from core.monitor.score import SCORES, Score

Calibration = Literal["trajectory", "pointwise"]
PValue = Literal["simple", "exact"]
Scaling = Literal["safe_std", "raw"]
MISS_RATE = Bounds(above=0, below=1, words="a miss rate lies between 0 and 1")


@dataclass(frozen=True)
class MonitorRecipe:
    """How to train a monitor. The defaults are the method with trajectory calibration."""

    t_early: Annotated[float, Bounds(above=0, words="the lead must be positive")] = 0.25
    """required warning lead time [s]; the one in effect is the next whole number of samples."""
    n_delay: Annotated[int, Bounds(least=0, words="it must be 0 or more")] = 2
    """past outputs in an observation: beside the newest one."""
    predictor: Predictor = PREDICTORS["linear"]
    score: Score = SCORES["nearest_neighbor"]
    calibration: Calibration = "trajectory"
    """calibration rule: as flown, over all samples up to t_fail - h, or by that one alone, as in
    the paper; `trajectory` or `pointwise`. The former is as valid and more powerful."""
    p_value: PValue = "simple"
    """p-value rule: `simple`, or the `exact` transductive one, never larger. With trajectory
    calibration the exact one judges a flight by its riskiest moment so far, so it hardly falls
    again. Scores of a magnitude or of the card look up no neighbours and have the simple one
    either way."""
    scaling: Scaling = "safe_std"
    """scaling of the channels: by their standard deviation on safe flights, or none, as in the
    paper; `safe_std` or `raw`."""
    epsilon: Annotated[float, MISS_RATE] = 0.1
    """accepted miss rate epsilon: share of failing flights on which silence is accepted."""
    guarantee: Guarantee = "average"
    """promise on the miss rate: at most epsilon on `average` over many monitors trained alike, or
    of this very one with `95%` confidence, which alerts more and needs more failures."""
    groups: Grouping = GROUPINGS["pooled"]
    """groups of failing flights: the promise holds for each, with a threshold of its own; it needs
    as many failures in each."""

    def __post_init__(self) -> None:
        """Refuse what no dataset could make right."""
        check_bounds(self)
        for name, choices in (
            ("calibration", Calibration),
            ("p_value", PValue),
            ("scaling", Scaling),
            ("guarantee", Guarantee),
        ):
            if getattr(self, name) not in get_args(choices):
                raise ValueError(
                    f"{name}={getattr(self, name)!r} was given: choose "
                    f"{' or '.join(get_args(choices))}"
                )
        if not isinstance(self.groups, Pooled) and self.is_exact:
            raise ValueError("groups need p_value simple: choose that, or groups pooled")
        if wrong := mismatch(self.predictor, self.score):
            raise ValueError(wrong)

    @property
    def is_exact(self) -> bool:
        """Whether p-values are transductive, as they are for scores that look up neighbours."""
        return self.p_value == "exact" and self.score.looks_up_neighbors


METHODS: dict[str, tuple[Predictor, Score]] = {
    "peak_ahead": (PREDICTORS["peak_ridge"], SCORES["rest_of_card"]),
    "test_card": (PREDICTORS["response_filter"], SCORES["card_window"]),
    "outputs_ahead": (PREDICTORS["linear"], SCORES["nearest_neighbor"]),
}
"""Pairs of predictor and score that people choose by name, the recommended one first."""


def mismatch(predictor: Predictor, score: Score) -> str:
    """Why a predictor and a score make no monitor; empty where they do."""
    if score.of_members != (predictor.forecast == "members"):
        return (
            "the predictor combination goes with the score highest_risk, and neither with another"
        )
    if score.reads_card != bool(predictor.forecast):
        forecasting = (key for key, one in PREDICTORS.items() if one.forecast)
        reading = (key for key, one in SCORES.items() if one.reads_card)
        return (
            f"the predictors {' and '.join(forecasting)} go with the score "
            f"{' or '.join(reading)}, and these with no other predictor"
        )
    if score.channel >= 0 and not predictor.maps_to_outputs:
        own = next(key for key, one in SCORES.items() if type(one) is type(score))
        mapping = (k for k, one in PREDICTORS.items() if one.maps_to_outputs and not one.forecast)
        return f"the score {own} reads an output: choose the predictor {' or '.join(mapping)}"
    return ""
