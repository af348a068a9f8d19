"""A campaign: planned tests, their points in order, and the result of each; saved as one file."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import floor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from app.campaigns.point import (
    CampaignError,
    Condition,
    Event,
    FlownPoint,
    Point,
    State,
    is_same_flight,
)
from app.recipes.recipes import RecipeError, default_test, from_plain, read_plain, to_plain
from core.bounds import quoted
from core.clearance.clearance import BuildUp, ClearanceRecipe
from core.planned_test.planned_test import ManeuverTest
from core.whole_file import write_whole

FORMAT, VERSION = "forewarn campaign", 2
"""Version 1 had one test for all points."""
BY_FILE = " (by the file)"
"""Suffix of the names of people in an imported file."""
MOST_POINTS, LONGEST_NAME, LONGEST_CRITERIA, LARGEST_DEG = 50, 200, 1_000, 90.0
USUAL_STEPS = (0.4, 0.6, 0.8, 1.0)
"""Default points, as shares of the planned amplitude."""
LEAST_GAIN = 0.25
"""A smaller step goes at least this share of the way from the last step to the refused one."""


POINTS = TypeAdapter(tuple[Point, ...])


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
            law = getattr(condition.test, "control_law", None)
            _check_growing(own, law and law.actuator.position_limit_deg)
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
            self._check_channels(point)
        over = [point.is_over for point in self.points]
        if sorted(over, reverse=True) != over:
            raise CampaignError("a point is over before an earlier one: fly the points in order")

    def _check_channels(self, point: Point) -> None:
        n_channels = len(self.condition_of(point).test.dictionary)
        if point.flown and point.flown.y and len(point.flown.y[0]) != n_channels:
            raise CampaignError(
                f"{point.name!r} has flown samples of {len(point.flown.y[0])} channels: give the "
                f"{n_channels} of its test"
            )

    def extended(
        self,
        condition: Condition,
        fractions: Sequence[float],
        passes_below: float = 1.0,
        criteria: str = "",
    ) -> "Campaign":
        points = points_at(condition, fractions, passes_below, criteria)
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
        of aircraft that exceed there, times epsilon, the share of these that is cleared; with a
        monitor, that is cleared and gives no alert in time.
        """
        return sum(
            share * (1.0 if clearing.p_value is None else clearing.recipe.epsilon)
            for clearing in (point.clearing for point in self.points)
            if clearing
            and clearing.cleared
            and (share := clearing.exceeding_share_at_most) is not None
        )

    @property
    def is_monitored(self) -> bool:
        """Whether a monitor is a part of any clearance: `exceeding_at_most` is without an alert."""
        return any(point.clearing and point.clearing.monitor for point in self.points)

    @property
    def following(self) -> Point | None:
        """The next point; None if all are over."""
        return None if self.is_over else self.next.point

    @property
    def is_first(self) -> bool:
        """Whether the next point has no flown step to compute its clearance from."""
        return self.following is not None and not self.flown(self.following.condition)

    @property
    def next(self) -> NextPoint:
        """The next point; CampaignError if all are over."""
        for number, point in enumerate(self.points):
            if not point.is_over:
                return NextPoint(number, point)
        raise CampaignError("every point is complete or aborted: the campaign is over")

    @property
    def smaller_step(self) -> Point | None:
        """A step to fly before a next point that is not cleared; None without one worth flying.

        At its largest recommended amplitude, in whole percent of the planned one. Its clearance is
        computed as for any point.
        """
        if self.is_over:
            return None
        number, point = self.next
        clearing = point.clearing
        if clearing is None or clearing.cleared or clearing.amplitude_deg is None:
            return None
        condition = self.condition_of(point)
        planned = condition.test.maneuver.peak_deg
        share = floor(100.0 * clearing.amplitude_deg / planned + 1e-9) / 100.0
        before = self.points[number - 1].peak_deg
        gain = (share * planned - before) / (point.peak_deg - before)
        is_new = _name(share, condition) not in {each.name for each in self.points}
        if not (LEAST_GAIN <= gain < 1.0 and is_new and len(self.points) < MOST_POINTS):
            return None
        (step,) = points_at(condition, [share], point.passes_below, point.criteria)
        return step

    def with_smaller_step(self, by: str, why: str = "") -> "Campaign":
        """Plan the smaller step before the next point."""
        number, point = self.next
        if (step := self.smaller_step) is None:
            raise CampaignError(
                f"no smaller step is proposed before {point.name!r}: compute its clearance first; "
                "where it is withdrawn or the recommended amplitude is barely above the last step, "
                "there is none"
            )
        points = (*self.points[:number], step, *self.points[number:])
        words = why.strip() or f"smaller step before {point.name}"
        return replace(self, points=points).changed(number, "planned", by, words)

    def condition_of(self, point: Point) -> Condition:
        return next(each for each in self.conditions if each.name == point.condition)

    def test_of(self, point: Point) -> ManeuverTest:
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
        number, point = self.next
        for other in self.points:
            if other.flown and is_same_flight(other.flown, flown):
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
        return replace(self, points=(*self.points[:number], point, *self.points[number + 1 :]))

    def as_plain(self) -> dict[str, Any]:
        """Plain data, for `from_file` to read."""
        return {"format": FORMAT, "version": VERSION, **to_plain(self)}

    def save(self, path: Path) -> None:
        """Write the campaign to a file, completely or not at all."""
        text = json.dumps(self.as_plain(), indent=1, ensure_ascii=False)
        write_whole(path, f"{text}\n".encode())


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


