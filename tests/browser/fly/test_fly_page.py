"""The Fly page in a real Chromium on the whole program: flown, alerted, steered, cut off."""

import json
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from app.access.guard import SESSION_OVER
from app.assessment.compiling import make_ready
from app.flights.watcher import RecentFrames
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from tests.browser.chromium import wait_until
from tests.browser.conftest import CUT, Relay, Text
from tests.browser.recordings.scored_chart import pixels
from tests.browser.site import Site, open_site
from tests.support.patience import PATIENCE

RECIPE = DatasetRecipe(n_unsafe=40, n_obs=10, seed=3)
EPSILON = 0.1
CALM = "NOT CALIBRATED"
"""What is said of a calm flight whose monitor's validity is not calibrated."""
UNTESTED = "◆ not tested on fresh flights"
"""What is said beside the name of such a monitor."""
UNSAFE = {"kind": "simulated", "seed": 7, "outcome": "unsafe"}
SAFE = {"kind": "simulated", "seed": 7, "outcome": "safe"}
RIGHTMOST = """() => Math.max(
  ...[...document.querySelectorAll(".status-value, .transport .button, .alarm-banner")]
    .filter((e) => e.checkVisibility()).map((e) => e.getBoundingClientRect().right))"""
SCROLL_SIZE = (
    "(({ scrollWidth, scrollHeight }) => [scrollWidth, scrollHeight])(document.documentElement)"
)
STACKED = (".flight > .status-strip", ".alarm-banner", ".gauge-dial", ".flight > .transport")
"""What is stacked in a small window."""
CUT_OFF = ["WebSocket connection to", "ERR_CONNECTION_REFUSED", "ERR_EMPTY_RESPONSE"]
WATCH_CHANGES = """() => {
  const first = (text) => text.replace(/^[▲◆✓] /, '').split(/ [·–] /)[0];
  const places = ['.status-item[data-item="state"] .status-value', 'title'];
  window.changes = [];
  const look = () => window.changes.push(
    places.map((place) => first(document.querySelector(place).textContent)));
  const everything = { subtree: true, childList: true, characterData: true };
  new MutationObserver(look).observe(document, everything);
}"""
"""What status line and title say after each change of the page."""
SCENE = [
    "THREE.Clock: This module has been deprecated",
    "GPU stall due to ReadPixels",
]


def draw_no_scene(page: Page) -> None:
    """Leave the scene's frame empty from here on: it takes seconds of processor time to draw."""
    page.route(
        "**/scene/*/?camera=*", lambda route: route.fulfill(body="", content_type="text/html")
    )


@contextmanager
def open_monitored_site(data_dir: Path, **settings: Any) -> Iterator[Site]:
    """A server with one dataset and one monitor."""
    with open_site(data_dir, **settings) as site:
        dataset = collect(RECIPE)
        stored = site.store.datasets.add(dataset, "F-16 doublet")
        monitor = train(dataset, MonitorRecipe())
        make_ready(monitor)  # else the first flight waits for its kernels to be compiled
        site.store.monitors.add(monitor, "doublet", stored.id)
        yield site


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with open_monitored_site(tmp_path_factory.mktemp("fly")) as site:
        yield site


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    """The scene is hidden: it is slow to draw here."""
    return {"forewarn.scene": "hidden"}


class Fly:
    """The page, and the server's view of the flight on it."""

    def __init__(self, page: Page, site: Site) -> None:
        self.page, self.site = page, site
        self.flight = ""

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        """Call the REST interface."""
        answer = self.page.request.fetch(f"{self.site.http}/api/v1{path}", method=method, data=body)
        assert answer.ok, answer.text()
        return answer.json() if answer.body() else None

    def watch(self, source: dict[str, Any], *actions: tuple[str, Any]) -> None:
        """Start a flight, steer it, open its page."""
        monitor = self.ask("GET", "/monitors")[0]["id"]
        order = {"source": source, "monitor": monitor, "epsilon": EPSILON}
        self.flight = self.ask("POST", "/flights", order)["id"]
        for action, value in actions:
            self.steer(action, value)
        self.page.goto(f"{self.site.http}/#/fly/{self.flight}")
        self.connected()

    def end(self) -> None:
        """End the flight, if there is one and it goes on."""
        if self.flight:
            self.page.request.post(f"{self.site.http}/api/v1/flights/{self.flight}/end")

    def steer(self, action: str, value: Any = None) -> None:
        body = {"action": action, "value": value}
        self.ask("POST", f"/flights/{self.flight}/transport", body)

    def connected(self) -> None:
        self.page.locator('[data-flight="open"]').wait_for(timeout=1000 * PATIENCE)

    def transport(self) -> dict[str, Any]:
        return self.ask("GET", f"/flights/{self.flight}")["transport"]

    def status(self, item: str) -> Any:
        return self.page.locator(f'.status-item[data-item="{item}"] .status-value')

    def event(self, words: str) -> Any:
        return self.page.locator(".event", has_text=re.compile(words)).first

    def event_time(self, words: str) -> float:
        return float(self.event(words).locator(".event-time").inner_text().split()[0])

    @property
    def banner(self) -> Any:
        return self.page.locator(".alarm-banner")

    def state_says(self, word: str) -> None:
        shown = self.page.locator(".flight .state-word")
        expect(shown).to_have_text(re.compile(f"^([▲◆✓] )?{word}$"))

    def number_is_shown(self) -> None:
        wait_until(self.page, "document.querySelector('.gauge-number').textContent !== ''")

    def assert_no_number(self) -> None:
        assert self.page.locator(".gauge-number").text_content() == ""


# Flying


