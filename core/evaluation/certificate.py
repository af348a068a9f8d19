"""The certificate of a monitor: its miss rate and usefulness on its own test flights."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from core.counted import counted
from core.evaluation import IN_WORDS, THRESHOLD
from core.evaluation.rates import clopper_pearson
from core.rollouts import is_same_flight

TWICE = 2.0
"""A monitor is unreliable on flights of which it surely misses more than epsilon, and measured more
than this multiple of it."""
USELESS = 0.2
"""A monitor is useless if, with 97.5 % confidence, fewer safe flights than this pass it."""
UNTESTED = (
    "the monitor was not tested on fresh flights: its miss rate and the share of safe flights "
    "without a false alarm are unknown"
)
UNCALIBRATED = (
    "validity is not calibrated: the monitor cannot tell whether a flight resembles its training"
)

USES = {
    "train and calibrate": "calibrated",
    "choose the method": "chose the method of",
    "calibrate validity": "calibrated the validity of",
    "certify": "certified",
}
"""Use of each part of own flights, in words."""


@dataclass(frozen=True)
class Share:
    """A share of flights with its Clopper-Pearson 95 % interval, low to high."""

    count: int
    total: int

    @property
    def share(self) -> float:
        return self.count / self.total

    @property
    def low(self) -> float:
        return float(clopper_pearson(self.count, self.total)[0])

    @property
    def high(self) -> float:
        return float(clopper_pearson(self.count, self.total)[1])

    def __str__(self) -> str:
        return f"{self.share:.1%} [{self.low:.1%}, {self.high:.1%}]"


@dataclass(frozen=True)
class Certificate:
    """Shares of fresh flights at a tested epsilon; None without flights to count.

    missed: failing flights, valid and without a timely alert.   quiet: safe flights, valid and
    without an alert ("power").   fail_given_alert: failing flights among those with an alert.
    withdrawn, safe_withdrawn: failing flights invalid before an alert, and safe flights invalid
    without an alert; they are in neither share. None where an older version did not count them;
    its quiet flights may include invalid ones.
    """

    epsilon: float
    missed: Share | None
    quiet: Share | None
    fail_given_alert: Share | None
    withdrawn: int | None = None
    safe_withdrawn: int | None = None

    @property
    def is_worse_than_promised(self) -> bool:
        """Whether the whole interval of the miss rate is above epsilon."""
        return self.missed is not None and self.missed.low > self.epsilon

    @property
    def is_useless(self) -> bool:
        """Whether so few safe flights pass without an alert that alerts mean nothing."""
        return self.quiet is not None and self.quiet.high < USELESS

    @property
    def warnings(self) -> list[str]:
        """Warnings to the user of the monitor: problem, figures, remedy; may be empty."""
        warnings = []
        if self.missed is not None and self.is_worse_than_promised:
            warnings.append(
                f"the monitor is worse than its promise: it missed {self.missed} of failing "
                f"flights, promised at most {self.epsilon:.3g}; calibrate it on more failures, or "
                "choose the promise with 95 % confidence"
            )
        if self.quiet is not None and self.is_useless:
            warnings.append(
                f"the monitor is of no use: only {self.quiet} of safe flights stay valid and "
                f"without an alert at epsilon {self.epsilon:.3g}, so alerts mean nothing; accept a "
                "larger epsilon, or train for a shorter warning lead time or with another method"
            )
        return warnings


class UselessMonitor(ValueError):
    """A monitor that alerts on nearly every safe flight, chosen as a flight's only monitor."""


def check_use(evaluation: Mapping[str, Any] | None, epsilon: float) -> None:
    """Raise UselessMonitor if alerts mean nothing; untested monitors pass."""
    tested = certificate(evaluation, epsilon)
    if tested is not None and tested.is_useless:
        raise UselessMonitor(f"{tested.warnings[-1]}. To use it anyway, accept a useless monitor")


