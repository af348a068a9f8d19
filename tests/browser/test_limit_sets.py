"""Limit sets on the page: made, given further versions, put in force where a flight is started."""

from playwright.sync_api import Page, expect

from tests.browser.fly.test_fly_page import Fly, site, stored
from tests.browser.site import Site

__all__ = ["site", "stored"]


def test_a_limit_set_is_made_versioned_and_chosen_at_the_start_of_a_live_flight(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422 (Unprocessable")
    page.goto(f"{site.http}/#/monitors")
    page.get_by_role("link", name="Limit sets").click()
    form = page.locator("form.panel")
    page.locator(".state-empty").get_by_role("button", name="Create a limit set").click()
    expect(form.get_by_label("Name", exact=True)).to_be_focused()
    form.get_by_label("Name", exact=True).fill("envelope")
    form.get_by_label("Name of the condition").fill("slow")
    form.get_by_label("Mach number below").fill("0.8")
    form.get_by_label("lateral acceleration").fill("0.45")
    form.get_by_label("sideslip").fill("10")
    form.get_by_label("Reason").fill("test card 7")
    form.get_by_role("button", name="Create the limit set").click()
    first = page.get_by_role("region", name="Version 1")
    expect(first).to_contain_text("By local, 20")
    expect(first).to_contain_text(": test card 7")
    expect(first.locator("tbody")).to_contain_text("below 0.8")
    expect(first.locator("tbody")).to_contain_text("0.45 g")
    expect(first.locator("tbody")).to_contain_text("10 deg")

    expect(form.get_by_label("sideslip")).to_have_value("10")
    form.get_by_role("button", name="Add a condition").click()
    fast = form.locator("fieldset", has_text="Condition").last
    fast.get_by_label("Name of the condition").fill("fast")
    fast.get_by_label("Mach number from").fill("0.7")
    form.get_by_role("button", name="Create version 2").click()
    expect(form.get_by_role("alert").last).to_contain_text("overlap")
    fast.get_by_label("Mach number from").fill("0.8")
    form.get_by_role("button", name="Create version 2").click()
    second = page.get_by_role("region", name="Version 2")
    expect(second.locator("tbody tr")).to_have_count(2)
    expect(first.locator("tbody tr")).to_have_count(1)
    (limits,) = site.store.limit_sets.all()
    assert (limits.name, limits.newest) == ("envelope", 2)

    page.get_by_role("link", name="Fly").first.click()
    page.get_by_role("radio", name="Live").check()
    page.get_by_label("Limits", exact=True).select_option("envelope, version 2")
    page.get_by_label("Mach number").fill("0.9")
    page.get_by_role("button", name="Start the flight").click()
    fly = Fly(page, site)
    fly.connected()
    fly.flight = page.url.rsplit("/", 1)[-1]
    expect(page.locator(".flight-limits")).to_contain_text("envelope version 2, fast: |Ny| 0.5 g")
    fly.end()
