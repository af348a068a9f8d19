"""Rollouts of a user's simulator, added and trained on in a real Chromium."""

import io
import re
from collections.abc import Iterator

import httpx2
import numpy as np
import pytest
from playwright.sync_api import FilePayload, Page, expect

from app.jobs.training import calibrating
from tests.browser.site import open_site
from tests.support.rollout_files import flights, npz

SLOW = 60_000
"""[ms] A first training compiles kernels."""
LONG = "Pitch doublets at Mach 0.6, 20 000 ft, nonlinear simulator, release candidate 7"


def payload(name: str, content: bytes) -> FilePayload:
    return {"name": name, "mimeType": "application/octet-stream", "buffer": content}


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with open_site(tmp_path_factory.mktemp("own")) as site:
        yield site.http


def choose(page: Page, origin: str, *files: FilePayload) -> None:
    page.goto(f"{origin}/#/datasets/rollouts")
    page.get_by_label("files of rollouts").set_input_files(files)


def test_own_rollouts_are_added_looked_at_and_trained_on(page: Page, origin: str) -> None:
    page.goto(f"{origin}/#/datasets")
    page.get_by_role("link", name="Add rollouts").first.click()
    page.get_by_label("files of rollouts").set_input_files(payload("pitch.npz", npz(flights(1500))))
    expect(page.get_by_text("pitch.npz: 1,500 flights of up to 4 s")).to_be_visible(timeout=SLOW)
    expect(page.get_by_label("role of elevator")).to_have_value("control")
    page.get_by_label("role of pitch rate").select_option("condition")
    page.get_by_label("low limit of normal acceleration").fill("1,5")
    page.get_by_role("button", name="Add", exact=True).click()
    expect(page.get_by_text("must be between the limits")).to_be_visible()
    page.get_by_label("low limit of normal acceleration").fill("−1.1")
    page.get_by_label("high limit of angle of attack").fill("25")
    page.get_by_label("high limit of normal acceleration").fill("2.9")
    page.get_by_label("name of the dataset").fill(LONG)
    page.get_by_text("Dictionary, sample interval, computed channels").click()
    page.get_by_label("computed channels").fill("load [kN] = 3*Nz")
    page.get_by_role("button", name="Add", exact=True).click()

    expect(page.get_by_role("heading", name=LONG, exact=True)).to_be_visible(timeout=SLOW)
    (stored,) = httpx2.get(f"{origin}/api/v1/datasets").json()
    assert stored["name"] == LONG
    assert (stored["limits"]["Nz"]["low"], stored["limits"]["Nz"]["high"]) == (-1.1, 2.9)
    assert stored["limits"]["alpha"]["high"] == pytest.approx(np.radians(25))
    assert stored["dictionary"]["channels"][1]["role"] == "condition"
    expect(page.locator(".findings")).to_contain_text("No duplicates")
    row = page.get_by_role("row").filter(has=page.get_by_role("rowheader", name="angle of attack"))
    expect(row).to_contain_text("at most 25 deg")
    computed = page.get_by_role("rowheader", name="= 3*Nz")
    expect(computed).to_have_text(re.compile("^load"))
    expect(page.locator(".rollout-strips [data-key=Nz]")).to_be_visible()

    page.get_by_role("link", name="Train a monitor").first.click()
    expect(page.locator("#method")).to_have_value("best")
    expect(page.locator("#method option", has_text="(recommended)")).to_have_count(1)
    served = page.locator(".served")
    expect(served).to_contain_text(f"{calibrating(stored['n_unsafe'])} failures")
    quarter = {"calibrating_share": 0.25}
    page.route("**/catalog", lambda route: route.fulfill(json=route.fetch().json() | quarter))
    page.reload()
    expect(served).to_contain_text(f"{stored['n_unsafe'] // 4} failures calibrate, 25 %")
    page.unroute_all()
    page.reload()
    page.get_by_role("button", name="Train", exact=True).click()
    methods = page.locator("section", has=page.get_by_role("heading", name="Methods tried"))
    expect(methods).to_be_visible(timeout=SLOW)
    (monitor,) = httpx2.get(f"{origin}/api/v1/monitors").json()
    assert monitor["dataset_id"] == stored["id"]
    tried = httpx2.get(f"{origin}/api/v1/monitors/{monitor['id']}/evaluation").json()["methods"]
    expect(methods.locator("tbody tr")).to_have_count(len(tried))
    expect(methods.locator("tr", has_text="chosen")).to_have_count(1)
    kept = f"misses at most {tried[0]['most_missed']} of {tried[0]['n_unsafe']}"
    expect(methods).to_contain_text(kept)
    expect(methods.locator("tbody tr").last).to_contain_text("threshold on the current value")
    expect(methods.locator("tbody tr").last).to_contain_text(
        f"{tried[-1]['quiet']} of {tried[-1]['n_safe']}"
    )

    page.locator("summary", has_text="Channels").click()
    expect(computed).to_have_text(re.compile("^load"))
    expect(page.locator("main")).to_contain_text("flights like those it was trained on, safe or")
    page.goto(f"{origin}/#/monitors")
    expect(page.get_by_role("cell", name="own rollouts")).to_be_visible()


