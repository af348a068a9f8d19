"""The page Storage: what everything takes, and what is kept for ever."""

from pathlib import Path

from playwright.sync_api import Page, expect

from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from tests.browser.site import open_site


def test_what_is_stored_is_listed_and_kept_for_ever_by_a_button(page: Page, tmp_path: Path) -> None:
    with open_site(tmp_path) as site:
        monitor = train(collect(DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)), MonitorRecipe())
        monitor_id = site.store.monitors.add(monitor, "doublet").id
        flight = site.store.flights.add({"kind": "simulated", "name": "one"}, monitor_id, 0.3)
        site.store.flights.end(flight)
        page.route(
            "**/storage/space",
            lambda route: route.fulfill(json={"total": 1, "free": 0, "warning": "0 GB left"}),
        )
        page.goto(f"{site.http}/#/recordings")
        page.get_by_role("link", name="Storage").click()
        expect(page.locator("#damage")).to_have_text("◆ Low disk space: 0 GB left.")
        row = page.locator("tr", has_text="Flights")
        expect(row.locator('[data-label="Number"]')).to_have_text("1")
        page.get_by_role("button", name="Keep permanently one").first.click()
        button = page.get_by_role("button", name="Kept permanently one", pressed=True)
        expect(button.first).to_be_visible()
        assert site.store.flights.info(flight).keep
        page.goto(f"{site.http}/#/fly/{flight}")
        page.get_by_role("button", name="✓ Kept permanently").click()
        expect(page.get_by_role("button", name="Keep permanently")).to_be_visible()
        assert not site.store.flights.info(flight).keep
        page.goto("about:blank")
