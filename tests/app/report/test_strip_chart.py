"""Strips as SVG: lines lie at their values, and reduction loses no visible peak."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.report.figures import faults
from app.report.strip_chart import LEFT, RIGHT, WIDTH, StripChart, envelope, runs, ticks

INNER = WIDTH - LEFT - RIGHT


def paths(chart: StripChart, kind: str) -> list[str]:
    """The drawn paths of a kind; the chart must be well-formed."""
    root = ElementTree.fromstring(chart.svg("a chart & more"))
    return [path.attrib["d"] for path in root.iter("path") if path.attrib["class"] == kind]


def words(chart: StripChart) -> list[str]:
    root = ElementTree.fromstring(chart.svg("a chart"))
    return ["".join(text.itertext()) for text in root.iter("text")]


def names(chart: StripChart) -> list[str]:
    root = ElementTree.fromstring(chart.svg("a chart"))
    return [text.text or "" for text in root.iter("text") if text.get("class") == "named"]


@pytest.fixture
def chart() -> StripChart:
    return StripChart(10.0, 20.0)


def test_a_line_goes_through_its_samples_and_is_broken_where_one_is_missing(chart: StripChart):
    strip = chart.strip(50.0)
    strip.low, strip.high = 0.0, 1.0
    t = np.array([10.0, 15.0, 16.0, 17.0, 20.0, 21.0])
    strip.line("trace", t, np.array([0.0, 1.0, np.nan, 0.5, 0.0, 0.0]))
    (path,) = paths(chart, "trace")
    points = np.array(re.findall(r"[ML]([\d.]+) ([\d.]+)", path), float)
    bottom = strip.top + 50.0
    expected = [
        (LEFT, bottom),
        (LEFT + INNER / 2, strip.top),
        (LEFT + 0.7 * INNER, strip.top + 25),
        (WIDTH - RIGHT, bottom),
    ]
    np.testing.assert_allclose(points, expected, atol=0.06)
    assert path.count("M") == 2


def test_a_strip_has_room_for_all_its_values(chart: StripChart):
    strip = chart.strip(50.0, "N_y [g]")
    strip.show(np.array([-0.3, np.nan, 0.1]), [0.5, -0.5])
    assert strip.low < -0.5
    assert strip.high > 0.5
    assert [text for _, text in strip.ticks] == ["−0.5", "0.0", "0.5"]
    assert "Ny [g]" in words(chart)


@pytest.mark.parametrize("values", [[], [np.nan], [0.0, 0.0], [3e9, 3e9], [1e-12, 2e-12]])
def test_a_strip_shows_anything(chart: StripChart, values: list[float]):
    strip = chart.strip(50.0)
    strip.show(values)
    strip.line("trace", np.linspace(10, 20, len(values)), np.array(values))
    assert strip.low < strip.high
    assert not any("nan" in path for path in paths(chart, "trace"))


@given(
    low=st.floats(-1e6, 1e6),
    spread=st.floats(1e-4, 1e7),
    n=st.integers(2, 10),
)
def test_ticks_are_round_and_about_as_many_as_requested(low: float, spread: float, n: int):
    high = low + spread
    found = [value for value, _ in ticks(low, high, n)]
    step = 10 ** np.floor(np.log10(spread / n)) / 1e6
    assert all(low - step <= value <= high + step for value in found)
    assert len(found) <= n + 1
    assert len(found) >= n / 2.5 - 1
    assert len({text for _, text in ticks(low, high, n)}) == len(found)


def test_names_that_do_not_fit_become_numbers_and_crowded_ones_are_left_out(chart: StripChart):
    chart.strip(50.0)
    chart.name([(10.0, "one"), (15.0, "two & a half")])
    assert names(chart) == ["one", "two & a half"]
    crowd = StripChart(10.0, 20.0)
    crowd.strip(50.0)
    crowd.name([(10 + 0.01 * k, f"manoeuvre {k}") for k in range(1000)])
    numbers = [int(text) for text in names(crowd)]
    assert numbers[0] == 1
    assert numbers == sorted(numbers)
    assert len(numbers) < 60


def test_intervals_have_a_visible_width(chart: StripChart):
    strip = chart.strip(50.0)
    strip.fill("alert", [(12.0, 12.0), (15.0, 16.0)], least=1.5)
    (path,) = paths(chart, "alert")
    boxes = np.array(re.findall(r"M([\d.]+) [\d.]+H([\d.]+)", path), float)
    np.testing.assert_allclose(np.diff(boxes).ravel(), [1.5, INNER / 10], atol=0.11)


def test_faults_have_one_strip_for_each_kind_in_fixed_order():
    intervals = [
        {"start": 5.0, "end": 6.0, "kind": "missing:Ny"},
        {"start": 1.0, "end": 2.0, "kind": "frozen:p"},
        {"start": 4.0, "end": 4.5, "kind": "gap"},
        {"start": 7.0, "end": 7.5, "kind": "gap"},
        {"start": 7.0, "end": 7.5, "kind": "unheard of"},
    ]
    picture = faults({"faults": intervals, "clocks": [{"start": 0.0, "end": 10.0}]})
    assert picture is not None
    text = ["".join(one.itertext()) for one in ElementTree.fromstring(picture).iter("text")]
    labels = [one for one in text if not re.match(r"[\d.]+$|t \[s\]", one)]
    assert labels == ["gaps", "Ny missing", "p frozen", "unheard of"]
    assert faults({"faults": [], "clocks": []}) is None
    assert faults(None) is None


def test_the_envelope_keeps_every_peak() -> None:
    rng = np.random.default_rng(1)
    t, values = np.arange(100_000.0), rng.standard_normal(100_000)
    values[123:130] = np.nan
    thin_t, thin = envelope(t, values, 500)
    assert len(thin) < 1500
    assert (np.diff(thin_t) >= 0).all()
    assert np.nanmax(thin) == np.nanmax(values)
    assert np.nanmin(thin) == np.nanmin(values)


def test_runs_are_the_first_and_the_last_of_each() -> None:
    assert runs(np.array([True, True, False, True])) == [(0, 1), (3, 3)]
    assert runs(np.zeros(3, bool)) == runs(np.zeros(0, bool)) == []
