"""A combination: several monitors of one planned test that raise their alerts by one rule.

Its risk is the highest that a member tells. That rule as a whole is calibrated, on failing flights
that taught none of its members: the highest timely risk of each is its score.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from core import __version__
from core.kernels.assessing import OK, WARMING_UP
from core.kernels.p_value import SIMPLE
from core.monitor.calibration import Guarantee, p_values
from core.monitor.file.portable import Section
from core.monitor.monitor import Monitor, Stream, assemble
from core.monitor.observation import lead_steps
from core.monitor.peak_forecast import LOST, Followed, PeakForecast, RunningForecast
from core.monitor.predictor import Members
from core.monitor.recipe import MonitorRecipe
from core.monitor.score import HighestRisk
from core.specification import specification_to_plain
from core.types import Array, Indices

FEWEST = 2
SIZES = ("n_unsafe", "n_obs", "seed", "max_rollouts", "max_safe")
"""Of a planned test's recipe, what says how much of it was simulated, and not what it is."""


def combine(
    members: Sequence[Monitor],
    flights: tuple[Array, Indices, *tuple[Any, ...]],
    *,
    lead: float,
    epsilon: float = MonitorRecipe.epsilon,
    guarantee: Guarantee = MonitorRecipe.guarantee,
) -> Monitor:
    """Return one monitor whose risk is the highest of its members', calibrated as it is flown.

    members: trained monitors of one planned test, of several leads, scores or predictors.
    flights: y (n, n_samples, 6) and fail_index (n,) of fresh flights of that test, which trained
    none of them; those that did not fail, with fail_index n_samples, are left out. As they chose
    nothing, the promise with confidence holds exactly.
    lead: an alert counts up to so long before the failure [s]; that of a member, whose validity,
    limits and points the combination has. What members say of validity on their own is not heard:
    withdrawn or not, each risk counts as in calibration, and one verdict withdraws the whole.
    ValueError where members do not go together, or the failures cannot serve the epsilon.
    """
    own = check_members(members, lead)
    y, fail_index, *_ = flights
    fails = fail_index < y.shape[1]
    rule = Combined(tuple(members))
    last = fail_index[fails] - own.h
    alphas = np.sort(rule.lowest_scores(y[fails], np.zeros_like(last), last))
    recipe = MonitorRecipe(
        t_early=own.recipe.t_early,
        n_delay=own.recipe.n_delay,
        predictor=Members(),
        score=HighestRisk(),
        scaling=own.recipe.scaling,
        epsilon=epsilon,
        guarantee=guarantee,
    )
    combination = replace(
        own,
        recipe=recipe,
        n_early=int(np.isposinf(alphas).sum()),
        fitted=assemble(recipe, own.affine, own.unsafe_points, own.safe_points, alphas),
        exact=SIMPLE,
        forecast=rule,
        evaluation=None,
        version=__version__,
    )
    combination.check_epsilon()
    return combination


def check_members(members: Sequence[Monitor], lead: float) -> Monitor:
    """Return the member of this lead [s]; ValueError where these make no combination."""
    own = _member_of_lead(members, lead)
    _check_alike(members)
    return own


def _member_of_lead(members: Sequence[Monitor], lead: float) -> Monitor:
    if len(members) < FEWEST:
        raise ValueError(f"{len(members)} monitors were given: a combination has 2 or more members")
    if not lead > 0:
        raise ValueError(f"lead={lead} s was given: it must be positive")
    own = [member for member in members if member.h == lead_steps(lead, member.dt)]
    if not own:
        leads = ", ".join(f"{member.lead:g}" for member in members)
        raise ValueError(
            f"lead={lead:g} s was given: choose that of a member, whose validity and points the "
            f"combination has, {leads} s"
        )
    return own[0]


def _check_alike(members: Sequence[Monitor]) -> None:
    """Refuse members that are not of one planned test, or that see its samples otherwise."""
    first = members[0]
    for number, member in enumerate(members, 1):
        if isinstance(member.forecast, Combined):
            raise ValueError(f"member {number} is a combination: give its own members instead")
        if any(_is_same(member, before) for before in members[: number - 1]):
            raise ValueError(f"member {number} was given before: give each monitor once")
        if member.groups is not None:
            raise ValueError(
                f"member {number} is calibrated by groups: give one whose failures are pooled"
            )
        for what, own, others in (
            ("sample interval dt [s]", member.dt, first.dt),
            ("number of past outputs n_delay", member.recipe.n_delay, first.recipe.n_delay),
            (
                "limits (specification)",
                *(specification_to_plain(m.specification) for m in (member, first)),
            ),
            ("planned test", _test_of(member), _test_of(first)),
        ):
            if own != others:
                raise ValueError(
                    f"member {number} differs from member 1 in {what}: combine monitors of one "
                    "planned test that see the same samples"
                )


