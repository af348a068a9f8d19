"""Pages of a server with years of data: they show the newest, and find the rest."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect
from sqlalchemy import insert

from app.store.tables import flights, recordings
from core.monitor import train
from core.planned_test.collection import DatasetRecipe, collect
from tests.browser.site import Site, open_site
from tests.support.stored import keep_recording

N_FLIGHTS, N_RECORDINGS = 65, 2_000
MOST_ELEMENTS = 3_000


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with open_site(tmp_path_factory.mktemp("site")) as site:
        monitor = train(collect(DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)))
        known = site.store.monitors.add(monitor, "doublet").id
        for k in range(N_FLIGHTS):
            source = {"kind": "simulated", "name": f"point {k}"}
            site.store.flights.end(site.store.flights.add(source, known, 0.3))
        keep_recording(site.store, "first", name="run_0.csv")
        with site.store.engine.begin() as connection:
            (row,) = connection.execute(recordings.select())
            more = ({"id": f"r{k}", "name": f"run_{k}.csv"} for k in range(1, N_RECORDINGS))
            connection.execute(insert(recordings), [row._asdict() | other for other in more])
            assert len(connection.execute(flights.select()).all()) == N_FLIGHTS
        yield site


def test_the_fly_page_shows_the_newest_flights_and_finds_the_others(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/fly")
    rows, more = page.locator(".flight-row"), page.get_by_role("button", name="Show more")
    expect(rows).to_have_count(30)
    expect(rows.first).to_contain_text("point 64")
    more.click()
    expect(rows).to_have_count(60)
    more.click()
    expect(rows).to_have_count(N_FLIGHTS)
    expect(more).to_be_hidden()
    search = page.get_by_role("searchbox", name="Search ended flights by name or monitor")
    search.fill("point 12")
    expect(rows).to_have_count(1)
    search.fill("nothing")
    expect(page.get_by_text("No ended flight has “nothing”")).to_be_visible()
    search.fill("")
    expect(rows).to_have_count(30)


def test_the_recordings_page_shows_the_newest_and_finds_the_others(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/recordings")
    rows = page.locator("tbody tr")
    expect(rows).to_have_count(50)
    assert page.locator("*").count() < MOST_ELEMENTS
    page.get_by_role("button", name="Show more").click()
    expect(rows).to_have_count(100)
    page.get_by_role("searchbox", name="Search recordings").fill("RUN_1234")
    expect(rows).to_have_count(1)
    expect(rows).to_contain_text("run_1234.csv")
    page.get_by_role("searchbox", name="Search recordings").fill("nothing")
    expect(page.get_by_text("No recording found")).to_be_visible()


HIDE = """(hidden) => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


def test_a_hidden_page_frees_its_connection_and_is_up_to_date_when_shown(
    own_page: Page, site: Site
) -> None:
    page = own_page
    page.goto(f"{site.http}/#/fly")
    row = page.locator(".flight-row").first
    expect(row).to_contain_text("point 64")
    with page.expect_event("requestfailed", lambda request: request.url.endswith("/api/v1/events")):
        page.evaluate(HIDE, True)
    source = {"kind": "simulated", "name": "flown meanwhile"}
    (monitor,) = site.store.monitors.all()
    site.store.flights.end(site.store.flights.add(source, monitor.id, 0.3))
    expect(row).to_contain_text("point 64")
    page.evaluate(HIDE, False)
    expect(row).to_contain_text("flown meanwhile")
    expect(page.get_by_text("Display is stale")).to_be_hidden()


def test_a_list_is_marked_at_once_when_its_server_is_gone_until_it_answers_again(
    own_page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors += ["ERR_CONNECTION_REFUSED", "ERR_INCOMPLETE_CHUNKED_ENCODING"]
    page = own_page
    page.goto(f"{site.http}/#/fly")
    expect(page.locator(".flight-row")).to_have_count(30)
    site.stop()
    expect(page.get_by_text("Display is stale: no answer")).to_contain_text("connection lost")
    expect(page.locator(".panel[data-lost]")).to_have_count(1)
    expect(page).to_have_title("◆ OUT OF DATE – Fly – Forewarn")
    site.start_again()
    expect(page.get_by_text("Display is stale")).to_be_hidden()
    expect(page).to_have_title("Fly – Forewarn")
