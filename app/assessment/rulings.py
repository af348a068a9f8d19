"""What applies to a sample at its flight condition: the limits, and the monitors they suit.

A monitor's own limits never change: its guarantee holds for them alone. Where other limits are in
force the monitor is not applicable. Where the limits in force are unknown, nothing is assessed;
what is beyond the limits of every case of the set still exceeds.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

from app.telemetry.targets import check_limits
from core.channels import LATERAL
from core.conditions import (
    CONDITION_KEYS,
    CONDITIONS,
    IMPLAUSIBLE,
    MISSING,
    NO_CONDITION,
    STALE,
    Cases,
    Condition,
    ConditionKey,
)
from core.flight_events import FlightLimits
from core.limits.limit_sets import LimitSet, limit_set_from_plain, limit_set_to_plain
from core.limits.limits import Envelope, Specification, limits_in_words
from core.monitor import Assessment, State
from core.monitor.assessment import Cause, withdrawn
from core.monitor.status import LIMITS_UNKNOWN, NOT_APPLICABLE

CONDITION_VALID_S = 1.0
"""How long a flight-condition value stays valid without a newer one [s]."""
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Ruling:
    """What applies to a sample.

    limits: what exceedances are judged by, None where unknown.   specification: the limits in
    force, None where unknown.   case: name of the flight condition; empty where there is none.
    reasons: for each monitor, why it is not applicable; empty where it is.   cause: of these.
    widest: of the set, beyond which alone a value exceeds where the limits in force are unknown;
    else None.   beyond: the same in words; empty for None.   member: what the set has of each case.
    """

    member: ClassVar[str] = "case"

    limits: Envelope | None
    specification: Specification
    case: str
    reasons: tuple[str, ...]
    cause: Cause

    @property
    def widest(self) -> Envelope | None:
        return self.limits if self.specification is None else None

    @property
    def beyond(self) -> str:
        return "" if self.widest is None else f"beyond the limit of every {self.member} of the set"

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
    """A ruling from the sample at t [s] on (None: all samples). ruling None: the monitor's own."""

    t: float | None
    ruling: Ruling | None


AnyRuling = TypeVar("AnyRuling", bound=Ruling)


