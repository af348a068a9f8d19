"""Evaluation on fresh rollouts: missed failures and false alarms of a monitor."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from core.channels import LATERAL
from core.monitor.group import GROUPINGS, members
from core.monitor.monitor import Monitor
from core.types import Array, Flags, Indices

EPSILONS = np.arange(1, 50) / 50
"""The grid of the paper's figure: 0.02, 0.04, ..., 0.98."""


def clopper_pearson(
    successes: npt.ArrayLike, trials: npt.ArrayLike, confidence: float = 0.95
) -> Array:
    """Exact binomial interval of a share.

    successes, trials: counts of any one shape, (...); fractional for effective sizes.
    Returns (..., 2) lower and upper bound; (0, 1) without a trial.
    """
    from scipy.special import betaincinv  # slow to import, and only needed here

    k, n = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    tail = (1 - confidence) / 2
    none, all_ = k <= 0, k >= n
    lower = betaincinv(np.where(none, 1, k), n - k + 1, tail)
    upper = betaincinv(k + 1, np.where(all_, 1, n - k), 1 - tail)
    return np.stack([np.where(none, 0, lower), np.where(all_, 1, upper)], axis=-1)


def clustered_interval(successes: npt.NDArray, trials: npt.NDArray) -> Array:
    """95 % interval of a share over clusters with scattering shares, such as a monitor's flights.

    Clopper-Pearson at the effective sample size (Korn and Graubard, Survey Methodology 24, 1998):
    the number of independent trials with the same scatter as between the clusters.

    successes: (n_clusters, ...).   trials: the same or broadcast to it.   Returns (..., 2).
    """
    from scipy.special import stdtrit  # slow to import, and only needed here

    trials, n_clusters = np.broadcast_to(trials, successes.shape), len(successes)
    if n_clusters == 1:
        return clopper_pearson(successes[0], trials[0])
    total = np.asarray(trials.sum(axis=0), float)
    share = successes.sum(axis=0) / np.maximum(total, 1)
    residual = (successes - share * trials) / np.maximum(total, 1)
    variance = (residual**2).sum(axis=0) * n_clusters / (n_clusters - 1)
    independent = np.divide(share * (1 - share), variance, out=total.copy(), where=variance > 0)
    tail = 0.025
    flights, clusters = np.maximum(total - 1, 1), n_clusters - 1
    few = (stdtrit(flights, tail) / stdtrit(clusters, tail)) ** 2
    effective = np.minimum(independent * few, total)
    return clopper_pearson(share * effective, effective)


