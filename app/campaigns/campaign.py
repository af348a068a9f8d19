"""A campaign: planned tests, their points in order, and what became of each; a value, as a file.

Its states are those that are said on the radio. A point that was computed to be safe is cleared on
condition, until a person confirms what no computation can see.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import ceil
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from app.recipes import to_plain
from core.channels import N_CHANNELS
from core.clearance import BuildUp, ClearanceRecipe
from core.evaluation.rates import clopper_pearson
from core.planned_test import DatasetRecipe
from core.quoted import quoted
from core.types import Array
from core.whole_file import write_whole

State = Literal["planned", "on condition", "cleared", "hold", "complete", "aborted"]
FORMAT, VERSION = "forewarn campaign", 2
"""Version 1 had one test for all points."""
BY_FILE = " (by the file)"
"""Behind the name of who decided in a file that was imported."""
MOST_POINTS, LONGEST_NAME, LONGEST_CRITERIA, LARGEST_DEG = 50, 200, 1_000, 90.0
USUAL_STEPS = (0.4, 0.6, 0.8, 1.0)
"""Of the planned amplitude, where nothing else is asked for."""


class CampaignError(ValueError):
    """What cannot be done with a campaign as it is."""


@dataclass(frozen=True)
class Event:
    """A change of a point's state.   at: UTC, ISO 8601.   by: who."""

    at: str
    by: str
    state: State
    words: str = ""

    def __post_init__(self) -> None:
        """Refuse what nobody decided, or nobody knows when."""
        if not self.by.strip():
            raise CampaignError("nobody was named: say who decides, with a name")
        try:
            datetime.fromisoformat(self.at)
        except ValueError:
            raise CampaignError(
                f"at is {quoted(self.at)}: it is a time, as ISO 8601 has it"
            ) from None