def test_what_was_found_is_shown_with_the_dataset(page: Page, origin: str) -> None:
    y = flights(80, seed=2)
    y[1] = y[0]
    choose(page, origin, payload("twice.npz", npz(y)))
    page.get_by_label("high limit of normal acceleration").fill("2.5")
    page.get_by_role("button", name="Add", exact=True).click()
    findings = page.locator(".findings")
    expect(findings).to_contain_text("Duplicate flights left out: 1", timeout=SLOW)
    expect(findings).to_contain_text("which needs 58")
    expect(findings.get_by_role("note")).to_have_count(2)


def test_files_that_cannot_be_read_say_what_to_do(
    page: Page, origin: str, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    choose(page, origin, payload("one.csv", b"t,a\n0,1\n1,2\n"))
    expect(page.get_by_role("alert").filter(has_text="one.csv has no column")).to_be_visible()
    y = np.zeros((3, 5, 2))
    file = io.BytesIO()
    np.savez(file, y=y)
    page.get_by_label("files of rollouts").set_input_files(payload("plain.npz", file.getvalue()))
    expect(
        page.get_by_role("alert").filter(has_text="does not name its 2 channels")
    ).to_be_visible()
    table = b"key,unit,role\nstick,deg,control\nvane,deg,output\n"
    page.get_by_label("dictionary").set_input_files(payload("mine.csv", table))
    expect(page.get_by_role("alert").filter(has_text="has no dt")).to_be_visible()
    page.get_by_label("sample interval").fill("0.1")
    page.get_by_label("sample interval").blur()
    expect(page.get_by_text("plain.npz: 3 flights of up to 0.4 s")).to_be_visible()
    expect(page.get_by_label("role of stick")).to_have_value("control")


def test_a_new_sample_interval_keeps_what_is_typed_and_the_focus(
    page: Page, origin: str, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    choose(page, origin, payload("pitch.npz", npz(flights(80))))
    high = page.get_by_label("high limit of normal acceleration")
    page.get_by_label("role of pitch rate").select_option("condition")
    page.get_by_text("Dictionary, sample interval, computed channels").click()
    again = []
    page.route("**/datasets/preview", lambda route: again.append(route))
    page.get_by_label("sample interval").fill("0.01")
    high.click()
    page.keyboard.type("2.")
    expect(page.get_by_text("Reading pitch.npz")).to_be_visible()
    again[0].continue_()
    expect(page.get_by_text("pitch.npz: 80 flights")).to_be_visible()
    page.keyboard.type("9")
    expect(high).to_have_value("2.9")
    expect(page.get_by_label("sample interval")).to_have_value("0.01")
    expect(page.get_by_label("role of pitch rate")).to_have_value("condition")
    page.unroute_all()
    interval = page.get_by_label("sample interval")
    interval.fill("-1")
    page.get_by_role("button", name="Add", exact=True).click()
    wrong = page.locator(".field", has=interval).locator(".error")
    expect(wrong).to_contain_text("Sample interval is")
    expect(high).to_have_value("2.9")
