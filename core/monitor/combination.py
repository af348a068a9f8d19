"""A combination: several monitors of one planned test with one common alert rule.

Its risk is the highest risk of its members. The combined rule is calibrated on failing flights
that no member was trained on: the score of a flight is its highest timely risk.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from core import __version__
from core.kernels.assessing import OK, WARMING_UP
from core.kernels.p_value import SIMPLE
from core.limits.limits import specification_to_plain
from core.monitor.calibration import Guarantee, p_values
from core.monitor.file.portable import Section
from core.monitor.monitor import Monitor, Stream, assemble
from core.monitor.observation import lead_steps
from core.monitor.peak_forecast import LOST, Ahead, ForecastScores, PeakForecast, RunningForecast
from core.monitor.predictor import Members
from core.monitor.recipe import MonitorRecipe
from core.monitor.score import HighestRisk
from core.types import Array, Indices

FEWEST = 2
SIZES = ("n_unsafe", "n_obs", "seed", "max_rollouts", "max_safe")
"""Fields of a planned test's recipe that only set the amount of simulation."""


def combine(
    members: Sequence[Monitor],
    flights: tuple[Array, Indices, *tuple[Any, ...]],
    *,
    lead: float,
    epsilon: float = MonitorRecipe.epsilon,
    guarantee: Guarantee = MonitorRecipe.guarantee,
) -> Monitor:
    """Combine monitors: the risk is the highest of the members', calibrated as in flight.

    members: trained monitors of one planned test, with different leads, scores or predictors.
    flights: y (n, n_samples, 6) and fail_index (n,) of fresh flights of that test that trained no
    member; safe flights (fail_index n_samples) are ignored. The guarantee with confidence is exact,
    because these flights chose nothing.
    lead: latest alert that counts, before the failure [s]. It must be a member's lead: the
    combination takes validity, limits and points from that member. The validity of the other
    members is ignored: their risks count as in calibration, and one verdict withdraws the whole.
    ValueError if the members do not match, or the failures are too few for epsilon.
    """
    lead_member = check_members(members, lead)
    y, fail_index, *_ = flights
    fails = fail_index < y.shape[1]
    rule = Combined(tuple(members))
    last = fail_index[fails] - lead_member.h
    alphas = np.sort(rule.lowest_scores(y[fails], np.zeros_like(last), last))
    recipe = MonitorRecipe(
        t_early=lead_member.recipe.t_early,
        n_delay=lead_member.recipe.n_delay,
        predictor=Members(),
        score=HighestRisk(),
        scaling=lead_member.recipe.scaling,
        epsilon=epsilon,
        guarantee=guarantee,
    )
    combination = replace(
        lead_member,
        recipe=recipe,
        n_early=int(np.isposinf(alphas).sum()),
        fitted=assemble(
            recipe, lead_member.affine, lead_member.unsafe_points, lead_member.safe_points, alphas
        ),
        exact=SIMPLE,
        forecast=rule,
        evaluation=None,
        version=__version__,
    )
    combination.check_epsilon()
    return combination


def check_members(members: Sequence[Monitor], lead: float) -> Monitor:
    """The member with this lead [s]. ValueError if the members cannot be combined."""
    lead_member = _member_of_lead(members, lead)
    _check_alike(members)
    return lead_member


def _member_of_lead(members: Sequence[Monitor], lead: float) -> Monitor:
    if len(members) < FEWEST:
        raise ValueError(f"{len(members)} monitors were given: give 2 or more to combine")
    if not lead > 0:
        raise ValueError(f"lead={lead} s was given: give a positive lead")
    matches = [member for member in members if member.h == lead_steps(lead, member.dt)]
    if not matches:
        leads = ", ".join(f"{member.lead:g}" for member in members)
        raise ValueError(
            f"lead={lead:g} s was given: choose a member's lead, whose validity and points the "
            f"combination uses: {leads} s"
        )
    return matches[0]


def _check_alike(members: Sequence[Monitor]) -> None:
    """Refuse members of different planned tests, or with different sampling."""
    first = members[0]
    for number, member in enumerate(members, 1):
        if isinstance(member.forecast, Combined):
            raise ValueError(f"member {number} is a combination: give its members instead")
        if any(_is_same(member, before) for before in members[: number - 1]):
            raise ValueError(f"member {number} was given before: give each monitor once")
        if member.groups is not None:
            raise ValueError(
                f"member {number} is calibrated by groups: give a monitor with groups pooled"
            )
        for name, value, expected in (
            ("sample interval dt [s]", member.dt, first.dt),
            ("number of past outputs n_delay", member.recipe.n_delay, first.recipe.n_delay),
            (
                "limits (specification)",
                *(specification_to_plain(m.specification) for m in (member, first)),
            ),
            ("planned test", _test_of(member), _test_of(first)),
        ):
            if value != expected:
                raise ValueError(
                    f"member {number} differs from member 1 in {name}: combine monitors of one "
                    "planned test with the same sampling and limits"
                )


def _is_same(first: Monitor, other: Monitor) -> bool:
    """Whether they give the same assessments for every flight."""
    same = first.recipe == other.recipe and first.dataset_digest == other.dataset_digest
    return same and np.array_equal(first.alphas, other.alphas)


