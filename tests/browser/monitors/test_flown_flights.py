"""Recordings of flown flights, added to a dataset and trained on in a real Chromium."""

from collections.abc import Iterator

import httpx2
import pytest
from playwright.sync_api import Page, expect

from tests.browser.monitors.test_add_rollouts import SLOW, payload
from tests.browser.site import open_site
from tests.support.flown import doublets, fails, flown
from tests.support.rollout_files import npz

LIMIT = "Nz=-1.1..2.9g"
FLOWN = doublets(60, 50)


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with open_site(tmp_path_factory.mktemp("flown")) as site:
        yield site.http


@pytest.fixture(scope="module")
def recordings(origin: str) -> list[str]:
    """Names of flights with three doublets each."""
    names = [f"flight {k:02}.csv" for k in range(20)]
    for k, name in enumerate(names):
        content = flown(*FLOWN[3 * k : 3 * k + 3])
        sent = httpx2.post(f"{origin}/api/v1/recordings", params={"name": name}, content=content)
        assert sent.status_code == 201
    return names


def only(origin: str, resource: str, name: str) -> dict:
    (found,) = [e for e in httpx2.get(f"{origin}/api/v1/{resource}").json() if e["name"] == name]
    return found


def test_flown_flights_join_a_dataset_and_calibrate(
    page: Page, origin: str, recordings: list[str]
) -> None:
    page.goto(f"{origin}/#/datasets/rollouts")
    page.get_by_label("files of rollouts").set_input_files(
        payload("pitch.npz", npz(doublets(1200, 1)))
    )
    expect(page.get_by_text("pitch.npz: 1,200 flights")).to_be_visible(timeout=SLOW)
    page.get_by_label("low limit of normal acceleration").fill("-1.1")
    page.get_by_label("high limit of normal acceleration").fill("2.9")
    page.get_by_label("name of the dataset").fill("simulated")
    page.get_by_role("button", name="Add", exact=True).click()
    expect(page.get_by_role("heading", name="simulated", exact=True)).to_be_visible(timeout=SLOW)
    base = only(origin, "datasets", "simulated")

    page.goto(f"{origin}/#/recordings")
    page.get_by_role("link", name=recordings[0], exact=True).click()
    page.get_by_role("link", name="Add to a dataset").click()
    expect(page.get_by_label(f"use {recordings[0]}")).to_be_checked()
    for name in recordings[1:]:
        page.get_by_label(f"use {name}").check()
    page.get_by_label("dataset that they join").select_option(base["id"])
    page.get_by_role("button", name="Read the recordings").click()
    expect(page.get_by_text("20 recordings: 1,260 flights, 60 of them flown")).to_be_visible(
        timeout=SLOW
    )
    expect(page.get_by_label("low limit of normal acceleration")).to_have_count(0)
    page.get_by_label(f"outcome of {recordings[0]}").fill("1.0")
    page.get_by_label("name of the dataset").fill("mixture")
    page.get_by_role("button", name="Add", exact=True).click()
    expect(page.get_by_text("in none of its manoeuvres")).to_be_visible(timeout=SLOW)
    page.get_by_role("button", name="Back").click()
    page.get_by_label(f"outcome of {recordings[0]}").fill("safe")
    page.get_by_role("button", name="Add", exact=True).click()

    expect(page.get_by_role("heading", name="mixture", exact=True)).to_be_visible(timeout=SLOW)
    mixture = only(origin, "datasets", "mixture")
    safe = {each["recording"] for each in mixture["recipe"]["flown"]
            if each["rollout"] >= mixture["n_unsafe"]}  # fmt: skip
    assert mixture["n_unsafe"] - base["n_unsafe"] == pytest.approx(
        sum(map(fails, FLOWN[3:])), abs=2
    )
    assert only(origin, "recordings", recordings[0])["id"] in safe
    expect(page.get_by_text("60 manoeuvres of 20 flights")).to_be_visible()
    table = page.locator("section", has=page.get_by_role("heading", name="Flown flights"))
    expect(table.get_by_role("row")).to_have_count(61)
    expect(table.get_by_role("link", name=recordings[0])).to_have_count(3)

    page.get_by_role("link", name="Train a monitor").first.click()
    page.get_by_role("button", name="Train", exact=True).click()
    expect(page.get_by_role("heading", name="Methods tried")).to_be_visible(timeout=2 * SLOW)
    (monitor,) = httpx2.get(f"{origin}/api/v1/monitors").json()
    counts = httpx2.get(f"{origin}/api/v1/monitors/{monitor['id']}/evaluation").json()
    counts = counts["calibrated_on"]
    words = f"Calibrated on {counts['simulated']} simulated and {counts['flown']} flown failures"
    expect(page.get_by_text(words)).to_contain_text("this mixture, not for either kind alone")
    page.locator("summary", has_text="All results on fresh flights").click()
    certificate = page.frame_locator("iframe.certificate")
    expect(certificate.locator("h2", has_text="Flown flights")).to_be_visible()


def test_recordings_without_the_channels_are_named(
    page: Page, origin: str, recordings: list[str], allowed_errors: list[str]
) -> None:
    allowed_errors.append("422 (Unprocessable")
    page.goto(f"{origin}/#/datasets/rollouts")
    page.get_by_text("Flown flights: recordings").click()
    read = page.get_by_role("button", name="Read the recordings")
    expect(read).to_be_disabled()
    page.get_by_label(f"use {recordings[0]}").check()
    expect(page.get_by_text("1 recording chosen")).to_be_visible()
    page.get_by_label(f"outcome of {recordings[0]}").fill("perhaps")
    read.click()
    wrong = page.locator(".error").filter(has_text="perhaps")
    expect(wrong).to_contain_text(f"of {recordings[0]} gives no time")
    page.get_by_label(f"outcome of {recordings[0]}").fill("")
    page.get_by_label("Search recordings").fill("flight 1")
    expect(page.get_by_label(f"use {recordings[1]}")).to_have_count(0)
    expect(page.get_by_label(f"use {recordings[0]}")).to_be_checked()
    read.click()
    failure = page.locator(".error").filter(has_text=f"{recordings[0]}: it has no beta")
    expect(failure).to_be_visible(timeout=SLOW)
    page.get_by_label(f"use {recordings[0]}").uncheck()
    expect(failure).to_be_hidden()
