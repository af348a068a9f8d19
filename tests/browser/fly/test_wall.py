"""Wall mode: read from 5 m, on a link and by a key, in every state and with long names."""

import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.chromium import violations, violations_of_themes, wait_until
from tests.browser.fly.test_live import Live, site, stored
from tests.browser.site import Site
from tests.browser.strips import Open
from tests.browser.window import SIZE
from tests.support import any_flight

__all__ = ["site", "stored"]
SIZES = ((1920, 1080), (3840, 2160))
WIDE, FAR = 1218.0, 5000.0
"""[mm] Of a 55-inch screen of 16:9, and from eye to screen."""
MINUTE = FAR * np.tan(np.radians(1 / 60))
"""[mm] 1.454."""
STATE, ANY = 40.0, 16.0
"""[arcmin] Least height of a capital."""
LONG = "wing_root_bending_moment_left_outboard_station_2"
STATES = {
    "ok": ("ok", "none", []),
    "alert": ("risk", "warning", []),
    "alarm": ("alarm", "warning", ["stale", "invalid"]),
    "exceeding": ("exceeding", "warning", []),
    "stale": ("stale", "caution", ["invalid"]),
    "not calibrated": ("not_calibrated", "advisory", []),
}
WATCH_CANVASES = """
window.drawn = new Map();
const write = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
    const { a, b } = this.getTransform();
    const of = drawn.get(this.canvas) ?? drawn.set(this.canvas, []).get(this.canvas);
    of.push([text, this.font, Math.hypot(a, b) / devicePixelRatio]);
    return write.call(this, text, ...at);
};
"""
TEXTS = """() => {
    const pen = document.createElement("canvas").getContext("2d");
    const capital = (font) => {
        pen.font = font;
        return pen.measureText("H").actualBoundingBoxAscent;
    };
    const found = [];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const { data, parentElement: element } = walker.currentNode;
        const isSeen = element.checkVisibility({ checkVisibilityCSS: true });
        if (data.trim() === "" || !isSeen) continue;
        if (element.closest(".visually-hidden, .skip-link")) continue;
        const range = document.createRange();
        range.selectNodeContents(walker.currentNode);
        const { left, right, top, bottom, width } = range.getBoundingClientRect();
        if (width < 2) continue;
        const { fontStyle, fontWeight, fontSize, fontFamily } = getComputedStyle(element);
        const scale = element.closest("svg") ? Math.abs(element.getScreenCTM().d) : 1;
        const high = scale * capital(`${fontStyle} ${fontWeight} ${fontSize} ${fontFamily}`);
        const beyond = Math.max(-left, -top, right - innerWidth, bottom - innerHeight);
        found.push([data, element.closest(".wall-state") !== null, high, beyond <= 1]);
    }
    for (const [canvas, words] of window.drawn ?? [])
        if (canvas.checkVisibility() && canvas.clientWidth > 0)
            for (const [text, font, scale] of words)
                found.push([text, false, scale * capital(font), true]);
    return found;
}"""
"""Every text seen: its words, whether it is the state, height of a capital [px], in view."""


def assert_legible(page: Page) -> None:
    """At both sizes and in both themes."""
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for theme in ("dark", "light"):
            page.evaluate("(theme) => (document.documentElement.dataset.theme = theme)", theme)
            texts = page.evaluate(TEXTS)
            angles = [(text, high * WIDE / width / MINUTE) for text, _, high, _ in texts]
            states = [
                a for (_, a), (_, is_state, *_) in zip(angles, texts, strict=True) if is_state
            ]
            assert states, texts
            assert min(states) >= STATE, angles
            assert min(angle for _, angle in angles) >= ANY, sorted(angles, key=lambda a: a[1])
            assert [text for text, *_, is_within in texts if not is_within] == []


def recording(state: str, monitors: int, long: bool) -> dict[str, Any]:
    """A flight of 32 channels with 5 limits, or of 6 with one, held in a state."""
    many = any_flight.many(32)
    made = (
        any_flight.recording(many, any_flight.FIVE, any_flight.oscillating(many))
        if long
        else any_flight.recording()
    )
    hello = made["hello"]
    others = [hello["monitors"][0] | {"authority": False, "name": f"{k} ahead"} for k in range(2)]
    hello["monitors"] += others[: monitors - 1]
    whole = made["frames"]["whole"]
    shown = {key: whole[key] for key in ("p_value", "alert", "state")}
    whole["display"] = [[{k: v[i] for k, v in shown.items()}] * 2 for i in range(len(whole["t"]))]
    if long:
        for about in hello["channels"]:
            about["symbol"] = f"{LONG}_{about['key']}"
    status, level, beside = STATES[state]
    key = next(each["key"] for each in hello["channels"] if each["high"] is not None)
    peak = {"channel": key, "t": 1.2, "value": 9.5, "over": True, "acknowledged": False}
    peak["recorded"] = 12.5
    exceeds = state in ("exceeding", "alarm")
    headline = {"status": status, "level": level, "beside": beside, "verdict": None}
    headline |= {"exceeded_t": 1.2 if exceeds else None, "latched": [peak] if exceeds else []}
    headline["exceeded_as_recorded"] = exceeds
    made["headlines"] = [{"seq": 0, "pair": [headline, headline]}]
    return made