@dataclass(frozen=True, eq=False)
class PooledCounts:
    """Counts of one method over several monitors, one row for each.

    misses, false_alerts: (n_monitors, ...) failing flights without a timely alert, and safe flights
    with an alert.   n_unsafe, n_safe: the same or broadcast to it, flights that failed and that did
    not.   Intervals are of 95 % and include the scatter between monitors.
    """

    misses: Indices
    n_unsafe: Indices
    false_alerts: Indices
    n_safe: Indices

    @property
    def miss_rate(self) -> Array:
        """(...,) share of all failing flights without a timely alert."""
        return self.misses.sum(axis=0) / max(self.n_unsafe.sum(), 1)

    @property
    def miss_interval(self) -> Array:
        return clustered_interval(self.misses, self.n_unsafe)

    @property
    def power(self) -> Array:
        """(...,) share of all safe flights without an alert."""
        return 1 - self.false_alerts.sum(axis=0) / max(self.n_safe.sum(), 1)

    @property
    def power_interval(self) -> Array:
        return clustered_interval(self.n_safe - self.false_alerts, self.n_safe)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Counts over fresh flights at each epsilon.

    epsilons: (n_eps,).   n_unsafe, n_safe: flights that failed and that did not.
    n_early: failures too early for any timely alert; each is a miss.
    misses: (n_eps,) failing flights without an alert at least t_early before the failure.
    false_alerts: (n_eps,) safe flights with an alert at any time.
    withdrawn: (n_eps,) failing flights outside training, so withdrawn before a timely alert:
    neither missed nor caught.
    safe_withdrawn: (n_eps,) safe flights withdrawn without an alert: neither a false alarm nor
    quiet.

    failures_of, misses_of, withdrawn_of: (n_aircraft,) and (n_aircraft, n_eps) the same of each
    aircraft with failures, where aircraft were flown several times; every aircraft then weighs the
    same in `miss_rate` and `withdrawn_rate`.

    Each failing flight is missed, withdrawn or caught; each safe flight has a false alert, is
    withdrawn or is quiet. An alert or a withdrawal counts only if it is in time: a later one leaves
    the flight missed.
    """

    epsilons: Array
    n_unsafe: int
    n_safe: int
    n_early: int
    misses: Indices
    false_alerts: Indices
    withdrawn: Indices
    safe_withdrawn: Indices
    failures_of: Indices | None = None
    misses_of: Indices | None = None
    withdrawn_of: Indices | None = None

    @property
    def caught(self) -> Indices:
        """(n_eps,) failing flights with an alert at least t_early before the failure."""
        return self.n_unsafe - self.misses - self.withdrawn

    @property
    def miss_rate(self) -> Array:
        """(n_eps,) share of the failing flights that were missed, or its mean over aircraft."""
        return self._share(self.misses, self.misses_of)

    @property
    def withdrawn_rate(self) -> Array:
        """(n_eps,) share of the failing flights that were withdrawn, or its mean over aircraft."""
        return self._share(self.withdrawn, self.withdrawn_of)

    def _share(self, count: Indices, of: Indices | None) -> Array:
        if self.failures_of is None or of is None or not self.n_unsafe:
            return count / max(self.n_unsafe, 1)
        return (of / self.failures_of[:, np.newaxis]).mean(axis=0)

    @property
    def miss_interval(self) -> Array:
        """(n_eps, 2) 95 % interval of the miss rate: Clopper-Pearson, with the scatter between
        aircraft where they were flown several times."""
        if self.failures_of is None or self.misses_of is None or not self.n_unsafe:
            return clopper_pearson(self.misses, self.n_unsafe)
        failures, each = self.failures_of[:, np.newaxis], self.failures_of.mean()
        shares = self.misses_of / failures
        return clustered_interval(each * shares, np.full_like(shares, each))

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
        """(n_eps,) share of the safe flights that are quiet; invalid ones are not."""
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
    monitor: Monitor,
    y: Array,
    fail_index: Indices,
    epsilons: Array | None = None,
    aircraft: Indices | None = None,
) -> Evaluation:
    """Fly fresh trajectories through a monitor and count at each epsilon.

    A monitor with calibrated validity withdraws once a flight is outside training.

    y: (n, n_samples, 6), none of which trained the monitor; safe ones over the full horizon.
    fail_index: (n,) first sample that exceeds a limit, n_samples for a safe flight.
    epsilons: (n_eps,); default: those of EPSILONS for which the monitor has enough failures.
    aircraft: (n,) number of each flight's aircraft, if aircraft were flown several times.
    """
    if epsilons is None:
        epsilons = EPSILONS[monitor.smallest_epsilon <= EPSILONS + 1e-9]
    above = np.array([monitor.alert_above(epsilon) for epsilon in epsilons])
    is_unsafe = fail_index < y.shape[1]
    last = np.where(is_unsafe, fail_index - monitor.h, y.shape[1] - 1)
    until = np.minimum(last, monitor.first_withdrawn(y, fail_index) - 1)
    silent = monitor.highest_p_values(y, until)[:, None] <= above
    is_missed = silent & (until == last)[:, None]
    counts = count_silent(np.asarray(epsilons), is_unsafe, last, silent, is_missed)
    if aircraft is None:
        return counts
    _, of, failures_of = np.unique(aircraft[is_unsafe], return_inverse=True, return_counts=True)
    misses_of, withdrawn_of = np.zeros((2, len(failures_of), len(above)), np.int64)
    np.add.at(misses_of, of, is_missed[is_unsafe])
    np.add.at(withdrawn_of, of, (silent & ~is_missed)[is_unsafe])
    return replace(counts, failures_of=failures_of, misses_of=misses_of, withdrawn_of=withdrawn_of)


def count_silent(
    epsilons: Array,
    is_unsafe: Flags,
    last: Indices,
    silent: Flags,
    is_valid: Flags | None = None,
) -> Evaluation:
    """Count flights without an alert.

    is_unsafe: (n,).   last: (n,) last sample at which an alert counts, negative for none.
    silent: (n, n_eps) whether a flight has no alert by then.   is_valid: (n, n_eps) which of these
    are valid by then; default: all.
    """
    is_missed = silent if is_valid is None else is_valid
    return Evaluation(
        epsilons=epsilons,
        n_unsafe=int(is_unsafe.sum()),
        n_safe=int((~is_unsafe).sum()),
        n_early=int((last < 0).sum()),
        misses=is_missed[is_unsafe].sum(axis=0),
        false_alerts=(~silent[~is_unsafe]).sum(axis=0),
        withdrawn=(silent & ~is_missed)[is_unsafe].sum(axis=0),
        safe_withdrawn=(silent & ~is_missed)[~is_unsafe].sum(axis=0),
    )


def evaluate_groups(
    monitor: Monitor, y: Array, fail_index: Indices
) -> dict[str, dict[str, Evaluation]]:
    """Count at the monitor's epsilon over the failing flights of each group, by grouping and name.

    The guarantee for all failing flights does not hold for each group.

    y, fail_index: as in `evaluate`.
    Groupings with fewer than two groups of these flights are left out. For a monitor calibrated by
    groups, its own groups are used. They are defined for the lateral channels only.
    """
    if monitor.dictionary != LATERAL:
        return {}
    at, fails = np.array([monitor.check_epsilon()]), fail_index < y.shape[1]
    y, fail_index = y[fails], fail_index[fails]
    own_groups, evaluations = monitor.groups, {}
    for rule, grouping in GROUPINGS.items():
        if own_groups is not None and own_groups.rule.kind == rule:
            groups = members(own_groups.rule, y, fail_index)
        else:
            groups = grouping.groups(y, fail_index, monitor.specification)
        if groups:
            evaluations[rule] = {
                name: evaluate(monitor, y[those], fail_index[those], at)
                for name, those in groups.items()
            }
    return evaluations


def first_alerts(
    monitor: Monitor, y: Array, fail_index: Indices, epsilon: float | None = None
) -> Indices:
    """First sample of each flight with an alert, up to its failure.

    y, fail_index: as in `evaluate`.   Returns (n,); n_samples without an alert.
    """
    above = monitor.alert_above(epsilon)
    last = np.minimum(fail_index, y.shape[1] - 1)
    until = np.minimum(last, monitor.first_withdrawn(y, fail_index) - 1)
    return first_sample(lambda y, k: monitor.highest_p_values(y, k) > above, y, until)


def first_sample(alerts: Callable[[Array, Indices], Flags], y: Array, until: Indices) -> Indices:
    """First sample up to `until` with an alert in each flight y, by bisection.

    alerts: (n,) whether flights y (n, n_samples, 6) alert by samples (n,).
    Returns (n,); n_samples without an alert.
    """
    first = np.full(len(y), y.shape[1])
    which = np.flatnonzero(alerts(y, until))
    y, silent, alerted = y[which], np.full(len(which), -1), until[which]
    while (apart := alerted - silent > 1).any():
        between = np.where(apart, (silent + alerted) // 2, alerted)
        reached = alerts(y, between)
        silent, alerted = np.where(reached, silent, between), np.where(reached, between, alerted)
    first[which] = alerted
    return first


def leads(alerts: Indices, fail_index: Indices, n_samples: int, dt: float) -> Array:
    """Time from the first alert to the failure of each failing flight.

    alerts: (n,) of `first_alerts`.   fail_index: (n,).   dt: [s].
    Returns (n_unsafe,) [s], shorter than the monitor's lead for a late alert, negative infinity
    without an alert by the failure.
    """
    alerts, fails = alerts[fail_index < n_samples], fail_index[fail_index < n_samples]
    return np.where(alerts < n_samples, (fails - alerts) * dt, -np.inf)
