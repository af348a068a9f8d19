"""The start page and the recorded demonstration, on a server without a monitor and with one."""

import json
import re
from collections.abc import Mapping

import pytest
from playwright.sync_api import Page, expect

from app.messages import Frame, Hello, StatusChange
from tests.browser.chromium import wait_until
from tests.browser.recorded_site import RecordedSite
from tests.browser.site import Site
from tests.support.demonstration_recording import (
    EXAMPLE,
    FILE,
    MODE,
    PICTURE,
    START,
    example,
    picture,
)

STEPS_DONE = "document.querySelectorAll('.story li[data-done]').length"
READY = {"phase": "ready", "step": "flying", "share": 1.0, "elapsed": 40.0, "remaining": 0.0}
COMPILING = {"phase": "compiling", "step": "compiling", "share": 0.25, "elapsed": 65.0}


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    """The scene is hidden: it is slow to draw here."""
    return {"forewarn.scene": "hidden"}


@pytest.fixture
def played(own_page: Page, allowed_errors: list[str]) -> Page:
    """A page whose alert tone the browser may keep blocked."""
    allowed_errors.append("AudioContext was not allowed")
    return own_page


def answer(page: Page, progress: Mapping[str, object]) -> None:
    """Answer what the page asks of the live demonstration; the newest answer counts."""
    whole = (
        None if progress is None else {"remaining": None, "flight": None, "problem": "", **progress}
    )
    page.route("**/api/v1/demonstration", lambda route: route.fulfill(json=whole))


def test_the_shipped_recording_is_small_and_warns_before_the_limit():
    recording = json.loads(FILE.read_text())
    assert FILE.stat().st_size < 300_000
    assert recording["hello"]["mode"] == MODE
    verdict = recording["headlines"][-1]["pair"][0]["verdict"]
    assert verdict["lead"] == pytest.approx(0.8)
    frames = recording["frames"]["whole"]
    assert {len(column) for column in frames.values()} == {121}
    assert picture(recording) == PICTURE.read_text()
    assert f"Warned {verdict['lead']:.2f} s" in (START / "index.js").read_text()
    assert example(recording) == EXAMPLE.read_text()


def test_the_recording_plays_to_its_end_without_a_monitor(played: Page, fresh: Site):
    played.goto(f"{fresh.http}/#/demonstration")
    wait_until(played, f"{STEPS_DONE} > 0")
    expect(played.locator(".mode")).to_have_text("DEMONSTRATION RECORDING")
    wait_until(played, f"{STEPS_DONE} === 3")
    expect(played.locator(".flight")).to_contain_text("Warned 0.80 s before the limit")
    expect(played.get_by_role("button", name="Replay")).to_be_visible(timeout=20_000)
    expect(played.get_by_role("link", name="What next")).to_be_visible()
    expect(played.locator(".transport-time")).to_have_text("6.00 / 6.00 s")
    assert played.evaluate("document.querySelectorAll('h1').length") == 1


def test_a_recorded_alarm_is_acknowledged_and_the_recording_replayed(played: Page, fresh: Site):
    played.goto(f"{fresh.http}/#/demonstration")
    expect(played.get_by_role("button", name="Replay")).to_be_visible(timeout=20_000)
    state = played.locator('.status-item[data-item="state"]')
    expect(state).to_contain_text("ALARM")
    played.keyboard.press("k")
    expect(state).to_contain_text("EXCEEDED")
    expect(state).not_to_contain_text("ALARM")
    played.get_by_role("button", name="Replay").click()
    expect(played.get_by_role("button", name="Replay")).to_be_hidden()
    wait_until(played, f"{STEPS_DONE} === 3")
    expect(state).to_contain_text("ALARM")


def test_the_progress_of_the_live_demonstration_is_shown_until_it_can_be_watched(
    played: Page, fresh: Site, allowed_errors: list[str]
):
    allowed_errors.append("flights/none")
    answer(played, COMPILING | {"remaining": 81.0})
    played.goto(f"{fresh.http}/#/demonstration")
    bar = played.locator("#preparing")
    expect(bar).to_contain_text("1:05 elapsed")
    expect(bar).to_contain_text("about 85 s left")
    wait_until(played, f"{STEPS_DONE} > 0")  # a view that opens later shows the flight at once
    answer(played, READY | {"flight": "none"})
    played.route("**/api/v1/flights/none", lambda route: route.abort())
    played.get_by_role("button", name="Watch it").click()
    wait_until(played, "location.hash === '#/fly/none'")
    expect(bar).to_be_hidden()


