"""A viewer's page in a real Chromium: who is logged in, what is not offered, what is refused."""

from pathlib import Path

import httpx2
import pytest
from playwright.sync_api import Page, expect

from core.collection import DatasetRecipe, collect
from core.monitor import MonitorRecipe, train
from tests.browser.site import open_site

TOKEN = "a-token-of-the-control-room"
OWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    """The scene is hidden: it is slow to draw here."""
    return {"forewarn.scene": "hidden"}


def test_a_viewer_sees_all_and_is_offered_nothing_that_changes_a_shared_flight(
    page: Page, tmp_path: Path, allowed_errors: list[str]
) -> None:
    allowed_errors.append("403 (Forbidden)")
    with open_site(tmp_path, TOKEN) as site:
        dataset = collect(DatasetRecipe(n_unsafe=40, n_obs=10, seed=3))
        monitor = site.store.monitors.add(train(dataset, MonitorRecipe()), "doublet").id
        source = {"kind": "simulated", "seed": 7, "outcome": "unsafe"}
        flights = f"{site.http}/api/v1/flights"
        started = httpx2.post(flights, headers=OWN, json={"source": source, "monitor": monitor})
        flight = started.raise_for_status().json()["id"]
        steer = f"{flights}/{flight}/transport"
        for action in ("pause", "next_alert"):
            httpx2.post(steer, headers=OWN, json={"action": action}).raise_for_status()

        vi, _ = site.store.tokens.add("Vi", "viewer")
        page.goto(f"{site.http}/login?link={site.store.tokens.make_link(vi.id)}")
        page.goto(f"{site.http}/#/fly/{flight}")
        expect(page.locator("#me")).to_have_text("Vi · viewer")
        page.locator('[data-flight="open"]').wait_for()
        expect(page.locator(".alarm-banner")).to_contain_text("ALERT")
        expect(page.get_by_role("button", name="Acknowledge")).to_be_hidden()
        expect(page.get_by_role("button", name="KNOCK IT OFF")).to_be_hidden()
        for button in ("Play", "To the start", "End flight"):
            expect(page.get_by_role("button", name=button)).to_be_disabled()

        refused = "he role operator is needed, Vi has the role viewer"
        page.keyboard.press("k")
        expect(page.locator(".flight .error:visible").first).to_contain_text(refused)
        page.keyboard.press("n")
        expect(page.locator(".transport-error:visible")).to_contain_text(refused)
        (alarm, *_) = httpx2.get(f"{flights}/{flight}/alarms", headers=OWN).json()
        assert alarm["by"] is None

        site.store.tokens.revoke(vi.id)
        expect(page.locator(".flight")).to_contain_text("The login has ended")
        httpx2.post(f"{flights}/{flight}/end", headers=OWN).raise_for_status()
        allowed_errors.extend(["401 (Unauthorized)", "WebSocket connection to"])
        page.goto("about:blank")
