"""The request for a flight."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, StrictBool, field_validator, model_validator

from app.flights.sources.source import SourceRequest
from app.json_codec import Whole
from core.conditions import ConditionKey, check_declared

MOST_DISPLAYED = 8


class FlightRequest(BaseModel):
    """A flight to start: a source, through a monitor, and monitors for display beside it."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={
            "examples": [
                {
                    "source": {"kind": "simulated", "seed": 1, "outcome": "unsafe"},
                    "monitor": "0123456789ab",
                    "epsilon": 0.1,
                }
            ]
        },
    )

    source: SourceRequest
    monitor: str | None = Field(
        default=None,
        description="id of the alarm authority: only its alerts are alarms. Give either this or "
        "`monitor_set`",
    )
    monitor_set: str | None = Field(
        default=None,
        description="id of a monitor set: the alarm authority is its monitor for the flight "
        "condition, at its own epsilon and limits. A live source sends the condition; other "
        "sources need it declared",
    )
    monitors: list[str] = Field(
        default_factory=list,
        max_length=MOST_DISPLAYED,
        description="ids of further monitors for display, each at its own epsilon; of the same "
        "aircraft, manoeuvre and sample interval. To replay a recording, each must have scored it",
    )
    epsilon: float | None = Field(
        default=None, gt=0, lt=1, description="accepted miss rate; default: the monitor's own"
    )
    limit_set: str | None = Field(
        default=None,
        description="id of the limit set that judges measured exceedances; default: the monitor's "
        "own limits",
    )
    limit_set_version: Whole | None = Field(
        default=None, ge=1, description="version of the limit set; default: the newest"
    )
    condition: dict[ConditionKey, float | str] = Field(
        default_factory=dict,
        description="the flight condition that selects the limits or the monitor: a declared value "
        "in SI units, or the name under which a live source sends it; default: its own name",
    )
    name: str | None = Field(default=None, min_length=1, max_length=200)
    wait_for_viewer: StrictBool = Field(
        default=False,
        description="start at the first connection to the stream, or after 10 s without one: "
        "the viewer sees the flight from its first sample. A live source never waits",
    )
    accept_useless: StrictBool = Field(
        default=False,
        description="fly a monitor although its evaluation found fewer than 20 % of safe flights "
        "without a false alarm; stored with the flight",
    )

    @property
    def declared(self) -> dict[ConditionKey, float]:
        return {key: v for key, v in self.condition.items() if not isinstance(v, str)}

    @property
    def source_names(self) -> dict[ConditionKey, str]:
        return {key: v for key, v in self.condition.items() if isinstance(v, str)}

    @field_validator("monitor", mode="before")
    @classmethod
    def check_authority(cls, given: Any) -> Any:
        if isinstance(given, list):
            raise ValueError(
                "a list of monitors has no calibrated miss rate: give one as `monitor`, which "
                "raises the alarms, and the others in `monitors` for display; or combine them into "
                "one calibrated monitor with POST /api/v1/monitors/combinations or `forewarn "
                "combine`"
            )
        return given

    @model_validator(mode="after")
    def check_display(self) -> "FlightRequest":
        if self.limit_set is None and self.limit_set_version is not None:
            raise ValueError("a version needs a limit_set: give its id")
        if self.limit_set is None and self.monitor_set is None and self.condition:
            raise ValueError("a condition needs a limit_set or a monitor_set: give its id")
        self._check_set()
        if self.source_names and getattr(self.source, "kind", "") != "live":
            raise ValueError(
                f"the condition {' and '.join(self.source_names)} is a name, which only a live "
                "source sends: give its value"
            )
        check_declared(self.declared)
        named = [str(self.monitor), *self.monitors]
        if twice := [name for name in self.monitors if named.count(name) > 1]:
            raise ValueError(
                f"monitor {twice[0]} is given twice: list each monitor once; `monitor` is always "
                "displayed"
            )
        return self

    def _check_set(self) -> None:
        if (self.monitor is None) == (self.monitor_set is None):
            given = "no monitor" if self.monitor is None else "both a monitor and a monitor_set"
            raise ValueError(f"{given} was given: give the id of one, as monitor or monitor_set")
        beside = {"monitors": self.monitors, "epsilon": self.epsilon, "limit_set": self.limit_set}
        given = [name for name, value in beside.items() if value]
        if self.monitor_set is not None and given:
            raise ValueError(
                f"a flight on a monitor set uses each monitor by itself, at its own epsilon and "
                f"limits: leave out {' and '.join(given)}"
            )
