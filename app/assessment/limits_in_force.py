"""The limits in force during a flight, by flight condition, and the monitors they suit.

A monitor's own limits never change: its guarantee holds for them alone. Where other limits are in
force the monitor is not applicable. Where the limits in force are unknown, nothing is assessed.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from core.channels import LATERAL
from core.flight_events import FlightLimits
from core.limits.limit_sets import (
    CONDITION_KEYS,
    MISSING,
    NO_CONDITION,
    STALE,
    Condition,
    ConditionKey,
    LimitSet,
    limit_set_from_plain,
    limit_set_to_plain,
)
from core.limits.limits import Envelope, Limits, limits_in_words
from core.monitor import Assessment, State
from core.monitor.assessment import Cause, withdrawn
from core.monitor.status import LIMITS_UNKNOWN, NOT_APPLICABLE

CONDITION_VALID_S = 1.0
"""How long a flight-condition value stays valid without a newer one [s]."""
ROUNDING = 1e-9


@dataclass(frozen=True)
class LimitsInForce(FlightLimits):
    """With the limits themselves. serving: for each case, which stored monitors would fit."""

    limits: LimitSet
    serving: tuple[str, ...]

    @property
    def words(self) -> str:
        return f"limit set {self.name} version {self.version}"

    def to_plain(self) -> dict[str, Any]:
        return vars(self) | {
            "limits": limit_set_to_plain(self.limits),
            "serving": list(self.serving),
        }

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> "LimitsInForce":
        limits = limit_set_from_plain(plain["limits"])
        return cls(**{**plain, "limits": limits, "serving": tuple(plain["serving"])})


@dataclass(frozen=True, eq=False)
class Ruling:
    """Which limits apply to a sample.

    limits: None where unknown.   case: name of the flight condition; empty where there is
    none.   reasons: for each monitor, why it is not applicable; empty where it is.
    """

    in_force: LimitsInForce
    limits: Envelope | None
    case: str
    reasons: tuple[str, ...]
    specification: Limits | None = None

    @property
    def reason(self) -> str:
        """Why the limits are unknown; empty where they are known."""
        return self.reasons[0] if self.limits is None else ""

    @property
    def cause(self) -> Cause:
        return Cause.LIMITS_UNKNOWN if self.limits is None else Cause.NOT_APPLICABLE

    def apply(
        self, assessment: Assessment, display: Sequence[Assessment] = ()
    ) -> tuple[Assessment, tuple[Assessment, ...]]:
        """Replace each assessment by a withdrawal where its monitor is not applicable."""
        ruled = [
            withdrawn(each.t, reason, self.cause)
            if reason and each.state is not State.STALE
            else each
            for each, reason in zip((assessment, *display), self.reasons, strict=True)
        ]
        return ruled[0], tuple(ruled[1:])


class InForceFrom(NamedTuple):
    """A ruling for samples after t [s] (None: all samples). ruling None: the monitor's own."""

    t: float | None
    ruling: Ruling | None


class LimitsRule:
    """Which limits apply to each sample of a flight while one version of a set is in force.

    own: limits of each monitor of the flight, the alarm authority first.
    """

    def __init__(self, in_force: LimitsInForce, own: Sequence[Envelope | None]) -> None:
        self.in_force, self._own = in_force, own
        fixed = in_force.fixed
        self._fixed = tuple(fixed.get(key) for key in CONDITION_KEYS)
        self._rulings: dict[int | str, Ruling] = {}
        self._last: tuple[Condition, Ruling] | None = None

    def at(self, measured: Condition = NO_CONDITION) -> Ruling:
        """The ruling at a condition; declared values override measured ones."""
        if self._last is not None and self._last[0] == measured:
            return self._last[1]
        condition = tuple(
            value if declared is None else declared
            for declared, value in zip(self._fixed, measured, strict=True)
        )
        ruling = self._ruling(condition)
        self._last = measured, ruling
        return ruling

    def _ruling(self, condition: Condition) -> Ruling:
        limits = self.in_force.limits
        case = limits.find(condition)
        key = limits.why_none(condition) if case is None else case
        if key not in self._rulings:
            if len(self._rulings) > 2 * len(limits.cases):
                self._rulings.clear()
            self._rulings[key] = self._made(key)
        return self._rulings[key]

    def _made(self, key: int | str) -> Ruling:
        in_force = self.in_force
        if isinstance(key, str):
            reason = f"{LIMITS_UNKNOWN}: {key}"
            return Ruling(in_force, None, "", (reason,) * len(self._own))
        case = in_force.limits.cases[key]
        limits = case.limits.envelope
        reasons = tuple(
            ""
            if own is not None and own.is_as(limits)
            else f"{NOT_APPLICABLE}: {limits_in_words(LATERAL, limits)} in force, the monitor "
            f"warns of {limits_in_words(LATERAL, own)}; {in_force.serving[key]}"
            for own in self._own
        )
        return Ruling(in_force, limits, case.name, reasons, case.limits)


class ConditionHold:
    """The measured condition at each time of a live flight, from the values received by then.

    A value applies until the next one of its channel, for at most CONDITION_VALID_S.
    """

    def __init__(self) -> None:
        self._values: dict[int, deque[tuple[float, float]]] = {}

    def note(self, t: float, condition: Sequence[float | None]) -> None:
        """Store the values sent with a sample: NaN means unknown, None means not sent."""
        for k, value in enumerate(condition):
            if value is not None:
                self._values.setdefault(k, deque(maxlen=10_000)).append((t, value))

    def at(self, t: float) -> Condition:
        """The condition at a grid time. Times increase, except where the clock steps."""
        if not self._values:
            return NO_CONDITION
        return tuple(self._at(k, t) for k in range(len(CONDITION_KEYS)))

    def _at(self, k: int, t: float) -> float | str:
        values = self._values.get(k)
        if not values:
            return MISSING
        newest = next((i for i in reversed(range(len(values))) if values[i][0] <= t + ROUNDING), -1)
        if newest < 0:
            return MISSING
        for _ in range(newest):
            values.popleft()
        when, value = values[0]
        if not isfinite(value):
            return MISSING
        return value if t - when <= CONDITION_VALID_S else STALE


class RequestedLimits(NamedTuple):
    """A stored limit set that an engineer asks to put in force.

    fixed: declared condition values; None keeps the present ones.
    """

    limit_set: str
    name: str
    version: int
    limits: LimitSet
    serving: tuple[str, ...]
    fixed: Mapping[ConditionKey, float] | None = None
