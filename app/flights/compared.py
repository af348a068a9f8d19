"""The monitors of a flight, compared sample by sample on its longest pass."""

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, Field

from app.assessment.comparison import (
    Assessed,
    RiskDifference,
    WarningOutcome,
    difference,
    longest_pass,
)
from app.flights.display_monitors import flown_monitors
from app.flights.recorder import RecordedSample
from app.flights.verdict import longest_manoeuvre, planned_length
from app.messages import FlownMonitor
from app.store.store import Store
from core.flight_events import Alarm
from core.monitor.assessment import STATES


class AlertInterval(BaseModel):
    """An interval of alerts."""

    start: float = Field(description="[s]")
    end: float = Field(description="[s]")


class LargestDifference(BaseModel):
    """Where the risks of two monitors differ the most."""

    t: float = Field(description="[s]")
    first: float = Field(description="risk of the first monitor")
    second: float = Field(description="risk of the second one")


class Differences(BaseModel):
    """Differences of a second monitor from the first one, where both assessed."""

    n_both: int = Field(description="samples that both assessed")
    largest: LargestDifference | None = Field(description="null if they assessed none together")
    only_first: list[AlertInterval] = Field(description="where only the first one alerts")
    only_second: list[AlertInterval] = Field(description="where only the second one alerts")


class ComparedMonitor(FlownMonitor):
    """A monitor on a flight."""

    n_assessed: int = Field(description="samples")
    alerts: list[AlertInterval]
    outcome: WarningOutcome | None = Field(
        description="how it warned of the first exceedance: in time (`timely_alert`), `late_alert`,"
        " `missed`, or `unseen` if it assessed no sample in time; null without an exceedance"
    )
    reached: float | None = Field(
        description="from its first alert to the exceedance [s]; null without one before it"
    )
    differences: Differences | None = Field(description="from the first monitor; null for that one")


class FlightComparison(BaseModel):
    """The monitors of a flight on the same samples, the alarm authority first."""

    start: float | None = Field(description="of the longest pass [s]; null without a sample")
    end: float | None = Field(description="[s]")
    n_samples: int
    exceeded_t: float | None = Field(description="first exceedance in it [s]")
    monitors: list[ComparedMonitor]


def differences_of(found: RiskDifference) -> Differences:
    largest = found.largest and dict(zip(("t", "first", "second"), found.largest, strict=True))
    return Differences(
        n_both=found.n_both,
        largest=LargestDifference(**largest) if largest else None,
        only_first=_intervals(found.only_first),
        only_second=_intervals(found.only_second),
    )


def _intervals(pairs: tuple[tuple[float, float], ...]) -> list[AlertInterval]:
    return [AlertInterval(start=start, end=end) for start, end in pairs]


def compared(
    store: Store,
    flight_id: str,
    alarms: Sequence[Alarm],
    waiting: Sequence[RecordedSample] = (),
) -> FlightComparison:
    """Compare by the samples so far. waiting: those not stored yet. NotFound; StoreError."""
    info, assessed = store.flights.info(flight_id), _assessed(store, flight_id, waiting)
    part = longest_pass(assessed[0].t)
    assessed = [each.part(part) for each in assessed]
    t = assessed[0].t
    exceeded = [a.t for a in alarms if a.kind == "limit" and len(t) and t[0] <= a.t <= t[-1]]
    first = min(exceeded, default=None)
    recipe = store.monitors.info(info.monitor_id).dataset_recipe
    longest = longest_manoeuvre(planned_length(recipe))
    monitors = []
    for k, (monitor, samples) in enumerate(
        zip(flown_monitors(store, [info])[flight_id], assessed, strict=False)
    ):
        warned = None if first is None else samples.warned(first, monitor.lead, longest)
        monitors.append(
            ComparedMonitor(
                **monitor.model_dump(),
                n_assessed=samples.n_assessed,
                alerts=_intervals(samples.alerts),
                outcome=warned and warned.outcome,
                reached=warned and warned.lead,
                differences=differences_of(difference(assessed[0], samples)) if k else None,
            )
        )
    return FlightComparison(
        start=float(t[0]) if len(t) else None,
        end=float(t[-1]) if len(t) else None,
        n_samples=len(t),
        exceeded_t=first,
        monitors=monitors,
    )


def _assessed(store: Store, flight_id: str, waiting: Sequence[RecordedSample]) -> list[Assessed]:
    """Samples of each monitor, the alarm authority first."""
    stored = store.flights.assessments(flight_id)
    newest = stored.seq[-1] if len(stored) else -1
    new = [sample for sample in waiting if sample.seq > newest]
    columns = [(stored.p_value, stored.alert, stored.state)]
    shown = (display.samples for display in stored.display)
    columns += [(each["p_value"], each["alert"], each["state"]) for each in shown]
    if not len(stored) and new:
        columns += columns[:1] * len(new[0].display)
    t = np.append(stored.t, [sample.assessment.t for sample in new])
    monitors = []
    for k, (p_value, alert, state) in enumerate(columns):
        own = [(sample.assessment, *sample.display)[k] for sample in new]
        risks = [np.nan if each.p_value is None else each.p_value for each in own]
        monitors.append(
            Assessed(
                t,
                np.append(p_value, risks),
                np.append(alert, [bool(each.alert) for each in own]).astype(bool),
                np.append(state, [STATES.index(each.state) for each in own]),
            )
        )
    return monitors
