"""The flight that is asked for."""

from pydantic import BaseModel, ConfigDict, Field, StrictBool

from app.flights.sources import SourceRequest


class FlightRequest(BaseModel):
    """A flight to start: a source, through a monitor."""

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
    monitor: str = Field(description="id")
    epsilon: float | None = Field(
        default=None, gt=0, lt=1, description="accepted miss rate; the monitor's own if absent"
    )
    name: str | None = Field(default=None, min_length=1, max_length=200)
    accept_useless: StrictBool = Field(
        default=False,
        description="fly a monitor although by its evaluation less than 20 % of safe flights pass "
        "without an alert; kept with the flight",
    )
