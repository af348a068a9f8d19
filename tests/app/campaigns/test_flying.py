"""A point's recording: what counts, and what is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.assessment.segments import Interval
from app.campaigns.campaign import Campaign, points_at
from app.campaigns.flying import aborted_flight, flown_point
from app.campaigns.point import CampaignError, Condition, FlownPoint
from app.commands.sample_flight import TRIM_S, table
from app.recordings.mapped_recording import MappedRecording
from app.telemetry.mapping.proposal import propose
from app.telemetry.reading import columns_of
from core.channels import KEYS
from core.clearance.clearance import ClearanceRecipe
from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import LateralSimulator
from core.types import Array

TEST = TESTS["ATTAS"]
NY, DELTA_R = KEYS.index("Ny"), KEYS.index("delta_r")
FAST = 10
"""Times as fast as the test's samples."""
AFTER = 40
"""Samples of the test recorded after the manoeuvre."""


def flight(scale: float = 0.6) -> Array:
    """The nominal aircraft on the planned test, then at rest: (n, 6) at FAST times the rate.

    It stays below its limit.
    """
    simulator = LateralSimulator(TEST)
    y = simulator.fly(simulator.plant.nominal[np.newaxis], np.random.default_rng(1))[0].y[0]
    y = np.vstack([scale * y, np.zeros((AFTER, len(KEYS)))])
    t = np.arange(len(y))
    fine = np.linspace(0.0, t[-1], FAST * t[-1] + 1)
    return np.column_stack([np.interp(fine, t, column) for column in y.T])


def flown(
    path: Path,
    y: Array,
    marked: tuple[float, float] | None = None,
    bias: float = 0.0,
    cut: Callable[..., FlownPoint] = flown_point,
) -> FlownPoint:
    """The point of a recording of these samples. bias: N_y in trim [g]."""
    file = path / "flight.csv"
    head, *rows = table(y, TEST.dt / FAST).splitlines()
    cells = np.array([row.split(",") for row in rows], np.float64)
    cells[:, head.split(",").index("ay_g")] += bias
    file.write_text("\n".join([head, *(",".join(map(repr, row)) for row in cells.tolist()), ""]))
    with columns_of(file) as columns:
        mapping = propose(columns).mapping
        flown_so = {key: replace(way, bias=0.0) for key, way in mapping.channels.items()}
        mapping = replace(mapping, channels=flown_so)
        recorded = MappedRecording.of(columns, mapping).scorable()
    return cut(file.name, recorded, TEST, marked and Interval(*marked, "point"))


def test_a_flight_as_planned_passes_without_a_remark(tmp_path: Path) -> None:
    point = flown(tmp_path, flight(0.85))
    assert point.exceeded == point.remark == ""
    assert 0.0 < point.reached < 1.0


def test_an_exceedance_between_two_samples_of_the_test_counts(tmp_path: Path) -> None:
    y = flight()
    k = 3 * FAST * 20 + FAST // 2
    y[k - 3 : k + 4, NY] = 0.52
    point = flown(tmp_path, y)
    assert point.reached == pytest.approx(1.04, abs=0.001)
    assert point.exceeded == f"Ny at {TRIM_S + (k - 3) * TEST.dt / FAST:.2f} s"


@pytest.mark.parametrize("marked", [(5.0, 9.9), (5.0, 11.0), None])
def test_marked_times_hide_no_exceedance_of_the_manoeuvre(
    tmp_path: Path, marked: tuple[float, float] | None
) -> None:
    """Nor one just after it; one much later gets a remark."""
    y = flight()
    y[round((12.0 - TRIM_S) / TEST.dt * FAST), NY] = -0.6
    point = flown(tmp_path, y, marked)
    assert (point.exceeded, point.reached) == ("Ny at 12.00 s", pytest.approx(1.2, abs=0.01))
    late = np.vstack([y[: -AFTER * FAST], np.zeros((100 * FAST + 1, 6))])
    late[-1, NY] = 0.6
    point = flown(tmp_path, late, marked)
    assert point.exceeded == ""
    assert "outside every manoeuvre" in point.remark


