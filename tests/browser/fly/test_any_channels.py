"""Flights of other dictionaries: limits of either sign, the margin, many channels, labels only."""

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from app.messages import limited_channels
from core.channels import LONGITUDINAL, Dictionary
from core.limits.limits import IntervalLimits, SafeInterval
from core.types import Array
from tests.browser.chromium import wait_until
from tests.browser.site import Site
from tests.browser.strips import Open, run
from tests.support import any_flight
from tests.support.any_flight import FIVE

MARGIN = "limit margin"


@pytest.fixture
def fly(own_page: Page, fresh: Site, allowed_errors: list[str]):
    """Play a recorded flight that ends with one of its alerts, or soon after its begin."""
    allowed_errors.append("AudioContext was not allowed")

    def played(recording: dict[str, Any], alerts: int = 0) -> Page:
        end = recording["messages"][alerts]["seq"] + 1 if alerts else 10
        whole = {key: values[:end] for key, values in recording["frames"]["whole"].items()}
        cut = recording | {"frames": recording["frames"] | {"whole": whole}}
        own_page.route("**/js/start/recording.json", lambda route: route.fulfill(json=cut))
        own_page.goto(f"{fresh.http}/#/demonstration")
        at = f"{whole['t'][-1]:.2f} / 6.00 s"
        expect(own_page.locator(".transport-time")).to_have_text(at)
        return own_page

    return played


def described(page: Page, key: str) -> str:
    """What a strip says to a screen reader."""
    words = f"""document.querySelector('.strip[data-key="{key}"] canvas').ariaLabel"""
    wait_until(page, words)
    return page.evaluate(words)


@pytest.mark.parametrize(
    ("first", "words"), [(2, "Nz 5.010 g, limit 4.9 g"), (3, "−1.441 g, limit −1.4 g")]
)
def test_an_alarm_names_the_limit_that_is_exceeded_with_its_sign(fly, first, words) -> None:
    recording = any_flight.recording()
    del recording["messages"][2:first]
    page = fly(recording, alerts=2)
    expect(page.locator(".alarm-text")).to_contain_text(words)
    assert "limit −1.4 to 4.9 g" in described(page, "Nz")


def test_an_alert_names_both_ends_of_the_interval(fly) -> None:
    page = fly(any_flight.recording(), alerts=1)
    expect(page.locator(".alarm-text")).to_contain_text("warns 0.5 s before Nz −1.4 or 4.9 g")


def test_one_channel_with_limits_on_both_sides_needs_no_margin_strip(fly) -> None:
    page = fly(any_flight.recording())
    expect(page.locator(".strip")).to_have_count(7)
    expect(page.locator(f'.strip[data-key="{MARGIN}"]')).to_have_count(0)
    expect(page.locator(".strip-tall")).to_have_count(2)
    expect(page.locator(".strip-folds")).to_have_count(0)


@pytest.mark.parametrize("intervals", [{"alpha": SafeInterval(None, 0.15)}, FIVE], ids=["1", "5"])
def test_the_margin_strip_is_the_monitors_margin(
    fly, intervals: Mapping[str, SafeInterval]
) -> None:
    many = any_flight.many(32)
    dictionary = LONGITUDINAL if len(intervals) == 1 else many
    y = any_flight.longitudinal() if len(intervals) == 1 else any_flight.oscillating(many)
    recording = any_flight.recording(dictionary, intervals, y)
    page = fly(recording, alerts=1)
    k = recording["messages"][1]["seq"]
    margin = IntervalLimits(dictionary, intervals).envelope.margin(y[k])
    shown = page.locator(f'.strip[data-key="{MARGIN}"] .readout-value')
    expect(shown).to_have_text(f"{margin:.2f}")


