"""Recordings in a real Chromium: a file comes in, is mapped, is scored."""

import json
import re
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, Route, expect

from core.channels import KEYS
from core.monitor.monitor_set import MonitorCase, MonitorSet
from tests.browser.recorded_site import (
    BAD_LINE,
    OUTCOMES,
    RecordedSite,
)
from tests.browser.site import open_site
from tests.support import ch10_flight
from tests.support.clocks import CLOCKS, COUNTS, EVEN, T0

WORDS = {"quiet": "QUIET", "timely_alert": "LIMIT EXCEEDED, warned", "invalid": "INVALID"}
LONG_NAME = f"{'a very long name of a recording ' * 6}.csv"
SLOW = 30_000
"""[ms] Reading starts a separate process."""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, site: RecordedSite) -> Path:
    path = tmp_path_factory.mktemp("files") / "doublets.csv"
    path.write_bytes(site.file)
    return path


def choose(page: Page, *files: Path) -> None:
    page.locator('input[type="file"]').set_input_files([str(path) for path in files])


def row(page: Page, key: str) -> Locator:
    return page.locator(f'.map-row[data-key="{key}"]')


def overflow(page: Page) -> int:
    """Pixels by which the page is wider than the window."""
    return page.evaluate("""Math.max(document.documentElement.scrollWidth - innerWidth,
        ...[document.querySelector('.page')].map((e) => e.scrollWidth - e.clientWidth))""")


# Nothing there yet


def test_without_recordings_the_page_says_what_one_is(page: Page, tmp_path: Path) -> None:
    with open_site(tmp_path) as fresh:
        page.goto(f"{fresh.http}/#/recordings")
        expect(page.locator(".state-empty")).to_contain_text("No recording yet")
        with page.expect_file_chooser():
            page.locator(".state-empty").get_by_role("button", name="Choose a file").click()
        expect(page.get_by_text("Drop a recording anywhere on this page")).to_be_visible()
        for title in ("Parquet", "MATLAB", "HDF5"):
            expect(page.locator(".drop-zone")).to_contain_text(title)
        page.goto("about:blank")


