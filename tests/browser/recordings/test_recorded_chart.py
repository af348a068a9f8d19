"""The chart of a scored recording: what is drawn, moving about, tiles."""

import re
from typing import Any

import pytest
from playwright.sync_api import Page, Request, Route, expect

from tests.browser.chromium import wait_until
from tests.browser.recorded_site import RecordedSite
from tests.browser.recordings.scored_chart import drawn, pixels, press, redrawn, shares, window

GUTTER = 46


def test_risk_is_coloured_by_what_may_be_said_of_it(scored: Page, scoring: dict[str, Any]) -> None:
    quiet, timely, invalid = (shares(scoring, k) for k in range(3))
    assert pixels(scored, "risk", "trace", quiet) > 50
    assert pixels(scored, "risk", "alert", quiet) == 0
    assert pixels(scored, "risk", "alert", timely) > 50
    assert pixels(scored, "risk", "trace", invalid) == 0
    assert pixels(scored, "risk", "stale", invalid) > 50
    assert pixels(scored, "Ny", "alert", timely) > pixels(scored, "Ny", "alert", quiet)


def test_a_strip_says_in_words_what_it_shows(scored: Page) -> None:
    lateral = scored.locator('.strip[data-key="Ny"] canvas')
    expect(lateral).to_have_attribute("aria-label", re.compile(r"acceleration N_y.*limit ±0\.2 g"))
    risk = scored.locator('.strip[data-key="risk"] canvas')
    expect(risk).to_have_attribute("aria-label", re.compile("withdrawn where invalid"))


def test_the_light_theme_is_drawn_at_once(scored: Page) -> None:
    before = pixels(scored, "Ny", "trace")
    scored.get_by_role("button", name="Theme: dark").click()
    wait_until(scored, "document.documentElement.dataset.theme === 'light'")
    redrawn(scored)
    assert before > 100
    assert pixels(scored, "Ny", "trace") == 0


def test_keys_zoom_move_and_show_the_entire_recording(scored: Page) -> None:
    entire = window(scored)
    press(scored, "+", "+")
    start, end = window(scored)
    assert end - start == pytest.approx((entire[1] - entire[0]) / 4, abs=0.2)
    press(scored, "PageDown")
    assert window(scored)[0] > start
    press(scored, "l")
    assert window(scored) == entire


def test_other_units_leave_the_window_and_the_cursors_where_they_are(scored: Page) -> None:
    press(scored, "+", "+", "PageDown", "a")
    before = window(scored)
    cursors = scored.locator(".strip-cursors").inner_text()
    scored.get_by_role("button", name=re.compile("^Units")).click()
    drawn(scored)
    redrawn(scored)
    assert window(scored) == before
    assert scored.locator(".strip-cursors").inner_text() == cursors


def test_a_wheel_zooms_where_the_pointer_is_and_a_drag_moves(scored: Page) -> None:
    box = scored.locator('.strip[data-key="Ny"] canvas').bounding_box()
    assert box is not None
    x, y = box["x"] + GUTTER + 0.5 * (box["width"] - GUTTER), box["y"] + 20
    scored.mouse.move(x, y)
    scored.mouse.wheel(0, -800)
    wait_until(
        scored, "!document.querySelector('.strip-interval').textContent.startsWith('0.0 to')"
    )
    start, end = window(scored)
    assert (start + end) / 2 == pytest.approx(15.05, abs=0.3)
    scored.mouse.down()
    scored.mouse.move(x - 200, y, steps=4)
    scored.mouse.up()
    redrawn(scored)
    assert window(scored)[0] > start


def test_a_narrower_window_asks_for_finer_tiles(scored: Page) -> None:
    scored.set_viewport_size({"width": 420, "height": 800})  # fewer pixels than samples
    with scored.expect_request(lambda request: seconds_of_bin(request) > 0) as first:
        scored.reload()
    drawn(scored)
    entire = seconds_of_bin(first.value)
    with scored.expect_request(lambda request: 0 < seconds_of_bin(request) < 0.7 * entire):
        press(scored, "+")


def seconds_of_bin(request: Request) -> float:
    """Length of the bins that a request for tiles asks for; 0 for any other request."""
    if "/tiles?" not in request.url:
        return 0
    query = dict(part.split("=") for part in request.url.split("?")[1].split("&"))
    return (float(query["end"]) - float(query["start"])) / float(query["bins"])


def test_next_goes_from_event_to_event(scored: Page, scoring: dict[str, Any]) -> None:
    begins = [manoeuvre["begins"] for manoeuvre in scoring["manoeuvres"]]
    alert, exceedance = (scoring["manoeuvres"][1][key] for key in ("alerts", "exceedance"))
    cursor = scored.locator(".strip-cursors")
    for t in (begins[0], begins[1], alert[0][0]):
        press(scored, "n")
        expect(cursor).to_contain_text(f"cursor {t:.3f} s")
    start, end = window(scored)
    assert start <= begins[1] <= exceedance["t"] <= end
    press(scored, "p")
    expect(cursor).to_contain_text(f"cursor {begins[1]:.3f} s")
    scored.locator(".event", has_text="exceeds its limit").get_by_role("button").click()
    expect(cursor).to_contain_text(f"cursor {exceedance['t']:.3f} s")


