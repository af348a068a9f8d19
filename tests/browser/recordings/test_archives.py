"""The page Archives: sums, the worst flights first, and any flight on the recorded chart."""

import re
import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from app.cli import main
from app.recordings import archive
from tests.browser.site import Site, open_site
from tests.support.places import DATA

MONITOR_FILE = DATA / "version_0_1_0" / "certified.fwm"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A server with an archive, and a folder that is none."""
    folder = tmp_path_factory.mktemp("archive")
    source, out = folder / "source", folder / "card 7"
    for seed, name in enumerate(("PH-LAB/2024-05-17.csv", "D-FLY/20240602.csv")):
        (source / name).parent.mkdir(parents=True)
        assert main(["sample-flight", "--seed", str(seed), "-o", str(source / name)]) == 0
    (source / "bad.csv").write_text("junk\n")
    call = ["score-archive", str(MONITOR_FILE), str(source), "--out", str(out), "--workers", "1"]
    assert main([*call, "--epsilon", "0.3"]) == 0
    (other := folder / "other").mkdir()
    with open_site(folder / "data", archives=(str(out), str(other))) as site:
        yield site
    shutil.rmtree(folder)


def test_a_guessed_mapping_is_marked_beside_its_flight(
    page: Page, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "DOUBTED", 1.0)
    page.goto(f"{site.http}/#/archives")
    page.get_by_role("link", name="card 7").click()
    rows = page.locator(".archive-table").last.locator("tbody tr")
    expect(rows.filter(has_text="mapping is a guess")).to_have_count(2)
    monkeypatch.undo()
    page.reload()
    expect(rows).to_have_count(2)
    expect(rows.filter(has_text="mapping is a guess")).to_have_count(0)


def test_an_archive_is_summed_filtered_and_its_flights_open(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/recordings")
    page.get_by_role("link", name="Archives").click()
    expect(page.get_by_text("holds no complete results")).to_be_visible()
    page.get_by_role("link", name="card 7").click()
    sums, flights = page.locator(".archive-table").first, page.locator(".archive-table").last
    expect(sums.locator('[data-label="Flights"]')).to_have_text("2")
    each = ("In time", "Late", "Misses", "False alarms", "Quiet", "No verdict")
    counts = [sums.locator(f'[data-label="{name}"]').inner_text() for name in each]
    manoeuvres = sums.locator('[data-label="Manoeuvres"]').inner_text()
    assert sum(int(re.findall(r"\d+", text)[0]) for text in counts) == int(manoeuvres)
    expect(page.get_by_role("row", name="bad.csv")).to_contain_text("no row of numbers")
    page.get_by_role("combobox", name="Summed by", exact=True).select_option("aircraft")
    expect(sums.locator("tbody tr")).to_have_count(2)
    page.get_by_role("combobox", name="Aircraft", exact=True).select_option("PH-LAB")
    expect(sums.locator("tbody tr")).to_have_count(1)
    expect(flights.locator("tbody tr")).to_have_count(1)
    page.get_by_role("combobox", name="Aircraft", exact=True).select_option("*")
    expect(flights.locator("tbody tr")).to_have_count(2)
    page.get_by_role("searchbox", name="Search flights").fill("d-fly")
    expect(flights.locator("tbody tr")).to_have_count(1)
    expect(page).to_have_url(re.compile(r"\?by=aircraft&find=d-fly$"))
    page.reload()
    expect(flights.locator("tbody tr")).to_have_count(1)
    expect(page.get_by_role("combobox", name="Summed by", exact=True)).to_have_value("aircraft")
    with page.expect_response("**/tiles?**") as tiles:
        flights.get_by_role("link", name="D-FLY/20240602.csv").click()
    assert tiles.value.ok
    expect(page.get_by_role("heading", name="D-FLY/20240602.csv")).to_be_visible()
    expect(page.locator(".verdict")).to_have_count(1)
    events = page.get_by_role("region", name="Events", exact=True)
    expect(events).to_contain_text("manoeuvre 1 begins (trim from 5.10 s)")
    expect(page.locator(".scored-chart")).to_contain_text(re.compile(r"β−?\d+\.\d+ … \d"))
    page.get_by_role("link", name="Archive", exact=True).click()
    expect(page.get_by_role("heading", name="card 7")).to_be_visible()
