"""The flight that is asked for."""

from math import isfinite
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, StrictBool, field_validator, model_validator

from app.flights.sources.source import SourceRequest
from app.json_codec import Whole
from core.limit_set import ConditionKey

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
    monitor: str = Field(description="id of the alarm authority: its alerts alone are alarms")
    monitors: list[str] = Field(
        default_factory=list,
        max_length=MOST_DISPLAYED,
        description="ids of further monitors, for display, each at its own epsilon: of the same "
        "aircraft, manoeuvre and sample interval. Of a recording, each must have scored it",
    )
    epsilon: float | None = Field(
        default=None, gt=0, lt=1, description="accepted miss rate; the monitor's own if absent"
    )
    limit_set: str | None = Field(
        default=None,
        description="id of the limit set that measured exceedances are held against; the monitor's "
        "own limits if absent",
    )
    limit_set_version: Whole | None = Field(
        default=None, ge=1, description="number of its version; the newest if absent"
    )
    condition: dict[ConditionKey, float | str] = Field(
        default_factory=dict,
        description="the flight condition by which limits are chosen: a value that is declared, in "
        "SI units, or the name under which a live source sends it; its own name if absent",
    )
    name: str | None = Field(default=None, min_length=1, max_length=200)
    wait_for_viewer: StrictBool = Field(
        default=False,
        description="start at the first connection to the stream, or after 10 s without one: "
        "the viewer sees the flight from its first sample. A live source never waits",
    )
    accept_useless: StrictBool = Field(
        default=False,
        description="fly a monitor although by its evaluation less than 20 % of safe flights pass "
        "without an alert; kept with the flight",
    )

    @property
    def declared(self) -> dict[ConditionKey, float]:
        """Values of the flight condition that are declared."""
        return {key: v for key, v in self.condition.items() if not isinstance(v, str)}

    @property
    def source_names(self) -> dict[ConditionKey, str]:
        """Names under which a live source sends others."""
        return {key: v for key, v in self.condition.items() if isinstance(v, str)}

    @field_validator("monitor", mode="before")
    @classmethod
    def check_authority(cls, given: Any) -> Any:
        """Refuse several monitors as alarm authority."""
        if isinstance(given, list):
            raise ValueError(
                "a list of monitors was not calibrated as a whole, so that nobody knows how often "
                "it misses: name one as `monitor`, which raises the alarms, and the others in "
                "`monitors`, for display; or make one of them that is calibrated as a whole, by "
                "POST /api/v1/monitors/combinations or `forewarn combine`, and name that"
            )
        return given

    @model_validator(mode="after")
    def check_display(self) -> "FlightRequest":
        """Refuse a monitor that is named twice."""
        if self.limit_set is None and (self.limit_set_version is not None or self.condition):
            raise ValueError("a version or a condition was given without a limit_set: name it")
        if self.source_names and getattr(self.source, "kind", "") != "live":
            raise ValueError(
                f"the condition of {' and '.join(self.source_names)} is a name, and only a live "
                "source sends it: declare its value"
            )
        if wild := [key for key, value in self.declared.items() if not isfinite(value)]:
            raise ValueError(f"the condition of {wild[0]} is no finite number: declare its value")
        named = [self.monitor, *self.monitors]
        if twice := [one for one in self.monitors if named.count(one) > 1]:
            raise ValueError(
                f"monitor {twice[0]} is named twice: `monitor` is shown anyway, and each of "
                "`monitors` once"
            )
        return self