def test_the_cursor_reads_the_values_there(
    scored: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    press(scored, "n", "n", "n")
    at = round(scoring["manoeuvres"][1]["alerts"][0][0] / scoring["dt"])
    path = f"/recordings/{recording}/scorings/{scoring['id']}/assessments"
    frame = site.ask("GET", f"{path}?first={at}&last={at}")["frames"][0]
    for key, value in (("Ny", frame["y"][3]), ("risk", frame["p_value"])):
        shown = scored.locator(f'.strip[data-key="{key}"] .tile-value').first
        expect(shown).to_have_text(f"{value:.3f}".replace("-", "−"))


def test_tiles_that_do_not_come_are_asked_for_again(
    page: Page,
    site: RecordedSite,
    recording: str,
    scoring: dict[str, Any],
    allowed_errors: list[str],
) -> None:
    allowed_errors.append("ERR_CONNECTION_REFUSED")
    refused: list[Route] = []

    def refuse(route: Route) -> None:
        refused.append(route)
        route.abort("connectionrefused")

    page.route("**/tiles?*", refuse)
    page.goto(f"{site.http}/#/recordings/{recording}?scoring={scoring['id']}")
    expect(page.locator(".chart-failure")).to_contain_text("The server does not answer")
    press(page, "+", "+")
    assert len(refused) == 1
    page.unroute("**/tiles?*")
    page.get_by_role("button", name="Read again").click()
    drawn(page)
    expect(page.locator(".chart-failure")).to_be_hidden()


def test_a_window_stays_within_its_recording(scored: Page) -> None:
    seen = scored.evaluate("""async () => {
        const { createTimeWindow } = await import("/js/charts/time_window.js");
        const made = createTimeWindow({ start: 100, end: 36100, width: 36000, least: 1 });
        const seen = [];
        const act = (name, ...given) => {
            made[name](...given);
            const { start, end } = made.view();
            seen.push([start, end]);
        };
        act("zoom", 0.5, 100);
        act("pan", -500);
        act("setWindow", 36000, 37000);
        act("zoom", 1e-9, 36050);
        act("setWindow", NaN, 5);
        act("goLive");
        return seen;
    }""")
    assert seen[0] == seen[1] == [100, 18100]
    assert seen[2] == [35100, 36100]
    assert seen[3] == seen[4]
    assert seen[3][1] - seen[3][0] == pytest.approx(1)
    assert seen[5] == [100, 36100]


def test_the_coarsest_tiles_that_are_fine_enough_are_drawn(scored: Page) -> None:
    picked = scored.evaluate("""async () => {
        const { createTileCache } = await import("/js/charts/recorded/tiles.js");
        const load = async (start, end, bins) => {
            const step = (end - start) / bins;
            const t = Array.from({ length: bins }, (_, k) => start + k * step);
            const zeros = t.map(() => 0);
            return { start, end, step, t, channels: { x: { low: zeros, high: zeros } } };
        };
        let arrived;
        const next = () => new Promise((done) => (arrived = done));
        const cache = createTileCache({
            load, start: 0, end: 1000, dt: 0.1, offset: 50, arrived: () => arrived(),
            failed: (error) => { throw error; },
        });
        const steps = [];
        for (const [start, end] of [[0, 1000], [100, 200], [100, 101]]) {
            const came = next();
            cache.want({ start, end }, 100);
            await came;
            steps.push(cache.best({ start, end }, 100).step);
        }
        const inside = cache.best({ start: 90, end: 190 }, 100);
        steps.push(inside.step, inside.valueAt("x", 120.05).low === 0, cache.entire().start);
        cache.close();
        return steps;
    }""")
    assert picked[0] == pytest.approx(10, rel=0.05)
    assert picked[1] == pytest.approx(1, rel=0.05)
    assert picked[2] == pytest.approx(0.1, rel=0.2)
    assert picked[3] == picked[1]
    assert picked[4:] == [True, 0]


def test_a_previews_channels_share_a_grid_and_keep_their_extremes(scored: Page) -> None:
    grid = scored.evaluate("""async () => {
        const { previewTiles } = await import("/js/charts/recorded/tiles.js");
        return previewTiles({
            fast: { t: [0, 1, 2, 3, 8, 9], low: [1, 2, 3, 4, 5, 6], high: [1, 2, 3, 4, 5, 7] },
            slow: { t: [0, 4, 8], low: [-1, null, -3], high: [1, null, 3] },
        });
    }""")
    assert grid["t"] == list(range(12))
    fast, slow = grid["channels"]["fast"], grid["channels"]["slow"]
    assert fast["low"] == [1, 2, 3, 4, None, None, None, None, 5, 6, None, None]
    assert fast["high"][9] == 7
    assert slow["low"] == [-1] * 4 + [None] * 4 + [-3] * 4


def test_a_link_shows_the_same_view_in_a_fresh_browser(scored: Page, site: RecordedSite) -> None:
    press(scored, "+", "+", "PageDown", "a", "ArrowLeft")
    scored.get_by_text("View", exact=True).click()
    scored.get_by_role("button", name="Add a cross plot").last.click()
    expect(scored).to_have_url(re.compile("from=.*cross="))
    browser = scored.context.browser
    assert browser is not None
    fresh = browser.new_context(viewport={"width": 1280, "height": 720}).new_page()
    fresh.goto(scored.url)
    for shown in (".strip-interval", ".strip-cursors"):
        expect(fresh.locator(shown)).to_have_text(scored.locator(shown).inner_text())
    expect(fresh.get_by_label("Channel upwards")).to_have_value("beta")
    fresh.context.close()
