"""A campaign: the planned test, its points in order, and what became of each; a value, as a file.

Its states are those that are said on the radio. A point that was computed to be safe is cleared on
condition, until a person confirms what no computation can see.
"""

import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from app.recipes import RecipeError, from_plain, read_plain, to_plain
from core.clearance import BuildUp, ClearanceRecipe
from core.planned_test import DatasetRecipe
from core.types import Array
from core.whole_file import write_whole

State = Literal["planned", "on condition", "cleared", "hold", "complete", "aborted"]
FORMAT, VERSION = "forewarn campaign", 1
MOST_POINTS = 50


class CampaignError(ValueError):
    """What cannot be done with a campaign as it is."""


@dataclass(frozen=True)
class Event:
    """A change of a point's state.   at: UTC, ISO 8601.   by: who."""

    at: str
    by: str
    state: State
    words: str = ""


@dataclass(frozen=True)
class FlownPoint:
    """How a point was flown.

    source: recording, and the time in it.   y: (n_samples, 6) from trim, each dt of the test.
    reached: largest part of a limit.   exceeded: channel and time, or empty.
    """

    source: str
    y: tuple[tuple[float, ...], ...]
    reached: float
    exceeded: str = ""


@dataclass(frozen=True)
class Clearing:
    """What was computed of a point before it was flown.

    steps: the flown points it was computed from.   reached: predicted part of a limit, 5 %, 50 %
    and 95 %.   withdrawn: checks that speak against the promise.   n_exceeding, n_tried: simulated
    aircraft that exceed, and among how many they were found; p_value is None where these are rare.
    amplitude_deg: largest one recommended, under a promise of its own.
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


@dataclass(frozen=True)
class Point:
    """A point of a campaign.   peak_deg: of the manoeuvre's command."""

    name: str
    peak_deg: float
    events: tuple[Event, ...] = ()
    clearing: Clearing | None = None
    flown: FlownPoint | None = None

    @property
    def state(self) -> State:
        """As of now."""
        return self.events[-1].state if self.events else "planned"

    @property
    def is_over(self) -> bool:
        """Whether it is not flown any more."""
        return self.state in ("complete", "aborted")


class NextPoint(NamedTuple):
    """The point that is next, and its number from 0."""

    number: int
    point: Point


@dataclass(frozen=True)
class Campaign:
    """Points of one planned test at growing amplitudes.

    test: of the last point; aircraft, law, limits and interval are those of all.
    CampaignError for points that are none.
    """

    name: str
    test: DatasetRecipe
    points: tuple[Point, ...]
    clearance: ClearanceRecipe = ClearanceRecipe()  # noqa: RUF009

    def __post_init__(self) -> None:
        """Refuse points that do not build up."""
        if not 2 <= len(self.points) <= MOST_POINTS:
            raise CampaignError(
                f"{len(self.points)} points were given: a campaign has 2 to {MOST_POINTS}"
            )
        peaks = [point.peak_deg for point in self.points]
        if not (peaks[0] > 0.0 and sorted(set(peaks)) == peaks):
            given = ", ".join(f"{peak:g}" for peak in peaks)
            raise CampaignError(
                f"amplitudes of {given} deg were given: those of a build-up are positive and grow"
            )
        if len({point.name for point in self.points}) < len(peaks):
            raise CampaignError("two points have one name: give each its own")

    @classmethod
    def planned(
        cls, name: str, test: DatasetRecipe, fractions: tuple[float, ...], recipe: ClearanceRecipe
    ) -> "Campaign":
        """Points at these fractions of the test's amplitude."""
        peak = test.maneuver.peak_deg
        points = tuple(Point(f"{part:.0%}", part * peak) for part in fractions)
        return cls(name, test, points, recipe)

    @property
    def flown(self) -> tuple[Point, ...]:
        """Complete points, in order."""
        return tuple(point for point in self.points if point.state == "complete")

    @property
    def next(self) -> NextPoint:
        """CampaignError where all are over."""
        for number, point in enumerate(self.points):
            if not point.is_over:
                return NextPoint(number, point)
        raise CampaignError("every point is complete or aborted: the campaign is over")

    def test_of(self, point: Point) -> DatasetRecipe:
        """The planned test at a point's amplitude."""
        return replace(self.test, maneuver=self.test.maneuver.with_peak(point.peak_deg))

    def build_up(self, point: Point) -> BuildUp:
        """Complete points with the one that follows; ClearanceError where there is none."""
        return BuildUp(tuple(self.test_of(step) for step in self.flown), self.test_of(point))

    def changed(
        self, number: int, state: State, by: str, words: str = "", **fields: Any
    ) -> "Campaign":
        """Return the campaign with a point in another state; fields: what else of it changes."""
        if not by.strip():
            raise CampaignError("nobody was named: say who decides, with a name")
        point = self.points[number]
        event = Event(datetime.now(UTC).isoformat(timespec="seconds"), by.strip(), state, words)
        point = replace(point, events=(*point.events, event), **fields)
        return replace(self, points=(*self.points[:number], point, *self.points[number + 1 :]))

    def save(self, path: Path) -> None:
        """Write the whole campaign into one file, or nothing."""
        plain = {"format": FORMAT, "version": VERSION, **to_plain(self)}
        write_whole(path, f"{json.dumps(plain, indent=1, ensure_ascii=False)}\n".encode())


POINTS = TypeAdapter(tuple[Point, ...])


def load(path: Path) -> Campaign:
    """Read a campaign's file; CampaignError where it is none."""
    plain = read_plain(path)
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise CampaignError(f"{path} is no campaign: make one with `forewarn campaign new`")
    if plain.get("version") != VERSION:
        raise CampaignError(
            f"{path} is a campaign of version {plain.get('version')!r}: this program reads "
            f"{VERSION}"
        )
    try:
        return Campaign(
            str(plain["name"]),
            from_plain(DatasetRecipe(), plain["test"], "test"),
            POINTS.validate_python(plain["points"]),
            from_plain(ClearanceRecipe(), plain["clearance"], "clearance"),
        )
    except KeyError as error:
        raise CampaignError(f"{path} lacks {error}: it is damaged") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise CampaignError(f"{path}: points.{where}: {first['msg']}") from None
    except RecipeError as error:
        raise CampaignError(f"{path}: {error}") from None


def samples_of(point: FlownPoint) -> Array:
    """(n_samples, 6) of a flown point."""
    return np.array(point.y, np.float64)
