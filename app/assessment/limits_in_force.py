"""The limits in force during a flight, by flight condition, and the monitors they suit.

A monitor's own limits never change: its guarantee holds for them alone. Where other limits are in
force the monitor is not applicable. Where the limits in force are unknown, nothing is assessed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from app.assessment.rulings import ConditionRule, Ruling
from app.telemetry.targets import check_limits
from core.channels import LATERAL
from core.conditions import ConditionKey
from core.flight_events import FlightLimits
from core.limits.limit_sets import LimitSet, limit_set_from_plain, limit_set_to_plain
from core.limits.limits import Envelope, limits_in_words
from core.monitor.assessment import Cause
from core.monitor.status import LIMITS_UNKNOWN, NOT_APPLICABLE


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
        return self.reasons[0] if self.limits is None else ""


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
        return LimitsRuling(None, None, "", reasons, Cause.LIMITS_UNKNOWN, self.in_force)


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