def points_at(
    condition: Condition,
    fractions: Sequence[float],
    passes_below: float = 1.0,
    criteria: str = "",
) -> tuple[Point, ...]:
    """Points at these fractions of the amplitude of a condition's test.

    A point is named by its fraction, and by its condition if that has a name. CampaignError for a
    fraction above 1: the test is that of the last point.
    """
    if max(fractions, default=0.0) > 1.0:
        raise CampaignError(
            f"steps={' '.join(f'{part:g}' for part in fractions)} was given: each is a share of "
            "the planned amplitude, at most 1; give smaller ones, or plan a larger amplitude"
        )
    return tuple(
        Point(
            _name(part, condition),
            part * condition.test.maneuver.peak_deg,
            condition=condition.name,
            passes_below=passes_below,
            criteria=criteria.strip(),
        )
        for part in fractions
    )


def _name(share: float, condition: Condition) -> str:
    return f"{share:.0%} {condition.name}".strip()


def _reached(flown: FlownPoint, point: Point) -> str:
    words = f"{flown.source}: reached {flown.reached:.0%} of a limit"
    if flown.exceeded:
        return f"{words}, EXCEEDED {flown.exceeded}"
    if flown.reached >= point.passes_below:
        return f"{words}, NOT PASSED: the criterion is below {point.passes_below:.0%}"
    return words


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


def load(path: Path) -> Campaign:
    """Read a campaign's file; CampaignError if it is not one."""
    return from_file(read_plain(path), str(path))


def from_file(plain: Any, where: str) -> Campaign:
    """Rebuild a campaign from the content of its file.   where: its origin, for errors."""
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise CampaignError(
            f"{where} is not a campaign file: create one with `forewarn campaign new`"
        )
    if (version := plain.get("version")) not in (1, VERSION):
        raise CampaignError(
            f"{where} is a campaign file of version {version!r}: this program reads up to {VERSION}"
        )
    try:
        if version == 1:
            plain = plain | {"conditions": [{"name": "", "test": plain["test"]}]}
        if not isinstance(plain["name"], str):
            raise CampaignError(f"{where}: name is {quoted(plain['name'])}: give a text")
        return Campaign(
            plain["name"],
            tuple(
                Condition(
                    each["name"], from_plain(default_test(each["test"]), each["test"], "test")
                )
                for each in plain["conditions"]
            ),
            POINTS.validate_python(plain["points"]),
            from_plain(ClearanceRecipe(), plain["clearance"], "clearance"),
        )
    except KeyError as error:
        raise CampaignError(f"{where} lacks {error}: it is damaged") from None
    except (TypeError, AttributeError) as error:
        raise CampaignError(f"{where} is damaged: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        message = str(first["msg"]).removeprefix("Value error, ")
        raise CampaignError(f"{where}: points.{place}: {message}") from None
    except RecipeError as error:
        raise CampaignError(f"{where}: {error}") from None