def show(page: Page, fresh: Site, flight: dict[str, Any], view: str = "?wall") -> None:
    """Play this flight as the demonstration; the modules stay from what the page showed before."""
    page.set_viewport_size(SIZE)  # pyright: ignore[reportArgumentType]
    page.goto(f"{fresh.http}/#/datasets")
    expect(page.locator("h1")).to_have_text("Datasets")
    page.unroute_all()
    page.route("**/js/start/recording.json", lambda route: route.fulfill(json=flight))
    page.goto(f"{fresh.http}/#/demonstration{view}")
    first = ".wall-row, .wall-why" if view else ".state-word"
    expect(page.locator(first).first).not_to_have_text("")


LARGER = """state => {
    const height = (element) => element.getBoundingClientRect().height
        && parseFloat(getComputedStyle(element).fontSize)
        * (element.ownerSVGElement ? element.getScreenCTM().a : 1);
    const least = height(document.querySelector(state));
    const texts = [...document.querySelectorAll("main *")].filter((element) =>
        [...element.childNodes].some((node) => node.nodeType === 3 && node.data.trim()));
    return texts.filter((one) => !one.closest("[data-alert]") && height(one) > least + 0.1)
        .map((one) => [one.className.baseVal ?? one.className, height(one), least]);
}"""


@pytest.mark.parametrize(("monitors", "long"), [(1, False), (3, True)], ids=["1", "3 long"])
def test_all_that_the_wall_shows_in_any_state_is_legible_from_5_m(
    own_page: Page, fresh: Site, allowed_errors: list[str], monitors: int, long: bool
) -> None:
    allowed_errors.append("AudioContext was not allowed")
    page = own_page
    page.add_init_script(WATCH_CANVASES)
    for state in STATES:
        show(page, fresh, recording(state, monitors, long))
        wait_until(page, "document.querySelector('.wall-clock').textContent !== ''")
        page.keyboard.press(".")
        expect(page.locator(".masthead")).to_be_hidden()
        expect(page.locator(".strip-chart")).to_be_hidden()
        expect(page.locator(".wall-row")).to_have_count(3 if long else 1)
        expect(page.locator(".wall-mode")).to_have_text("DEMONSTRATION RECORDING")
        expect(page.locator(".wall-sound")).to_have_text(re.compile("Sound blocked|^$"))
        exceeding = page.locator(".wall-row[data-exceeded]")
        if state in ("exceeding", "alarm"):
            expect(exceeding.locator(".wall-value")).to_contain_text("▲")
            expect(exceeding.locator(".wall-limit")).to_contain_text("peak from trim, sensor")
        if state == "alarm":
            first = "EXCEEDED first at 1.20 s as recorded"
            expect(page.locator(".wall-beside")).to_contain_text(first)
        assert_legible(page)


def between(flight: dict[str, Any]) -> dict[str, Any]:
    """The same flight on a monitor set, between its conditions, whose limits differ."""
    hello = flight["hello"]
    limited = [about["key"] for about in hello["channels"] if about["high"] is not None]
    widest = {key: {"low": -9, "high": 9, "rest": 0} for key in limited}
    for about in hello["channels"]:
        about |= {"low": None, "high": None, "limit": None}
    hello["monitor_set"] = {
        "id": "s", "name": "doublets", "fixed": {}, "case": "", "widest": widest,
        "reason": "not applicable: no monitor for this Mach number",
        "conditions": [{"name": "slow", "ranges": {}, "monitor": "m", "monitor_name": "m",
                        "alert_above": 0.1, "warnings": []}],
    }  # fmt: skip
    return flight


@pytest.mark.parametrize(("state", "rows"), [("stale", 0), ("exceeding", 1)])
def test_between_the_conditions_of_a_set_the_wall_gives_reason_and_what_exceeds(
    own_page: Page, fresh: Site, allowed_errors: list[str], state: str, rows: int
) -> None:
    allowed_errors.append("AudioContext was not allowed")
    page = own_page
    show(page, fresh, between(recording(state, 1, False)))
    why = page.locator(".wall-why")
    expect(why).to_have_text("◆ NO MONITOR IN USE: no monitor for this Mach number")
    expect(page.locator(".wall-row")).to_have_count(rows)
    if rows:
        expect(page.locator(".wall-row .wall-value")).to_contain_text("▲")
        expect(page.locator(".wall-row .wall-limit")).to_contain_text("peak from trim, sensor")
    assert_legible(page)