def _test_of(member: Monitor) -> dict[str, Any]:
    return {key: value for key, value in member.dataset_recipe.items() if key not in SIZES}


NO_FORECAST = "not available for a combination whose members show no forecast"


class RunningCombination(RunningForecast):
    """The members' streams of one flight.

    Lost as soon as one member is: with fewer members than in calibration, the rule would miss more
    than it promises.
    """

    def __init__(self, members: Sequence[Monitor], showing: int | None) -> None:
        """showing: index of the member whose forecast of the rest is shown, if any."""
        self._streams = [Stream(member, 1.0, exemplars=False) for member in members]
        self._showing = None if showing is None else self._streams[showing]

    def update(self, t: float, y: Array, code: int, neighbor_score: float) -> tuple[float, int]:
        """Score of the next sample: minus the highest risk of the members that have one.

        State WARMING_UP if no member has one.
        """
        assessments = [stream.update(t, y) for stream in self._streams]
        self.lost = any(assessment.reason == LOST for assessment in assessments)
        risks = [assessment.p_value for assessment in assessments if assessment.p_value is not None]
        if code != OK or not risks:
            return np.nan, WARMING_UP if code == OK else code
        return -max(risks), code

    def ahead(self) -> Ahead | None:
        return None if self._showing is None else self._showing.forecast_ahead()


@dataclass(frozen=True, eq=False)
class Combined(PeakForecast):
    """The members of a combination, in the role of a forecast.   members: as trained."""

    section: ClassVar[str] = "members"
    members: tuple[Monitor, ...]

    @property
    def no_forecast_reason(self) -> str:
        return NO_FORECAST if self._showing is None else ""

    @cached_property
    def _showing(self) -> int | None:
        """Index of the first member that shows a forecast of the rest, if any."""
        forecasts = (member.forecast for member in self.members)
        shows = (f is not None and not f.no_forecast_reason for f in forecasts)
        return next((index for index, shown in enumerate(shows) if shown), None)

    @cached_property
    def risk_members(self) -> tuple[Monitor, ...]:
        """The members without their own validity and epsilon, for their risks alone."""
        return tuple(
            replace(
                member,
                recipe=replace(member.recipe, epsilon=0.5, guarantee="average"),
                support=None,
            )
            for member in self.members
        )

    def start(self, dt: float) -> RunningCombination:
        return RunningCombination(self.risk_members, self._showing)

    def follow(
        self, t: Array, y: Array, state: Indices, dt: float, neighbor_scores: Array
    ) -> ForecastScores:
        assessed = [member.assess(t, y, withdraw=False) for member in self.risk_members]
        risk = np.fmax.reduce([assessments.p_value for assessments in assessed])
        lost = [a.withdrawal.first for a in assessed if a.withdrawal is not None]
        silent = (state == OK) & np.isnan(risk)
        return ForecastScores(
            score=np.where(state == OK, -risk, np.nan),
            state=np.where(silent, WARMING_UP, state),
            y_hat=np.full(y.shape, np.nan),
            lost=min(lost, default=len(t)),
        )

    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        """Minus the highest risk of each trajectory, from its first sample.

        first: (n,) zeros, because the rule is calibrated as flown.
        """
        if first.any():
            raise ValueError("a combination is calibrated over all samples: give first as zeros")
        scores, unscored = np.where(last < 0, np.inf, 0.0), np.zeros(len(y), bool)
        for member in self.risk_members:
            if member.forecast is None:
                risk = member.highest_p_values(y, last)
            else:
                lowest = member.lowest_scores(y, last)
                risk, unscored = p_values(lowest, member.alphas), unscored | np.isposinf(lowest)
            scores = np.minimum(scores, np.where(last < 0, np.inf, -risk))
        for flight in np.flatnonzero(unscored & (last >= 0)):
            if self._is_lost_at_once(y[flight, :1]):
                scores[flight] = np.inf
        return scores

    def _is_lost_at_once(self, y: Array) -> bool:
        """Whether the forecast is lost at the first sample, or else never.   y: (1, 6)."""
        start, state, near = np.zeros(1), np.full(1, OK), np.full(1, np.nan)
        forecasts = [(member.forecast, member.dt) for member in self.risk_members]
        return any(
            f is not None and f.follow(start, y, state, dt, near).lost == 0 for f, dt in forecasts
        )

    def to_section(self) -> Section:
        """Section of a monitor's file: the complete files of the members."""
        files = {
            f"{number}": np.frombuffer(member.to_bytes(), np.uint8)
            for number, member in enumerate(self.members, 1)
        }
        return Section(self.section, 1, True, {"n_members": len(files)}, files)


def members_of(monitor: Monitor) -> tuple[Monitor, ...]:
    """Members of a combination as trained; empty for other monitors."""
    return monitor.forecast.members if isinstance(monitor.forecast, Combined) else ()


def combination_of(members: tuple[Monitor, ...], n_delay: int, h: int) -> Combined:
    """Combination from its members. ValueError if they do not match its history and lead."""
    member = check_members(members, h * members[0].dt)
    if member.recipe.n_delay != n_delay:
        raise ValueError(f"its members have n_delay={member.recipe.n_delay} instead of {n_delay}")
    return Combined(members)
