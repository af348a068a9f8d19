"""Choose epsilon: by the cost of a miss in false alarms, or by a target for each.

One half of the fresh flights chooses epsilon and the other half certifies it, so that a lucky
choice does not certify itself.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from core.bounds import Bounds, check_bounds
from core.evaluation.rates import Evaluation, clopper_pearson, evaluate
from core.monitor.monitor import Monitor
from core.simulation.simulator import Rollouts
from core.types import Array, Flags

MOST_CANDIDATES = 200
MOST_FLIGHTS = 10_000_000
"""If more flights are needed, a certificate is out of reach."""
N_FLIGHTS = 10_000
"""Default number of fresh flights."""


SHARE = Bounds(above=0, below=1, words="give a share between 0 and 1")


class ChoiceError(ValueError):
    """Targets that no epsilon keeps, or that need more flights to certify."""


@dataclass(frozen=True)
class ChoiceRecipe:
    """The criterion for epsilon: both targets, or the cost of a miss."""

    most_missed: Annotated[float | None, SHARE] = None
    """misses: accepted share of the failing flights."""
    most_false_alarms: Annotated[float | None, SHARE] = None
    """false alarms: accepted share of the safe flights."""
    cost_of_miss: Annotated[float | None, Bounds(above=0)] = None
    """cost of a miss: in false alarms, instead of both targets."""
    n_test: Annotated[int, Bounds(least=1)] = N_FLIGHTS
    """fresh flights: one half chooses, the other certifies."""

    def __post_init__(self) -> None:
        check_bounds(self)
        targets = self.most_missed, self.most_false_alarms
        if (self.cost_of_miss is None) == (None in targets):
            names = "most_missed", "most_false_alarms", "cost_of_miss"
            given = [name for name in names if getattr(self, name) is not None]
            raise ChoiceError(
                f"given: {' and '.join(given) or 'none of the targets'}. Give both most_missed and "
                "most_false_alarms, or only cost_of_miss"
            )


@dataclass(frozen=True)
class Choice:
    """An epsilon and its counts over the flights that did not choose it.

    most_missed, most_false: upper bounds on the shares of missed failing flights and of safe
    flights with an alert; both hold together with 95 % confidence.
    withdrawn, safe_withdrawn: failing flights invalid before an alert, and safe flights invalid
    without one; in neither share, and not in the cost.
    cost: per flight, in false alarms; None without a cost of a miss.
    """

    epsilon: float
    alert_above: float
    misses: int
    n_unsafe: int
    false_alerts: int
    n_safe: int
    most_missed: float
    most_false: float
    withdrawn: int
    safe_withdrawn: int
    cost: float | None = None


def choose(monitor: Monitor, flights: Rollouts, recipe: ChoiceRecipe) -> Choice:
    """Choose an epsilon by the recipe.

    flights: fresh ones that neither trained nor calibrated the monitor; half of them choose.
    ChoiceError if no epsilon keeps both targets, or if more flights are needed to certify one.
    """
    missed, false = recipe.most_missed, recipe.most_false_alarms
    if missed is not None and false is not None:
        return _by_targets(monitor, flights, missed, false)
    assert recipe.cost_of_miss is not None
    return _by_cost(monitor, flights, recipe.cost_of_miss)


def _by_targets(
    monitor: Monitor, flights: Rollouts, most_missed: float, most_false: float
) -> Choice:
    """The epsilon that keeps both targets with the largest margin, certified."""
    chosen, certified = _halves(monitor, flights, candidates(monitor))
    room = np.minimum(
        _room(chosen.miss_rate, most_missed, chosen.n_unsafe),
        _room(chosen.false_alarm_rate, most_false, chosen.n_safe),
    )
    best = int(room.argmax())
    choice = _choice(monitor, certified, best)
    if choice.most_missed <= most_missed and choice.most_false <= most_false:
        return choice
    missed, false = (
        (first + second) / n
        for first, second, n in (
            (chosen.misses[best], choice.misses, chosen.n_unsafe + choice.n_unsafe),
            (chosen.false_alerts[best], choice.false_alerts, chosen.n_safe + choice.n_safe),
        )
    )
    both = (
        f"at epsilon {choice.epsilon:.3g} {_percent(missed)} are missed and {_percent(false)} have "
        "a false alarm"
    )
    beyond = [
        f"{name} at most {_percent(target)}"
        for name, share, target in (
            ("missed", missed, most_missed),
            ("false alarms", false, most_false),
        )
        if share >= target
    ]
    if beyond:
        raise ChoiceError(
            f"no epsilon keeps both targets; the closest: {both}; out of reach: "
            f"{' and '.join(beyond)}. Accept more of either, or train for a shorter warning lead "
            "time or with another method"
        )
    share = chosen.n_unsafe / (chosen.n_unsafe + chosen.n_safe)
    needed = max(
        _flights_needed(missed, most_missed) / share,
        _flights_needed(false, most_false) / (1 - share),
    )
    if not needed <= MOST_FLIGHTS / 2:
        many = f"more than {MOST_FLIGHTS:,}"
    else:
        many = f"about {round(2 * needed, -2):,.0f}"
    raise ChoiceError(
        f"{len(flights.y):,} fresh flights cannot certify both targets: {both}, but with 95 % "
        f"confidence only at most {_percent(choice.most_missed)} and "
        f"{_percent(choice.most_false)}; use {many} fresh flights"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _by_cost(monitor: Monitor, flights: Rollouts, cost_of_miss: float) -> Choice:
    """The epsilon with the lowest expected cost per flight; a false alarm costs 1."""
    chosen, certified = _halves(monitor, flights, candidates(monitor))
    unsafe_share = flights.is_unsafe.mean()
    cost = unsafe_share * cost_of_miss * chosen.miss_rate
    best = int((cost + (1 - unsafe_share) * chosen.false_alarm_rate).argmin())
    choice = _choice(monitor, certified, best)
    total = cost_of_miss * choice.misses + choice.false_alerts
    return replace(choice, cost=total / (choice.n_unsafe + choice.n_safe))


def candidates(monitor: Monitor) -> Array:
    """Miss rates to choose from: the steps of the p-values, from the smallest possible one."""
    steps = np.arange(1, monitor.n_unsafe + 1) / (monitor.n_unsafe + 1)
    possible = steps[steps >= monitor.smallest_epsilon - 1e-9]
    selected = np.unique(np.linspace(0, len(possible) - 1, MOST_CANDIDATES).astype(int))
    return possible[selected]


def _halves(monitor: Monitor, flights: Rollouts, epsilons: Array) -> tuple[Evaluation, Evaluation]:
    """Counts of the flights that choose and of those that certify: every second one."""
    second: Flags = np.arange(len(flights.y)) % 2 == 1
    halves = flights.some(~second), flights.some(second)
    for half in halves:
        if not 0 < np.count_nonzero(half.is_unsafe) < len(half.y):
            raise ChoiceError(
                f"{len(flights.y)} fresh flights were given, but too few failed or stayed safe: "
                "give more"
            )
    chosen, certified = (evaluate(monitor, half.y, half.fail_index, epsilons) for half in halves)
    return chosen, certified


def _room(share: Array, target: float, n: int) -> Array:
    """Distance of a share below its target, in standard errors at the target."""
    return (target - share) / np.sqrt(target * (1 - target) / n)


def _choice(monitor: Monitor, certified: Evaluation, at: int) -> Choice:
    epsilon = float(certified.epsilons[at])
    misses, false = int(certified.misses[at]), int(certified.false_alerts[at])
    return Choice(
        epsilon=epsilon,
        alert_above=monitor.alert_above(epsilon),
        misses=misses,
        n_unsafe=certified.n_unsafe,
        false_alerts=false,
        n_safe=certified.n_safe,
        most_missed=upper_bound(misses, certified.n_unsafe),
        most_false=upper_bound(false, certified.n_safe),
        withdrawn=int(certified.withdrawn[at]),
        safe_withdrawn=int(certified.safe_withdrawn[at]),
    )


def upper_bound(count: float, n: float) -> float:
    """Upper bound of one of two shares; both hold with 95 % confidence (Bonferroni).

    This is the upper end of the share's two-sided 95 % interval.
    """
    return float(clopper_pearson(count, n)[1])


def _flights_needed(share: float, target: float) -> float:
    """Flights of one kind that would certify an unchanged share; inf above MOST_FLIGHTS."""
    n = 10.0
    while upper_bound(share * n, n) > target:
        n *= 1.05
        if n > MOST_FLIGHTS:
            return np.inf
    return n
