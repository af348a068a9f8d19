"""The test card of a flight: the planned input of its monitor, and when it was flown."""

from collections.abc import Collection, Iterable

import numpy as np

from app.assessment.planned_test import PlannedTest, planned_test
from app.assessment.trim import GUARD_S, departure, input_sizes
from app.messages import CardInput, CardPoint, PlannedCard
from app.store.campaigns import StoredCampaign
from core.monitor import Monitor
from core.simulation.maneuver import MANEUVERS
from core.types import Array, Indices

MOST_DRAWN = 400
"""Most points of a drawn input."""
NO_INPUT = "the monitor does not record a planned input: it learned from flights without a recipe"


def planned_card(monitor: Monitor, point: CardPoint | None = None) -> PlannedCard:
    """The card of the test that a monitor was trained for."""
    try:
        planned = planned_test(monitor)
    except ValueError as error:
        return PlannedCard(why=f"the planned test is unknown: {error}", point=point)
    condition = planned.aircraft.condition if planned.aircraft else None
    inputs, steps = _inputs(planned)
    rest, length = planned.trim_segment_s, planned.duration
    return PlannedCard(
        why="" if inputs else _target(monitor) or NO_INPUT,
        point=point,
        inputs=inputs,
        steps=steps,
        length=None if length is None else length - rest,
        rest=rest + GUARD_S,
        airspeed=condition.airspeed if condition else None,
        altitude=condition.altitude if condition else None,
    )


def _target(monitor: Monitor) -> str:
    """What the pilot of a monitor's test captures; empty if nothing."""
    plain = monitor.dataset_recipe.get("maneuver", {})
    maneuver = MANEUVERS.get(plain.get("kind", ""))
    if maneuver is None or not maneuver.captured:
        return ""
    first, then = plain["amplitude_deg"], plain["then_deg"]
    return (
        f"the pilot captures targets of {plain['axis']}: {first:g} deg, {then:g} deg after "
        f"{plain['hold_s']:g} s"
    )


def _inputs(planned: PlannedTest) -> tuple[list[CardInput], list[float]]:
    """The controls that the plan moves, and the times of its steps [s] from the first input."""
    commands = planned.commands
    moved = np.flatnonzero(commands.any(axis=1))
    if not len(moved):
        return [], []
    flown = commands[moved[0] :]
    keys = [planned.dictionary.channels[c].key for c in planned.controls]
    inputs = [
        _input(key, column, planned.dt)
        for key, column in zip(keys, flown.T, strict=True)
        if column.any()
    ]
    changes = np.abs(np.diff(flown, axis=0)).max(axis=1) > 0.0
    apart = changes & ~np.append(changes[1:], False) & ~np.append(False, changes[:-1])
    return inputs, [0.0, *(planned.dt * (1 + np.flatnonzero(apart))).round(6).tolist()]


def _input(key: str, command: Array, dt: float) -> CardInput:
    """command: (n,) [rad] from the first input on."""
    changes = np.flatnonzero(np.diff(command))
    ends = np.array([0, len(command) - 1])
    shown = np.unique(np.concatenate([ends, changes, changes + 1]))
    shown = shown[:: -(-len(shown) // MOST_DRAWN)]
    size = np.abs(command)
    return CardInput(
        channel=key,
        t=(dt * shown).round(6).tolist(),
        y=command[shown].round(6).tolist(),
        peak=float(command[size.argmax()]),
        lasts=float(dt * (size >= 0.5 * size.max()).sum()),
    )


def first_input(y: Array, planned: PlannedTest) -> int | None:
    """First sample at which a control departs from trim; None if none does.

    y: (n, n_channels) from trim.
    """
    moved = np.abs(np.nan_to_num(y[:, planned.controls])) > departure(input_sizes(planned))
    departed: Indices = np.flatnonzero(moved.any(axis=1))
    return int(departed[0]) if len(departed) else None


def points_of(
    campaigns: Iterable[StoredCampaign], monitors: Collection[str]
) -> dict[str, CardPoint]:
    """The point of a campaign that each monitor was trained for, by monitor id."""
    points = dict[str, CardPoint]()
    for campaign in campaigns:
        planned = campaign.content["points"]
        for number, point in enumerate(planned, 1):
            if (monitor := point.get("monitor")) in monitors:
                card = CardPoint(
                    campaign=campaign.id,
                    campaign_name=campaign.name,
                    number=number,
                    points=len(planned),
                    name=point["name"],
                )
                points.setdefault(monitor, card)
    return points
