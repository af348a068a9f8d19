"""The page of a flight, for tests whose modules have a `site` with monitors."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page

from tests.browser.fly.test_fly_page import Fly
from tests.browser.fly.test_live import Live
from tests.browser.site import Site


@pytest.fixture
def fly(page: Page, site: Site) -> Iterator[Fly]:
    """The page, without a flight yet."""
    fly = Fly(page, site)
    yield fly
    fly.end()


@pytest.fixture
def own_fly(own_page: Page, site: Site) -> Iterator[Fly]:
    """A page of its own, for a test that reroutes its WebSockets."""
    fly = Fly(own_page, site)
    yield fly
    fly.end()


@pytest.fixture
def live(page: Page, site: Site) -> Iterator[Live]:
    live = Live(page, site)
    yield live
    live.end()


@pytest.fixture
def own_live(own_page: Page, site: Site) -> Iterator[Live]:
    live = Live(own_page, site)
    yield live
    live.end()
