"""The session check: what it measures, its drill, and its result in the next flight's record."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.fly.test_fly_page import UNTESTED, Fly, site, stored
from tests.browser.site import Site

__all__ = ["site", "stored"]


class Check(Fly):
    """The page of the check."""

    def open(self) -> None:
        self.page.goto(f"{self.site.http}/#/fly")
        self.page.evaluate("localStorage.removeItem('forewarn.session_check')")
        self.page.goto(f"{self.site.http}/#/fly/check")
        expect(self.row("link")).to_contain_text("round trip")

    def row(self, name: str) -> Any:
        return self.page.locator(f'[data-check="{name}"]')

    def result(self, name: str) -> Any:
        return self.row(name).locator(".chip")

    def start_live(self) -> list[dict[str, Any]]:
        """Start a live flight by the form; returns its markers."""
        self.page.goto(f"{self.site.http}/#/fly")
        self.page.get_by_role("radio", name="Live").check()
        self.page.get_by_role("button", name="Start the flight").click()
        self.connected()
        self.flight = self.page.url.rsplit("/", 1)[-1]
        return self.ask("GET", f"/flights/{self.flight}/markers")


@pytest.fixture
def check(own_page: Page, site: Site) -> Iterator[Check]:
    check = Check(own_page, site)
    yield check
    check.end()


def test_what_needs_nobody_is_checked_at_once_and_the_rest_is_not_done(check: Check) -> None:
    check.open()
    for name in ("program", "limits", "link", "clock"):
        expect(check.result(name)).to_have_text("passed")
    expect(check.row("program")).to_contain_text(re.compile(r"Forewarn \d"))
    digest = check.ask("GET", "/monitors")[0]["digest"]
    expect(check.row("monitor")).to_contain_text(digest[:12])
    expect(check.row("limits")).to_contain_text("0.5 g")
    expect(check.result("monitor")).to_have_text("failed")  # it was not tested
    expect(check.row("monitor")).to_contain_text(UNTESTED.removeprefix("◆ "))
    for name in ("sound", "drill"):
        expect(check.result(name)).to_have_text("not done")


def test_clocks_that_differ_fail_the_check(check: Check) -> None:
    check.page.clock.install()
    check.page.clock.set_fixed_time("2031-01-01T00:00:00Z")
    check.open()
    expect(check.result("clock")).to_have_text("failed")


def test_a_muted_or_unheard_tone_fails_and_is_in_the_record_of_the_next_flight(
    check: Check,
) -> None:
    check.open()
    check.page.get_by_role("button", name="Play the tone").click()
    check.page.get_by_role("button", name="I heard nothing").click()
    expect(check.result("sound")).to_have_text("failed")
    (marker,) = check.start_live()
    assert marker["kind"] == "event"
    assert marker["text"].startswith("Session check FAILED")
    assert "sound (tone not heard" in marker["text"]
    assert "not done: alert drill" in marker["text"]
    event = check.page.locator(".event", has_text="Session check FAILED")
    expect(event).to_have_count(1)


def test_each_spoken_callout_is_played_by_its_button_once_chosen(check: Check) -> None:
    check.open()
    check.page.get_by_label("spoken callouts").check()
    for word in ("alert", "limit", "abort", "stale"):
        check.page.get_by_role("button", name=f"Play the callout {word}").click()
        expect(check.row("sound")).to_contain_text(f"“{word}” played")
    check.page.get_by_role("button", name="I heard it").click()
    expect(check.row("sound")).to_contain_text("tone and voice heard")
    check.page.reload()
    expect(check.page.get_by_label("spoken callouts")).to_be_checked()


def test_a_live_flight_without_a_check_has_that_in_its_record(check: Check) -> None:
    check.page.goto(f"{check.site.http}/#/fly")
    expect(check.page.locator(".check-line")).to_contain_text("not done")
    (marker,) = check.start_live()
    assert marker["text"].startswith("Session check NOT DONE")


def test_the_drill_passes_once_its_alarms_were_shown_and_acknowledged(check: Check) -> None:
    check.open()
    page = check.page
    page.get_by_role("button", name="Start the drill").click()
    expect(page.locator(".event", has_text="alert, risk")).to_be_visible(timeout=60_000)
    expect(page.locator(".alarm-banner")).to_contain_text("LIMIT EXCEEDED")
    expect(check.row("drill")).to_be_hidden()
    page.keyboard.press("Space")  # later alarms would need a further acknowledgement
    expect(page.locator('[data-action="play"]')).to_have_attribute("aria-label", "Play")
    page.keyboard.press("k")
    expect(check.result("drill")).to_have_text("passed")
    (flight,) = (one for one in check.ask("GET", "/flights") if one["name"] == "alert drill")
    assert (flight["progress"], flight["source"]["outcome"]) == ("ended", "unsafe")


def test_a_drill_that_is_stopped_fails(check: Check) -> None:
    check.open()
    check.page.get_by_role("button", name="Start the drill").click()
    check.page.get_by_role("button", name="Stop the drill").click()
    expect(check.result("drill")).to_have_text("failed")
    expect(check.page.locator(".check-head")).to_contain_text("FAILED")
