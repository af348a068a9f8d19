"""Evaluation on fresh rollouts: how often a monitor is silent, how often it alerts in vain."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.monitor.group import GROUPINGS, members
from core.monitor.monitor import Monitor
from core.types import Array, Indices

EPSILONS = np.arange(1, 50) / 50
"""The grid of the paper's figure: 0.02, 0.04, ..., 0.98."""


def clopper_pearson(
    successes: npt.ArrayLike, trials: npt.ArrayLike, confidence: float = 0.95
) -> Array:
    """Exact binomial interval of a share.

    successes, trials: counts of any one shape, (...); fractional counts serve effective sizes.
    Returns (..., 2) lower and upper bound; (0, 1) where there was no trial.
    """
    from scipy.special import betaincinv  # slow to import, and only needed here

    k, n = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    tail = (1 - confidence) / 2
    none, all_ = k <= 0, k >= n
    lower = betaincinv(np.where(none, 1, k), n - k + 1, tail)
    upper = betaincinv(k + 1, np.where(all_, 1, n - k), 1 - tail)
    return np.stack([np.where(none, 0, lower), np.where(all_, 1, upper)], axis=-1)


def clustered_interval(
    successes: npt.NDArray, trials: npt.NDArray, confidence: float = 0.95
) -> Array:
    """Interval of a share over clusters whose own shares scatter, such as one monitor's flights.

    Clopper-Pearson at the effective sample size (Korn and Graubard, Survey Methodology 24, 1998):
    as many independent trials as would give the scatter seen between the clusters.

    successes: (n_clusters, ...).   trials: the same or broadcast to it.   Returns (..., 2).
    """
    from scipy.special import stdtrit  # slow to import, and only needed here

    trials, n_clusters = np.broadcast_to(trials, successes.shape), len(successes)
    if n_clusters == 1:
        return clopper_pearson(successes[0], trials[0], confidence)
    total = np.asarray(trials.sum(axis=0), float)
    share = successes.sum(axis=0) / np.maximum(total, 1)
    residual = (successes - share * trials) / np.maximum(total, 1)
    variance = (residual**2).sum(axis=0) * n_clusters / (n_clusters - 1)
    independent = np.divide(share * (1 - share), variance, out=total.copy(), where=variance > 0)
    tail = (1 - confidence) / 2
    flights, clusters = np.maximum(total - 1, 1), n_clusters - 1
    few = (stdtrit(flights, tail) / stdtrit(clusters, tail)) ** 2
    effective = np.minimum(independent * few, total)
    return clopper_pearson(share * effective, effective, confidence)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Counts over fresh flights at each epsilon.

    epsilons: (n_eps,).   n_unsafe, n_safe: flights that failed and that did not.
    n_early: failures that came before any timely alert could; each is a miss.
    misses: (n_eps,) failing flights without an alert at least t_early before the failure.
    false_alerts: (n_eps,) safe flights with an alert at any time.
    withdrawn: (n_eps,) failing flights of which nothing was said any more, for being outside
    training, before an alert that would have counted: neither missed nor caught.
    safe_withdrawn: (n_eps,) safe flights that were called so without an alert: no false alarm, and
    no quiet flight either.

    So each failing flight is missed, withdrawn or caught, and each safe one has a false alert, is
    withdrawn or is quiet.
    """

    epsilons: Array
    n_unsafe: int
    n_safe: int
    n_early: int
    misses: Indices
    false_alerts: Indices
    withdrawn: Indices
    safe_withdrawn: Indices

    @property
    def caught(self) -> Indices:
        """(n_eps,) failing flights with an alert at least t_early before the failure."""
        return self.n_unsafe - self.misses - self.withdrawn

    @property
    def miss_rate(self) -> Array:
        """(n_eps,) share of the failing flights that were missed."""
        return self.misses / max(self.n_unsafe, 1)

    @property
    def miss_interval(self) -> Array:
        """(n_eps, 2) Clopper-Pearson 95 % interval of the miss rate."""
        return clopper_pearson(self.misses, self.n_unsafe)

    @property
    def quiet(self) -> Indices:
        """(n_eps,) safe flights that stayed valid and had no alert."""
        return self.n_safe - self.false_alerts - self.safe_withdrawn

    @property
    def false_alarm_rate(self) -> Array:
        """(n_eps,) share of the safe flights with an alert."""
        return self.false_alerts / max(self.n_safe, 1)

    @property
    def power(self) -> Array:
        """(n_eps,) share of the safe flights that are quiet: those called invalid do not count."""
        return 1 - (self.false_alerts + self.safe_withdrawn) / max(self.n_safe, 1)

    @property
    def power_interval(self) -> Array:
        """(n_eps, 2) Clopper-Pearson 95 % interval of the power."""
        return clopper_pearson(self.quiet, self.n_safe)

    @property
    def fail_given_alert(self) -> Array:
        """(n_eps,) share of failures among flights with a timely or false alert; NaN for none."""
        alerts = self.caught + self.false_alerts
        return np.divide(self.caught, alerts, out=np.full(len(alerts), np.nan), where=alerts > 0)

    @property
    def fail_given_alert_interval(self) -> Array:
        """(n_eps, 2) Clopper-Pearson 95 % interval of P(fail | alert)."""
        return clopper_pearson(self.caught, self.caught + self.false_alerts)


def evaluate(
    monitor: Monitor, y: Array, fail_index: Indices, epsilons: Array | None = None
) -> Evaluation:
    """Fly fresh trajectories through a monitor and count, at each epsilon it can serve.

    A monitor whose validity is calibrated says nothing of a flight once it is outside training.

    y: (n, n_samples, 6), none of which trained the monitor; safe ones over the full horizon.
    fail_index: (n,) first sample that exceeds a limit, n_samples for a safe flight.
    epsilons: (n_eps,); unless given, those of EPSILONS that the monitor's failures can serve.
    """
    if epsilons is None:
        epsilons = EPSILONS[monitor.smallest_epsilon <= EPSILONS + 1e-9]
    above = np.array([monitor.alert_above(epsilon) for epsilon in epsilons])
    is_unsafe = fail_index < y.shape[1]
    last = np.where(is_unsafe, fail_index - monitor.h, y.shape[1] - 1)
    heard = np.minimum(last, monitor.first_withdrawn(y, fail_index) - 1)
    silent = monitor.highest_p_values(y, heard)[:, None] <= above
    is_missed = silent & (heard == last)[:, None]
    return Evaluation(
        epsilons=np.asarray(epsilons),
        n_unsafe=int(is_unsafe.sum()),
        n_safe=int((~is_unsafe).sum()),
        n_early=int((last < 0).sum()),
        misses=is_missed[is_unsafe].sum(axis=0),
        false_alerts=(~silent[~is_unsafe]).sum(axis=0),
        withdrawn=(silent & ~is_missed)[is_unsafe].sum(axis=0),
        safe_withdrawn=(silent & ~is_missed)[~is_unsafe].sum(axis=0),
    )


def evaluate_groups(
    monitor: Monitor, y: Array, fail_index: Indices, epsilon: float | None = None
) -> dict[str, dict[str, Evaluation]]:
    """Count at one epsilon over the failing flights of each group, by grouping and by its name.

    What is promised of all failing flights is not promised of each group.

    y, fail_index: as in `evaluate`.   epsilon: the monitor's own unless given.
    Groupings of which the flights are not in two groups at least are left out; of a monitor that is
    calibrated by groups, these are its own.
    """
    at, fails = np.array([monitor.check_epsilon(epsilon)]), fail_index < y.shape[1]
    y, fail_index = y[fails], fail_index[fails]
    own, found = monitor.groups, {}
    for rule, grouping in GROUPINGS.items():
        if own is not None and own.rule.kind == rule:
            groups = members(own.rule, y, fail_index)
        else:
            groups = grouping.groups(y, fail_index, monitor.specification)
        if groups:
            found[rule] = {
                name: evaluate(monitor, y[those], fail_index[those], at)
                for name, those in groups.items()
            }
    return found


def first_alerts(
    monitor: Monitor, y: Array, fail_index: Indices, epsilon: float | None = None
) -> Indices:
    """First sample of each flight at which the monitor alerts, by its failure if it fails.

    y, fail_index: as in `evaluate`.   Returns (n,); n_samples where it does not alert.
    """
    above, n_samples = monitor.alert_above(epsilon), y.shape[1]
    last = np.minimum(fail_index, n_samples - 1)
    heard = np.minimum(last, monitor.first_withdrawn(y, fail_index) - 1)
    found = np.full(len(y), n_samples)
    which = np.flatnonzero(monitor.highest_p_values(y, heard) > above)
    y, silent, alerted = y[which], np.full(len(which), -1), heard[which]
    while (apart := alerted - silent > 1).any():
        between = np.where(apart, (silent + alerted) // 2, alerted)
        alerts = monitor.highest_p_values(y, between) > above
        silent, alerted = np.where(alerts, silent, between), np.where(alerts, between, alerted)
    found[which] = alerted
    return found


def leads(alerts: Indices, fail_index: Indices, n_samples: int, dt: float) -> Array:
    """Time from the first alert to the failure of each failing flight.

    alerts: (n,) as `first_alerts` finds them.   fail_index: (n,).   dt: [s].
    Returns (n_unsafe,) [s], shorter than the monitor's lead where the alert came too late to
    count, negative infinity where none came by the failure.
    """
    alerts, fails = alerts[fail_index < n_samples], fail_index[fail_index < n_samples]
    return np.where(alerts < n_samples, (fails - alerts) * dt, -np.inf)