def test_what_is_not_there_is_said(
    page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.append("404")
    for address in ("no-such", "no-such?scoring=none", "no-such?compare=a,b"):
        page.goto(f"{site.http}/#/recordings/{address}")
        expect(page.locator(".state-error")).to_contain_text("There is no")


# The whole way


def test_a_file_is_uploaded_mapped_and_scored(page: Page, site: RecordedSite, file: Path) -> None:
    page.goto(f"{site.http}/#/recordings")
    page.get_by_label("Aircraft").fill("D-TEST")
    choose(page, file)
    expect(page.get_by_role("heading", level=1)).to_have_text("doublets.csv", timeout=SLOW)
    mapping = page.locator(".mapping")
    expect(mapping.locator("summary .chip").first).to_have_text("unconfirmed")
    expect(page.get_by_label("signal of sideslip β")).to_have_value("signal:AOSS_deg")
    expect(page.get_by_label("unit of sideslip β")).to_have_value("deg")
    expect(row(page, "beta").locator(".confidence-word")).to_have_text(re.compile("high|medium"))
    row(page, "beta").locator(".confidence > summary").click()
    expect(row(page, "beta").locator(".reasons li").first).to_be_visible()
    page.get_by_role("button", name="Confirm the mapping").click()
    expect(mapping.locator("summary .chip").first).to_have_text("confirmed")
    expect(page.locator(".picker-chart .lane-item")).to_have_count(3)
    page.get_by_role("button", name="Score", exact=True).click()
    page.wait_for_url("**?scoring=*")
    chips = page.locator(".verdict-table td:nth-child(2) .chip")
    expect(chips).to_have_text([re.compile(WORDS[outcome]) for outcome in OUTCOMES])
    page.goto(f"{site.http}/#/recordings")
    listed = page.locator("tbody tr", has_text="doublets.csv")
    expect(listed).to_contain_text("D-TEST")
    expect(listed).to_contain_text("confirmed")


def test_an_aircrafts_mapping_is_remembered_and_its_name_offered(
    page: Page, site: RecordedSite
) -> None:
    site.confirm(site.upload(aircraft="D-KNOWN"))
    page.goto(f"{site.http}/#/recordings/{site.upload(aircraft='D-KNOWN')}")
    expect(page.locator(".mapping summary .chip").first).to_have_text("remembered")
    expect(page.get_by_label("Aircraft")).to_have_value("D-KNOWN")
    page.goto(f"{site.http}/#/recordings")
    expect(page.locator('#known-aircraft option[value="D-KNOWN"]')).to_have_count(1)


# Correcting a mapping


def test_a_correction_is_shown_in_the_data_at_once(page: Page, site: RecordedSite) -> None:
    page.goto(f"{site.http}/#/recordings/{site.upload()}")
    words = row(page, "beta").locator(".mini-words")
    expect(words).to_have_text(re.compile(r"^−3\.\d+ to 4\.\d+ deg$"))
    page.get_by_label("unit of sideslip β").select_option("rad")
    expect(words).to_have_text(re.compile(r"^−\d{3} to 2\d\d deg$"))
    page.get_by_label("unit of sideslip β").select_option("deg")
    page.get_by_label("sign of sideslip β: as recorded").click()
    expect(words).to_have_text(re.compile(r"^−4\.\d+ to 3\.\d+ deg$"))
    expect(page.get_by_label("sign of sideslip β: reversed")).to_have_attribute(
        "aria-pressed", "true"
    )
    page.get_by_label("bias removed from sideslip β in deg").fill("57.3")
    expect(words).to_have_text(re.compile(r"^−6\d\.\d to −5\d\.\d deg$"))
    page.get_by_role("button", name=re.compile("^Units")).dblclick()
    expect(words).to_have_text(re.compile(r"^−1\.0\d* to −0\.9\d* rad$"))
    expect(page.get_by_label("bias removed from sideslip β in rad")).to_have_value("1.00007")
    expect(row(page, "beta").locator(".map-verdict")).to_have_text("set by you")


def test_raw_counts_are_scaled_and_stay_so(
    page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    made = site.upload()
    page.goto(f"{site.http}/#/recordings/{made}")
    counts = row(page, "beta").locator(".map-counts")
    words = row(page, "beta").locator(".mini-words")
    expect(words).to_have_text(re.compile(r"^−3\.\d+ to 4\.\d+ deg$"))
    counts.locator("summary").click()
    page.get_by_label("scale of sideslip β").fill("0.5")
    page.get_by_label("offset of sideslip β").fill("-20")
    expect(words).to_have_text(re.compile(r"^−21\.\d+ to −17\.\d+ deg$"))
    expect(counts.locator("summary")).to_have_text("0.5 × raw − 20")
    page.get_by_label("scale of sideslip β").fill("0")
    expect(page.locator(".mapping > .error")).to_contain_text("has a scale of 0")
    page.get_by_label("scale of sideslip β").fill("0.5")
    expect(page.locator(".mapping > .error")).to_be_hidden()
    page.get_by_role("button", name="Confirm the mapping").click()
    expect(page.locator(".mapping summary .chip").first).to_contain_text("confirmed")
    page.reload()
    page.locator(".mapping > summary").click()
    expect(counts.locator("summary")).to_have_text("0.5 × raw − 20")


def test_the_scale_that_a_file_declares_comes_with_its_signal(
    page: Page, site: RecordedSite
) -> None:
    t = 0.05 * np.arange(200)
    values = {key: 4.0 * np.sin((1 + k) * t) for k, key in enumerate(KEYS)}
    values["Ny"] = 0.1 * values["Ny"]
    content, _, _ = ch10_flight.recorded(values, 0.05)
    page.goto(f"{site.http}/#/recordings/{site.upload('flight.ch10', content)}")
    summary = row(page, "beta").locator(".map-counts > summary")
    words = row(page, "beta").locator(".mini-words")
    expect(summary).to_have_text("0.00549316 × raw")
    expect(words).to_have_text(re.compile(r"^−4(\.0*)? to 4(\.0*)? deg$"))
    expect(row(page, "Ny").locator(".map-counts > summary")).to_have_text("0.0001 × raw − 2")
    choice = page.get_by_label("signal of sideslip β")
    choice.focus()
    choice.select_option("signal:1553 channel 5 (NAV) from RT03 SA02/word 01")
    expect(summary).to_have_text("numbers as recorded")
    choice.select_option("signal:BETA")
    expect(summary).to_have_text("0.00549316 × raw")
    expect(words).to_have_text(re.compile(r"^−4(\.0*)? to 4(\.0*)? deg$"))


def test_a_mapping_confirmed_over_a_warning_stays_marked(page: Page, site: RecordedSite) -> None:
    made = site.upload()
    page.goto(f"{site.http}/#/recordings/{made}")
    page.get_by_label("sign of roll rate p: as recorded").click()
    expect(row(page, "p").locator(".map-warnings")).to_contain_text("reversed")
    page.get_by_role("button", name="Confirm the mapping").click()
    chip = page.locator(".mapping summary .chip").first
    expect(chip).to_have_text("confirmed over a warning")
    expect(chip).to_have_attribute("data-level", "caution")
    page.locator(".mapping > summary").click()
    expect(row(page, "p").locator(".map-verdict")).to_contain_text("reversed")
    page.goto(f"{site.http}/#/recordings")
    listed = page.locator("tr", has=page.locator(f'a[href="#/recordings/{made}"]'))
    expect(listed).to_contain_text("confirmed over a warning")
    site.ask("DELETE", f"/recordings/{made}")


def test_what_cannot_be_applied_is_said_and_cannot_be_confirmed(
    page: Page, site: RecordedSite
) -> None:
    page.goto(f"{site.http}/#/recordings/{site.upload()}")
    error = page.locator(".mapping > .error")
    page.get_by_label("signal of roll rate p").select_option("derive:p_from_attitude")
    expect(row(page, "p").locator(".map-verdict")).to_contain_text("DERIVED")
    expect(row(page, "p").locator(".mini-words")).to_contain_text("deg/s")
    page.get_by_label("signal of bank angle φ").select_option("")
    expect(error).to_contain_text("phi is not mapped")
    expect(page.get_by_role("button", name="Confirm the mapping")).to_be_disabled()
    page.get_by_label("signal of bank angle φ").select_option("signal:Bank_deg")
    expect(error).to_be_hidden()
    expect(page.get_by_role("button", name="Confirm the mapping")).to_be_enabled()


def test_a_channel_that_the_file_lacks_is_named(page: Page, site: RecordedSite) -> None:
    lacking = b"\n".join(
        b",".join(line.split(b",")[:1] + line.split(b",")[2:])
        for line in site.file.split(b"\n")
        if b"garbage" not in line
    )
    octets = {"content-type": "application/octet-stream"}
    query = {"name": "no sideslip.csv"}
    made = site.ask("POST", "/recordings", params=query, content=lacking, headers=octets)
    page.goto(f"{site.http}/#/recordings/{made['id']}")
    expect(page.locator(".mapping summary").first).to_contain_text("without sideslip")
    expect(row(page, "beta").locator(".map-verdict")).to_contain_text("MISSING")
    page.get_by_label("map another quantity").select_option("v")
    expect(row(page, "v")).to_be_visible()


# What is wrong with a file


def test_bad_rows_gaps_and_signals_are_shown(page: Page, site: RecordedSite) -> None:
    page.goto(f"{site.http}/#/recordings/{site.upload()}")
    page.locator(".bad-rows > summary").click()
    bad = page.locator(".bad-rows tbody tr")
    expect(bad).to_have_count(1)
    expect(bad).to_contain_text([re.compile(rf"{BAD_LINE}.*garbage")])
    expect(page.locator(".quality svg text", has_text="gaps")).to_be_visible()
    expect(page.locator(".quality .sentences")).to_contain_text(re.compile("2 gaps?"))
    page.locator(".signal-list summary").click()
    expect(page.locator(".signal-list tr", has_text="TAS_kt")).to_contain_text("254.6")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (bytes(range(256)) * 20, "neither text table"),
        (b"", "empty"),
        (None, "rows cannot be read"),
    ],
    ids=["noise", "empty", "bad rows"],
)
def test_a_refused_file_says_why_and_leaves_nothing(
    page: Page,
    site: RecordedSite,
    allowed_errors: list[str],
    tmp_path: Path,
    content: bytes | None,
    says: str,
) -> None:
    allowed_errors.append("422")
    if content is None:
        content = site.file.replace(b"0.0", b"x")
    (tmp_path / "refused.csv").write_bytes(content)
    before = site.ask("GET", "/recordings")
    page.goto(f"{site.http}/#/recordings")
    choose(page, tmp_path / "refused.csv")
    refused = page.locator('.upload[data-status="refused"]')
    expect(refused.get_by_role("alert")).to_contain_text(says, timeout=SLOW)
    refused.get_by_role("button", name="Dismiss").click()
    expect(page.locator(".upload")).to_have_count(0)
    assert site.ask("GET", "/recordings") == before