def test_a_banner_offers_the_live_demonstration_elsewhere(own_page: Page, fresh: Site):
    page = own_page
    answer(page, READY | {"flight": "none"})
    page.goto(f"{fresh.http}/#/datasets")
    expect(page.get_by_role("button", name="Watch it")).to_be_visible()
    assert page.evaluate("location.hash") == "#/datasets"
    page.get_by_role("button", name="Dismiss").click()
    expect(page.locator("#preparing")).to_be_hidden()
    page.reload()
    expect(page.locator("h1")).to_have_text("Datasets")
    expect(page.locator("#preparing")).to_be_hidden()


def test_the_banner_is_gone_once_the_demonstration_was_opened(
    own_page: Page, fresh: Site, allowed_errors: list[str]
):
    page = own_page
    allowed_errors.append("flights/none")
    answer(page, READY | {"flight": "none"})
    page.route("**/api/v1/flights/none", lambda route: route.abort())
    page.goto(f"{fresh.http}/#/fly/none")
    expect(page.locator("#preparing")).to_be_hidden()
    page.evaluate("location.hash = '#/datasets'")
    expect(page.get_by_role("heading", level=1)).to_have_text("Datasets")
    expect(page.locator("#preparing")).to_be_hidden()


def test_the_start_page_offers_five_jobs(page: Page, fresh: Site):
    page.goto(f"{fresh.http}/#/")
    expect(page.get_by_role("listitem").locator("h2")).to_have_count(5)
    expect(page.locator(".picture")).to_be_visible()
    page.get_by_role("button", name="Watch a flight").click()
    expect(page).to_have_url(re.compile("#/demonstration$"))


def test_the_brand_opens_the_start_page(page: Page, fresh: Site):
    page.goto(f"{fresh.http}/#/datasets")
    page.get_by_role("link", name="Forewarn").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("An alert before the limit")


def test_every_view_links_to_its_guide(page: Page, fresh: Site):
    for view, guide in (("datasets", "first-monitor"), ("recordings", "first-recording")):
        page.goto(f"{fresh.http}/#/{view}")
        link = page.get_by_role("link", name="Guide to this page")
        expect(link).to_have_attribute("href", f"/guide/{guide}")


def test_the_example_plan_is_filled_in(page: Page, fresh: Site):
    page.goto(f"{fresh.http}/#/")
    page.get_by_role("button", name="Open an example plan").click()
    expect(page.get_by_label("name of the campaign")).to_have_value("Example build-up")


def test_the_example_recording_is_scored_once(page: Page, site: RecordedSite):
    for _ in range(2):
        page.goto(f"{site.http}/#/")
        page.get_by_role("button", name="Score an example").click()
        expect(page).to_have_url(re.compile(r"#/recordings/\w+\?scoring=\w+$"))
    (recording,) = site.ask("GET", "/recordings")
    assert len(site.ask("GET", f"/recordings/{recording['id']}/scorings")) == 1


def test_a_monitor_that_can_be_simulated_is_preselected(page: Page, site: RecordedSite):
    choice = """async () => {
        const { fittingMonitor } = await import("/js/lib/monitors.js");
        const monitor = (id, dataset_recipe, warnings = []) => ({ id, dataset_recipe, warnings });
        const f16 = { aircraft: {} };
        return [
            [monitor("files", {}), monitor("flown", f16)],
            [monitor("files", {}), monitor("worse", f16, ["◆"]), monitor("flown", f16)],
            [monitor("files", {})],
        ].map((monitors) => fittingMonitor(monitors).id);
    }"""
    page.goto(f"{site.http}/#/datasets")
    assert page.evaluate(choice) == ["flown", "flown", "files"]


def test_files_are_compressed_and_streams_are_not(page: Page, fresh: Site):
    page.goto(f"{fresh.http}/#/datasets")
    static = page.request.get(f"{fresh.http}/js/main.js")
    assert static.headers["content-encoding"] == "gzip"
    assert "gzip" not in page.request.get(f"{fresh.http}/healthz").headers.get(
        "content-encoding", ""
    )


def test_the_recording_holds_messages_of_this_program():
    recording = json.loads(FILE.read_text())
    hello = Hello.model_validate(recording["hello"] | {"mode": "simulated"})
    assert hello.monitors[0].warnings == []
    whole, sparse = recording["frames"]["whole"], recording["frames"]["sparse"]
    for k in range(len(whole["t"])):
        frame = {key: values[k] for key, values in whole.items()}
        frame |= {key: dict(values).get(k) for key, values in sparse.items()}
        Frame.model_validate(frame | {"seq": k, "sent": None, "reason": frame["reason"] or ""})
    for change in recording["headlines"]:
        for headline in change["pair"]:
            StatusChange.model_validate(headline)
    kinds = [each["message"]["type"] for each in recording["messages"]]
    assert kinds == ["state", "alarm", "alarm"]