def test_the_sensors_value_is_beside_that_from_trim(strips: Open) -> None:
    code = """async (channel) => {
      const { createWall } = await import("/static/js/fly/wall.js");
      const element = document.createElement("div");
      const wall = createWall(element, element, { get: () => "", follow() {} });
      const now = { words: ["OK"], level: "ok", channels: [channel], y: [0.0] };
      return [{}, { sensor: { [channel.key]: 0.3 } }].map((sensor) => {
        wall.show({ ...now, ...sensor });
        return element.querySelector(".wall-limit").textContent;
      });
    }"""
    channel = next(each for each in any_flight.recording()["hello"]["channels"] if each["high"])
    alone, both = strips().evaluate(code, channel)
    assert "sensor" not in alone
    assert re.search(r"from trim, sensor 0\.3", both)


def test_of_an_exceedance_that_a_seek_passed_no_calm_value_is_the_state(strips: Open) -> None:
    code = """async (channel) => {
      const { createWall } = await import("/static/js/fly/wall.js");
      const element = document.createElement("div");
      const wall = createWall(element, element, { get: () => "", follow() {} });
      const passed = { channel: channel.key, t: 7.7, value: 2 * channel.high, skipped: true };
      const now = { words: ["EXCEEDED"], level: "caution", channels: [channel], y: [0.0] };
      wall.show({ ...now, latched: [passed] });
      return [".wall-value", ".wall-limit"].map((part) => element.querySelector(part).textContent);
    }"""
    channel = next(each for each in any_flight.recording()["hello"]["channels"] if each["high"])
    value, words = strips().evaluate(code, channel)
    assert value == "▲ SKIPPED"
    assert words.startswith("values beyond it were skipped")


def test_an_ended_flight_has_a_short_state_and_its_verdict_beside_it(strips: Open) -> None:
    code = """async (flight) => {
      const { resultOf } = await import("/static/js/fly/headline.js");
      return resultOf(flight).parts;
    }"""
    page, text = strips(), "LIMIT EXCEEDED, warned 0.80 s before the limit"
    flight = {"progress": "ended", "level": "caution", "status": "exceeded", "beside": []}
    exceeded = flight | {"verdict": {"text": text, "warning": "Warned"}, "exceeded_t": 1.7}
    assert page.evaluate(code, exceeded) == ["◆ EXCEEDED", text]
    calm = flight | {"level": "none", "status": "ok", "verdict": None, "exceeded_t": None}
    assert page.evaluate(code, calm) == ["ENDED"]


@pytest.mark.parametrize("view", ["", "?wall"])
def test_no_text_is_larger_than_the_state_but_the_risk_that_alerts(
    own_page: Page, fresh: Site, allowed_errors: list[str], view: str
) -> None:
    allowed_errors.append("AudioContext was not allowed")
    for state in STATES:
        show(own_page, fresh, recording(state, 1, False), view)
        larger = own_page.evaluate(LARGER, ".wall-state" if view else ".state-word")
        assert larger == [], state


@pytest.mark.parametrize("view", ["", "?wall"])
def test_a_flight_has_no_violations_of_wcag(
    own_page: Page, fresh: Site, allowed_errors: list[str], view: str
) -> None:
    allowed_errors.append("AudioContext was not allowed")
    for state in ("exceeding", "stale", "ok"):
        show(own_page, fresh, recording(state, 3, True), view)
        assert violations_of_themes(own_page) == {}, state


def test_a_waiting_flight_and_its_scene_are_legible_from_5_m(live: Live) -> None:
    page = live.page
    live.begin()
    address = page.url
    page.goto("about:blank")
    page.goto(f"{address}?wall")
    expect(page.locator(".wall-state")).to_have_text("NO DATA")
    assert_legible(page)


def test_a_key_opens_the_wall_the_address_has_it_and_escape_leaves_it(live: Live) -> None:
    page = live.page
    live.begin()
    address = page.url
    strips = page.locator(".source-address")
    expect(strips).to_be_visible()
    page.keyboard.press("w")
    expect(strips).to_be_hidden()
    assert page.url == f"{address}?wall"
    page.keyboard.press("Escape")
    expect(strips).to_be_visible()
    assert page.url == address
    page.get_by_role("button", name="Wall").click()
    expect(strips).to_be_hidden()
    page.keyboard.press("w")
    expect(strips).to_be_visible()
    page.goto("about:blank")
    page.goto(f"{address}?wall")
    live.connected()
    expect(page.locator(".wall-state")).to_have_text("NO DATA")
    expect(strips).to_be_hidden()
    live.end()
    page.locator('[data-flight="over"]').wait_for()
    expect(page.locator(".wall-clock")).to_have_text("")
    assert_legible(page)
    page.keyboard.press("Escape")
    expect(page.locator(".notice")).to_be_visible()


def test_a_link_that_hides_all_strips_tells_so(live: Live) -> None:
    page = live.page
    live.begin()
    address, hidden = page.url, page.locator(".layout-unknown")
    expect(hidden).to_be_hidden()
    page.goto("about:blank")
    page.goto(f"{address}?strips=")
    live.connected()
    expect(hidden).to_have_text("◆ All strips are hidden: show some by View > Layout.")
    assert violations(page) == []
    page.goto("about:blank")
    page.goto(f"{address}?strips=.beta")
    live.connected()
    expect(hidden).to_be_hidden()