def certificate(evaluation: Mapping[str, Any] | None, epsilon: float) -> Certificate | None:
    """The certificate at this epsilon, or at the nearest tested one.

    evaluation: plain data, as stored with a monitor; None if it was not tested.
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
    """The evaluation with the power recomputed, for those of older versions.

    They counted flights that were invalid without an alert as quiet. Where such flights were not
    counted separately, the evaluation stays unchanged.
    """
    n_safe, at, curves = (evaluation[key] for key in ("n_safe", "at_epsilon", "curves"))
    if not n_safe or "safe_withdrawn" not in at or "safe_withdrawn" not in curves:
        return dict(evaluation)

    def powers(counts: Mapping[str, Any]) -> dict[str, Any]:
        left = np.asarray(counts["false_alerts"], int) + np.asarray(counts["safe_withdrawn"], int)
        interval = clopper_pearson(n_safe - left, n_safe)
        return {"power": (1 - left / n_safe).tolist(), "power_interval": interval.tolist()}

    return {**evaluation, "at_epsilon": at | powers(at), "curves": curves | powers(curves)}


def warnings_of(
    evaluation: Mapping[str, Any] | None, epsilon: float, *, is_calibrated: bool = True
) -> list[str]:
    """Warnings to show wherever a monitor appears; also that it was not tested.

    is_calibrated: whether its validity is.
    """
    unchecked = [] if is_calibrated else [UNCALIBRATED]
    tested = certificate(evaluation, epsilon)
    if evaluation is None or tested is None:
        return [UNTESTED, *unchecked]
    return [*tested.warnings, *_no_gain(evaluation), *_off_the_plan(evaluation), *unchecked]


def calibrated_on(evaluation: Mapping[str, Any] | None) -> str:
    """Which failures calibrated a monitor of flown flights, and what its promise is for.

    Empty for a monitor without flown ones.
    """
    counts = (evaluation or {}).get("calibrated_on")
    if counts is None:
        return ""
    simulated, flown, flights = (counts[key] for key in ("simulated", "flown", "flights"))
    of = f"{counted(flown, 'flown failure')} ({counted(flights, 'flight')})"
    if not simulated:
        return f"calibrated on {of}; the promise is for flights drawn like these"
    return (
        f"calibrated on {simulated} simulated and {of}; the promise is for flights drawn like this "
        "mixture, not for either kind alone"
    )


def use_of(evaluation: Mapping[str, Any] | None, digest: str, sizes: Sequence[float] = ()) -> str:
    """Use of a flown flight in training; empty if it had none.

    digest: SHA-256 of its file.   sizes: of its samples, see `is_same_flight`.
    """
    for row in (evaluation or {}).get("flown", ()):
        use = f"this flight is among those that {USES[row['part']]} the monitor"
        if row["digest"] == digest:
            return use
        if is_same_flight(row.get("sizes", ()), sizes):
            return f"{use}, by its samples, which are those of {row['flight']}"
    return ""


def _no_gain(evaluation: Mapping[str, Any]) -> list[str]:
    """The warning that the chosen method is no better than a plain threshold."""
    methods = evaluation.get("methods", ())
    chosen = [method["quiet"] for method in methods if method["chosen"]]
    plain = [method["quiet"] for method in methods if method["name"] == THRESHOLD]
    if not chosen or not plain or plain[0] < chosen[0]:
        return []
    n_safe = methods[0]["n_safe"]
    return [
        f"no method is better than a {IN_WORDS}: {chosen[0]} of {n_safe} safe flights have no "
        f"alert, {plain[0]} with the threshold; expect no early warning, and clear this point "
        "beforehand"
    ]


def _off_the_plan(evaluation: Mapping[str, Any]) -> list[str]:
    """The warning about flights that differ from the plan, if too many failures are missed."""
    epsilon = evaluation["epsilon"]
    missed = []
    for row in evaluation.get("robustness", {}).values():
        rate, (low, high) = miss_rate_of(row)
        if rate is not None and rate > TWICE * epsilon and low > epsilon:
            missed.append(f"{rate:.1%} [{low:.1%}, {high:.1%}] ({row['words']})")
    if not missed:
        return []
    return [
        "the monitor is unreliable off its planned test: of failing flights there it missed "
        f"{', '.join(missed)} at epsilon {epsilon:.3g}, which the promise does not cover; fly as "
        "planned, or train for such flights"
    ]


def miss_rate_of(row: Mapping[str, Any]) -> tuple[float | None, tuple[float, float]]:
    """Miss rate of a stored robustness row, None without failures, and its 95 % interval."""
    misses, n = row["misses"], row["n_unsafe"]
    low, high = row.get("miss_interval") or clopper_pearson(misses, n).tolist()
    rate = row.get("miss_rate")
    return (misses / n if rate is None else rate) if n else None, (low, high)


def _share(count: int, total: int) -> Share | None:
    return Share(count, total) if total else None
