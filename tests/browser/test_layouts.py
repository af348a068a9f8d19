"""Layouts: strips and panels arranged, shared by link, name and file, alone in a second window."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, WebSocketRoute, expect

from tests.browser.chromium import violations, violations_of_themes, watch_errors
from tests.browser.recorded_site import RecordedSite
from tests.browser.test_time_of_day import dated, scored
from tests.browser.window import SIZE

pytestmark = pytest.mark.usefixtures("no_scene")
KEYS = ["Ny", "risk", "beta", "p", "r", "delta_a", "delta_r"]
"""Strips of a scoring, from top to bottom."""
DRAWN = """() => [...document.querySelectorAll("canvas")].map((canvas) => canvas.toDataURL())"""


@pytest.fixture(scope="module")
def scoring(site: RecordedSite) -> str:
    """Address of a scoring with the time of day, whose N_y exceeds its limit."""
    return scored(site, dated(site.file))


def keys_of(page: Page, place: str = ".strips") -> list[str | None]:
    return [strip.get_attribute("data-key") for strip in page.locator(f"{place} > .strip").all()]


def edit(page: Page) -> Locator:
    """Open the editor of the layout, by the keyboard."""
    page.locator(".view-menu summary").press("Enter")
    page.get_by_role("button", name="Layout").press("Enter")
    editor = page.get_by_role("region", name="Layout")
    expect(editor.get_by_role("button", name="Close")).to_be_focused()
    return editor


def part(editor: Locator, key: str) -> Locator:
    return editor.locator(f'[data-part="{key}"]')


def opened(page: Page, address: str) -> Page:
    page.goto(address)
    expect(page.locator(".strip").first).to_be_visible()
    return page


def test_strips_are_hidden_moved_sized_and_scaled_by_the_keyboard(page: Page, scoring: str) -> None:
    opened(page, scoring)
    assert keys_of(page) == KEYS
    editor = edit(page)
    part(editor, "p").get_by_label("Show").select_option("hidden")
    part(editor, "r").get_by_label("Show").select_option("number")
    up = part(editor, "delta_r").get_by_label("Move")
    up.first.press("Enter")
    expect(up.first).to_be_focused()
    part(editor, "beta").get_by_label("Size").select_option("double")
    low, high = part(editor, "beta").locator("input").all()
    low.fill("-30")
    high.fill("10")
    high.press("Tab")
    assert keys_of(page) == ["Ny", "risk", "beta", "delta_r", "delta_a"]
    assert keys_of(page, ".strip-readings") == ["r"]
    heights = [page.locator(f'.strip[data-key="{key}"]').bounding_box() for key in KEYS[2::4]]
    assert heights[0]["height"] == pytest.approx(2 * heights[1]["height"], rel=0.2)  # pyright: ignore[reportOptionalSubscript]
    expect(page).to_have_url(re.compile(r"strips=Ny,risk,beta\*2@-0\.52\d+:0\.17\d+,\.r,delta_r"))
    high.fill("-40")
    high.press("Tab")
    expect(editor.get_by_role("alert")).to_contain_text("−30 to −40 was given")
    assert violations_of_themes(page) == {}
    editor.get_by_role("button", name="Desk").press("Enter")
    assert keys_of(page) == KEYS
    expect(page).not_to_have_url(re.compile("strips="))
    page.keyboard.press("Escape")
    expect(editor).to_be_hidden()


def test_the_strip_of_an_exceeding_channel_is_never_hidden(page: Page, scoring: str) -> None:
    opened(page, f"{scoring}&strips=risk,.Ny")
    assert keys_of(page) == ["risk", "Ny"]
    expect(page.locator('.strip[data-key="Ny"] .strip-back')).to_contain_text("exceeded its limit")
    page.goto(f"{scoring}&strips=beta")
    page.reload()
    expect(page.locator('.strips > [data-key="Ny"]')).to_be_visible()
    assert set(keys_of(page)) == {"beta", "Ny"}
    expect(part(edit(page), "Ny")).to_contain_text("exceeded its limit: shown")


def test_a_link_that_asks_for_unknown_parts_tells_so_and_shows_the_others(
    page: Page, scoring: str
) -> None:
    page = opened(page, f"{scoring}&strips=Ny,lift,p,p*9&panels=map,notes&cross=beta:Ny,beta:mach")
    assert keys_of(page) == ["Ny", "p"]
    unknown = page.locator(".layout-unknown")
    expect(unknown).to_have_text(re.compile(r": lift, p\*9, map, mach\."))
    expect(page.locator(".cross-plot")).to_have_count(1)
    expect(page.get_by_label("Events", exact=True)).to_be_hidden()
    assert violations(page) == []
    page.reload()
    expect(unknown).to_have_text(re.compile(r": lift, p\*9, map, mach\."))
    page.get_by_role("button", name="Remove this cross plot").click()
    expect(unknown).to_have_text(re.compile(r": lift, p\*9, map\."))
    edit(page).get_by_role("button", name="Desk").click()
    expect(unknown).to_be_hidden()
    opened(page, f"{scoring}&only=map")
    expect(unknown).to_have_text(re.compile(r": map\."))
    assert keys_of(page) == KEYS
    expect(page.locator(".masthead")).to_be_visible()


def test_a_value_outside_a_fixed_scale_and_a_limit_are_never_lost(page: Page, scoring: str) -> None:
    opened(page, f"{scoring}&strips=Ny@-0.01:0.01,delta_r@0:0.001")
    page.locator(".view-menu summary").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="as SVG").click()
    picture = Path(saved.value.path()).read_text()
    assert {">+0.2<", ">−0.2<", ">OFF SCALE<"} <= set(re.findall(r">[^<>]+<", picture))


def test_a_link_shows_the_same_picture_in_a_fresh_browser(
    own_page: Page, browser: Browser, scoring: str
) -> None:
    page = opened(own_page, scoring)
    editor = edit(page)
    editor.get_by_role("button", name="Analysis").click()
    part(editor, "p").get_by_label("Show").select_option("hidden")
    part(editor, "events").get_by_label("Move").first.press("Enter")
    part(editor, "notes").get_by_label("Show").select_option("hidden")
    editor.get_by_role("button", name="Close").click()
    page.get_by_role("button", name=re.compile("^Units")).click()
    page.get_by_role("button", name=re.compile("^Time")).click()
    chart = page.locator(".strip-chart")
    chart.focus()
    for key in ("Home", "ArrowRight", "a", "Shift+ArrowRight", "b", "+"):
        page.keyboard.press(key)
    expect(page).to_have_url(re.compile(r"(?=.*units=)(?=.*time=day)(?=.*cross=)(?=.*&b=)"))
    fresh = browser.new_context(viewport=SIZE, color_scheme="dark").new_page()  # pyright: ignore[reportArgumentType]
    errors = watch_errors(fresh)
    opened(fresh, page.url)
    for shown in (".strip-interval", ".strip-cursors", ".event-time >> nth=0", "#units", "#time"):
        text = page.locator(shown).inner_text()
        expect(fresh.locator(shown)).to_have_text(text, use_inner_text=True)
    assert keys_of(fresh) == keys_of(page)
    page.mouse.move(0, 0)
    for seen in (page, fresh):
        seen.wait_for_load_state("networkidle")
    until_equal(lambda: page.evaluate(DRAWN), lambda: fresh.evaluate(DRAWN), fresh)
    assert fresh.url == page.url
    assert errors == []
    fresh.context.close()


def until_equal(first: Callable[[], Any], second: Callable[[], Any], page: Page) -> None:
    for _ in range(100):
        if first() == second():
            return
        page.wait_for_timeout(100)
    assert first() == second()


def test_a_layout_is_kept_by_name_and_as_a_file(page: Page, scoring: str, tmp_path: Path) -> None:
    opened(page, scoring)
    editor = edit(page)
    part(editor, "p").get_by_label("Show").select_option("hidden")
    editor.get_by_label("Name of the layout").fill("no roll")
    editor.get_by_label("Name of the layout").press("Enter")
    with page.expect_download() as saved:
        editor.get_by_role("button", name="Save as file").click()
    file = tmp_path / saved.value.suggested_filename
    saved.value.save_as(file)
    editor.get_by_role("button", name="Desk").click()
    assert "p" in keys_of(page)
    opened(page, scoring)
    page.reload()
    editor = edit(page)
    editor.get_by_role("button", name="Open", exact=True).click()
    assert "p" not in keys_of(page)
    editor.get_by_role("button", name="Delete").click()
    expect(editor.get_by_role("button", name="Open", exact=True)).to_be_hidden()
    editor.get_by_role("button", name="Desk").click()
    editor.get_by_label("Open a layout file").set_input_files(file)
    expect(page.locator('.strips > [data-key="p"]')).to_have_count(0)
    expect(editor.get_by_label("Name of the layout")).to_have_value("no roll")


BAD = {
    "no JSON": ("{", "no JSON"),
    "another file": ("[1]", "no layout of Forewarn"),
    "other channels": ({"strips": "Nz,alpha"}, "not in this view: Nz, alpha"),
    "no strip": ({"strips": "Ny*7"}, r"not in this view: Ny\*7"),
    "other panels": ({"panels": "map"}, "not in this view: map"),
    "unknown part": ({"colour": "red"}, "its colour cannot be read"),
    "crossed": ({"cross": "Nz:beta"}, "not in this view: Nz"),
}


@pytest.mark.parametrize(("given", "error"), BAD.values(), ids=BAD)
def test_a_file_that_is_no_layout_of_these_channels_gets_one_error(
    page: Page, scoring: str, given: Any, error: str
) -> None:
    opened(page, scoring)
    editor = edit(page)
    layout = {"forewarn_layout": 1, "name": "x", "channels": [], "layout": given}
    content = given if isinstance(given, str) else json.dumps(layout)
    sent = {"name": "x.json", "mimeType": "application/json", "buffer": content.encode()}
    editor.get_by_label("Open a layout file").set_input_files(sent)  # pyright: ignore[reportArgumentType]
    expect(editor.get_by_role("alert")).to_have_text(re.compile(f"^x.json: .*{error}"))
    assert keys_of(page) == KEYS
    expect(page).not_to_have_url(re.compile("strips="))


@pytest.fixture
def flight(site: RecordedSite) -> Iterator[str]:
    """A flight that exceeds a limit, at its end."""
    source = {"kind": "simulated", "seed": 3, "outcome": "unsafe"}
    order = {"source": source, "monitor": site.monitor, "epsilon": 0.1}
    flight = site.ask("POST", "/flights", json=order)["id"]
    yield flight
    site.ask("POST", f"/flights/{flight}/end")


def test_no_layout_hides_an_alarm_or_a_call(
    page: Page, site: RecordedSite, flight: str, allowed_errors: list[str]
) -> None:
    allowed_errors.append("404 (Not Found)")  # a scene opened as its flight ends
    page.goto(f"{site.http}/#/fly/{flight}?strips=beta&panels=gauge")
    expect(page.locator(".event-panel")).to_be_hidden()
    expect(page.locator('.strips > [data-key="Ny"]')).to_be_visible()
    assert keys_of(page) == ["beta", "Ny"]
    expect(page.locator(".alarm-panel")).to_contain_text("LIMIT EXCEEDED")
    site.ask("POST", f"/flights/{flight}/markers", json={"kind": "abort", "by": "test conductor"})
    expect(page.locator(".marker-last")).to_be_visible()
    editor = edit(page)
    assert violations(page) == []
    editor.get_by_role("button", name="Desk").click()
    part(editor, "gauge").get_by_label("Show").scroll_into_view_if_needed()
    expect(page.locator(".alarm-banner")).to_be_in_viewport(ratio=1)
    editor.get_by_role("button", name="Minimal").click()
    assert set(keys_of(page)) == {"Ny", "risk"}
    part(editor, "gauge").get_by_label("Show").select_option("hidden")
    expect(page.locator(".marker-last")).to_be_visible()
    editor.get_by_role("button", name="Wall").click()
    expect(page.locator(".wall-state")).to_be_visible()
    page.keyboard.press("w")
    editor.get_by_role("button", name="Desk").click()
    expect(page.locator(".event-panel .event").first).to_be_visible()


def drag(page: Page, handle: Locator, over: Locator) -> None:
    handle.hover()
    page.mouse.down()
    over.hover(position={"x": 5, "y": 3})
    page.mouse.up()


def test_panels_and_strips_are_dragged_to_another_place(
    page: Page, site: RecordedSite, flight: str
) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(f"{site.http}/#/fly/{flight}")
    drag(page, page.get_by_role("heading", name="Events"), page.locator(".gauge-panel"))
    expect(page).to_have_url(re.compile("panels=scene,events,gauge,card$"))
    events, gauge = (page.locator(part).bounding_box() for part in (".event-panel", ".gauge-panel"))
    assert events is not None
    assert gauge is not None
    assert events["y"] < gauge["y"]
    editor = edit(page)
    drag(page, part(editor, "r").locator("th"), part(editor, "p").locator("th"))
    expect(page).to_have_url(re.compile("strips=Ny,beta,r,p,"))


def test_keys_typed_into_the_layout_editor_are_no_shortcuts_but_calls_work_beside_its_fields(
    page: Page, site: RecordedSite, flight: str
) -> None:
    page.goto(f"{site.http}/#/fly/{flight}")
    editor = edit(page)
    every = "abcefgjklmnopqtvwxyz0?[],.+-"
    fields = (editor.get_by_label("Name of the layout"), part(editor, "beta").locator("input").last)
    for field in fields:
        field.press_sequentially(every)
        expect(field).to_have_value(every)
    assert site.ask("GET", f"/flights/{flight}/markers") == []
    for away in (".wall-state", "dialog", ".event-entry"):
        expect(page.locator(away)).to_be_hidden()
    part(editor, "beta").get_by_label("Show").press("x")
    expect(page.locator(".marker-last")).to_contain_text("ABORT")
    editor.get_by_role("button", name="Close").press("q")
    expect(page.get_by_label("Events", exact=True)).to_contain_text("KNOCK IT OFF")


def test_every_second_window_shows_a_lost_link_as_the_page_does(
    own_page: Page, site: RecordedSite, flight: str
) -> None:
    page, isnot_cut = own_page, [True]

    def pass_on(route: WebSocketRoute) -> None:
        server = route.connect_to_server()
        server.on_message(lambda text: route.send(text) if isnot_cut else None)

    page.context.route_web_socket(re.compile(r"/stream\?"), pass_on)
    page.goto(f"{site.http}/#/fly/{flight}")
    windows = edit(page).get_by_role("group", name="In a second window")
    seconds: list[Page] = []
    for button in windows.get_by_role("button").all():
        with page.context.expect_page() as opened:
            button.click()
        seconds.append(opened.value)
        expect(opened.value.locator(".alarm-panel")).to_contain_text("LIMIT EXCEEDED")
    isnot_cut.clear()
    expect(page.locator('[data-item="link"]')).to_contain_text("LOST")
    for second in seconds:
        expect(second.locator(".link-lost")).to_contain_text("Connection lost")
        expect(second.locator(".link-lost")).to_be_in_viewport()
        second.close()


def test_a_panel_in_a_second_window_tells_of_alarm_and_end(
    own_page: Page, site: RecordedSite, flight: str, allowed_errors: list[str]
) -> None:
    allowed_errors.append("404 (Not Found)")  # a scene opened as its flight ends
    page = own_page
    page.goto(f"{site.http}/#/fly/{flight}")
    editor = edit(page)
    windows = editor.get_by_role("group", name="In a second window")
    for name, seen, away in (
        ("Strips", ".strip-chart", ".gauge-panel"),
        ("Gauge", ".gauge-dial", ".strip-chart"),
    ):
        with page.context.expect_page() as opened:
            windows.get_by_role("button", name=name).click()
        second = opened.value
        expect(second.locator(seen)).to_be_visible()
        for hidden in (away, ".masthead", ".transport"):
            expect(second.locator(hidden)).to_be_hidden()
        expect(second.locator(".alarm-panel")).to_contain_text("LIMIT EXCEEDED")
        assert violations(second) == []
        if name == "Strips":
            second.close()
    site.ask("POST", f"/flights/{flight}/end")
    expect(second.locator(".notice")).to_contain_text("This flight was ended")
    second.close()
