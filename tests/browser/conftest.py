"""Fixtures of the browser tests: Chromium, the page's files, a page that must not complain."""

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

from app.routes import scene
from core.monitor import Monitor
from tests.browser.chromium import file_server, open_chromium, wait_until
from tests.browser.recorded_site import RecordedSite, open_recorded_site
from tests.browser.site import Site, open_site
from tests.browser.strips import Open
from tests.browser.window import Window

expect.set_options(
    timeout=20_000
)  # on a busy machine a page takes longer; no test fails by the clock


@pytest.fixture(scope="session")
def origin() -> Iterator[str]:
    """Origin under which /static/ and /browser/ are served, such as http://127.0.0.1:40001."""
    with file_server() as address:
        yield address


class _Chromium:
    """The browser of consecutive files: slow to start, and its event loop must not outlive them."""

    def __init__(self) -> None:
        self._parts, self._browser = ExitStack(), None

    def open(self) -> Browser:
        if self._browser is None:
            self._browser = self._parts.enter_context(open_chromium())
        return self._browser

    def close(self) -> None:
        self._parts.close()
        self._browser = None


CHROMIUM = _Chromium()
HERE = Path(__file__).parent


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> Iterator[None]:
    """Close the browser before a test of another folder."""
    try:
        yield
    finally:
        if nextitem is None or HERE not in nextitem.path.parents:
            CHROMIUM.close()


@pytest.fixture(scope="module")
def browser() -> Browser:
    return CHROMIUM.open()


@pytest.fixture
def allowed_errors() -> list[str]:
    """Parts of console messages that a test expects; it appends to the list."""
    return []


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A server that has nothing."""
    with open_site(tmp_path_factory.mktemp("fresh")) as site:
        yield site


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, attas: Monitor) -> Iterator[RecordedSite]:
    """A server with a monitor, for files that have no other."""
    with open_recorded_site(tmp_path_factory.mktemp("site"), attas) as site:
        yield site


@pytest.fixture(scope="module")
def no_scene() -> Iterator[None]:
    """Servers of this process send a scene's frame empty: it takes seconds to draw."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "client_page", lambda: scene.ClientPage(b"<!doctype html>", '"empty"'))
        yield


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    """What the page's browser remembers before each test of a file."""
    return {}


@pytest.fixture(scope="module")
def window(browser: Browser, stored: dict[str, str]) -> Iterator[Window]:
    """The page that the tests of a file share."""
    made = Window(browser, stored)
    yield made
    made.close()


@pytest.fixture
def page(
    window: Window, allowed_errors: list[str], request: pytest.FixtureRequest
) -> Iterator[Page]:
    """A page of 1280 x 720, dark; fails the test if its console holds an unexpected error.

    It is the last test's page where that left nothing behind: the modules load once a file. A
    test that listens to the page, or alters what cannot be taken back, asks for `own_page`. A page
    of allowed errors is closed, since the console may tell of them late.
    """
    n_failed = request.session.testsfailed
    yield window.open()
    has_failed = request.session.testsfailed != n_failed
    errors = window.leave(keep=not has_failed and not allowed_errors)
    assert unexpected(errors, allowed_errors) == []


@pytest.fixture
def own_page(browser: Browser, stored: dict[str, str], allowed_errors: list[str]) -> Iterator[Page]:
    """Such a page that no other test has or had."""
    window = Window(browser, stored)
    yield window.open()
    errors = window.close()
    assert unexpected(errors, allowed_errors) == []


ENDED = re.compile(r"status of 404 .*/flights/\w+/source\?")
"""A flight's source is gone with its end, also for a page that is just reading what lies before."""

CUT = 1011
"""Close code of a server that has failed."""
RELAYED_LATE = "error: WebSocket is already in CLOSING or CLOSED state"
"""The server closed its socket while a test passed a message of the page on to it.

The page's own socket is then Playwright's, which raises an exception instead.
"""


def unexpected(errors: list[str], allowed: list[str]) -> list[str]:
    """What of the errors no test has allowed."""
    return [
        error
        for error in errors
        if not ENDED.search(error) and not any(part in error for part in allowed)
    ]


Text = str | bytes


class Relay(Protocol):
    """Pass the messages of the page's streams on, None for none; returns the streams passed on.

    to_page: of a message and the number of its stream.   is_cut: whether a new stream is refused.
    """

    def __call__(
        self,
        to_page: Callable[[Text, int], Text | None] = ...,
        to_server: Callable[[Text], Text | None] = ...,
        is_cut: Callable[[], bool] = ...,
    ) -> list[WebSocketRoute]: ...


@pytest.fixture
def relay(own_page: Page, allowed_errors: list[str]) -> Relay:
    """Start before the page opens a stream."""

    def started(
        to_page: Callable[[Text, int], Text | None] = lambda text, _: text,
        to_server: Callable[[Text], Text | None] = lambda text: text,
        is_cut: Callable[[], bool] = lambda: False,
    ) -> list[WebSocketRoute]:
        routes: list[WebSocketRoute] = []

        def pass_on(route: WebSocketRoute) -> None:
            if is_cut():
                route.close(code=CUT)
                return
            server, number = route.connect_to_server(), len(routes)
            route.on_message(lambda text: send(server, to_server(text)))
            server.on_message(lambda text: send(route, to_page(text, number)))
            routes.append(route)

        def send(to: WebSocketRoute, text: Text | None) -> None:
            if text is not None:
                to.send(text)

        allowed_errors.append(RELAYED_LATE)
        own_page.route_web_socket(re.compile(r"/stream\?"), pass_on)
        return routes

    return started


@pytest.fixture
def strips(page: Page, origin: str) -> Open:
    """Open the strips with a query; feed and draw through `harness`."""

    def opened(query: str = "seconds=20") -> Page:
        page.goto(f"{origin}/browser/strip_harness.html?{query}")
        wait_until(page, "window.harness")
        return page

    return opened
