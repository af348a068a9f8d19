"""A server with a recording, and a scoring of it: what these tests share."""

from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.recorded_site import OUTCOMES, RecordedSite
from tests.browser.recordings.scored_chart import drawn


@pytest.fixture(scope="module")
def recording(site: RecordedSite) -> str:
    made = site.upload()
    site.confirm(made)
    return made


@pytest.fixture(scope="module")
def scoring(site: RecordedSite, recording: str) -> dict[str, Any]:
    made = site.score(recording, epsilon=0.1)
    assert [manoeuvre["outcome"] for manoeuvre in made["manoeuvres"]] == OUTCOMES
    return made


@pytest.fixture
def scored(page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]) -> Page:
    """The scored recording's page, drawn."""
    page.goto(f"{site.http}/#/recordings/{recording}?scoring={scoring['id']}")
    drawn(page)
    return page