class ConditionRule(ABC, Generic[AnyRuling]):
    """Which case of a set holds at a flight condition.

    Declared values override measured ones.   contradiction: why measured ones would give another
    case than the newest; empty if they would not.
    """

    def __init__(self, cases: Cases[Any], declared: Mapping[Any, float]) -> None:
        self._cases = cases
        self._declared = tuple(declared.get(key) for key in CONDITION_KEYS)
        self._rulings: dict[int | str, AnyRuling] = {}
        self._last: tuple[Condition, AnyRuling] | None = None
        self._case: int | None = None
        self.contradiction = ""

    @property
    def measured(self) -> list[ConditionKey]:
        """Channels that decide which case holds, without declared ones."""
        declared = dict(zip(CONDITION_KEYS, self._declared, strict=True))
        return [key for key in self._cases.needed if declared[key] is None]

    def at(self, measured: Condition = NO_CONDITION) -> AnyRuling:
        """The ruling at the next condition; the same object while nothing changes."""
        if self._last is not None and self._last[0] == measured:
            return self._last[1]
        case, ruling = self._found(measured)
        self._case = self._case if case is None else case
        self._last = measured, ruling
        self.contradiction = self._contradiction(measured)
        return ruling

    def ahead(self, measured: Condition) -> AnyRuling:
        """The ruling at a condition that is not next yet."""
        return self._found(measured)[1]

    def _contradiction(self, measured: Condition) -> str:
        condition, labels = self._merged(measured), []
        sent = list(condition)
        for k, (declared, value) in enumerate(zip(self._declared, measured, strict=True)):
            if declared not in (None, value) and not isinstance(value, str):
                sent[k] = value
                label = CONDITIONS[CONDITION_KEYS[k]].label
                labels.append(f"{label} {declared:g} is declared, the source sends {value:g}")
        find = self._cases.find
        same = not labels or find(tuple(sent), self._case) == find(condition, self._case)
        return "" if same else "; ".join(labels)

    def _merged(self, measured: Condition) -> Condition:
        return tuple(
            value if declared is None else declared
            for declared, value in zip(self._declared, measured, strict=True)
        )

    def _found(self, measured: Condition) -> tuple[int | None, AnyRuling]:
        condition = self._merged(measured)
        case = self._cases.find(condition, self._case)
        key = self._cases.why_none(condition) if case is None else case
        if key not in self._rulings:
            if len(self._rulings) > 2 * len(self._cases.cases):
                self._rulings.clear()
            self._rulings[key] = self._of_case(key) if isinstance(key, int) else self._without(key)
        return case, self._rulings[key]

    @abstractmethod
    def _of_case(self, case: int) -> AnyRuling: ...

    @abstractmethod
    def _without(self, reason: str) -> AnyRuling:
        """The ruling where no case holds, and why."""


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
        condition = self.ahead(t)
        for values in self._values.values():
            while len(values) > 1 and values[1][0] <= t + ROUNDING:
                values.popleft()
        return condition

    def ahead(self, t: float) -> Condition:
        """The condition at a time whose grid time is not next yet."""
        if not self._values:
            return NO_CONDITION
        return tuple(self._at(k, t) for k in range(len(CONDITION_KEYS)))

    def _at(self, k: int, t: float) -> float | str:
        known = (each for each in reversed(self._values.get(k, ())) if each[0] <= t + ROUNDING)
        when, value = next(known, (t, inf))
        if not isfinite(value):
            return MISSING
        if not CONDITIONS[CONDITION_KEYS[k]].is_plausible(value):
            return IMPLAUSIBLE
        return value if t - when <= CONDITION_VALID_S else STALE


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
class LimitsRuling(Ruling):
    """Which limits of a limit set apply to a sample, and which monitors they suit."""

    in_force: LimitsInForce

    @property
    def reason(self) -> str:
        """Why the limits are unknown; empty where they are known."""
        return self.reasons[0] if self.specification is None else ""


class LimitsRule(ConditionRule[LimitsRuling]):
    """Which limits apply to each sample of a flight while one version of a set is in force.

    own: limits of each monitor of the flight, the alarm authority first.
    """

    def __init__(self, in_force: LimitsInForce, own: Sequence[Envelope | None]) -> None:
        super().__init__(in_force.limits, in_force.fixed)
        self.in_force, self._own = in_force, own

    def _of_case(self, case: int) -> LimitsRuling:
        in_force = self.in_force
        of_case = in_force.limits.cases[case]
        limits = of_case.limits.envelope
        reasons = tuple(
            ""
            if own is not None and own.is_as(limits)
            else f"{NOT_APPLICABLE}: {limits_in_words(LATERAL, limits)} in force, the monitor "
            f"warns of {limits_in_words(LATERAL, own)}; {in_force.serving[case]}"
            for own in self._own
        )
        about = limits, of_case.limits, of_case.name, reasons, Cause.NOT_APPLICABLE
        return LimitsRuling(*about, in_force)

    def _without(self, reason: str) -> LimitsRuling:
        reasons = (f"{LIMITS_UNKNOWN}: {reason}",) * len(self._own)
        widest = Envelope.widest([case.limits.envelope for case in self.in_force.limits.cases])
        return LimitsRuling(widest, None, "", reasons, Cause.LIMITS_UNKNOWN, self.in_force)


def check_plausible(limits: LimitSet) -> None:
    """TelemetryError for a limit that no plausible value can exceed."""
    for case in limits.cases:
        for channel, limit in zip(LATERAL.channels, case.limits.magnitudes, strict=True):
            check_limits(channel, limit)


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