def test_a_monitor_in_training_is_shown_where_there_is_none(page: Page, site: Site) -> None:
    job = {"id": "1", "kind": "monitor", "request": {"name": "first"}, "status": "running"}
    job |= {"message": "unsafe rollouts", "progress": 3, "total": 10, "error": None}
    monitors, jobs = [], [job]
    page.route("**/api/v1/monitors", lambda route: route.fulfill(json=monitors))
    page.route("**/api/v1/jobs?*", lambda route: route.fulfill(json=jobs))
    events = "".join(f"data: {json.dumps(job | {'status': s})}\n\n" for s in ("running", "failed"))
    page.route(
        "**/jobs/1/events",
        lambda route: route.fulfill(body=events, content_type="text/event-stream"),
    )
    page.goto(f"{site.http}/#/fly")
    training = page.locator(".job")
    expect(training).to_contain_text("Training “first”")
    expect(training).to_contain_text("It failed")
    expect(page.get_by_text("No monitor yet")).to_have_count(0)
    jobs[0] = job | {"status": "failed", "error": "no memory", "created": "2026-01-01T00:00:00Z"}
    page.reload()
    expect(page.get_by_text("No monitor yet")).to_be_visible()
    expect(page.get_by_text("1 that did not finish")).to_be_visible()


def test_a_flight_is_started_and_alerts_before_its_exceedance(fly: Fly) -> None:
    page = fly.page
    page.goto(f"{fly.site.http}/#/fly")
    page.get_by_label("Outcome").select_option("unsafe")
    page.get_by_label("Seed").fill("7")
    expect(page.get_by_text("Risk is not the probability of failure")).to_be_visible()
    expect(page.get_by_text("The monitor was not tested on fresh flights")).to_be_visible()
    page.get_by_role("button", name="Start the flight").click()
    fly.connected()
    expect(fly.status("test")).to_have_text(UNTESTED)
    expect(page.get_by_text("risk (higher is worse)")).to_be_visible()
    fly.event("exceeds its limit").wait_for()
    expect(fly.banner).to_be_visible()
    assert fly.event_time("alert, risk") <= fly.event_time("exceeds its limit") - 0.25
    for item in ("source", "monitor", "utc"):
        expect(fly.status(item)).not_to_have_text("–")
    expect(fly.status("record")).to_have_text("complete")


def test_the_form_warns_of_what_speaks_against_the_epsilon_that_is_typed(fly: Fly) -> None:
    monitor = fly.ask("GET", "/monitors")[0]
    told = {**monitor, "warnings": ["the monitor is of no use: at this epsilon"]}
    fly.page.route("**/monitors/*?epsilon=0.4", lambda route: route.fulfill(json=told))
    fly.page.goto(f"{fly.site.http}/#/fly")
    epsilon = fly.page.get_by_label("ε, accepted miss rate")
    warnings = fly.page.locator(".monitor-warning")
    epsilon.fill("0.4")
    expect(warnings).to_have_text(["The monitor is of no use: at this epsilon."])
    epsilon.fill(str(monitor["epsilon"]))
    expect(warnings.first).to_contain_text("was not tested")


def test_the_form_opens_with_the_epsilon_of_its_address(fly: Fly) -> None:
    monitor = fly.ask("GET", "/monitors")[0]["id"]
    fly.page.goto(f"{fly.site.http}/#/fly?monitor={monitor}&epsilon=0.3")
    expect(fly.page.get_by_label("ε, accepted miss rate")).to_have_value("0.3")


def test_a_monitor_of_an_own_simulator_is_offered_a_live_flight(fly: Fly) -> None:
    own = fly.ask("GET", "/monitors")[0] | {"dataset_recipe": {"simulator": "pitch:pitch"}}
    fly.page.route("**/api/v1/monitors", lambda route: route.fulfill(json=[own]))
    fly.page.goto(f"{fly.site.http}/#/fly?monitor={own['id']}")
    expect(fly.page.get_by_label("Live", exact=True)).to_be_checked()