def _is_same(one: Monitor, other: Monitor) -> bool:
    """Whether they say the same of every flight."""
    same = one.recipe == other.recipe and one.dataset_digest == other.dataset_digest
    return same and np.array_equal(one.alphas, other.alphas)


def _test_of(member: Monitor) -> dict[str, Any]:
    return {key: value for key, value in member.dataset_recipe.items() if key not in SIZES}


NO_REST = "a combination of monitors gives none"


class RunningCombination(RunningForecast):
    """The members' streams of one flight; lost as soon as one of them is.

    With fewer members than were calibrated, the rule would miss more than it promises.
    """

    def __init__(self, members: Sequence[Monitor]) -> None:
        self._streams = [Stream(member, 1.0, exemplars=False) for member in members]

    def update(self, t: float, y: Array, code: int) -> tuple[float, int]:
        """Take the next sample; its score is minus the highest risk of the members that tell one.

        WARMING_UP where none does.
        """
        heard = [stream.update(t, y) for stream in self._streams]
        self.lost = any(assessment.reason == LOST for assessment in heard)
        risks = [assessment.p_value for assessment in heard if assessment.p_value is not None]
        if code != OK or not risks:
            return np.nan, WARMING_UP if code == OK else code
        return -max(risks), code


@dataclass(frozen=True, eq=False)
class Combined(PeakForecast):
    """The members of a combination, in place of a forecast.   members: as they were trained."""

    section: ClassVar[str] = "members"
    members: tuple[Monitor, ...]

    @property
    def no_rest(self) -> str:
        """Why the risk alone is told."""
        return NO_REST

    @cached_property
    def heard(self) -> tuple[Monitor, ...]:
        """The members without a verdict and a promise of their own: what is heard is their risk."""
        return tuple(
            replace(
                member,
                recipe=replace(member.recipe, epsilon=0.5, guarantee="average"),
                support=None,
            )
            for member in self.members
        )

    def begin(self, dt: float) -> RunningCombination:
        """Begin a flight."""
        return RunningCombination(self.heard)

    def follow(self, t: Array, y: Array, state: Indices, dt: float) -> Followed:
        """Score a flight."""
        heard = [member.assess(t, y, withdraw=False) for member in self.heard]
        risk = np.fmax.reduce([assessments.p_value for assessments in heard])
        lost = [a.withdrawal.first for a in heard if a.withdrawal is not None]
        silent = (state == OK) & np.isnan(risk)
        return Followed(
            score=np.where(state == OK, -risk, np.nan),
            state=np.where(silent, WARMING_UP, state),
            y_hat=np.full(y.shape, np.nan),
            lost=min(lost, default=len(t)),
        )

    def lowest_scores(self, y: Array, first: Indices, last: Indices) -> Array:
        """Minus the highest risk of each trajectory, from its first sample on.

        first: (n,) zeros, as the rule is calibrated as flown.
        """
        if first.any():
            raise ValueError("a combination is calibrated over all samples: give zeros as first")
        scores, unheard = np.where(last < 0, np.inf, 0.0), np.zeros(len(y), bool)
        for member in self.heard:
            if member.forecast is None:
                risk = member.highest_p_values(y, last)
            else:
                lowest = member.lowest_scores(y, last)
                risk, unheard = p_values(lowest, member.alphas), unheard | np.isposinf(lowest)
            scores = np.minimum(scores, np.where(last < 0, np.inf, -risk))
        for flight in np.flatnonzero(unheard & (last >= 0)):
            if self._is_lost_at_once(y[flight, :1]):
                scores[flight] = np.inf
        return scores

    def _is_lost_at_once(self, y: Array) -> bool:
        """Whether a flight without a gap is lost: at its first sample, or never.   y: (1, 6)."""
        start, state = np.zeros(1), np.full(1, OK)
        forecasts = [(member.forecast, member.dt) for member in self.heard]
        return any(f is not None and f.follow(start, y, state, dt).lost == 0 for f, dt in forecasts)

    def to_section(self) -> Section:
        """Return the section of a monitor's file: the members' own files, whole."""
        files = {
            f"{number}": np.frombuffer(member.to_bytes(), np.uint8)
            for number, member in enumerate(self.members, 1)
        }
        return Section(self.section, 1, True, {"n_members": len(files)}, files)


def members_of(monitor: Monitor) -> tuple[Monitor, ...]:
    """The members of a combination, as they were trained; none of any other monitor."""
    return monitor.forecast.members if isinstance(monitor.forecast, Combined) else ()


def of_members(members: tuple[Monitor, ...], n_delay: int, h: int) -> Combined:
    """Rebuild it; ValueError where these are no members of a monitor of this history and lead."""
    own = check_members(members, h * members[0].dt)
    if own.recipe.n_delay != n_delay:
        raise ValueError(f"its members have n_delay={own.recipe.n_delay} instead of {n_delay}")
    return Combined(members)
