"""ABORT and KNOCK IT OFF on the page: by key and button, on every screen, and in the record."""

import re

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.fly.test_fly_page import SAFE, UNSAFE, Fly, draw_no_scene, site, stored
from tests.browser.fly.test_live import Live
from tests.browser.fly.test_wall import LARGER
from tests.browser.site import Site

__all__ = ["site", "stored"]
ABORT = "ABORT at 0.00 s, by local"


def test_a_key_and_a_button_mark_the_flight_on_every_screen_and_in_its_record(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    other = page.context.new_page()
    other.goto(page.url)
    other.locator('[data-flight="open"]').wait_for()
    page.get_by_label("Speed").focus()
    other.goto(f"{fly.site.http}/#/fly")
    row = other.locator(f'.flight-row[data-flight="{fly.flight}"] .chip:not(.mode)')
    expect(row).to_contain_text("PAUSED")
    page.keyboard.press("x")
    expect(row).to_have_text("▲ ABORT · at 0.00 s, by local · PAUSED")
    expect(row).to_have_attribute("data-level", "alert")
    assert fly.ask("GET", f"/flights/{fly.flight}")["call"]["kind"] == "abort"
    other.goto(page.url)
    shown = [view.locator(".marker-last > span") for view in (page, other)]
    for one in shown:
        expect(one).to_have_text(ABORT)
    expect(other.locator(".mute")).to_have_attribute("data-callout", "abort")
    for size in ({"width": 1024, "height": 768}, {"width": 1920, "height": 1080}):
        page.set_viewport_size(size)  # type: ignore[arg-type]
        expect(shown[0]).to_be_in_viewport(ratio=1)
        below = shown[0].evaluate("(one) => one.getBoundingClientRect().bottom")
        assert below <= page.locator(".strip-chart").bounding_box()["y"]  # type: ignore[index]
    page.get_by_role("button", name="KNOCK IT OFF").click()
    for one in shown:
        expect(one).to_have_text(ABORT)
    for words in ("ABORT (safety of flight)", "KNOCK IT OFF (no useful data)"):
        expect(other.locator(".event", has_text=words)).to_have_count(1)
    other.close()
    page.keyboard.press("?")
    expect(page.locator(".shortcuts")).to_contain_text("ABORT: safety of flight")
    page.keyboard.press("x")
    page.keyboard.press("Escape")
    set_kinds = [one["kind"] for one in fly.ask("GET", f"/flights/{fly.flight}/markers")]
    assert set_kinds == ["abort", "knock_it_off"]
    fly.end()
    record = page.locator(".notice .marker-last")
    expect(record).to_have_count(2)
    expect(record.first).to_contain_text("ABORT (safety of flight) at 0.00 s")
    expect(page.locator(".event", has_text="ABORT (safety of flight)")).to_have_count(1)


def test_a_call_heads_desk_and_wall_until_somebody_clears_it(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    for call, word, level in (("x", "▲ ABORT", "alert"), ("q", "◆ KNOCK IT OFF", "caution")):
        page.keyboard.press(call)
        fly.state_says(word)
        expect(page.locator('.status-item[data-item="state"]')).to_have_attribute(
            "data-level", level
        )
        expect(page.locator(".state-beside")).to_contain_text("at 0.00 s, by local · PAUSED")
        assert page.evaluate(LARGER, ".state-word") == []
        page.keyboard.press("w")
        expect(page.locator(".wall-state")).to_have_text(word)
        expect(page.locator(".wall-beside")).to_contain_text("at 0.00 s, by local · PAUSED")
        assert page.evaluate(LARGER, ".wall-state") == []
        page.keyboard.press("Escape")
        page.get_by_role("button", name="Clear [U]").click()
        fly.state_says("PAUSED")
        expect(page.locator(".marker-last")).to_be_hidden()
    expect(page.locator(".event", has_text="CALL CLEARED").first).to_be_visible()


def test_a_new_manoeuvre_takes_a_call_from_the_headline(fly: Fly) -> None:
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    fly.page.keyboard.press("x")
    fly.state_says("▲ ABORT")
    fly.steer("seek", 3.0)  # the planned input begins before
    fly.state_says("PAUSED")
    fly.page.keyboard.press("x")
    fly.state_says("▲ ABORT")


def test_the_wall_gives_a_line_each_to_call_and_exceedance_and_a_scene_room(own_fly: Fly) -> None:
    fly, page = own_fly, own_fly.page  # no window that still leaves the full screen
    fly.watch(UNSAFE, ("pause", None), ("seek", 3.0), ("seek", 0.0))
    for alarm in fly.ask("GET", f"/flights/{fly.flight}/alarms"):
        fly.ask("POST", f"/flights/{fly.flight}/alarms/{alarm['id']}/acknowledge", {})
    draw_no_scene(page)
    page.get_by_role("button", name="Show scene").click()
    page.set_viewport_size({"width": 1920, "height": 1080})
    wall = f"{page.url}?wall"
    page.goto("about:blank")  # opened by its address, it asks for no full screen
    page.goto(wall)
    for _ in range(2):
        expect(page.locator(".wall-beside")).to_contain_text("first at")
        line = page.locator(".wall-state").evaluate("(one) => one.clientHeight / innerWidth")
        assert line < 0.1  # one line
        scene = page.locator(".scene-cell").bounding_box()
        assert scene is not None
        assert scene["height"] >= 280
        expect(page.locator(".marker-last")).to_be_hidden()
        page.keyboard.press("x")
        expect(page.locator(".wall-beside")).to_contain_text("by local")
    page.set_viewport_size({"width": 1280, "height": 720})
    expect(page.locator(".scene-cell")).to_be_hidden()
    expect(page.locator(".gauge-dial")).to_be_visible()


def test_an_abort_that_was_not_set_is_said_as_loudly_as_one_that_was(
    fly: Fly, allowed_errors: list[str]
) -> None:
    allowed_errors += ["ERR_FAILED", "503 (Service"]
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    held: list[Route] = []
    page.route("**/markers", lambda route: held.append(route))
    page.keyboard.press("x")
    refused = page.locator(".marker-refused")
    expect(refused).to_have_text(re.compile("^ABORT IS NOT CONFIRMED"))
    held.pop().abort()
    expect(refused).to_have_text(re.compile(r"^ABORT WAS NOT SET\..*Call it by voice\.$"))
    page.unroute("**/markers")
    page.keyboard.press("q")
    expect(page.locator(".marker-last")).to_contain_text("KNOCK IT OFF")
    size = "(one) => [Number.parseFloat(getComputedStyle(one).fontSize), one.dataset.level]"
    page.route("**/markers", lambda route: route.abort())
    page.keyboard.press("x")
    expect(refused).to_contain_text("WAS NOT SET")
    font, level = refused.evaluate(size)
    assert font >= page.locator(".marker-last").evaluate(size)[0]
    assert level == "alert"
    page.unroute("**/markers")
    page.keyboard.press("x")
    expect(refused).to_be_hidden()
    expect(page.locator(".marker-last > span")).to_have_text(ABORT)


def test_abort_is_set_while_a_question_is_open(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    page.evaluate("document.body.appendChild(document.createElement('dialog')).showModal()")
    page.keyboard.press("x")
    expect(page.locator(".marker-last > span")).to_have_text(ABORT)
    page.evaluate("document.querySelector('body > dialog').remove()")


def test_no_key_marks_while_a_text_is_typed_or_modified_or_held(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None))
    page.evaluate("document.body.append(document.createElement('textarea'))")
    page.locator("body > textarea").focus()
    page.keyboard.press("x")
    page.locator("body > textarea").blur()
    page.keyboard.press("Control+q")
    page.keyboard.down("q")
    page.keyboard.down("q")
    page.keyboard.up("q")
    expect(page.locator(".marker-last")).to_contain_text("KNOCK IT OFF")
    markers = fly.ask("GET", f"/flights/{fly.flight}/markers")
    assert [one["kind"] for one in markers] == ["knock_it_off"]
    page.evaluate("document.querySelector('body > textarea').remove()")


def test_an_event_is_typed_and_shown_to_everyone_at_the_moment_of_its_key(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 2.0))
    other = page.context.new_page()
    other.goto(page.url)
    other.locator('[data-flight="open"]').wait_for()
    expect(page.locator(".transport-time")).to_contain_text("2.00")
    page.keyboard.press("e")
    entry = page.get_by_role("textbox", name="Event")
    expect(entry).to_be_focused()
    fly.steer("seek", 3.0)
    entry.fill("x: chase saw vapour on the left wing root")  # x calls nothing while typed
    page.keyboard.press("Enter")
    expect(entry).to_be_hidden()
    for view in (page, other):
        expect(view.locator(".event", has_text="chase saw vapour")).to_contain_text("2.00 s")
        expect(view.locator(".marker-last")).to_be_hidden()
    other.close()
    (marker,) = fly.ask("GET", f"/flights/{fly.flight}/markers")
    assert (marker["kind"], marker["t"]) == ("event", pytest.approx(2.0))
    page.keyboard.press("e")
    page.keyboard.press("Escape")
    expect(entry).to_be_hidden()
    fly.end()
    expect(page.locator(".notice .marker-last")).to_contain_text("EVENT: x: chase saw vapour")
    expect(page.locator(".event", has_text="chase saw vapour")).to_have_count(1)


def test_an_event_of_a_live_flight_is_in_its_replay_and_its_recording(
    page: Page, site: Site
) -> None:
    live = Live(page, site)
    live.begin()
    live.send(1, 0, 20)
    live.ask("POST", f"/flights/{live.flight}/markers", {"kind": "event", "text": "vapour"})
    live.end()
    source = {"kind": "journal", "flight_id": live.flight}
    monitor = live.ask("GET", "/monitors")[0]["id"]
    replay = live.ask("POST", "/flights", {"source": source, "monitor": monitor})["id"]
    page.goto(f"{site.http}/#/fly/{replay}")
    live.connected()
    expect(page.locator(".event", has_text="vapour")).to_have_count(1)
    live.ask("POST", f"/flights/{replay}/end")


FLAG = """async (text) => {
  const { markerNote } = await import("/static/js/fly/alarms/flight_markers.js");
  const { event, flag } = markerNote({ t: 2, word: "EVENT", level: "none", text, by: "local" });
  return [event.text, flag.word, flag.key];
}"""


def test_a_long_event_is_whole_in_the_list_and_short_on_every_strip(page: Page, site: Site) -> None:
    page.goto(site.http)
    text = "chase saw vapour on the left wing root, then on the right one"
    listed, flag, key = page.evaluate(FLAG.replace("/static/js", "/js"), text)
    assert text in listed
    assert flag.endswith("…")
    assert text.startswith(flag[:-1])
    assert len(flag) <= 28
    assert key is None
