"""The recipe of a monitor: every choice for training, as shown in the form."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from core.bounds import Bounds, check_bounds
from core.monitor.calibration import Guarantee
from core.monitor.group import GROUPINGS, Grouping, Pooled
from core.monitor.predictor import PREDICTORS, Ensemble, Predictor
from core.monitor.score import SCORES, Score

Calibration = Literal["trajectory", "pointwise"]
PValue = Literal["simple", "exact"]
Scaling = Literal["safe_std", "raw"]
MISS_RATE = Bounds(above=0, below=1, words="give a miss rate between 0 and 1")


@dataclass(frozen=True)
class MonitorRecipe:
    """How to train a monitor. The defaults are the method with trajectory calibration."""

    t_early: Annotated[float, Bounds(above=0, words="the lead must be positive")] = 0.25
    """required warning lead time [s]; rounded up to whole samples."""
    n_delay: Annotated[int, Bounds(least=0, words="it must be 0 or more")] = 2
    """past outputs in an observation: besides the newest one."""
    predictor: Predictor = PREDICTORS["linear"]
    score: Score = SCORES["nearest_neighbor"]
    calibration: Calibration = "trajectory"
    """calibration rule: `trajectory` (as flown, over all samples up to t_fail - h) or `pointwise`
    (that sample alone, as in the paper). Both are valid; `trajectory` gives fewer false alarms."""
    p_value: PValue = "simple"
    """p-value rule: `simple`, or `exact` (transductive, never larger). With trajectory calibration
    the exact one uses the riskiest moment so far, so it rarely falls again. Scores without
    neighbours (a magnitude, the card) always use the simple one."""
    scaling: Scaling = "safe_std"
    """scaling of the channels: by their standard deviation on safe flights (`safe_std`), or none as
    in the paper (`raw`)."""
    epsilon: Annotated[float, MISS_RATE] = 0.1
    """accepted miss rate epsilon: accepted share of missed failures."""
    guarantee: Guarantee = "average"
    """promise on the miss rate: at most epsilon on `average` over many monitors trained alike, or
    for this monitor with `95%` confidence, which alerts more and needs more failures."""
    groups: Grouping = GROUPINGS["pooled"]
    """groups of failing flights: the promise holds for each group, which has its own threshold and
    needs as many failures."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if not isinstance(self.groups, Pooled) and self.is_exact:
            raise ValueError("groups need p_value simple: choose it, or groups pooled")
        if wrong := mismatch(self.predictor, self.score):
            raise ValueError(wrong)
        if not isinstance(self.groups, Pooled) and self.is_near:
            raise ValueError("groups need the scope planned: choose it, or groups pooled")

    @property
    def is_near(self) -> bool:
        """Whether the promise is also for aircraft and hands near the planned ones."""
        return isinstance(self.predictor, Ensemble) and self.predictor.scope == "near"

    def as_planned(self) -> "MonitorRecipe":
        """The same for the planned aircraft and hands alone, where no others can be simulated."""
        return replace(self, predictor=planned(self.predictor))

    @property
    def is_exact(self) -> bool:
        """Whether p-values are transductive, which needs a score with neighbours."""
        return self.p_value == "exact" and self.score.looks_up_neighbors


def planned(predictor: Predictor) -> Predictor:
    """The same predictor with the promise for the planned aircraft and hands alone."""
    is_ensemble = isinstance(predictor, Ensemble)
    return replace(predictor, scope="planned") if is_ensemble else predictor


METHODS: dict[str, tuple[Predictor, Score]] = {
    "ensemble": (Ensemble(scope="near"), SCORES["highest_risk"]),
    "peak_ahead": (PREDICTORS["peak_ridge"], SCORES["rest_of_card"]),
    "peak_soon": (PREDICTORS["peak_ridge"], SCORES["card_window"]),
    "test_card": (PREDICTORS["response_filter"], SCORES["card_window"]),
    "outputs_ahead": (PREDICTORS["linear"], SCORES["nearest_neighbor"]),
}
"""Named pairs of predictor and score, the recommended one first."""


def mismatch(predictor: Predictor, score: Score) -> str:
    """Why a predictor and a score do not work together; empty if they do."""
    if score.of_members != (predictor.forecast in ("ensemble", "members")):
        return (
            "the predictors ensemble and combination go with the score highest_risk, and no other"
        )
    if score.reads_card != bool(predictor.forecast):
        forecasting = (k for k, known in PREDICTORS.items() if known.forecast in ("card", "peaks"))
        reading = (k for k, s in SCORES.items() if s.reads_card and not s.of_members)
        return (
            f"the predictors {' and '.join(forecasting)} go with the score "
            f"{' or '.join(reading)}, and these scores with no other predictor"
        )
    if score.channel >= 0 and not predictor.maps_to_outputs:
        key = next(key for key, known in SCORES.items() if type(known) is type(score))
        mapping = (k for k, p in PREDICTORS.items() if p.maps_to_outputs and not p.forecast)
        return f"the score {key} reads an output: choose the predictor {' or '.join(mapping)}"
    return ""