def test_too_large_a_file_says_the_servers_sentence(
    page: Page, site: RecordedSite, file: Path, allowed_errors: list[str]
) -> None:
    allowed_errors.append("413")
    detail = "the body is larger than 4294967296 bytes: send less"
    problem = {"status": 413, "title": "Content Too Large", "detail": detail}
    page.route("**/api/v1/recordings?name=*", lambda route: route.fulfill(status=413, json=problem))
    page.goto(f"{site.http}/#/recordings")
    choose(page, file)
    expect(page.locator(".upload .error")).to_have_text(
        "The body is larger than 4294967296 bytes: send less."
    )


def test_without_an_answer_an_upload_is_tried_again(
    page: Page, site: RecordedSite, file: Path, allowed_errors: list[str]
) -> None:
    allowed_errors.append("ERR_CONNECTION_REFUSED")
    page.route(
        "**/api/v1/recordings?name=*", lambda route: route.abort("connectionrefused"), times=1
    )
    page.goto(f"{site.http}/#/recordings")
    choose(page, file)
    expect(page.locator(".upload .error")).to_contain_text("The server does not answer")
    page.get_by_role("button", name="Try again").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("doublets.csv", timeout=SLOW)


def test_an_upload_is_cancelled(page: Page, site: RecordedSite, file: Path) -> None:
    held: list[Route] = []
    page.route("**/api/v1/recordings?name=*", lambda route: held.append(route))
    before = site.ask("GET", "/recordings")
    page.goto(f"{site.http}/#/recordings")
    choose(page, file)
    expect(page.locator(".upload .progress")).to_be_visible()
    page.get_by_role("button", name="Cancel doublets.csv").click()
    expect(page.locator(".upload")).to_have_count(0)
    assert len(held) == 1
    assert site.ask("GET", "/recordings") == before