@dataclass(frozen=True)
class FlownPoint:
    """How a point was flown.

    source: recording, and the time in it.   y: (n_samples, 6) from trim, each dt of the test; empty
    of a point that was aborted in flight, of which nothing is computed.   reached: largest part of
    a limit.   exceeded: channel and time, or empty.   recording: id, where it is stored.   start,
    end: in the recording [s].   remark: on how it was flown, or empty.
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
        """Refuse samples that nothing can be computed from."""
        if self.y:
            _check_samples(self.y)
        if not 0.0 <= self.reached < np.inf:
            raise CampaignError(f"reached is {self.reached:g}: it is a part of a limit, 0 or more")


@dataclass(frozen=True)
class Clearing:
    """What was computed of a point before it was flown.

    steps: the flown points it was computed from.   reached: predicted part of a limit, 5 %, 50 %
    and 95 %.   withdrawn: checks that speak against the promise.   n_exceeding: simulated aircraft
    that exceed and calibrated it; p_value is None where they are rare.   n_tried, exceeding_share:
    how many were simulated, and how many of these exceed.   amplitude_deg: largest one recommended,
    under a promise of its own.
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
        """Refuse shares that are none."""
        for name in ("p_value", "clear_below", "exceeding_share"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= 1.0:
                raise CampaignError(f"{name} is {value:g}: it is from 0 to 1")

    @property
    def exceeding_share_at_most(self) -> float | None:
        """Share of aircraft that exceed, at most: with 95 % confidence by those simulated."""
        if self.exceeding_share is None:
            return None
        n_met = round(self.exceeding_share * self.n_tried)
        return float(clopper_pearson(n_met, self.n_tried, confidence=0.9)[1])


@dataclass(frozen=True)
class Condition:
    """A flight condition: planned test there, of its last point.

    Derivatives are of one flight condition: no point is cleared from steps flown at another.
    """

    name: str
    test: DatasetRecipe


@dataclass(frozen=True)
class Point:
    """A point of a campaign.

    peak_deg: of the manoeuvre's command.   condition: name of its flight condition.
    passes_below: pass criterion, the part of a limit that it must stay below.   criteria: what else
    it must show, in words.   monitor: id of the one that was trained for it, where it is stored.
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
        """As of now."""
        return self.events[-1].state if self.events else "planned"

    @property
    def is_over(self) -> bool:
        """Whether it is not flown any more."""
        return self.state in ("complete", "aborted")

    @property
    def failed(self) -> bool:
        """Whether it was flown, all of it or not, and did not stay below what it must."""
        return self.flown is not None and self.flown.reached >= self.passes_below


class NextPoint(NamedTuple):
    """The point that is next, and its number from 0."""

    number: int
    point: Point


@dataclass(frozen=True)
class Campaign:
    """Points at growing amplitudes, at one flight condition or several.

    CampaignError for points that are none.
    """

    name: str
    conditions: tuple[Condition, ...]
    points: tuple[Point, ...]
    clearance: ClearanceRecipe = ClearanceRecipe()  # noqa: RUF009

    def __post_init__(self) -> None:
        """Refuse points that do not build up."""
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
                    f"{point.name!r} is of the flight condition {point.condition!r}: choose "
                    f"{', '.join(map(repr, sorted(known)))}"
                )
            if not 0.0 < point.passes_below <= 1.0:
                raise CampaignError(
                    f"{point.name!r} must stay below {point.passes_below:g} of a limit: give a "
                    "part above 0, at most 1"
                )
            _check_flown(point)
        over = [point.is_over for point in self.points]
        if sorted(over, reverse=True) != over:
            raise CampaignError("a point is over before one that comes earlier: they go in order")

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

        A point is called by its fraction, and its condition where that has a name.
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
        """The campaign with points at another flight condition after the others."""
        points = _points(condition, fractions, passes_below, criteria)
        return replace(
            self, conditions=(*self.conditions, condition), points=(*self.points, *points)
        )

    @property
    def is_over(self) -> bool:
        """Whether no point is flown any more."""
        return all(point.is_over for point in self.points)

    @property
    def imported(self) -> "Campaign":
        """As it is taken from a file: who decided in it, by the file, was not logged in here."""

        def marked(event: Event) -> Event:
            return replace(event, by=event.by.removesuffix(BY_FILE) + BY_FILE)

        points = (replace(p, events=tuple(map(marked, p.events))) for p in self.points)
        return replace(self, points=tuple(points))

    def flown(self, condition: str) -> tuple[Point, ...]:
        """Complete points of a flight condition, in order."""
        return tuple(p for p in self.points if p.condition == condition and p.state == "complete")

    def last_flown(self, condition: str) -> Point:
        """The last point of a flight condition that was flown, all of it or not."""
        return [p for p in self.points if p.condition == condition and p.flown][-1]

    @property
    def exceeding_at_most(self) -> float:
        """Probability that any point exceeds that was cleared by computation, at most.

        Over the aircraft of D_theta, each flown as simulated: for each point the share of them that
        exceed there, at most, of which a share epsilon is cleared; and the sum of the points'.
        """
        return sum(
            share * (1.0 if one.p_value is None else one.recipe.epsilon)
            for one in (point.clearing for point in self.points)
            if one and one.cleared and (share := one.exceeding_share_at_most) is not None
        )

    @property
    def next(self) -> NextPoint:
        """CampaignError where all are over."""
        for number, point in enumerate(self.points):
            if not point.is_over:
                return NextPoint(number, point)
        raise CampaignError("every point is complete or aborted: the campaign is over")

    def condition_of(self, point: Point) -> Condition:
        """The flight condition of a point."""
        return next(one for one in self.conditions if one.name == point.condition)

    def test_of(self, point: Point) -> DatasetRecipe:
        """The planned test at a point's amplitude."""
        test = self.condition_of(point).test
        return replace(test, maneuver=test.maneuver.with_peak(point.peak_deg))

    def build_up(self, point: Point) -> BuildUp:
        """Complete points with the one that follows; ClearanceError where there is none."""
        flown = self.flown(point.condition)
        return BuildUp(tuple(self.test_of(step) for step in flown), self.test_of(point))

    def confirmed(self, by: str, why: str = "") -> "Campaign":
        """The next point is cleared: a person confirms the checklist, or a first point."""
        number, point = self.next
        is_first = not self.flown(point.condition)
        if point.state == "cleared":
            raise CampaignError(f"{point.name!r} is cleared already, see by whom")
        aborted = [p.name for p in self.points if p.condition == point.condition and p.is_over]
        if is_first and aborted and not why.strip():
            raise CampaignError(
                f"{', '.join(aborted)} came to nothing, and no step was flown before "
                f"{point.name!r}, so that nothing can be computed of it: give the reason why it "
                "may be flown all the same"
            )
        if not is_first and point.state != "on condition":
            raise CampaignError(
                f"{point.name!r} is {point.state}: what is confirmed was cleared on condition "
                "before, by computing its clearance"
            )
        usual = "first point" if is_first else "checklist confirmed"
        return self.changed(number, "cleared", by, why.strip() or usual)

    def held(self, by: str, why: str = "") -> "Campaign":
        """The next point is not flown for now."""
        return self.changed(self.next.number, "hold", by, why.strip())

    def aborted(self, by: str, why: str, flown: FlownPoint | None = None) -> "Campaign":
        """The next point is not flown any more, or was broken off.

        flown: what a recording shows of it, without samples.
        """
        number, point = self.next
        if not why.strip():
            raise CampaignError("no reason was given: say why the point is aborted")
        words = why.strip() if flown is None else f"{why.strip()}; {_reached(flown, point)}"
        return self.changed(number, "aborted", by, words, flown=flown)

    def completed(self, flown: FlownPoint, by: str) -> "Campaign":
        """The next point was flown."""
        number, point = self.next
        for other in self.points:
            if other.flown and other.flown.y == flown.y:
                raise CampaignError(
                    f"{flown.source} are the samples of {other.name!r}: give the recording of "
                    f"{point.name!r}"
                )
        words = _reached(flown, point)
        if point.state != "cleared":
            words += f"; it was flown although it was {point.state}"
        if flown.remark:
            words += f"; {flown.remark}"
        return self.changed(number, "complete", by, words, flown=flown)

    def changed(
        self, number: int, state: State, by: str, words: str = "", **fields: Any
    ) -> "Campaign":
        """Return the campaign with a point in another state; fields: what else of it changes."""
        point = self.points[number]
        event = Event(datetime.now(UTC).isoformat(timespec="seconds"), by.strip(), state, words)
        return self.with_point(number, replace(point, events=(*point.events, event), **fields))

    def with_point(self, number: int, point: Point) -> "Campaign":
        """Return the campaign with another point in the place of one."""
        return replace(self, points=(*self.points[:number], point, *self.points[number + 1 :]))

    def as_plain(self) -> dict[str, Any]:
        """As JSON's types, to read by `from_file`."""
        return {"format": FORMAT, "version": VERSION, **to_plain(self)}

    def save(self, path: Path) -> None:
        """Write the whole campaign into one file, or nothing."""
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
    """How far a point was flown, in words."""
    words = f"{flown.source}: reached {flown.reached:.0%} of a limit"
    if flown.exceeded:
        return f"{words}, EXCEEDED {flown.exceeded}"
    if flown.reached >= point.passes_below:
        return f"{words}, NOT PASSED: it had to stay below {point.passes_below:.0%}"
    return words


def _check_samples(samples: tuple[tuple[float, ...], ...]) -> None:
    try:
        y = np.array(samples, np.float64)
    except ValueError:
        y = np.empty((0, 0))
    if y.ndim != 2 or y.shape[1] != N_CHANNELS or len(y) < 2 or not np.isfinite(y).all():
        raise CampaignError(
            f"the flown samples have the shape {y.shape}: they need to be (n_samples, "
            f"{N_CHANNELS}), finite"
        )


def _check_flown(point: Point) -> None:
    has_samples = point.flown is not None and len(point.flown.y) > 0
    if has_samples != (point.state == "complete"):
        there = "and has" if has_samples else "and lacks"
        raise CampaignError(
            f"{point.name!r} is {point.state} {there} flown samples: just a complete point has some"
        )
    if point.flown is not None and not point.is_over:
        raise CampaignError(
            f"{point.name!r} is {point.state} and was flown: that is complete or aborted"
        )


def _check_distinct(what: str, names: list[str]) -> None:
    if len(set(names)) < len(names):
        raise CampaignError(f"two {what} have one name: give each its own")


def _check_growing(peaks: list[float], stop: float | None) -> None:
    """stop: largest command that the actuators take [deg]; None for no limit."""
    given = ", ".join(f"{peak:g}" for peak in peaks)
    sizes = [abs(peak) for peak in peaks]
    if len({np.sign(peak) for peak in peaks}) > 1 or sorted({*sizes} - {0.0}) != sizes:
        raise CampaignError(
            f"amplitudes of {given} deg were given: those of a build-up are of one sign, and grow "
            "from point to point"
        )
    if sizes and not sizes[-1] <= (most := LARGEST_DEG if stop is None else stop):
        raise CampaignError(
            f"amplitudes of {given} deg were given: the surface goes to {most:g} deg at most, plan "
            "smaller ones"
        )


def percent_at_most(share: float) -> str:
    """A bound in percent: rounded up, as it would be none otherwise."""
    return f"{ceil(1e4 * share - 1e-9) / 100:.2f} %"


def samples_of(point: FlownPoint) -> Array:
    """(n_samples, 6) of a flown point."""
    return np.array(point.y, np.float64)