def test_of_many_channels_four_are_large_and_groups_unfold(fly) -> None:
    many = any_flight.many(32)
    page = fly(any_flight.recording(many, FIVE, any_flight.oscillating(many)))
    limited = [page.locator(".strips > .strip").nth(k).get_attribute("data-key") for k in range(7)]
    assert limited == [*FIVE, MARGIN, "risk"]
    expect(page.locator(".strip-tall")).to_have_count(5)
    expect(page.locator(".strips > .strip")).to_have_count(7)
    expect(page.locator(".strip-readings .readout-value")).to_have_count(27)
    folded = page.locator('.strip-readings > [data-key="x4"]')
    expect(folded.locator(".readout-value")).to_have_text(re.compile(r"^−?\d"))
    group = page.locator(".strip-fold", has_text="surfaces")
    group.click()
    opened = page.locator('.strips > [data-key="x4"]')
    expect(opened).to_be_visible()
    expect(page.locator(".strips > .strip")).to_have_count(12)
    assert opened.locator("canvas").evaluate("(canvas) => canvas.height") > 30
    opened.get_by_role("button").click()
    expect(folded).to_be_visible()
    expect(group).to_have_attribute("aria-expanded", "false")


def test_a_label_only_monitor_says_that_no_limit_is_known(fly) -> None:
    page = fly(any_flight.recording(intervals={}), alerts=1)
    expect(page.locator(".flight-limits")).to_contain_text("No limit is known")
    expect(page.locator(".alarm-text")).to_contain_text("before a failure as labelled")
    expect(page.locator('.strip[data-key="risk"]')).to_be_visible()
    expect(page.locator(f'.strip[data-key="{MARGIN}"]')).to_have_count(0)


def plain(dictionary: Dictionary, limits: IntervalLimits) -> list[dict[str, Any]]:
    return [channel.model_dump() for channel in limited_channels(dictionary, limits)]


def test_margins_of_the_page_are_those_of_the_monitor(strips: Open) -> None:
    rng = np.random.default_rng(3)
    dictionary = any_flight.many(6)
    page = strips()
    for _ in range(20):
        intervals = {key: _interval(rng) for key in rng.choice(dictionary.keys, 3, replace=False)}
        limits = IntervalLimits(dictionary, intervals)
        y: Array = rng.normal(size=6)
        shown = run(
            page,
            f"""
            const channels = {json.dumps(plain(dictionary, limits))};
            const values = {y.tolist()};
            const strips = channels.map(({{ key }}) => h.stripOf(key, channels));
            const read = ({{ key }}) => {{
              const value = values[channels.findIndex((channel) => channel.key === key)];
              return {{ low: value, high: value }};
            }};
            return h.marginAt(strips, 0, read).high;
            """,
        )
        assert shown == pytest.approx(limits.envelope.margin(y))


def _interval(rng: np.random.Generator) -> SafeInterval:
    rest, below, above = rng.normal(), *rng.uniform(0.1, 2.0, 2)
    low, high = rest - below, rest + above
    least, greatest = [(low, high), (None, high), (low, None)][rng.integers(3)]
    return SafeInterval(least, greatest, rest)


@pytest.mark.parametrize(
    ("interval", "limits", "exceeded"),
    [
        (SafeInterval(-0.5, 0.5), "|Nz| 0.5 g", "|Nz| 0.5 g"),
        (SafeInterval(-1.4, 4.9, 1.0), "Nz −1.4 to 4.9 g", "Nz −1.4 or 4.9 g"),
        (SafeInterval(None, 4.9), "Nz at most 4.9 g", "Nz 4.9 g"),
        (SafeInterval(-1.4, None), "Nz at least −1.4 g", "Nz −1.4 g"),
    ],
)
def test_limits_read_in_words(
    strips: Open, interval: SafeInterval, limits: str, exceeded: str
) -> None:
    channels = plain(LONGITUDINAL, IntervalLimits(LONGITUDINAL, {"Nz": interval}))
    words = run(
        strips(),
        f"""
        const channels = {json.dumps(channels)};
        return [h.limitsInWords(channels), h.exceededWords(channels)];
        """,
    )
    assert [text.replace("N_z", "Nz") for text in words] == [limits, exceeded]


def test_limits_by_key_are_magnitudes_or_intervals(strips: Open) -> None:
    limits = run(
        strips(),
        """
        const [Ny, p] = [{ low: -1.4, high: 4.9, rest: 1 }, { low: null, high: 2, rest: 0 }];
        const channels = h.withLimits(h.CHANNELS, { beta: 0.2, Ny, p });
        return channels.map(({ low, high, rest, limit }) => [low, high, rest, limit]);
        """,
    )
    assert limits[0] == [-0.2, 0.2, 0, 0.2]
    assert limits[1] == [None, 2, 0, None]
    assert limits[3] == [-1.4, 4.9, 1, None]
    assert limits[4] == [None, None, 0, None]