def test_a_dropped_file_comes_in(page: Page, site: RecordedSite) -> None:
    page.goto(f"{site.http}/#/recordings")
    expect(page.locator(".drop-zone")).to_be_visible()
    page.evaluate(
        """(text) => {
            const carried = new DataTransfer();
            carried.items.add(new File([text], "dropped.csv"));
            const made = { dataTransfer: carried, bubbles: true, cancelable: true };
            document.querySelector(".page").dispatchEvent(new DragEvent("dragover", made));
            if (!document.querySelector(".drop-zone[data-over]")) throw new Error("unmoved");
            document.querySelector(".page").dispatchEvent(new DragEvent("drop", made));
        }""",
        site.file.decode(),
    )
    expect(page.get_by_role("heading", level=1)).to_have_text("dropped.csv", timeout=SLOW)


# Every clock


BEGINS = {
    "iso": "2026-03-01 12:34:56.789",
    "iso in a zone": "2026-03-01 17:34:56.789 UTC",
    "day": "060:12:34:56.789, without a year",
    "clock": "12:34:56.789, without a date",
    "clock in UTC": "12:34:56.789 UTC, without a date",
    "minutes": "34:56.789, without a date",
    "seconds": "not recorded",
    "1970 in nanoseconds": "not recorded",
}
"""What is said of each clock that the page may tell from the others."""


