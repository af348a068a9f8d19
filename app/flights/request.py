"""The flight that is asked for."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, StrictBool, field_validator, model_validator

from app.flights.sources import SourceRequest

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
    name: str | None = Field(default=None, min_length=1, max_length=200)
    accept_useless: StrictBool = Field(
        default=False,
        description="fly a monitor although by its evaluation less than 20 % of safe flights pass "
        "without an alert; kept with the flight",
    )

    @field_validator("monitor", mode="before")
    @classmethod
    def check_authority(cls, given: Any) -> Any:
        """Refuse several monitors as alarm authority."""
        if isinstance(given, list):
            raise ValueError(
                "a list of monitors was not calibrated as a whole, so that nobody knows how often "
                "it misses: name one as `monitor`, which raises the alarms, and the others in "
                "`monitors`, for display"
            )
        return given

    @model_validator(mode="after")
    def check_display(self) -> "FlightRequest":
        """Refuse a monitor that is named twice."""
        named = [self.monitor, *self.monitors]
        if twice := [one for one in self.monitors if named.count(one) > 1]:
            raise ValueError(
                f"monitor {twice[0]} is named twice: `monitor` is shown anyway, and each of "
                "`monitors` once"
            )
        return self
