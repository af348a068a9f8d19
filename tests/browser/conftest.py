"""Fixtures of the browser tests: Chromium, the page's files, a page that must not complain."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.chromium import file_server, open_chromium, wait_until, watch_errors
from tests.browser.strips import Open

expect.set_options(
    timeout=20_000
)  # on a busy machine a page takes longer; no test fails by the clock


@pytest.fixture(scope="session")
def origin() -> Iterator[str]:
    """Origin under which /static/ and /browser/ are served, such as http://127.0.0.1:40001."""
    with file_server() as address:
        yield address


@pytest.fixture(scope="module")  # its event loop must not outlive the browser tests
def browser() -> Iterator[Browser]:
    with open_chromium() as chromium:
        yield chromium


@pytest.fixture
def allowed_errors() -> list[str]:
    """Parts of console messages that a test expects; it appends to the list."""
    return []


@pytest.fixture
def page(browser: Browser, allowed_errors: list[str]) -> Iterator[Page]:
    """A fresh page of 1280 x 720, dark; fails the test if its console holds an unexpected error."""
    context = browser.new_context(viewport={"width": 1280, "height": 720}, color_scheme="dark")
    page = context.new_page()
    errors = watch_errors(page)
    yield page
    context.close()
    unexpected = [e for e in errors if not any(part in e for part in allowed_errors)]
    assert unexpected == []


@pytest.fixture
def strips(page: Page, origin: str) -> Open:
    """Open the strips with a query; feed and draw through `harness`."""

    def opened(query: str = "seconds=20") -> Page:
        page.goto(f"{origin}/browser/strip_harness.html?{query}")
        wait_until(page, "window.harness")
        return page

    return opened