def test_an_alarm_stays_seen_and_heard_until_it_is_acknowledged(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    expect(fly.banner).to_contain_text("ALERT at")
    fly.state_says("ALARM")
    expect(fly.status("state")).to_have_text("▲ ALARM · PAUSED")
    fly.steer("seek", 0.0)
    fly.number_is_shown()
    fly.state_says("ALARM")
    expect(fly.banner).to_contain_text("Acknowledge")
    fly.page.keyboard.press("k")
    expect(fly.banner).to_be_hidden()
    fly.state_says("PAUSED")
    fly.event("acknowledged by local").wait_for()
    alarms = fly.ask("GET", f"/flights/{fly.flight}/alarms")
    assert [alarm["by"] for alarm in alarms] == ["local"] * len(alarms)
    expect(fly.page.get_by_text("No unacknowledged alarms")).to_be_visible()


def test_the_tone_is_muted_by_a_key_and_says_so(fly: Fly) -> None:
    fly.watch(SAFE, ("pause", None))
    mute = fly.page.locator(".mute")
    fly.page.locator(".strips").click()
    expect(mute).to_have_text("Sound on")
    fly.page.keyboard.press("m")
    expect(mute).to_have_text("Muted")
    assert mute.get_attribute("data-sound") == "muted"


def test_a_paused_flight_says_so_on_desk_wall_and_list_and_names_itself(fly: Fly) -> None:
    fly.watch(SAFE | {"seed": 8}, ("pause", None))
    fly.state_says("PAUSED")
    page = fly.page
    state = page.locator('.status-item[data-item="state"]')
    expect(state).to_have_attribute("data-level", "advisory")
    page.keyboard.press("w")
    expect(page.locator(".wall-state")).to_have_text("PAUSED")
    page.keyboard.press("Escape")
    page.keyboard.press(" ")
    fly.state_says(CALM)
    monitor = fly.ask("GET", "/monitors")[0]
    named = {"source": SAFE, "monitor": monitor["id"], "epsilon": EPSILON, "name": "card 4 b"}
    fly.end()
    fly.flight = fly.ask("POST", "/flights", named)["id"]
    fly.steer("pause")
    page.goto(f"{fly.site.http}/#/fly")
    row = page.locator(".flight-row", has_text="card 4 b")
    expect(row.locator(".chip").last).to_have_text("PAUSED")
    for mode in ("simulated", "record"):
        page.goto(f"{fly.site.http}/#/fly/{fly.flight}")
        expect(page.locator(".mode")).to_have_attribute("data-mode", mode)
        expect(fly.status("source")).to_have_text("card 4 b, seed 7, safe")
        page.keyboard.press("w")
        expect(page.locator(".wall-flight")).to_have_text(f"card 4 b · {monitor['name']}")
        page.keyboard.press("Escape")
        fly.end()
        page.goto(f"{fly.site.http}/#/fly")


@pytest.mark.parametrize("size", [(1024, 768), (1440, 900), (1920, 1080)])
def test_no_state_word_is_cut_off(fly: Fly, size: tuple[int, int]) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None))
    fly.number_is_shown()
    page.set_viewport_size({"width": size[0], "height": size[1]})
    beyond = page.evaluate("""async () => {
      const { STATE_WORDS } = await import("/js/lib/states.js");
      const readout = [...document.querySelectorAll(".strip-chart .readout")].at(-1);
      const copy = readout.cloneNode(true); // which no sample changes
      readout.replaceWith(copy);
      const part = (name) => copy.querySelector(`.readout-${name}`);
      const [word, value, unit] = ["state", "value", "unit"].map(part);
      value.textContent = "";
      unit.hidden = true;
      word.hidden = false;
      const right = (element) => element.getBoundingClientRect().right;
      const headlines = ["not_calibrated", "exceeded", "no_alert"]; // which no strip shows
      const shown = Object.entries(STATE_WORDS).filter(([state]) => !headlines.includes(state));
      return shown.map(([state, text]) => {
        copy.dataset.state = state;
        word.textContent = text;
        return [text, right(word) - right(copy)];
      }).filter(([, over]) => over > 0);
    }""")
    assert beyond == []
    beside = page.locator(".state-beside")
    page.keyboard.press("x")
    expect(beside).to_contain_text("PAUSED")
    cut = "(({ scrollWidth, clientWidth }) => scrollWidth > clientWidth)"
    assert not page.evaluate(f"{cut}(document.querySelector('.state-beside'))")
    for item in ("source", "monitor"):
        room = fly.status(item).evaluate(
            "(one) => one.clientWidth / parseFloat(getComputedStyle(one).fontSize)"
        )
        assert room >= 4.5, item


def test_paused_beyond_the_limit_everything_shows_that_it_exceeds(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None))
    fail_t = fly.ask("GET", f"/flights/{fly.flight}")["fail_t"]
    fly.steer("seek", fail_t)
    fly.state_says("EXCEEDING")
    fly.number_is_shown()
    expect(fly.status("state")).to_have_text("▲ EXCEEDING · PAUSED")
    expect(fly.page).to_have_title(re.compile("^▲ EXCEEDING · PAUSED – "))
    expect(fly.banner).to_contain_text("LIMIT EXCEEDED at")
    expect(fly.page.locator(".mute")).to_have_attribute("data-callout", "limit")
    expect(fly.page.locator(".gauge-panel")).not_to_contain_text(
        re.compile("exceed", re.IGNORECASE)
    )
    assert fly.ask("GET", f"/flights/{fly.flight}")["status"] == "exceeding"
    fly.page.keyboard.press("k")
    expect(fly.banner).to_contain_text("continues, acknowledged")
    fly.state_says("EXCEEDING")
    fly.steer("seek", 0.0)
    fly.state_says(CALM)
    earlier = f"EXCEEDED first at {fail_t:.2f} s"
    expect(fly.status("state")).to_have_text(f"◆ {CALM} · PAUSED · {earlier}")
    fly.page.goto(f"{fly.site.http}/#/fly")
    row = fly.page.locator(f'.under-way li:has([href="#/fly/{fly.flight}"])')
    expect(row.locator(".chip").last).to_contain_text(earlier)
    fly.page.set_viewport_size({"width": 1024, "height": 768})
    assert row.evaluate("row => row.scrollWidth <= row.clientWidth"), "nothing sticks out"


