"""A campaign: planned tests, their points in order, and the result of each; saved as one file.

The states are those used on the radio. A point that a computation clears is "on condition" until a
person confirms the checklist.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import ceil
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from app.recipes.recipes import to_plain
from core.bounds import quoted
from core.channels import N_CHANNELS
from core.clearance.clearance import BuildUp, ClearanceRecipe
from core.evaluation.rates import clopper_pearson
from core.planned_test.planned_test import DatasetRecipe
from core.types import Array
from core.whole_file import write_whole

State = Literal["planned", "on condition", "cleared", "hold", "complete", "aborted"]
FORMAT, VERSION = "forewarn campaign", 2
"""Version 1 had one test for all points."""
BY_FILE = " (by the file)"
"""Suffix of the names of people in an imported file."""
MOST_POINTS, LONGEST_NAME, LONGEST_CRITERIA, LARGEST_DEG = 50, 200, 1_000, 90.0
USUAL_STEPS = (0.4, 0.6, 0.8, 1.0)
"""Default points, as shares of the planned amplitude."""


class CampaignError(ValueError):
    """An action that the campaign does not allow in its present state."""


@dataclass(frozen=True)
class Event:
    """A change of a point's state.   at: UTC, ISO 8601.   by: who."""

    at: str
    by: str
    state: State
    words: str = ""

    def __post_init__(self) -> None:
        if not self.by.strip():
            raise CampaignError("no name was given: enter the name of the person who decides")
        try:
            datetime.fromisoformat(self.at)
        except ValueError:
            raise CampaignError(f"at is {quoted(self.at)}: give a time in ISO 8601") from None


@dataclass(frozen=True)
class FlownPoint:
    """A point as flown.

    source: recording and time in it.   y: (n_samples, 6) from trim, one each dt of the test; empty
    for a point aborted in flight, which is not used for computing.   reached: largest part of a
    limit.   exceeded: channel and time, or empty.   recording: id, where it is stored.   start,
    end: in the recording [s].   remark: on the flown input, or empty.
    """

    source: str
    y: tuple[tuple[float, ...], ...]
    reached: float
    exceeded: str = ""
    recording: str = ""
    start: float | None = None
    end: float | None = None
    remark: str = ""

    def __post_init__(self) -> None:
        if self.y:
            _check_samples(self.y)
        if not 0.0 <= self.reached < np.inf:
            raise CampaignError(f"reached is {self.reached:g}: give a part of a limit, 0 or more")


