"""Moments in test time or in the time of day, where a recording or a live source gives it."""

import csv
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

from playwright.sync_api import Page, expect

from core.channels import KEYS
from tests.browser.recorded_site import RecordedSite
from tests.browser.recordings.test_scoring_page import SCENE
from tests.support import attas

BEGAN = datetime(2026, 3, 1, 23, 59, 50, tzinfo=UTC)
"""Ten seconds before midnight."""
TEXTS = """async ([start, moments]) => {
    const { chooseTime, formatTime, setZero, TIMES } = await import("/js/lib/clock.js");
    setZero(start, "unknown");
    chooseTime(TIMES[1]);
    const texts = moments.map(([t, step]) => formatTime(t, step));
    localStorage.clear();
    return texts;
}"""
CLOCK = r"\d\d:\d\d:\d\d\.\d\d"


def dated(content: bytes) -> bytes:
    """The site's file with dates in place of its seconds."""
    head, *rows = content.decode().splitlines()
    moments = []
    for row in rows:
        seconds, _, values = row.partition(",")
        t = BEGAN + timedelta(seconds=float(seconds))
        moments.append(f"{t:%Y-%m-%dT%H:%M:%S.%f}Z,{values}")
    return "\n".join([head.replace("Time_s", "Time"), *moments, ""]).encode()


def scored(site: RecordedSite, content: bytes = b"") -> str:
    """Address of a new scoring."""
    recording = site.upload(content=content)
    site.confirm(recording)
    return f"{site.http}/#/recordings/{recording}?scoring={site.score(recording)['id']}"


MOMENTS = [
    (
        "2026-03-01T23:59:50Z",
        [(0, 1), (9.999, 0.01), (10.25, 0.1), (-0.5, 0.1)],
        ["23:59:50", "00:00:00.00", "00:00:00.3", "23:59:49.5"],
    ),
    ("2026-03-01T12:30:00.5+02:00", [(0, 0.01)], ["10:30:00.50"]),
    ("234:15:35:50.7", [(60, 0.1)], ["15:36:50.7"]),
    ("15:35:50.75", [(0.25, 0.01)], ["15:35:51.00"]),
    ("35:50.7", [(60, 0.1)], ["60.0"]),  # no hour: not a time of day
    ("2026-03-01", [(60, 0.1)], ["60.0"]),
    ("", [(125, 0.1)], ["2:05.0"]),
]
"""Zero of a recording, moments [s] with their step, and their texts."""


def test_a_moment_is_the_zero_of_the_recording_plus_its_time(
    own_page: Page, site: RecordedSite
) -> None:
    own_page.goto(site.http)
    for start, moments, said in MOMENTS:
        assert own_page.evaluate(TEXTS, [start, moments]) == said, start


def test_a_dated_recording_is_read_in_the_time_of_day(
    own_page: Page, site: RecordedSite, tmp_path: Path
) -> None:
    page = own_page
    page.goto(scored(site, dated(site.file)))
    time = page.get_by_role("button", name=re.compile("^Time"))
    expect(time).to_have_text("Time: test")
    first = page.locator(".event-time").first
    expect(first).to_have_text(re.compile(r"^\d+\.\d\d s$"))
    seconds = float(first.inner_text().removesuffix(" s"))
    time.press("Enter")
    expect(time).to_have_text("Time: day")
    expect(time).to_be_focused()
    moment = BEGAN + timedelta(seconds=seconds)
    expect(first).to_have_text(f"{moment:%H:%M:%S.%f}"[:11])
    expect(page.locator(".strip-interval")).to_contain_text("2026-03-01 23:59:50")
    expect(page).to_have_url(re.compile("time=day"))
    page.locator(".view-menu summary").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="as CSV").click()
    head, row, *_ = csv.reader(Path(saved.value.path()).read_text().splitlines())
    assert head[:2] == ["t [s]", "time of day (UTC)"]
    expected = f"{BEGAN + timedelta(seconds=float(row[0])):%H:%M:%S.%f}"
    assert row[1][:-1] == expected[: len(row[1]) - 1]
    with page.expect_download() as saved:
        page.get_by_role("button", name="as SVG").click()
    picture = Path(saved.value.path()).read_text()
    assert ">UTC<" in picture
    assert "t [s]" not in picture


def test_a_recording_without_a_date_gives_the_reason(own_page: Page, site: RecordedSite) -> None:
    page = own_page
    page.goto(scored(site))
    time = page.get_by_role("button", name=re.compile("^Time"))
    expect(time).to_have_attribute("aria-disabled", "true")
    time.press("Enter")
    expect(page.get_by_role("dialog")).to_contain_text("neither date nor clock")
    page.get_by_role("button", name="Close").click()
    expect(time).to_have_text("Time: test")
    page.goto(f"{site.http}/#/monitors")
    expect(time).to_be_hidden()


def test_a_live_flight_has_the_time_of_day_of_its_arrivals(
    own_page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.extend(SCENE)
    page = own_page
    order = {"source": {"kind": "live"}, "monitor": site.monitor, "epsilon": 0.1}
    flight = site.ask("POST", "/flights", json=order)["id"]
    page.goto(f"{site.http}/#/fly/{flight}?time=day")
    time = page.get_by_role("button", name=re.compile("^Time"))
    expect(time).to_have_attribute("title", re.compile("no sample has arrived yet"))
    t = [attas.TEST.dt * k for k in range(50)]
    sent = {"sequence": 0, "t": t, **{key: [0.0] * len(t) for key in KEYS}}
    site.ask("POST", f"/flights/{flight}/samples", json=sent)
    expect(time).to_have_text("Time: day")
    zero = datetime.fromisoformat(site.ask("GET", f"/flights/{flight}")["live"]["time_zero"])
    age = (datetime.now(UTC) - zero).total_seconds() - t[-1]
    assert 0 <= age < 60
    expect(page.locator(".event-time").first).to_have_text(re.compile(f"^{CLOCK}$"))
    site.ask("POST", f"/flights/{flight}/end")
    expect(page.locator(".notice")).to_contain_text("Its record is shown")
    expect(time).to_have_text("Time: day")


def test_a_simulated_flight_has_no_time_of_day(
    own_page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.extend(SCENE)
    order = {"source": {"kind": "simulated", "seed": 1}, "monitor": site.monitor, "epsilon": 0.1}
    flight = site.ask("POST", "/flights", json=order)["id"]
    own_page.goto(f"{site.http}/#/fly/{flight}")
    time = own_page.get_by_role("button", name=re.compile("^Time"))
    expect(time).to_have_attribute("title", re.compile("the flight is simulated"))
    site.ask("POST", f"/flights/{flight}/end")