def test_five_lines_of_events_are_in_sight_on_a_laptop(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fly.event("alert, risk").wait_for()
    fly.page.set_viewport_size({"width": 1440, "height": 900})
    room, line = fly.page.evaluate(
        """() => {
          const panel = document.querySelector(".event-panel").getBoundingClientRect();
          const event = document.querySelector(".event").getBoundingClientRect();
          return [panel.bottom - event.top, event.height];
        }"""
    )
    assert room >= 5 * line


def test_no_panel_beside_the_strips_covers_another(fly: Fly) -> None:
    draw_no_scene(fly.page)
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fly.event("alert, risk").wait_for()
    fly.page.get_by_role("button", name="Show scene").click()
    expect(fly.page.locator(".scene-panel iframe")).to_be_attached()
    fly.page.evaluate(
        """() => {
            const rest = document.querySelector(".rest-of-card");
            rest.hidden = false;
            rest.querySelector("p").textContent = "▲ another exceedance predicted, "
                + "peak ahead 104 % of a limit (90 % interval: 94 % to 114 %)";
            document.querySelector(".card-words").textContent =
                "rudder: planned 9.5 deg, 2 s; flown before this display began";
        }"""
    )
    for width, height in ((1440, 900), (1024, 768)):
        fly.page.set_viewport_size({"width": width, "height": height})
        edges = fly.page.locator(".side-column > *").evaluate_all(
            """(panels) => panels.map((panel) => panel.getBoundingClientRect())
                 .filter(({ height }) => height > 0).map(({ top, bottom }) => [top, bottom])"""
        )
        assert len(edges) == 4
        column = fly.page.locator(".side-column").bounding_box()
        assert column is not None
        if width == 1440:
            assert edges[-1][1] <= column["y"] + column["height"], "the test card is in sight"
        assert all(above[1] <= below[0] for above, below in pairwise(edges)), edges
        scene = fly.page.locator(".scene-panel").bounding_box()
        gauge = fly.page.locator(".gauge-dial").bounding_box()
        assert scene is not None
        assert gauge is not None
        assert scene["y"] + scene["height"] <= gauge["y"]
        assert gauge["y"] + gauge["height"] <= height
    shown = fly.page.evaluate(
        """() => {
            const cover = document.querySelector(".link-lost");
            const views = document.querySelector(".scene-views");
            return [true, false].map((hidden) => {
                cover.hidden = hidden;
                return getComputedStyle(views).visibility;
            });
        }"""
    )
    assert shown == ["visible", "hidden"]  # no button under the cover of the scene


def test_a_simulated_flight_says_so_and_has_no_age_or_latency(fly: Fly) -> None:
    fly.watch(SAFE, ("pause", None))
    expect(fly.page.locator(".status-strip .mode")).to_have_text("SIMULATED")
    expect(fly.page.get_by_text("live", exact=True)).to_have_count(0)
    for item in ("age", "latency"):
        expect(fly.status(item)).to_be_hidden()


def test_the_strips_do_not_begin_before_the_flight(fly: Fly) -> None:
    fly.watch(SAFE, ("pause", None), ("seek", 0.5))
    fly.number_is_shown()
    fly.page.locator(".strip-chart").focus()
    fly.page.keyboard.press("Home")
    expect(fly.page.locator(".strip-cursors")).to_contain_text("cursor 0.000 s")


def test_the_record_of_a_flight_that_exceeded_says_how_it_was_warned(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fail_t = fly.ask("GET", f"/flights/{fly.flight}")["fail_t"]
    when = fly.event_time("alert, risk")
    fly.steer("seek", fail_t)
    fly.state_says("EXCEEDING")
    warning = f"Warned {fail_t - when:.2f} s before the limit"
    expect(fly.status("state")).to_have_text(f"▲ EXCEEDING · PAUSED · {warning}")
    fly.ask("POST", f"/flights/{fly.flight}/end")
    said = f"LIMIT EXCEEDED, {warning.replace('W', 'w')}"
    expect(fly.status("state")).to_have_text(f"▲ {said}")
    expect(fly.page.locator("main")).to_contain_text(said)
    assert fly.page.locator("main").inner_text().count(said) == 1, "one fact, one place"
    expect(fly.page.locator(".gauge-panel, .scene-cell")).to_have_count(0)
    fly.page.set_viewport_size({"width": 1440, "height": 900})
    word = fly.page.locator(".state-word").bounding_box()
    assert word is not None
    assert word["height"] < 30, "one line"
    expect(fly.status("test")).to_have_text(UNTESTED)
    expect(fly.page.locator(".notice .monitor-warning").first).to_contain_text("was not tested")
    fly.page.goto(f"{fly.site.http}/#/fly")
    row = fly.page.locator(".flight-row", has_text=said).first
    expect(row.locator(".monitor-mark")).to_have_text(f"{UNTESTED}, validity is not calibrated")
    chip = row.locator(".chip").nth(1)
    assert chip.get_attribute("data-level") in ("alert", "caution")
    fly.page.set_viewport_size({"width": 1024, "height": 768})
    within, around = chip.bounding_box(), row.bounding_box()
    assert within is not None
    assert around is not None
    assert within["x"] + within["width"] <= around["x"] + around["width"]


def test_alarms_of_a_flight_that_is_over_are_acknowledged_on_its_record(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fly.event("alert, risk").wait_for()
    fly.ask("POST", f"/flights/{fly.flight}/end")
    expect(fly.status("state")).to_contain_text("ALARM")
    button = fly.page.get_by_role("button", name="Acknowledge 1 alarm")
    button.click()
    expect(button).to_be_hidden()
    (alarm,) = fly.ask("GET", f"/flights/{fly.flight}/alarms")
    assert alarm["acknowledged"]
    fly.event(f"alarm 1 \\({alarm['t']:.2f} s\\) acknowledged by local").wait_for()
    assert "ALARM" not in fly.page.locator(".notice").inner_text()
    fly.page.reload()
    acknowledged = fly.event("alarm 1 .* acknowledged by local").locator(".event-time")
    expect(acknowledged).to_have_text(f"{alarm['acknowledged'][11:19]} UTC")
    expect(button).to_be_hidden()


def test_the_record_of_a_flight_whose_server_was_killed_does_not_say_that_it_has_all(
    fly: Fly,
) -> None:
    monitor = fly.ask("GET", "/monitors")[0]["id"]
    flight = fly.site.store.flights.add(UNSAFE, monitor, EPSILON)
    fly.site.store.flights.end(flight, "interrupted")
    assert fly.ask("GET", f"/flights/{flight}")["lost"] is None
    fly.page.goto(f"{fly.site.http}/#/fly/{flight}")
    expect(fly.status("record")).to_have_text("◆ end may be missing")
    expect(fly.page.locator(".notice")).to_contain_text("server was killed")


def test_the_theme_is_the_machine_s_until_one_is_chosen(own_page: Page, site: Site) -> None:
    theme = "document.documentElement.dataset.theme"
    own_page.emulate_media(color_scheme="light")
    own_page.goto(f"{site.http}/#/fly")
    wait_until(own_page, f"{theme} === 'light'")
    own_page.emulate_media(color_scheme="dark")
    wait_until(own_page, f"{theme} === 'dark'")
    own_page.locator("#theme").click()
    wait_until(own_page, f"{theme} === 'light'")
    own_page.reload()
    wait_until(own_page, f"{theme} === 'light'")


# Steering


def test_scrubbing_shows_the_source_at_that_time_with_what_came_before(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None))
    frames = fly.ask("GET", f"/flights/{fly.flight}/source")["frames"]
    for k in (60, 20, 45):
        fly.page.locator("input.scrub").fill(str(frames[k]["t"]))
        expect(fly.page.locator(".transport-time")).to_contain_text(f"{frames[k]['t']:.2f} /")
        shown = f"{frames[k]['y'][3]:.3f}".replace("-", "−").replace("−0.000", "0.000")
        expect(fly.page.locator('.strip[data-key="Ny"] .readout-value')).to_have_text(shown)
        assert fly.transport()["sample"] == k
    fly.page.locator(".strip-chart").focus()
    fly.page.keyboard.press("End")
    fly.page.keyboard.press("Shift+ArrowLeft")
    cursor = fly.page.locator('.strip[data-key="Ny"] .readout-detail')
    expect(cursor).to_have_text(re.compile(r"^cursor −?\d\.\d{3}$"))


def test_a_page_that_joins_late_shows_the_flight_from_its_beginning(
    fly: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RecentFrames.__init__, "__defaults__", (20, list))  # kept for the stream
    with fly.page.expect_response(re.compile(r"/assessments\?first=0&last=")):
        fly.watch(UNSAFE, ("step", 60))
    frames = fly.ask("GET", f"/flights/{fly.flight}/assessments")["frames"]
    fly.page.locator(".strip-chart").focus()
    fly.page.keyboard.press("End")
    for _ in range(len(frames) - 6):
        fly.page.keyboard.press("ArrowLeft")
    shown = f"{frames[5]['y'][3]:.3f}".replace("-", "−").replace("−0.000", "0.000")
    cursor = fly.page.locator('.strip[data-key="Ny"] .readout-detail')
    expect(cursor).to_have_text(f"cursor {shown}")
    expect(fly.page.locator('.status-item[data-item="skipped"]')).to_be_hidden()


def test_keys_play_step_and_jump_to_the_next_alert(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None))
    press = fly.page.keyboard.press
    press("0")
    expect(fly.page.locator(".transport-time")).to_contain_text("0.00 /")
    press(".")
    press(".")
    expect(fly.page.locator(".transport-time")).to_contain_text("0.10 /")
    press(",")
    expect(fly.page.locator(".transport-time")).to_contain_text("0.05 /")
    press("n")
    fly.state_says("ALARM")
    press("]")
    expect(fly.page.get_by_label("Speed")).to_have_value("2")
    press("o")
    expect(fly.page.locator('[data-action="loop"]')).to_have_attribute("aria-pressed", "true")
    press(" ")
    expect(fly.page.locator('[data-action="play"]')).to_have_attribute("data-playing", "true")
    press("?")
    expect(fly.page.get_by_role("dialog")).to_contain_text("acknowledge the alarm")
    press("Escape")
    expect(fly.page.get_by_role("dialog")).to_be_hidden()


def test_an_event_takes_the_flight_back_to_it(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    alert = fly.event("alert, risk")
    alert.wait_for()
    when = fly.event_time("alert, risk")
    fly.page.keyboard.press("k")
    fly.state_says("ALERT")
    fly.page.keyboard.press("0")
    fly.state_says("PAUSED")
    alert.get_by_role("button").click()
    expect(fly.page.locator(".transport-time")).to_contain_text(f"{when:.2f} /")
    fly.state_says("ALERT")  # acknowledged before: the same onset is no new alarm


# Losing and finding the server


@pytest.mark.parametrize("paused", [False, True])
def test_a_cut_connection_is_stale_at_once_and_resumes(
    own_fly: Fly, relay: Relay, paused: bool
) -> None:
    fly = own_fly
    page = fly.page
    asked: list[int] = []
    first: dict[int, int] = {}
    resets: list[int] = []
    cut = False

    def note(text: Text, turn: int = -1) -> Text:
        message = json.loads(text)
        if message["type"] == "resume":
            asked.append(message["seq"])
        if message["type"] == "reset":
            resets.append(turn)  # the loop came round: what was before is gone
        if message["type"] == "frames":
            first.setdefault(turn, message["frames"][0]["seq"])
        return text

    routes = relay(to_page=note, to_server=note, is_cut=lambda: cut)
    fly.watch(SAFE, ("loop", True), ("speed", 0.2))
    fly.state_says(CALM)
    fly.number_is_shown()
    if paused:
        fly.page.keyboard.press(" ")
        expect(fly.page.locator(".strip-toolbar .chip")).to_have_text("PAUSED")
    cut = True
    routes[-1].close(code=CUT)
    fly.state_says("STALE")
    fly.assert_no_number()
    expect(fly.status("link")).to_contain_text("LOST")
    expect(fly.status("state")).to_have_text(f"◆ STALE{' · PAUSED' * paused}")
    expect(page).to_have_title(re.compile("^◆ STALE"))
    expect(page.locator('[data-action="play"]')).to_be_disabled()
    expect(page.locator(".link-lost")).to_be_visible()
    expect(page.get_by_text("new alarms cannot arrive")).to_be_visible()
    expect(page.locator('.strip[data-key="risk"] .readout-state')).to_have_text("STALE")
    cut = False
    fly.connected()
    fly.state_says("PAUSED" if paused else CALM)
    fly.event("reconnected").wait_for()
    expect(page.locator('.strip[data-key="risk"] .readout-state')).to_have_text("")
    expect(page.locator(".link-lost")).to_be_hidden()
    assert len(routes) == 2
    assert asked[1] > asked[0] == -1
    assert paused or 1 in resets or first[1] == asked[1] + 1


def test_a_server_that_falls_silent_is_no_open_link_and_the_last_samples_stay(
    own_fly: Fly, relay: Relay
) -> None:
    fly = own_fly
    silent = False
    relay(to_page=lambda text, _: None if silent else text)
    fly.watch(SAFE, ("loop", True), ("speed", 0.5))
    fly.state_says(CALM)
    expect(fly.status("link")).to_contain_text("open")
    fly.page.evaluate(WATCH_CHANGES)
    wait_until(fly.page, "performance.now() > 3000")
    silent = True
    expect(fly.status("link")).not_to_contain_text("open")
    seen = fly.page.evaluate("window.changes")
    assert {tuple(words) for words in seen} == {(CALM,) * 2, ("STALE",) * 2}
    fly.state_says("STALE")
    fly.assert_no_number()
    expect(fly.page.locator(".link-lost")).to_contain_text("out of date")
    assert pixels(fly.page, "p", "trace") > 20


@pytest.mark.parametrize(("source", "said"), [(SAFE, "NO DATA"), (UNSAFE, "▲ ALARM · PAUSED")])
def test_before_a_sample_is_shown_nothing_calm_is_said(
    own_fly: Fly, relay: Relay, source: dict[str, Any], said: str
) -> None:
    relay(to_page=lambda text, _: None if "frames" in json.loads(text) else text)
    place = ("next_alert", None) if source is UNSAFE else ("seek", 1.0)
    own_fly.watch(source, ("pause", None), place)
    expect(own_fly.status("state")).to_have_text(said)
    expect(own_fly.page).to_have_title(re.compile(f"^{said} – "))
    expect(own_fly.page.locator(".gauge-word")).to_have_text("NO DATA")


def test_the_transport_s_clock_is_not_ahead_of_the_samples_that_came(
    own_fly: Fly, relay: Relay
) -> None:
    fly, waiting, is_held = own_fly, list[Text](), False

    def unless_held(text: Text, _: int) -> Text | None:
        if not (is_held and "frames" in json.loads(text)):
            return text
        waiting.append(text)
        return None

    routes = relay(to_page=unless_held)
    fly.watch(SAFE, ("pause", None), ("seek", 1.0))
    clock = fly.page.locator(".transport-time")
    expect(clock).to_have_text(re.compile(r"^1\.00 / "))
    is_held = True
    fly.steer("step", 4)
    fly.steer("loop", True)
    expect(fly.page.locator('[data-action="loop"]')).to_have_attribute("aria-pressed", "true")
    assert fly.transport()["position"] == pytest.approx(1.2)
    assert clock.inner_text().startswith("1.00 / ")
    is_held = False
    for text in waiting:
        routes[-1].send(text)
    expect(clock).to_have_text(re.compile(r"^1\.20 / "))


def test_a_page_that_joins_a_paused_flight_shows_the_rest_by_its_newest_sample(
    own_fly: Fly, relay: Relay
) -> None:
    peak = {"mean": 0.8, "low": 0.6, "high": 0.9}
    told = {"no_rest": "", "ahead": {"t": [], "channels": {}, "peak": peak, "why": ""}}

    def forecast(text: Text, _: int) -> str:
        message = json.loads(text)
        return json.dumps(message | told if message["type"] == "hello" else message)

    relay(to_page=forecast)
    own_fly.watch(SAFE, ("pause", None), ("seek", 1.0))
    rest = own_fly.page.locator(".rest-of-card")
    expect(rest).to_contain_text("80 % of a limit (90 % interval: 60 % to 90 %)")
    own_fly.page.keyboard.press(".")
    expect(own_fly.page.locator(".transport-time")).to_contain_text("1.05 /")
    for _ in range(6):
        own_fly.page.keyboard.press(".")
    expect(rest).to_contain_text("not known")  # it was of another sample


def test_the_rest_is_judged_by_the_limits_that_a_reconnected_page_is_told(
    own_fly: Fly, relay: Relay
) -> None:
    band = {"mean": [0.6], "low": [0.55], "high": [0.65], "predicted": 1.2, "possible": 1.2}
    ahead = {"t": [1.2], "channels": {"Ny": band}, "peak": None, "why": ""}

    def with_limits(text: Text, turn: int) -> str:
        message = json.loads(text)
        if message["type"] != "hello":
            return json.dumps(message)
        limit = {0: 0.5, 1: 0.3}[turn]
        (ny,) = (channel for channel in message["channels"] if channel["key"] == "Ny")
        ny |= {"low": -limit, "high": limit, "limit": limit}
        return json.dumps(message | {"no_rest": "", "ahead": ahead})

    routes = relay(to_page=with_limits)
    own_fly.watch(SAFE, ("pause", None), ("seek", 1.0))
    rest = own_fly.page.locator(".rest-of-card")
    expect(rest).to_contain_text("exceed 0.5 g")
    routes[-1].close(code=CUT)
    expect(rest).to_contain_text("exceed 0.3 g")


def test_a_login_that_ended_is_said_and_not_tried_again(own_fly: Fly, relay: Relay) -> None:
    fly = own_fly
    routes = relay()
    fly.watch(SAFE, ("pause", None))
    routes[0].close(code=SESSION_OVER)
    expect(fly.page.locator(".link-lost")).to_contain_text("reload the page to log in again")
    fly.state_says("STALE")
    fly.event("the login has expired").wait_for()
    assert len(routes) == 1


def test_a_page_that_was_held_up_itself_does_not_cry_stale(
    fly: Fly, allowed_errors: list[str]
) -> None:
    allowed_errors.append("Synchronous XMLHttpRequest")

    def answer_late(route: Route) -> None:
        time.sleep(4.5)  # longer than a silent server is believed
        route.fulfill(body="")

    fly.page.route("**/late", answer_late)
    fly.watch(SAFE, ("loop", True), ("speed", 0.1))
    expect(fly.status("monitor").locator("..")).to_contain_text("validity not calibrated")
    fly.state_says(CALM)
    seen, held_up = fly.page.evaluate(
        """async () => {
          const seen = new Set();
          const look = (place) => seen.add(document.querySelector(place).textContent);
          const watching = new MutationObserver(() => [".state-word", ".readout-state"].map(look));
          watching.observe(document.body, { subtree: true, childList: true, characterData: true });
          const request = new XMLHttpRequest();
          const began = performance.now();
          request.open("GET", "/late", false); // nothing else runs until it is answered
          request.send();
          const heldUp = performance.now() - began;
          await new Promise((resolve) => setTimeout(resolve, 700));
          watching.disconnect();
          return [[...seen], heldUp];
        }"""
    )
    assert held_up >= 4500
    assert not [words for words in seen if "STALE" in words]
    assert CALM in seen
    assert fly.page.locator(".event", has_text="connection to the server lost").count() == 0


def test_after_a_restart_of_the_server_the_record_is_shown_and_flown_again(
    fly: Fly, allowed_errors: list[str]
) -> None:
    allowed_errors += CUT_OFF
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    wait_until(fly.page, "document.querySelector('.gauge-number').textContent !== ''")
    fly.steer("play")
    fly.site.stop()
    fly.state_says("ALARM")
    expect(fly.status("state")).to_contain_text("▲ ALARM · STALE")
    fly.assert_no_number()
    fly.site.start_again()
    notice = fly.page.locator(".notice")
    expect(notice).to_contain_text("This flight was ended", timeout=20_000)
    expect(fly.page.locator(".strip canvas").first).to_be_visible()
    expect(fly.page.locator(".gauge-number")).to_have_count(0)
    fly.event("alert, risk").wait_for()
    notice.get_by_role("button", name="Fly it again").click()
    fly.connected()
    assert fly.flight not in fly.page.url


# States that say what to do next


def test_a_flight_that_never_was_says_so(fly: Fly, allowed_errors: list[str]) -> None:
    allowed_errors.append("404")
    fly.page.goto(f"{fly.site.http}/#/fly/nothing")
    expect(fly.page.get_by_role("alert")).to_contain_text("nothing")
    fly.page.get_by_role("link", name="Flights").click()
    expect(fly.page.get_by_role("button", name="Start the flight")).to_be_visible()


def test_without_a_monitor_the_page_leads_to_training(fly: Fly) -> None:
    fly.page.route("**/api/v1/monitors", lambda route: route.fulfill(json=[]))
    fly.page.goto(f"{fly.site.http}/#/fly")
    expect(fly.page.get_by_role("link", name="Train a monitor")).to_be_visible()


@pytest.mark.parametrize(("view", "heading"), [("fly", "Fly"), ("fly/0123456789ab", "Flight")])
def test_a_view_has_a_heading_while_it_loads(fly: Fly, view: str, heading: str) -> None:
    fly.page.route("**/api/v1/monitors", lambda route: None)  # never answered
    fly.page.route("**/api/v1/flights/*", lambda route: None)
    fly.page.goto(f"{fly.site.http}/#/{view}")
    expect(fly.page.get_by_role("heading", level=1)).to_have_text(heading)
    expect(fly.page.locator("main .state-loading").first).to_be_visible()
    fly.page.goto("about:blank")  # so that no request is let through once its route is gone


def test_a_refused_flight_says_what_is_needed(fly: Fly, allowed_errors: list[str]) -> None:
    allowed_errors.append("422")
    fly.page.goto(f"{fly.site.http}/#/fly")
    fly.page.get_by_label("accepted miss rate").fill("0.001")
    fly.page.get_by_role("button", name="Start the flight").click()
    expect(fly.page.get_by_role("alert")).to_contain_text("999")


# The look of it


SCREENS = ((1280, 720), (820, 1180))
ZOOMED = ((960, 540), (720, 450), (640, 360))
"""What 1920 x 1080, 1440 x 900 and 1280 x 720 leave at a zoom of 200 %."""


def test_nothing_overflows(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    expect(fly.banner).to_be_visible()
    for width, height in (*SCREENS, *ZOOMED):
        fly.page.set_viewport_size({"width": width, "height": height})
        scroll_width, scroll_height = fly.page.evaluate(SCROLL_SIZE)
        assert scroll_width <= width
        banner = fly.banner.bounding_box()
        assert banner is not None
        assert banner["y"] + banner["height"] <= height, width
        assert scroll_height <= height or width < 1000, width
        assert 0 < fly.page.evaluate(RIGHTMOST) <= width


OVERLAP = """() => {
    const box = (name) => [...document.querySelectorAll(name)].at(-1).getBoundingClientRect();
    return box(".strip").bottom - box(".strip-toolbar").top;
}"""
GREEN = """() => {
    const probe = document.createElement("i");
    probe.style.color = "var(--ok)";
    document.body.append(probe);
    const ok = getComputedStyle(probe).color;
    const places = ["color", "stroke", "backgroundColor"];
    const bears = (e) => places.some((place) => getComputedStyle(e)[place] === ok);
    return [...document.querySelectorAll(".flight *")]
        .filter((e) => e.checkVisibility() && e.getAttribute("visibility") !== "hidden" && bears(e))
        .map((e) => e.outerHTML.slice(0, 80));
}"""


@pytest.mark.parametrize("is_live", [False, True])
def test_the_line_of_states_is_one_line_on_a_screen_of_1024(fly: Fly, is_live: bool) -> None:
    fly.page.set_viewport_size({"width": 1024, "height": 768})
    if is_live:
        fly.watch({"kind": "live", "trim": "none"})
    else:
        fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fly.page.keyboard.press("m")
    assert fly.page.locator(".flight > .status-strip").bounding_box()["height"] < 50  # pyright: ignore
    covered = fly.page.evaluate(
        """() => [...document.querySelectorAll(".flight > .status-strip > *")]
          .filter((part) => part.checkVisibility()).map((part) => part.getBoundingClientRect())
          .filter(({ left }, k, all) => k > 0 && left < all[k - 1].right - 1).length"""
    )
    assert covered == 0


@pytest.mark.parametrize("width", [1280, 1024])
def test_the_transport_is_one_line_on_a_screen_of_1024(fly: Fly, width: int) -> None:
    fly.page.set_viewport_size({"width": width, "height": 768})
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    expect(fly.page.locator('[data-action="next_event"]')).to_be_visible()
    clock = fly.page.locator(".transport-time")
    clock.evaluate("(e) => (e.textContent = '→ 3358.45 / 3460.20 s')")  # as of a recording
    height = fly.page.evaluate("document.querySelector('.flight > .transport').clientHeight")
    assert height < 60
    slider = fly.page.locator(".scrub").bounding_box()
    assert slider is not None
    assert slider["width"] >= 60


def test_nothing_is_green_beside_an_alarm(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None), ("step", 6))
    fly.state_says("ALARM")
    assert fly.page.evaluate(GREEN) == []


def test_a_record_of_much_to_say_leaves_its_strips_their_place(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fly.event("alert, risk").wait_for()
    fly.ask("POST", f"/flights/{fly.flight}/end")
    expect(fly.page.locator(".notice .monitor-warning").last).to_be_visible()
    fly.page.locator(".strip").last.wait_for()
    assert fly.page.evaluate(OVERLAP) <= 1


def test_the_scene_has_no_panel_of_its_own_and_lets_keys_through(
    own_fly: Fly, allowed_errors: list[str]
) -> None:
    allowed_errors += SCENE
    fly, page = own_fly, own_fly.page
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    page.get_by_role("button", name="Show scene").click()
    inside = page.frame_locator(".scene-panel iframe")
    inside.locator("canvas[data-engine]").wait_for(timeout=60_000)
    expect(inside.locator(".mantine-Paper-root").first).to_be_hidden()
    inside.locator("canvas[data-engine]").click(position={"x": 40, "y": 40})
    page.keyboard.press("k")
    fly.event("acknowledged by local").wait_for()
    expect(page.locator(".attitude")).to_have_attribute("aria-label", re.compile("bank .*°, pitch"))
    expect(page.locator('[data-angle="beta"] b')).to_contain_text("°")
    expect(page.locator(".attitude-plan")).to_have_text("translucent: as planned")
    page.get_by_role("button", name="Tail").click()
    assert page.url.endswith("?camera=tail")
    page.keyboard.press("v")
    expect(page.get_by_role("button", name="Side")).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Hide scene").click()
    expect(page.locator(".scene-panel iframe")).to_have_count(0)
    draw_no_scene(page)
    page.get_by_role("button", name="Show scene").click()
    source = page.locator(".scene-panel iframe").get_attribute("src")
    assert source is not None
    assert source.endswith("?camera=side")
    for width in (1024, 1440, 1920):
        page.set_viewport_size({"width": width, "height": 900})
        box = page.locator(".scene-panel").bounding_box()
        assert box is not None
        assert box["height"] >= 278  # and its border


def test_a_flight_whose_scene_is_gone_says_so_in_its_place(
    own_fly: Fly, allowed_errors: list[str]
) -> None:
    allowed_errors.append("status of 404")
    fly, page = own_fly, own_fly.page
    fly.watch(SAFE, ("pause", None))
    fly.site.close_scene(fly.flight)
    page.get_by_role("button", name="Show scene").click()
    expect(page.locator(".scene-panel")).to_contain_text("This flight has no scene")


def test_an_alert_of_one_sample_stays_long_enough_to_be_seen(fly: Fly) -> None:
    fly.watch(UNSAFE, ("speed", 2))
    fly.state_says("ALARM")
    expect(fly.status("state")).to_contain_text("▲ ALARM")
    fly.event("alert, risk").wait_for()


def test_a_list_of_flights_out_of_date_is_marked(fly: Fly, allowed_errors: list[str]) -> None:
    allowed_errors.append("ERR_FAILED")
    fly.watch(UNSAFE, ("pause", None))
    fly.page.goto(f"{fly.site.http}/#/fly")
    silent = fly.page.get_by_text("Display is stale: no answer")
    row = fly.page.locator(f'.under-way li:has([href="#/fly/{fly.flight}"])')
    expect(row.locator(".chip").last).to_have_text("PAUSED")
    expect(silent).to_be_hidden()
    asked = re.compile(r"/api/v1/flights\?")
    fly.page.route(asked, lambda route: route.abort())
    fly.ask("POST", f"/flights/{fly.flight}/transport", {"action": "next_alert"})
    expect(silent).to_be_visible()
    was = "[data-lost] > .under-way li"
    expect(fly.page.locator(was)).not_to_have_count(0)
    expect(fly.page).to_have_title(re.compile("OUT OF DATE"))
    fly.page.unroute(asked)
    expect(silent).to_be_hidden()
    expect(fly.page.locator(was)).to_have_count(0)
    expect(fly.page).to_have_title("Fly – Forewarn")


def test_the_title_of_a_record_says_what_its_flight_came_to(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None), ("step", 30))
    fly.ask("POST", f"/flights/{fly.flight}/end")
    verdict = fly.status("state")
    expect(verdict).to_contain_text("LIMIT EXCEEDED")
    expect(fly.page).to_have_title(re.compile(f"{re.escape(verdict.inner_text())} – simulated"))


def test_a_window_at_200_percent_shows_alarm_gauge_and_transport_at_once(fly: Fly) -> None:
    fly.watch(UNSAFE, ("pause", None), ("next_alert", None))
    fly.number_is_shown()
    expect(fly.banner).to_be_visible()
    for width, height in ZOOMED:
        fly.page.set_viewport_size({"width": width, "height": height})
        boxes = {name: fly.page.locator(name).bounding_box() for name in STACKED}
        for above, below in pairwise(boxes.values()):
            assert above
            assert below
            assert above["y"] + above["height"] <= below["y"] + 1, (width, boxes)
        assert fly.page.evaluate(RIGHTMOST) <= width