def test_the_next_manoeuvre_of_a_recording_is_another_point(tmp_path: Path) -> None:
    mild, worse = flight(0.6)[: -AFTER * FAST], flight(2.0)
    both = np.vstack([mild, np.zeros((round(1.5 / TEST.dt) * FAST, len(KEYS))), worse])
    point = flown(tmp_path, both, (TRIM_S, TRIM_S + 6.0))
    assert (point.exceeded, point.reached < 1.0) == ("", True)
    assert "outside every manoeuvre" in point.remark


def test_a_sample_beyond_the_limit_as_recorded_is_not_explained_away_by_trim(
    tmp_path: Path,
) -> None:
    y = flight(0.8)
    largest = y[np.abs(y[:, NY]).argmax(), NY]
    point = flown(tmp_path, y, bias=float(np.copysign(0.51 - abs(largest), largest)))
    assert point.exceeded.endswith("as recorded, trim not subtracted")
    assert point.reached == pytest.approx(1.02, abs=0.001)


def reversed_rudder(y: Array) -> Array:
    y[:, DELTA_R] *= -1.0
    return y


def aileron_instead(y: Array) -> Array:
    return y[:, [0, 1, 2, 3, 5, 4]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (reversed_rudder, "its sign is reversed"),
        (aileron_instead, "the planned manoeuvre does not use it"),
        (lambda y: 0.25 * y, "barely flown"),
        (lambda y: y[: round(0.7 * (len(y) - AFTER * FAST))], "give the whole manoeuvre"),
    ],
)
def test_other_flights_than_the_point_are_refused(
    tmp_path: Path, change: Callable[[Array], Array], words: str
) -> None:
    with pytest.raises(CampaignError, match=words):
        flown(tmp_path, change(flight(1.0)))


def test_another_amplitude_than_planned_gets_a_remark(tmp_path: Path) -> None:
    assert "rudder moved by" in flown(tmp_path, flight(0.5)).remark


def test_an_aborted_flight_counts_against_the_limits_as_recorded(tmp_path: Path) -> None:
    """With its trim, within the marked times; no clearance is computed from it."""
    y = flight()[: 2 * FAST * 20]
    y[FAST * 20, NY] = 0.55
    at = TRIM_S + 20 * TEST.dt
    whole = flown(tmp_path, y, bias=0.05, cut=aborted_flight)
    assert (whole.y, whole.source) == ((), "flight.csv, entire recording")
    assert (whole.exceeded, whole.reached) == (f"Ny at {at:.2f} s", pytest.approx(1.2))
    before = flown(tmp_path, y, (0.0, TRIM_S), bias=0.05, cut=aborted_flight)
    assert (before.exceeded, before.reached) == ("", pytest.approx(0.1, abs=0.01))
    assert (before.start, before.end) == (0.0, TRIM_S)
    with pytest.raises(CampaignError, match="holds no sample of Ny, which has a limit"):
        flown(tmp_path, y, (90.0, 99.0), cut=aborted_flight)


def test_one_recording_serves_one_point(tmp_path: Path) -> None:
    point = flown(tmp_path, flight(0.8))
    condition = Condition("", TEST)
    points = points_at(condition, (0.8, 0.9))
    campaign = Campaign("c", (condition,), points, ClearanceRecipe())
    campaign = campaign.completed(point, "Bob")
    y = np.array(point.y)
    later = np.vstack([y[1:], y[-1:]]) + 0.01 * np.abs(y).max(axis=0)
    for again in (y, later):  # cut out at another sample, from another trim
        with pytest.raises(CampaignError, match="has the samples of '80%'"):
            campaign.completed(replace(point, y=tuple(map(tuple, again.tolist()))), "Bob")
    other = campaign.completed(flown(tmp_path, flight(0.9)), "Bob")
    assert other.points[1].state == "complete"