def clocked(name: str) -> bytes:
    """A recording of 1.3 s by a clock."""
    if name in COUNTS:
        head, counts, _ = COUNTS[name]
        times = [repr(float(t)) for t in counts[:64]]
    else:
        head, times = "UTC", [CLOCKS[name](T0 + timedelta(seconds=t)) for t in EVEN[:64].tolist()]
    rows = [f"{t};{k % 7}" for k, t in enumerate(times)]
    return "\n".join([f"{head};beta [deg]", *rows]).encode()


def test_a_recording_by_any_clock_opens(page: Page, site: RecordedSite) -> None:
    begins = page.locator(".facts div", has=page.get_by_text("Begins", exact=True)).locator("dd")
    for name, told in BEGINS.items():
        made = site.upload(f"{name}.csv", clocked(name))
        page.goto(f"{site.http}/#/recordings/{made}")
        expect(page.get_by_role("heading", level=1)).to_have_text(f"{name}.csv")
        expect(begins, name).to_have_text(told)
        site.ask("DELETE", f"/recordings/{made}")


def test_a_recording_without_times_is_mapped_by_a_typed_rate(
    page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")  # the monitor needs more than two channels
    rows = [f"{k % 7};{k % 5}" for k in range(100)]
    made = site.upload("untimed.csv", "\n".join(["beta_deg;p_dps", *rows]).encode())
    page.goto(f"{site.http}/#/recordings/{made}")
    error, confirm = page.locator(".mapping > .error"), page.locator(".map-end button")
    expect(error).to_contain_text("has no time")
    page.get_by_label("signal of time").select_option("derive:rate")
    rate = page.get_by_label("rate of time")
    rate.fill("fast")
    expect(error).to_contain_text("not a sample rate")
    rate.fill("50 Hz from 12:31:05")
    expect(error).to_be_hidden()
    confirm.click()
    expect(page.locator(".mapping summary .chip").first).to_have_text("confirmed")
    told = site.ask("GET", f"/recordings/{made}")
    assert told["mapping"]["times"] == {
        "": {"signal": "", "unit": "s", "rate": 50.0, "start": 45065.0}
    }
    page.locator(".mapping > summary").click()
    expect(rate).to_have_value("50 Hz from 12:31:05")
    site.ask("DELETE", f"/recordings/{made}")


def test_a_mapping_file_is_chosen_or_pasted(
    page: Page, site: RecordedSite, allowed_errors: list[str], tmp_path: Path
) -> None:
    allowed_errors.append("422")
    made = site.upload("filed.csv")
    mapping = site.ask("GET", f"/recordings/{made}")["mapping"]
    mapping["channels"]["p"]["sign"] = -1
    mapping["channels"]["V"] = mapping["channels"]["V"] | {"signal": ""}
    (tmp_path / "mapping.json").write_text(json.dumps(mapping))
    page.goto(f"{site.http}/#/recordings/{made}")
    page.get_by_text("use a mapping file").click()
    text, use = page.get_by_label("mapping as text"), page.get_by_text("Use this mapping")
    error = page.locator(".map-file .error")
    unknown = {"channels": {"qq": {"signal": "t"}}}
    for given, told in (("p: RollRate", "This is not a mapping"), (json.dumps(unknown), "'qq'")):
        text.fill(given)
        use.click()
        expect(error).to_contain_text(told)
    page.get_by_label("mapping file", exact=True).set_input_files(tmp_path / "mapping.json")
    reversed_ = page.get_by_label("sign of roll rate p: reversed")
    expect(reversed_).to_have_attribute("aria-pressed", "true")
    expect(row(page, "V")).to_have_count(0)
    mapping["channels"]["p"]["sign"] = 1
    text.fill(json.dumps(mapping))
    use.click()
    expect(reversed_).to_have_count(0)
    expect(error).to_be_hidden()
    page.get_by_role("button", name="Confirm the mapping").click()
    expect(page.locator(".mapping summary .chip").first).to_have_text("confirmed")
    assert "V" not in site.ask("GET", f"/recordings/{made}")["mapping"]["channels"]
    page.goto("about:blank")  # the page may still ask about what is deleted next
    site.ask("DELETE", f"/recordings/{made}")


# Choosing what to score


def test_a_manoeuvre_is_marked_by_dragging_and_scored(page: Page, site: RecordedSite) -> None:
    recording = site.upload("marked.csv")
    site.confirm(recording)
    page.goto(f"{site.http}/#/recordings/{recording}")
    page.get_by_label("Marked by hand").check()
    page.get_by_role("button", name="Score", exact=True).click()
    expect(page.locator(".score-form .error:visible")).to_contain_text(
        "Mark at least one manoeuvre"
    )
    strip = page.locator(".picker-chart .strip canvas").first
    strip.scroll_into_view_if_needed()
    box = strip.bounding_box()
    assert box is not None
    at = [box["x"] + 46 + share * (box["width"] - 46) for share in (0.4, 0.62)]
    page.mouse.move(at[0], box["y"] + 10)
    page.mouse.down()
    page.mouse.move(at[1], box["y"] + 12, steps=4)
    page.mouse.up()
    page.get_by_role("button", name="Add the manoeuvre from A to B").click()
    start = page.get_by_label("start of manoeuvre 1 in seconds")
    assert float(start.input_value()) == pytest.approx(0.4 * 30.1, abs=0.2)
    page.get_by_label("name of manoeuvre 1").fill("the hard one")
    page.get_by_role("button", name="Score", exact=True).click()
    page.wait_for_url("**?scoring=*")
    expect(page.locator(".verdict")).to_have_count(1)
    expect(page.locator(".verdict th")).to_contain_text("the hard one")


def test_several_epsilons_are_scored_at_once_and_a_wrong_one_is_told(
    page: Page, site: RecordedSite
) -> None:
    recording = site.upload("several.csv")
    site.confirm(recording)
    page.goto(f"{site.http}/#/recordings/{recording}")
    epsilons = page.get_by_label("epsilons of transport doublet")
    told = {**site.ask("GET", "/monitors")[0], "warnings": ["the monitor is of no use: there"]}
    page.route("**/monitors/*?epsilon=0.4", lambda route: route.fulfill(json=told))
    mark = page.locator(".monitor-choice .monitor-mark", has_text="of no use")
    expect(mark).to_have_count(0)
    epsilons.fill("0.1 0.4")
    expect(mark).to_be_visible()
    epsilons.fill("0.1 0.001")
    expect(mark).to_have_count(0)
    page.get_by_role("button", name="Score", exact=True).click()
    expect(page.locator(".score-form .error:visible")).to_contain_text("0.001 was given")
    epsilons.fill("0,1 zero")
    page.get_by_role("button", name="Score", exact=True).click()
    expect(page.locator(".score-form .error:visible")).to_contain_text("“0,1 zero” was given")
    epsilons.fill("0,1 0.3")
    page.get_by_role("button", name="Score", exact=True).click()
    rows = page.locator(".scoring-table tbody tr")
    expect(rows).to_have_count(2)
    for tick in rows.get_by_role("checkbox").all():
        tick.check()
    page.get_by_role("button", name="Compare", exact=True).click()
    page.wait_for_url("**?compare=*")
    expect(page.locator(".compare-table tbody tr")).to_have_count(3)


def test_a_recording_is_deleted_after_asking(page: Page, site: RecordedSite) -> None:
    recording = site.upload("short lived.csv")
    page.goto(f"{site.http}/#/recordings/{recording}")
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete permanently").click()
    page.wait_for_url("**/#/recordings")
    assert recording not in [one["id"] for one in site.ask("GET", "/recordings")]


def test_a_long_name_fits_at_every_width(page: Page, site: RecordedSite) -> None:
    recording = site.upload(LONG_NAME)
    site.confirm(recording)
    scoring = site.score(recording)
    for address in (
        "",
        f"/{recording}",
        f"/{recording}?scoring={scoring['id']}",
        f"/{recording}?compare={scoring['id']}",
    ):
        page.goto(f"{site.http}/#/recordings{address}")
        expect(page.locator(".page-head h1")).to_be_visible()
        expect(page.locator(".state-loading")).to_have_count(0)
        page.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))")
        for width in (1440, 1024, 420):
            page.set_viewport_size({"width": width, "height": 800})
            assert overflow(page) <= 0, (address, width)
    page.goto(f"{site.http}/#/recordings")
    page.set_viewport_size({"width": 1024, "height": 800})
    word = "(chip) => (chip.textContent = 'confirmed over a warning')"
    page.locator(".recording-table .chip").first.evaluate(word)
    beyond = "({ scrollWidth, clientWidth }) => scrollWidth - clientWidth"
    assert page.locator(".table-scroll").first.evaluate(beyond) <= 0


