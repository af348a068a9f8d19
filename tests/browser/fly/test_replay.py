"""A recording replayed as a flight: events and notes of the recording, one after the other."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from tests.browser.chromium import violations, wait_until
from tests.browser.recorded_site import DT, RecordedSite
from tests.browser.window import Window
from tests.support.patience import until

START = 3358.0
TWO_PRESSES = """async () => {
    const { createTransportBar } = await import("/js/fly/playback/transport_bar.js");
    const act = () => new Promise(() => {}); // no answer comes between
    const bar = createTransportBar(document.createElement("div"), { act });
    bar.show({ playing: false, speed: 1, start: 0, position: 0, duration: 9, seekable: true });
    bar.mark([1, 2, 3].map((t) => ({ t, level: "advisory" })));
    const press = () => (bar.keys.j(), bar.t);
    return [press(), press()];
}"""

CLOCK = """async () => {
    const { createTransportBar } = await import("/js/fly/playback/transport_bar.js");
    const element = document.createElement("div");
    const bar = createTransportBar(element, { act: async () => {} });
    bar.show({ playing: true, speed: 1, start: 0, position: 2.25, duration: 6, seekable: true });
    const clock = () => element.querySelector(".transport-time").textContent;
    const shown = [clock()];
    bar.moved(2);
    shown.push(clock());
    const sought = bar.seek(5);
    shown.push(clock());
    await sought;
    bar.moved(2.05);
    shown.push(clock());
    bar.arrived();
    bar.moved(5);
    shown.push(clock());
    bar.moved(null);
    return [...shown, clock()];
}"""

LISTED = """async () => {
    const { createReplayNotes } = await import("/js/fly/playback/replay_notes.js");
    const validity = { valid: false, reasons: ["off its forecast over the 0.5 s to 6.05 s"] };
    const times = { start: 5, withdrawn_t: 5.65, exceedance: null, alerts: [] };
    const flown = { name: "manoeuvre 1", ...times, validity };
    const api = { get: async (path) => path.endsWith("/markers") ? [] : { manoeuvres: [flown] } };
    const said = [];
    let begun;
    const marked = new Promise((resolve) => (begun = resolve));
    const notes = createReplayNotes({
        api, source: { recording: "r", scoring: "s" }, now: () => 5.6,
        add: ({ t, text }) => said.push([t, text]),
        marked: begun, fail: (error) => said.push(String(error)) });
    await marked;
    const before = said.length;
    notes.moved(5.65);
    return [before, said];
}"""


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    """The scene is hidden: it is slow to draw here."""
    return {"forewarn.scene": "hidden"}


def later(file: bytes) -> bytes:
    """The same file, begun in mid-flight: its clock does not start at zero."""
    head, *rows = file.decode().splitlines()
    moved = (row.split(",", 1) for row in rows)
    return "\n".join([head, *(f"{float(t) + START:.7g},{rest}" for t, rest in moved)]).encode()


@pytest.fixture(scope="module")
def source(site: RecordedSite) -> dict[str, str]:
    """Of flights: a scored recording with one marker."""
    octets = {"content-type": "application/octet-stream"}
    recording = site.ask(
        "POST", "/recordings", params={"name": "late.csv"}, content=later(site.file), headers=octets
    )["id"]
    scoring = site.score(recording, epsilon=0.1)
    marker = {"t": START + 3.0, "text": "gust <b>here</b>", "kind": "marker"}
    site.ask("POST", f"/recordings/{recording}/markers", json=marker)
    return {"kind": "recording", "recording": recording, "scoring": scoring["id"]}


@pytest.fixture
def replay(page: Page, site: RecordedSite, source: dict[str, str]) -> Iterator[Page]:
    """The flight of the scored recording, paused at its start."""
    order = {"source": source, "monitor": site.monitor, "epsilon": 0.1}
    flight = site.ask("POST", "/flights", json=order)["id"]
    site.ask("POST", f"/flights/{flight}/transport", json={"action": "pause"})
    page.goto(f"{site.http}/#/fly/{flight}")
    page.locator('[data-flight="open"]').wait_for()
    yield page
    page.request.post(f"{site.http}/api/v1/flights/{flight}/end")


def position(page: Page) -> float:
    """Where the transport says the flight is [s]."""
    words = page.locator(".transport-time").inner_text()
    minutes, seconds = re.findall(r"(\d+):([\d.]+)", words)[0]
    return 60.0 * float(minutes) + float(seconds)


def shown_time(t: float) -> str:
    return f"{int(t // 60)}:{t % 60:05.2f}"


def go_to_next_event(page: Page) -> float:
    before = position(page)
    page.keyboard.press("j")  # the time is shown at once, with an arrow until it is reached
    wait_until(page, f"Number(document.querySelector('input.scrub').value) > {before + 0.005}")
    expect(page.locator(".transport-time")).not_to_contain_text("→")
    return position(page)


def test_the_next_event_is_a_manoeuvre_a_note_an_alert_or_a_limit(
    replay: Page, site: RecordedSite
) -> None:
    slider = replay.get_by_label("Time in the flight")
    assert float(slider.get_attribute("min") or 0) == pytest.approx(START, abs=DT)
    events = replay.locator(".event-list")
    wait_until(replay, "document.querySelectorAll('.scrub-mark[data-level=caution]').length > 2")
    expect(events.get_by_text("gust <b>here</b>")).to_have_count(0)  # it is still to come
    replay.locator("body").click(position={"x": 5, "y": 300})
    visited = [go_to_next_event(replay) for _ in range(4)]
    expect(events.get_by_text("gust <b>here</b>")).to_be_visible()
    expect(events.get_by_text("begins", exact=False).first).to_be_visible()
    expect(replay.locator(".status-strip .mode")).to_have_text("REPLAY")
    assert visited == sorted(visited)
    assert any(t == pytest.approx(START + 3.0, abs=DT) for t in visited), visited


def test_two_quick_presses_go_on_by_two_events(page: Page, site: RecordedSite) -> None:
    page.goto(site.http)
    assert page.evaluate(TWO_PRESSES) == [1, 2]


def test_the_clock_is_of_the_newest_sample_shown_and_a_time_sought_is_marked(
    page: Page, site: RecordedSite
) -> None:
    page.goto(site.http)
    shown = ["–", "2.00", "→ 5.00", "→ 5.00", "5.00", "–"]
    assert page.evaluate(CLOCK) == [f"{words} / 6.00 s" for words in shown]


def test_that_a_manoeuvre_is_invalid_is_said_once_its_replay_comes_to_the_withdrawal(
    page: Page, site: RecordedSite
) -> None:
    page.goto(site.http)
    begins, invalid = [5, "manoeuvre 1 begins"], [5.65, "manoeuvre 1 is invalid from here on"]
    assert page.evaluate(LISTED) == [1, [begins, invalid]]


def test_a_note_written_during_the_replay_stays_with_the_recording(
    replay: Page, site: RecordedSite
) -> None:
    seeks: list[Route] = []
    replay.route("**/transport", lambda route: seeks.append(route))
    with replay.expect_request("**/transport"):
        replay.get_by_label("Time in the flight").fill(str(START + 3.0))
    clock = replay.locator(".transport-time")
    expect(clock).to_have_text(
        re.compile(f"^→ {shown_time(START + 3.0)} / ")
    )  # it has not come yet
    replay.keyboard.press("t")
    for seek in seeks:
        seek.continue_()
    replay.get_by_label("Note", exact=True).fill("pilot calls buffet")
    replay.get_by_role("button", name="Save").click()
    expect(replay.locator(".event-list").get_by_text("pilot calls buffet")).to_be_visible()
    markers = [
        marker
        for recording in site.ask("GET", "/recordings")
        for marker in site.ask("GET", f"/recordings/{recording['id']}/markers")
        if marker["text"] == "pilot calls buffet"
    ]
    assert [(m["t"], m["kind"]) for m in markers] == [
        (pytest.approx(START + 3.0, abs=2 * DT), "note")
    ]


def test_strips_before_a_point_that_was_sought_are_the_recordings(replay: Page) -> None:
    slider = replay.get_by_label("Time in the flight")
    slider.evaluate(
        "(s, t) => { s.value = t; s.dispatchEvent(new Event('input'));"
        " s.dispatchEvent(new Event('change')); }",
        START + 8.0,
    )
    clock = replay.locator(".transport-time")
    expect(clock).to_have_text(re.compile(f"^{shown_time(START + 8.0)} / "))
    expect(replay.locator(".strip-chart")).to_be_visible()
    expect(replay.locator(".readout-value", has_text=re.compile(r"\d")).first).to_be_visible()


def test_a_lost_validity_waits_in_amber_until_it_is_acknowledged(
    replay: Page, site: RecordedSite, source: dict[str, str]
) -> None:
    flight = replay.url.rsplit("/", 1)[-1]
    path = f"/recordings/{source['recording']}/scorings/{source['scoring']}"
    quiet, _, invalid = site.ask("GET", path)["manoeuvres"]

    def seek(t: float) -> None:
        action = {"action": "seek", "value": t}
        site.ask("POST", f"/flights/{flight}/transport", json=action)

    alarms = f"/flights/{flight}/alarms"
    seek(invalid["start"] + 1.0)
    for passed in site.ask("GET", alarms):  # by the seek, over the manoeuvre between
        if passed["level"] == "warning":
            site.ask("POST", f"{alarms}/{passed['id']}/acknowledge")
    banner = replay.locator(".alarm-banner")
    expect(banner).to_contain_text("INVALID at")
    assert banner.get_attribute("data-level") == "caution"
    expect(replay.locator(".state-word")).to_have_text("◆ INVALID")
    seek(quiet["start"] + 1.0)
    expect(replay.locator(".state-word")).to_have_text("◆ CAUTION")
    expect(replay).to_have_title(re.compile("^◆ CAUTION"))
    replay.keyboard.press("k")
    expect(banner).to_be_hidden()
    replay.locator('.event[data-level="caution"]', has_text="invalid: ").wait_for()
    *_, caution = site.ask("GET", alarms)
    assert (caution["kind"], caution["by"]) == ("invalid", "local")


@pytest.fixture
def second(replay: Page, browser: Browser, stored: dict[str, str]) -> Iterator[Page]:
    """Another screen of the same replay."""
    window = Window(browser, stored)
    page = window.open()
    page.goto(replay.url)
    page.locator('[data-flight="open"]').wait_for()
    yield page
    assert window.close() == []


def says(page: Page, words: str) -> None:
    expect(page.locator(".following")).to_have_text(re.compile(words))


def test_a_screen_follows_the_one_that_leads_until_it_takes_the_lead(
    replay: Page, second: Page
) -> None:
    first, play = replay, "[data-action=play]"
    says(first, "1 other screen also shows this replay. The first to steer leads")
    first.locator(play).click()
    says(first, "This screen leads. 1 other screen follows")
    says(second, r"Follows screen \d+: in step\.")
    expect(second.locator(play)).to_be_hidden()
    expect(first.locator(play)).to_have_attribute("data-playing", "true")
    second.keyboard.press(" ")  # no key of a follower steers
    first.locator(play).click()
    expect(first.locator(play)).to_have_attribute("data-playing", "false")
    for _ in range(3):
        first.keyboard.press("j")
    first.keyboard.press("]")
    wait_until(first, f"Number(document.querySelector('input.scrub').value) > {START + 0.5}")
    clock = first.locator(".transport-time")
    expect(clock).to_have_attribute("title", "Time of the newest sample shown")
    until(lambda: clock.inner_text() == second.locator(".transport-time").inner_text())
    expect(second.locator("select.speed")).to_have_value("2")
    says(second, "in step")
    assert violations(second) == []
    second.get_by_role("button", name="Take the lead").click()
    says(second, "This screen leads")
    says(first, "Follows screen")
    expect(second.locator(play)).to_be_visible()
    expect(first.locator(play)).to_be_hidden()


def test_a_follower_whose_window_is_elsewhere_is_out_of_step(replay: Page, second: Page) -> None:
    replay.keyboard.press("j")
    says(second, "in step")
    strips = second.locator(".strip-chart").first
    strips.focus()
    for _ in range(3):
        second.keyboard.press("PageDown")
    says(second, "◆ OUT OF STEP: its window shows")


def test_a_leader_that_is_gone_is_named_until_another_screen_steers(
    replay: Page, second: Page
) -> None:
    second.locator("[data-action=play]").click()
    says(replay, "Follows screen")
    second.goto("about:blank")
    says(replay, r"◆ LEADER GONE: screen \d+ has left. The next to steer leads")
    replay.locator("[data-action=play]").click()
    expect(replay.locator(".following")).to_be_hidden()
