"""A page that tests use one after the other, while each leaves it as it was."""

import json

from playwright.sync_api import Browser, Page

from tests.browser.chromium import watch_errors

SIZE = {"width": 1280, "height": 720}
EMPTY = "#/datasets?left"
"""A view with little in it, at an address that no test goes to."""

LEAVE = """async ([stored, empty]) => {
    const page = document.querySelector("#page");
    if (page && location.hash !== empty) {
        const left = new Promise((done) => addEventListener("hashchange", done, { once: true }));
        location.hash = empty;
        await left;
    }
    const remembered = Object.entries(localStorage);
    return remembered.every(([key, value]) => stored[key] === value)
        && document.cookie === "" && document.querySelector("dialog") === null;
}"""
STORE = """for (const [key, value] of Object.entries(%s))
    try { localStorage.getItem(key) ?? localStorage.setItem(key, value); } catch {}"""


class Window:
    """A page in its own browser profile; it is replaced once a test has left something there.

    stored: what the page finds in localStorage.
    """

    def __init__(self, browser: Browser, stored: dict[str, str]) -> None:
        self._browser, self._stored = browser, stored
        self._page: Page | None = None
        self._errors: list[str] = []

    def open(self) -> Page:
        """The page, 1280 x 720 and dark."""
        if self._page is None:
            context = self._browser.new_context(viewport=SIZE, color_scheme="dark")  # pyright: ignore[reportArgumentType]
            if self._stored:
                context.add_init_script(STORE % json.dumps(self._stored))
            self._page = context.new_page()
            self._errors = watch_errors(self._page)
        return self._page

    def leave(self, keep: bool) -> list[str]:
        """Show an empty view in the page, or close it; returns what it has complained of."""
        page = self._page
        if page is None or not (keep and self._is_as_before(page)):
            return self.close()
        page.unroute_all()
        page.mouse.move(0, 0)
        page.emulate_media(media="null", color_scheme="dark")
        page.set_viewport_size(SIZE)  # pyright: ignore[reportArgumentType]
        errors = list(self._errors)
        self._errors.clear()
        return errors

    def close(self) -> list[str]:
        """Close the page and its profile; returns what it has complained of."""
        if self._page is not None:
            self._page.context.close()
            self._page = None
        errors = list(self._errors)
        self._errors.clear()
        return errors

    def _is_as_before(self, page: Page) -> bool:
        if not page.url.startswith("http"):
            return False
        return page.evaluate(LEAVE, [self._stored, EMPTY])