@dataclass(frozen=True)
class Clearing:
    """The clearance computed for a point before it is flown.

    steps: the flown points it is computed from.   reached: predicted part of a limit, 5 %, 50 % and
    95 %.   withdrawn: failed checks that void the guarantee.   n_exceeding: simulated aircraft that
    exceed a limit and calibrate it; p_value is None where they are too rare.   n_tried,
    exceeding_share: number of simulated aircraft, and the share of them that exceed.
    amplitude_deg: largest recommended amplitude, under its own guarantee.
    """

    cleared: bool
    p_value: float | None
    clear_below: float | None
    reached: tuple[float, float, float]
    amplitude_deg: float | None
    withdrawn: tuple[str, ...]
    n_exceeding: int
    n_tried: int
    recipe: ClearanceRecipe
    steps: tuple[str, ...]
    exceeding_share: float | None = None

    def __post_init__(self) -> None:
        for name in ("p_value", "clear_below", "exceeding_share"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= 1.0:
                raise CampaignError(f"{name} is {value:g}: give a number from 0 to 1")

    @property
    def exceeding_share_at_most(self) -> float | None:
        """Upper bound on the share of aircraft that exceed a limit, with 95 % confidence."""
        if self.exceeding_share is None:
            return None
        n_met = round(self.exceeding_share * self.n_tried)
        return float(clopper_pearson(n_met, self.n_tried, confidence=0.9)[1])


@dataclass(frozen=True)
class Condition:
    """A flight condition, with the planned test of its last point.

    Derivatives hold for one flight condition: steps at one never clear a point at another.
    """

    name: str
    test: DatasetRecipe


@dataclass(frozen=True)
class Point:
    """A point of a campaign.

    peak_deg: of the manoeuvre's command.   condition: name of its flight condition.
    passes_below: pass criterion, the part of a limit to stay below.   criteria: further pass
    criteria, in words.   monitor: id of the monitor trained for it, where it is stored.
    """

    name: str
    peak_deg: float
    events: tuple[Event, ...] = ()
    clearing: Clearing | None = None
    flown: FlownPoint | None = None
    condition: str = ""
    passes_below: float = 1.0
    criteria: str = ""
    monitor: str = ""

    @property
    def state(self) -> State:
        return self.events[-1].state if self.events else "planned"

    @property
    def is_over(self) -> bool:
        return self.state in ("complete", "aborted")

    @property
    def failed(self) -> bool:
        """Whether it was flown, in full or in part, and did not pass."""
        return self.flown is not None and self.flown.reached >= self.passes_below


class NextPoint(NamedTuple):
    """The next point, and its number from 0."""

    number: int
    point: Point


@dataclass(frozen=True)
class Campaign:
    """Points at growing amplitudes, at one or several flight conditions.

    CampaignError for points that do not build up.
    """

    name: str
    conditions: tuple[Condition, ...]
    points: tuple[Point, ...]
    clearance: ClearanceRecipe = ClearanceRecipe()  # noqa: RUF009

    def __post_init__(self) -> None:
        if not 0 < len(self.name.strip()) <= LONGEST_NAME:
            raise CampaignError(
                f"the campaign's name has {len(self.name.strip())} characters: give 1 to "
                f"{LONGEST_NAME}"
            )
        if not 2 <= len(self.points) <= MOST_POINTS:
            raise CampaignError(
                f"{len(self.points)} points were given: a campaign has 2 to {MOST_POINTS}"
            )
        _check_distinct("flight conditions", [condition.name for condition in self.conditions])
        for condition in self.conditions:
            own = [p.peak_deg for p in self.points if p.condition == condition.name]
            _check_growing(own, condition.test.control_law.actuator.position_limit_deg)
        _check_distinct("points", [point.name for point in self.points])
        known = {condition.name for condition in self.conditions}
        for point in self.points:
            if point.condition not in known:
                raise CampaignError(
                    f"{point.name!r} has the unknown flight condition {point.condition!r}: choose "
                    f"{', '.join(map(repr, sorted(known)))}"
                )
            if not 0.0 < point.passes_below <= 1.0:
                raise CampaignError(
                    f"{point.name!r} passes below {point.passes_below:g} of a limit: give a part "
                    "above 0, at most 1"
                )
            _check_flown(point)
        over = [point.is_over for point in self.points]
        if sorted(over, reverse=True) != over:
            raise CampaignError("a point is over before an earlier one: fly the points in order")

    @classmethod
    def planned(
        cls,
        name: str,
        condition: Condition,
        fractions: Sequence[float],
        recipe: ClearanceRecipe,
        passes_below: float = 1.0,
        criteria: str = "",
    ) -> "Campaign":
        """Points at these fractions of the amplitude of a condition's test.

        A point is named by its fraction, and by its condition if that has a name.
        """
        points = _points(condition, fractions, passes_below, criteria)
        return cls(name, (condition,), points, recipe)

    def extended(
        self,
        condition: Condition,
        fractions: Sequence[float],
        passes_below: float = 1.0,
        criteria: str = "",
    ) -> "Campaign":
        """Append points at another flight condition."""
        points = _points(condition, fractions, passes_below, criteria)
        return replace(
            self, conditions=(*self.conditions, condition), points=(*self.points, *points)
        )

    @property
    def is_over(self) -> bool:
        return all(point.is_over for point in self.points)

    @property
    def imported(self) -> "Campaign":
        """The campaign with its names marked BY_FILE: these people did not log in here."""

        def marked(event: Event) -> Event:
            return replace(event, by=event.by.removesuffix(BY_FILE) + BY_FILE)

        points = (replace(p, events=tuple(map(marked, p.events))) for p in self.points)
        return replace(self, points=tuple(points))

    def flown(self, condition: str) -> tuple[Point, ...]:
        """Complete points of a flight condition, in order."""
        return tuple(p for p in self.points if p.condition == condition and p.state == "complete")

    def last_flown(self, condition: str) -> Point:
        """The last point flown at a flight condition, in full or in part."""
        return [p for p in self.points if p.condition == condition and p.flown][-1]

    @property
    def exceeding_at_most(self) -> float:
        """Upper bound on the probability that any point cleared by computation exceeds a limit.

        Over the aircraft of D_theta, flown as simulated: the sum over points of the largest share
        of aircraft that exceed there, times epsilon, the share of these that is cleared.
        """
        return sum(
            share * (1.0 if clearing.p_value is None else clearing.recipe.epsilon)
            for clearing in (point.clearing for point in self.points)
            if clearing
            and clearing.cleared
            and (share := clearing.exceeding_share_at_most) is not None
        )

    @property
    def next(self) -> NextPoint:
        """The next point; CampaignError if all are over."""
        for number, point in enumerate(self.points):
            if not point.is_over:
                return NextPoint(number, point)
        raise CampaignError("every point is complete or aborted: the campaign is over")

    def condition_of(self, point: Point) -> Condition:
        return next(each for each in self.conditions if each.name == point.condition)

    def test_of(self, point: Point) -> DatasetRecipe:
        """The planned test at a point's amplitude."""
        test = self.condition_of(point).test
        return replace(test, maneuver=test.maneuver.with_peak(point.peak_deg))

    def build_up(self, point: Point) -> BuildUp:
        """The complete points and the point after them; ClearanceError without complete points."""
        flown = self.flown(point.condition)
        return BuildUp(tuple(self.test_of(step) for step in flown), self.test_of(point))

    def confirmed(self, by: str, why: str = "") -> "Campaign":
        """Clear the next point: a person confirms the checklist, or a first point."""
        number, point = self.next
        is_first = not self.flown(point.condition)
        if point.state == "cleared":
            raise CampaignError(f"{point.name!r} is already cleared: see its events for the name")
        aborted = [p.name for p in self.points if p.condition == point.condition and p.is_over]
        if is_first and aborted and not why.strip():
            raise CampaignError(
                f"{', '.join(aborted)} aborted and no step flown before {point.name!r}, so its "
                "clearance cannot be computed: give the reason to clear it"
            )
        if not is_first and point.state != "on condition":
            raise CampaignError(
                f"{point.name!r} cannot be confirmed in state {point.state!r}: compute its "
                "clearance first; a person can confirm it once it is on condition"
            )
        usual = "first point" if is_first else "checklist confirmed"
        return self.changed(number, "cleared", by, why.strip() or usual)

    def on_hold(self, by: str, why: str = "") -> "Campaign":
        """Put the next point on hold."""
        return self.changed(self.next.number, "hold", by, why.strip())

    def aborted(self, by: str, why: str, flown: FlownPoint | None = None) -> "Campaign":
        """Abort the next point, before or in flight.

        flown: the aborted flight, without samples.
        """
        number, point = self.next
        if not why.strip():
            raise CampaignError("no reason was given: say why the point is aborted")
        words = why.strip() if flown is None else f"{why.strip()}; {_reached(flown, point)}"
        return self.changed(number, "aborted", by, words, flown=flown)

    def completed(self, flown: FlownPoint, by: str) -> "Campaign":
        """Complete the next point with its flight."""
        number, point = self.next
        for other in self.points:
            if other.flown and other.flown.y == flown.y:
                raise CampaignError(
                    f"{flown.source} has the samples of {other.name!r}: attach the recording of "
                    f"{point.name!r}"
                )
        words = _reached(flown, point)
        if point.state != "cleared":
            words += f"; flown without clearance, while {point.state}"
        if flown.remark:
            words += f"; {flown.remark}"
        return self.changed(number, "complete", by, words, flown=flown)

    def changed(
        self, number: int, state: State, by: str, words: str = "", **fields: Any
    ) -> "Campaign":
        """Return the campaign with a point in a new state; fields: other changes to the point."""
        point = self.points[number]
        event = Event(datetime.now(UTC).isoformat(timespec="seconds"), by.strip(), state, words)
        return self.with_point(number, replace(point, events=(*point.events, event), **fields))

    def with_point(self, number: int, point: Point) -> "Campaign":
        """Return the campaign with one point replaced."""
        return replace(self, points=(*self.points[:number], point, *self.points[number + 1 :]))

    def as_plain(self) -> dict[str, Any]:
        """Plain data, for `from_file` to read."""
        return {"format": FORMAT, "version": VERSION, **to_plain(self)}

    def save(self, path: Path) -> None:
        """Write the campaign to a file, completely or not at all."""
        text = json.dumps(self.as_plain(), indent=1, ensure_ascii=False)
        write_whole(path, f"{text}\n".encode())


def _points(
    condition: Condition, fractions: Sequence[float], passes_below: float, criteria: str
) -> tuple[Point, ...]:
    return tuple(
        Point(
            f"{part:.0%} {condition.name}".strip(),
            part * condition.test.maneuver.peak_deg,
            condition=condition.name,
            passes_below=passes_below,
            criteria=criteria.strip(),
        )
        for part in fractions
    )


def _reached(flown: FlownPoint, point: Point) -> str:
    words = f"{flown.source}: reached {flown.reached:.0%} of a limit"
    if flown.exceeded:
        return f"{words}, EXCEEDED {flown.exceeded}"
    if flown.reached >= point.passes_below:
        return f"{words}, NOT PASSED: the criterion is below {point.passes_below:.0%}"
    return words


def _check_samples(samples: tuple[tuple[float, ...], ...]) -> None:
    try:
        y = np.array(samples, np.float64)
    except ValueError:
        y = np.empty((0, 0))
    if y.ndim != 2 or y.shape[1] != N_CHANNELS or len(y) < 2 or not np.isfinite(y).all():
        raise CampaignError(
            f"the flown samples have the shape {y.shape}: give finite samples (n_samples, "
            f"{N_CHANNELS})"
        )


def _check_flown(point: Point) -> None:
    has_samples = point.flown is not None and len(point.flown.y) > 0
    if has_samples != (point.state == "complete"):
        verb = "has" if has_samples else "lacks"
        raise CampaignError(
            f"{point.name!r} is {point.state} and {verb} flown samples: only a complete point has "
            "flown samples"
        )
    if point.flown is not None and not point.is_over:
        raise CampaignError(
            f"{point.name!r} is {point.state} and was flown: a flown point is complete or aborted"
        )


def _check_distinct(what: str, names: list[str]) -> None:
    if len(set(names)) < len(names):
        raise CampaignError(f"two {what} have the same name: give each its own")


def _check_growing(peaks: list[float], stop: float | None) -> None:
    """stop: largest deflection of the actuators [deg]; None for no limit."""
    given = ", ".join(f"{peak:g}" for peak in peaks)
    sizes = [abs(peak) for peak in peaks]
    if len({np.sign(peak) for peak in peaks}) > 1 or sorted({*sizes} - {0.0}) != sizes:
        raise CampaignError(
            f"amplitudes of {given} deg were given: in a build-up they have one sign and grow from "
            "point to point"
        )
    if sizes and not sizes[-1] <= (most := LARGEST_DEG if stop is None else stop):
        raise CampaignError(
            f"amplitudes of {given} deg were given: the surface goes to {most:g} deg at most; give "
            "smaller ones"
        )


def percent_at_most(share: float) -> str:
    """An upper bound in percent, rounded up so that it stays one."""
    return f"{ceil(1e4 * share - 1e-9) / 100:.2f} %"


def samples_of(point: FlownPoint) -> Array:
    """(n_samples, 6) of a flown point."""
    return np.array(point.y, np.float64)
