"""The token's login page in a real Chromium, whose requests carry what browsers add."""

from pathlib import Path

from playwright.sync_api import Page, expect

from tests.browser.site import open_site

TOKEN = "a-token-of-the-control-room"


def test_the_token_lets_a_browser_in_and_another_does_not(
    page: Page, tmp_path: Path, allowed_errors: list[str]
) -> None:
    allowed_errors.append("401 (Unauthorized)")
    with open_site(tmp_path, token=TOKEN) as site:
        page.goto(site.http)
        expect(page.get_by_role("heading", name="Forewarn")).to_be_visible()
        page.emulate_media(color_scheme="light")
        ground = "getComputedStyle(document.documentElement).colorScheme"
        assert page.evaluate(ground) == "light dark"
        page.get_by_label("Token of this Forewarn server").fill("another-token-altogether")
        page.get_by_role("button", name="Enter").click()
        expect(page.get_by_role("alert")).to_have_text("This is not a token of this server.")
        mark = "(alert) => getComputedStyle(alert, '::before').content"
        assert page.get_by_role("alert").evaluate(mark) == '"◆ "'
        page.get_by_label("Token of this Forewarn server").fill(TOKEN)
        page.get_by_role("button", name="Enter").click()
        expect(page.get_by_role("link", name="Monitors", exact=True)).to_be_visible()
        nav = page.locator(".nav")
        expect(page.locator("#me")).to_have_text("server · admin")
        expect(nav.get_by_role("link", name="People")).to_be_visible()
        for width in (1024, 1280, 1440, 1600):
            page.set_viewport_size({"width": width, "height": 768})
            assert nav.evaluate("({ scrollWidth, clientWidth }) => scrollWidth <= clientWidth")
        nav.get_by_role("link", name="People").click()
        expect(page.locator(".state-empty")).to_contain_text("FOREWARN_TOKEN")
        page.wait_for_load_state("networkidle")  # a module cut off in its loading is an error
        page.get_by_role("button", name="Log out").click()
        expect(page.get_by_label("Token of this Forewarn server")).to_be_visible()
        page.goto(site.http)
        expect(page.get_by_label("Token of this Forewarn server")).to_be_visible()
        page.goto("about:blank")


def test_a_server_without_a_token_has_nothing_to_log_out_of(page: Page, tmp_path: Path) -> None:
    with open_site(tmp_path) as site:
        page.goto(site.http)
        expect(page.get_by_role("link", name="Monitors", exact=True)).to_be_visible()
        expect(page.get_by_role("button", name="Log out")).to_be_hidden()
        nav = page.locator(".nav")
        expect(nav.get_by_role("link", name="People")).to_be_visible()
        assert nav.evaluate("({ scrollWidth, clientWidth }) => scrollWidth <= clientWidth")
        page.goto("about:blank")
