"""Choosing epsilon: by what a miss and a false alarm cost, or by a target for each.

An epsilon is chosen on one half of the fresh flights and certified on the other, so that what was
chosen by chance does not certify itself.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from core.bounds import Bounds, check_bounds
from core.evaluation.rates import Evaluation, clopper_pearson, evaluate
from core.monitor.monitor import Monitor
from core.planned_test import Rollouts
from core.types import Array, Flags

MOST_CANDIDATES = 200
MOST_FLIGHTS = 10_000_000
"""Flights beyond which a certificate is out of reach."""
N_FLIGHTS = 10_000
"""Fresh flights unless another number is asked for."""


class ChoiceError(ValueError):
    """Targets that no epsilon keeps, or that so few flights cannot certify."""


@dataclass(frozen=True)
class ChoiceRecipe:
    """What an epsilon is chosen by: both targets, or the cost of a miss."""

    most_missed: float | None = None
    """misses: share of the failing flights that may be missed."""
    most_false_alarms: float | None = None
    """false alarms: share of the safe flights that may have an alert."""
    cost_of_miss: float | None = None
    """cost of a miss: in false alarms, instead of both targets."""
    n_test: Annotated[int, Bounds(least=1)] = N_FLIGHTS
    """fresh flights: half of them choose, the others certify."""

    def __post_init__(self) -> None:
        """Refuse what is neither both targets nor a cost."""
        check_bounds(self)
        targets = self.most_missed, self.most_false_alarms
        if (self.cost_of_miss is None) == (None in targets):
            raise ChoiceError(
                f"most_missed={self.most_missed}, most_false_alarms={self.most_false_alarms} and "
                f"cost_of_miss={self.cost_of_miss} were given: give both targets, or the cost alone"
            )
        for name, target in (("most_missed", targets[0]), ("most_false_alarms", targets[1])):
            if target is not None and not 0 < target < 1:
                raise ChoiceError(f"{name}={target} was given: give a share between 0 and 1")
        cost = self.cost_of_miss
        if cost is not None and not (np.isfinite(cost) and cost > 0):
            raise ChoiceError(f"cost_of_miss={cost} was given: give a number above 0")


@dataclass(frozen=True)
class Choice:
    """An epsilon, and what it costs, by flights that had no part in choosing it.

    most_missed, most_false: upper bounds of the shares of failing flights that are missed and of
    safe flights with an alert, which hold together with 95 % confidence.
    withdrawn, safe_withdrawn: failing flights that were called invalid before an alert, and safe
    ones without one: in neither share, and in no cost.
    cost: of a flight, in false alarms; None where no cost of a miss was given.
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
    """Choose an epsilon as the recipe asks.

    flights: fresh ones, which neither trained nor calibrated the monitor; half of them choose.
    ChoiceError where no epsilon keeps both targets, or with how many flights one could be
    certified.
    """
    missed, false = recipe.most_missed, recipe.most_false_alarms
    if missed is not None and false is not None:
        return _by_targets(monitor, flights, missed, false)
    assert recipe.cost_of_miss is not None
    return _by_cost(monitor, flights, recipe.cost_of_miss)


def _by_targets(
    monitor: Monitor, flights: Rollouts, most_missed: float, most_false: float
) -> Choice:
    """The epsilon that keeps two targets with the most room, certified."""
    chosen, certified = _halves(monitor, flights, candidates(monitor))
    room = np.minimum(
        _room(chosen.miss_rate, most_missed, chosen.n_unsafe),
        _room(chosen.false_alarm_rate, most_false, chosen.n_safe),
    )
    best = int(room.argmax())
    found = _choice(monitor, certified, best)
    if found.most_missed <= most_missed and found.most_false <= most_false:
        return found
    missed, false = (
        (first + second) / n
        for first, second, n in (
            (chosen.misses[best], found.misses, chosen.n_unsafe + found.n_unsafe),
            (chosen.false_alerts[best], found.false_alerts, chosen.n_safe + found.n_safe),
        )
    )
    both = (
        f"at epsilon {found.epsilon:.3g} {_percent(missed)} are missed and {_percent(false)} have "
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
            f"no epsilon keeps both targets: {both}, which comes closest; out of reach: "
            f"{' and '.join(beyond)}. Accept more of either, or train for a shorter lead or by "
            "another method"
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
        f"{len(flights.y):,} fresh flights cannot certify both targets: {both}, which is below "
        f"them, but with 95 % confidence only at most {_percent(found.most_missed)} and "
        f"{_percent(found.most_false)}; {many} fresh flights would"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _by_cost(monitor: Monitor, flights: Rollouts, cost_of_miss: float) -> Choice:
    """The epsilon of the least expected cost a flight, where a false alarm costs 1."""
    chosen, certified = _halves(monitor, flights, candidates(monitor))
    unsafe_share = flights.is_unsafe.mean()
    cost = unsafe_share * cost_of_miss * chosen.miss_rate
    best = int((cost + (1 - unsafe_share) * chosen.false_alarm_rate).argmin())
    found = _choice(monitor, certified, best)
    of_all = cost_of_miss * found.misses + found.false_alerts
    return replace(found, cost=of_all / (found.n_unsafe + found.n_safe))


def candidates(monitor: Monitor) -> Array:
    """Miss rates among which to choose: steps of the p-values that its failures can serve."""
    steps = np.arange(1, monitor.n_unsafe + 1) / (monitor.n_unsafe + 1)
    served = steps[steps >= monitor.smallest_epsilon - 1e-9]
    few = np.unique(np.linspace(0, len(served) - 1, MOST_CANDIDATES).astype(int))
    return served[few]


def _halves(monitor: Monitor, flights: Rollouts, epsilons: Array) -> tuple[Evaluation, Evaluation]:
    """Counts of the flights that choose, and of those that certify: every second one."""
    second: Flags = np.arange(len(flights.y)) % 2 == 1
    halves = flights.some(~second), flights.some(second)
    for half in halves:
        if not 0 < np.count_nonzero(half.is_unsafe) < len(half.y):
            raise ChoiceError(
                f"{len(flights.y)} fresh flights were given, too few of which failed or stayed "
                "safe: give more"
            )
    one, two = (evaluate(monitor, half.y, half.fail_index, epsilons) for half in halves)
    return one, two


def _room(share: Array, target: float, n: int) -> Array:
    """How far below its target a share is, in standard errors of one that lies at the target."""
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
    """Upper bound of one of two shares: both hold with 95 % confidence, by Bonferroni's rule.

    So it is the upper end of the share's own two-sided 95 % interval.
    """
    return float(clopper_pearson(count, n)[1])


def _flights_needed(share: float, target: float) -> float:
    """Flights of one kind by which a share that stays as it is would be certified; inf for many."""
    n = 10.0
    while upper_bound(share * n, n) > target:
        n *= 1.05
        if n > MOST_FLIGHTS:
            return np.inf
    return n