def test_a_recording_without_the_condition_is_scored_by_a_set_that_is_given_it(
    page: Page, site: RecordedSite, tmp_path: Path
) -> None:
    info = site.store.monitors.all()[0]
    cases = (
        MonitorCase("slow", {"mach": (None, 0.8)}, info),
        MonitorCase("fast", {"mach": (0.8, None)}, info),
    )
    site.store.monitor_sets.add("declared", MonitorSet(cases), "Ann")
    recording = site.upload("undeclared.csv")
    site.confirm(recording)
    page.goto(f"{site.http}/#/recordings/{recording}")
    form = page.locator("form.score-form")
    mach = form.get_by_label("Mach number for declared")
    expect(form.locator("input[type=checkbox]:checked")).not_to_have_count(0, timeout=SLOW)
    expect(mach).to_be_hidden()
    for box in form.locator(".monitor-choice input[type=checkbox]:checked").all():
        box.uncheck()
    form.get_by_label("declared", exact=True).check()
    form.get_by_role("button", name="Score", exact=True).click()
    verdicts = page.get_by_role("region", name="Verdicts")
    expect(verdicts).to_contain_text("Mach number is missing", timeout=SLOW)
    expect(page.get_by_role("link", name="Train a monitor for this manoeuvre")).to_have_count(0)
    page.go_back()
    expect(form.locator("input[type=checkbox]:checked")).not_to_have_count(0, timeout=SLOW)
    for box in form.locator(".monitor-choice input[type=checkbox]:checked").all():
        box.uncheck()
    form.get_by_label("declared", exact=True).check()
    mach.fill("0.9")
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        mach.scroll_into_view_if_needed()
        page.screenshot(path=tmp_path / f"condition-{scheme}.png")
    form.get_by_role("button", name="Score", exact=True).click()
    expect(verdicts).to_contain_text("fast", timeout=SLOW)
