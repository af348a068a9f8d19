"""The mapping page for a monitor of any channels: its rows first, others on demand, by hand."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.recorded_site import RecordedSite
from tests.support.own_channels import TEN, monitor, ten_mat

NAME = "ten channels of our own"


@pytest.fixture(scope="module")
def own(site: RecordedSite) -> str:
    return site.site.store.monitors.add(monitor(10), NAME).id


@pytest.fixture
def opened(page: Page, site: RecordedSite, own: str, tmp_path: Path) -> Page:
    """The page of a recording of ten channels, mapped for their monitor."""
    page.goto(f"{site.http}/#/recordings/{site.upload('ten.mat', ten_mat(tmp_path))}")
    page.get_by_label("Channels of", exact=True).select_option(NAME)
    return page


def row(page: Page, key: str) -> Locator:
    return page.locator(f'.map-row[data-key="{key}"]')


def test_the_rows_are_the_channels_of_the_chosen_monitor(opened: Page) -> None:
    rows = opened.locator(".map-table > .map-rows:not(.time-rows) > .map-row")
    expect(rows).to_have_count(10)
    keys = rows.evaluate_all("(rows) => rows.map((row) => row.dataset.key)")
    assert keys == list(TEN.keys)
    expect(row(opened, "γ̇")).to_contain_text("MISSING")
    expect(row(opened, "γ̇")).to_contain_text("no signal has the name")
    expect(row(opened, "wing load").locator(".mini-words")).to_contain_text("lbf")
    opened.get_by_label("Channels of", exact=True).select_option("transport doublet")
    expect(row(opened, "γ̇")).to_have_count(0)
    expect(row(opened, "beta")).to_contain_text("MISSING")
    expect(row(opened, "wing load")).to_be_visible()


def test_a_channel_is_mapped_by_hand_in_a_unit_of_its_kind(
    opened: Page, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")  # the lateral monitor does not fit
    opened.get_by_label(re.compile("^signal of flight-path rate")).select_option("signal:gamma")
    unit = opened.get_by_label(re.compile("^unit of flight-path rate"))
    expect(unit.locator("option")).to_have_text(["rad/s", "deg/s"])
    unit.select_option("deg/s")
    expect(row(opened, "γ̇").locator(".mini-words")).to_have_text(re.compile("deg/s$"))
    opened.get_by_label("sign of tail load n: as recorded").click()
    opened.get_by_label("map another quantity").select_option("sideslip")
    opened.get_by_label("signal of sideslip β").select_option("signal:gamma")
    expect(row(opened, "beta").locator(".map-warnings")).to_contain_text("also mapped")
    opened.get_by_label("signal of sideslip β").select_option("")
    opened.get_by_role("button", name="Confirm the mapping").click()
    summary = opened.locator(".mapping > summary")
    expect(summary.locator(".chip")).to_have_text("confirmed")
    expect(summary).not_to_contain_text("without")
    summary.click()
    expect(opened.get_by_label("sign of tail load n: reversed")).to_be_visible()
    expect(row(opened, "γ̇").locator(".map-verdict")).to_contain_text("confirmed")
    expect(opened.get_by_text("No monitor here fits this recording.")).to_be_visible()


def test_what_was_corrected_before_stays_when_a_monitor_is_chosen(
    page: Page, site: RecordedSite, own: str, tmp_path: Path
) -> None:
    page.goto(f"{site.http}/#/recordings/{site.upload('ten.mat', ten_mat(tmp_path))}")
    page.get_by_label("signal of pitch rate q").select_option("signal:gamma")
    page.get_by_label("Channels of", exact=True).select_option(NAME)
    expect(page.get_by_label("signal of pitch rate q")).to_have_value("signal:gamma")
    expect(row(page, "wing load")).to_be_visible()
