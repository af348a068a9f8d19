"""The certificate of a monitor: what its own test flights say of its promise, and of its use."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from core.evaluation.rates import clopper_pearson

USELESS = 0.2
"""A monitor is of no use that lets, with 97.5 % confidence, less of the safe flights pass."""


UNTESTED = (
    "the monitor was not tested on fresh flights: how often it misses, and how many safe flights "
    "pass without an alert, is not known"
)


@dataclass(frozen=True)
class Share:
    """A share of flights with its Clopper-Pearson 95 % interval, low to high."""

    count: int
    total: int

    @property
    def share(self) -> float:
        """count / total."""
        return self.count / self.total

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return float(clopper_pearson(self.count, self.total)[0])

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return float(clopper_pearson(self.count, self.total)[1])

    def __str__(self) -> str:
        return f"{self.share:.1%} [{self.low:.1%}, {self.high:.1%}]"


@dataclass(frozen=True)
class Certificate:
    """What fresh flights said at an epsilon that was tested; None where there was none to count.

    missed: of the failing flights, valid and without a timely alert.   quiet: of the safe flights,
    valid and without an alert ("power").   fail_given_alert: failing ones of those with an alert.
    withdrawn, safe_withdrawn: failing and safe flights that were called invalid before, and
    without, an alert, and so are in neither share; None where the version that tested the monitor
    did not count them, whose quiet flights may be withdrawn ones.
    """

    epsilon: float
    missed: Share | None
    quiet: Share | None
    fail_given_alert: Share | None
    withdrawn: int | None = None
    safe_withdrawn: int | None = None

    @property
    def is_worse_than_promised(self) -> bool:
        """Whether more was missed than promised, by the whole interval."""
        return self.missed is not None and self.missed.low > self.epsilon

    @property
    def is_useless(self) -> bool:
        """Whether so few safe flights pass without an alert that an alert tells nothing."""
        return self.quiet is not None and self.quiet.high < USELESS

    @property
    def warnings(self) -> list[str]:
        """What a person must know before relying on the monitor; empty where all is well.

        Each says what is wrong, then after a colon the figures and what to do.
        """
        found = []
        if self.missed is not None and self.is_worse_than_promised:
            found.append(
                f"the monitor is worse than its promise: it missed {self.missed} of failing "
                f"flights, where at most {self.epsilon:.3g} was promised; calibrate it "
                "on more failures, or promise with confidence"
            )
        if self.quiet is not None and self.is_useless:
            found.append(
                f"the monitor is of no use: only {self.quiet} of safe flights stay valid "
                f"and without an alert at epsilon {self.epsilon:.3g}, so that an alert tells "
                "nothing; accept a larger epsilon, or train for a shorter lead or by another method"
            )
        return found


class UselessMonitor(ValueError):
    """A monitor that alerts on nearly every safe flight, where it would be a flight's only one."""


def check_use(evaluation: Mapping[str, Any] | None, epsilon: float) -> None:
    """UselessMonitor for one whose alerts tell nothing; one that was not tested may be used."""
    tested = certificate(evaluation, epsilon)
    if tested is not None and tested.is_useless:
        raise UselessMonitor(f"{tested.warnings[-1]}. To use it all the same, accept that it is")


def certificate(evaluation: Mapping[str, Any] | None, epsilon: float) -> Certificate | None:
    """What the test flights said at this epsilon, or at the nearest one that they were asked.

    evaluation: as plain data, as a monitor carries it; None: it was not tested.
    """
    if evaluation is None:
        return None
    curves = evaluation["curves"]
    points = [evaluation["at_epsilon"] | {"epsilon": evaluation["epsilon"]}]
    points += [
        dict(zip(curves, values, strict=True)) for values in zip(*curves.values(), strict=True)
    ]
    at = min(points, key=lambda point: abs(point["epsilon"] - epsilon))
    misses, false_alerts = int(at["misses"]), int(at["false_alerts"])
    withdrawn, safe_withdrawn = at.get("withdrawn"), at.get("safe_withdrawn")
    n_unsafe, n_safe = evaluation["n_unsafe"], evaluation["n_safe"]
    caught = n_unsafe - misses - (withdrawn or 0)
    return Certificate(
        at["epsilon"],
        _share(misses, n_unsafe),
        _share(n_safe - false_alerts - (safe_withdrawn or 0), n_safe),
        _share(caught, caught + false_alerts),
        withdrawn,
        safe_withdrawn,
    )


def with_power_of_quiet(evaluation: Mapping[str, Any]) -> dict[str, Any]:
    """The evaluation with the power of quiet flights, also where an older version wrote it.

    Once the power counted flights that were called invalid without an alert. Where these were not
    counted apart it stays as it is.
    """
    n_safe, at, curves = (evaluation[key] for key in ("n_safe", "at_epsilon", "curves"))
    if not n_safe or "safe_withdrawn" not in at or "safe_withdrawn" not in curves:
        return dict(evaluation)

    def powers(counts: Mapping[str, Any]) -> dict[str, Any]:
        left = np.asarray(counts["false_alerts"], int) + np.asarray(counts["safe_withdrawn"], int)
        interval = clopper_pearson(n_safe - left, n_safe)
        return {"power": (1 - left / n_safe).tolist(), "power_interval": interval.tolist()}

    return {**evaluation, "at_epsilon": at | powers(at), "curves": curves | powers(curves)}


def warnings_of(evaluation: Mapping[str, Any] | None, epsilon: float) -> list[str]:
    """Sentences that stand wherever a monitor is told of; also that it was not tested."""
    tested = certificate(evaluation, epsilon)
    return [UNTESTED] if tested is None else tested.warnings


def _share(count: int, total: int) -> Share | None:
    return Share(count, total) if total else None
