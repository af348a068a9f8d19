"""The page of a flight, for tests whose modules have a `site` with monitors."""

from collections.abc import Iterator
from typing import TypeVar

import pytest
from playwright.sync_api import Page

from tests.browser.fly.test_fly_page import Fly
from tests.browser.fly.test_live import Live
from tests.browser.site import Site

View = TypeVar("View", Fly, Live)


def until_ended(view: View) -> Iterator[View]:
    yield view
    view.end()


@pytest.fixture
def fly(page: Page, site: Site) -> Iterator[Fly]:
    """The page, without a flight yet."""
    yield from until_ended(Fly(page, site))


@pytest.fixture
def own_fly(own_page: Page, site: Site) -> Iterator[Fly]:
    """A separate page, for a test that reroutes its WebSockets."""
    yield from until_ended(Fly(own_page, site))


@pytest.fixture
def live(page: Page, site: Site) -> Iterator[Live]:
    yield from until_ended(Live(page, site))


@pytest.fixture
def own_live(own_page: Page, site: Site) -> Iterator[Live]:
    yield from until_ended(Live(own_page, site))
