"""A scored recording in a real Chromium: strips, events, verdicts, notes, comparisons, replay."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.chromium import wait_until
from tests.browser.recorded_site import OUTCOMES, RecordedSite, open_recorded_site

GUTTER = 46
SCENE = ["'unsafe-eval' is not an allowed source", "THREE.Clock", "GPU stall due to ReadPixels"]
COLOURS = {"alert": "#ff6a5e", "trace": "#5cc8ff", "stale": "#8d9baa", "forecast": "#e6a3ff"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RecordedSite]:
    with open_recorded_site(tmp_path_factory.mktemp("scored")) as site:
        yield site


@pytest.fixture(scope="module")
def recording(site: RecordedSite) -> str:
    made = site.upload()
    site.confirm(made)
    return made


@pytest.fixture(scope="module")
def scoring(site: RecordedSite, recording: str) -> dict[str, Any]:
    made = site.score(recording, epsilon=0.1)
    assert [stretch["outcome"] for stretch in made["stretches"]] == OUTCOMES
    return made


@pytest.fixture
def scored(page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]) -> Page:
    """The scored recording's page, drawn."""
    page.goto(f"{site.http}/#/recordings/{recording}?scoring={scoring['id']}")
    drawn(page)
    return page


def drawn(page: Page) -> None:
    """Wait for tiles: the readouts have their numbers."""
    page.locator(".tile-value", has_text="…").first.wait_for()


def window(page: Page) -> tuple[float, float]:
    """What the strips show [s]."""
    words = page.locator(".strip-interval").inner_text()
    start, end = re.findall(r"([\d.]+)(?= to| \()", words)[:2]
    return float(start), float(end)


def pixels(page: Page, key: str, colour: str, share: tuple[float, float] = (0, 1)) -> int:
    """Pixels of a strip's plot in about a colour, from one share of its width to another."""
    return page.evaluate(
        """([key, colour, from, to]) => {
            const strip = document.querySelector(`.strip[data-key="${key}"] canvas`);
            const canvas = document.createElement("canvas");
            [canvas.width, canvas.height] = [strip.width, strip.height];
            const copy = canvas.getContext("2d", { willReadFrequently: true });
            copy.drawImage(strip, 0, 0);
            const width = canvas.width - 46;
            const [x0, x1] = [46 + from * width, 46 + to * width].map(Math.round);
            const { data } = copy.getImageData(x0, 0, x1 - x0, canvas.height);
            const wanted = [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
            let n = 0;
            for (let i = 0; i < data.length; i += 4)
              n += wanted.every((value, k) => Math.abs(data[i + k] - value) < 24);
            return n;
        }""",
        [key, COLOURS[colour], *share],
    )


def shares(scoring: dict[str, Any], k: int) -> tuple[float, float]:
    """Where a manoeuvre lies while the entire recording is shown."""
    stretch, length = scoring["stretches"][k], scoring["end"] - scoring["start"]
    return stretch["start"] / length, stretch["end"] / length


def press(page: Page, *keys: str) -> None:
    """Press keys on the strips, and let them be drawn."""
    page.locator(".strip-chart").focus()
    for key in keys:
        page.keyboard.press(key)
    redrawn(page)


def redrawn(page: Page) -> None:
    """Wait for what changed to be drawn: every second frame is."""
    page.evaluate("""() => new Promise((done) => {
        const frames = (n) => (n ? requestAnimationFrame(() => frames(n - 1)) : done());
        frames(5);
    })""")


# What is drawn


def test_risk_is_coloured_by_what_may_be_said_of_it(scored: Page, scoring: dict[str, Any]) -> None:
    quiet, timely, invalid = (shares(scoring, k) for k in range(3))
    assert pixels(scored, "risk", "trace", quiet) > 50
    assert pixels(scored, "risk", "alert", quiet) == 0
    assert pixels(scored, "risk", "alert", timely) > 50
    assert pixels(scored, "risk", "trace", invalid) == 0
    assert pixels(scored, "risk", "stale", invalid) > 50
    assert pixels(scored, "Ny", "alert", timely) > pixels(scored, "Ny", "alert", quiet)


def test_every_verdict_has_a_word_and_says_what_is_promised(
    scored: Page, scoring: dict[str, Any]
) -> None:
    words = ["✓ QUIET", "✓ TIMELY ALERT", "✕ INVALID"]
    expect(scored.locator(".scored-summary .chip")).to_have_text(words)
    lane = scored.locator(".lane-item")
    expect(lane).to_have_count(3)
    for k, word in enumerate(("QUIET", "TIMELY ALERT", "INVALID")):
        expect(lane.nth(k)).to_have_attribute("title", re.compile(f"^manoeuvre {k + 1}: {word}"))
    verdicts = scored.locator(".verdict")
    for k, stretch in enumerate(scoring["stretches"]):
        expect(verdicts.nth(k)).to_contain_text(stretch["guarantee"])
        checks = verdicts.nth(k).locator(".checks li")
        expect(checks).to_have_count(len(stretch["validity"]["checks"]))
    promised = f"{scoring['stretches'][1]['lead']:.2f} s, at least 0.25 s"
    expect(verdicts.nth(1)).to_contain_text(promised)
    expect(verdicts.nth(2)).to_contain_text("The guarantee is withdrawn")
    for label in ("First alert", "Warning lead time", "Peak risk"):
        expect(verdicts.nth(2).locator(f'[data-label="{label}"]')).to_have_text("withdrawn")
    expect(scored.locator(".scored-summary")).to_contain_text("channels are from trim")
    expect(verdicts.nth(2).locator('[data-ok="false"]')).to_contain_text("✕")


def test_an_exceedance_outside_every_manoeuvre_is_told(
    page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    path = f"/recordings/{recording}/scorings/{scoring['id']}"
    crossing = {"t": 0.2, "channel": "Ny", "value": -0.21}
    stretches = [{**scoring["stretches"][0], "outcome": "unseen"}]
    told = {**scoring, "outside": [crossing], "stretches": stretches}
    page.route(f"**/api/v1{path}", lambda route: route.fulfill(json=told))
    page.goto(f"{site.http}/#{path.replace('/scorings/', '?scoring=')}")
    drawn(page)
    line = page.locator(".outside-line")
    expect(line).to_contain_text("exceeds its limit outside every manoeuvre: −0.210 g at 0.20 s")
    expect(page.locator(".event-list .event")).to_contain_text(["outside every manoeuvre"])
    expect(page.locator(".verdict .chip").first).to_have_text("◇ NOT ALL SEEN")
    expect(page.locator('.verdict [data-label="First exceedance"]')).to_have_text("not known")
    expect(page.locator('.verdict .chip[data-level="ok"]')).to_have_count(0)
    press(page, "n")
    assert "cursor 0." in page.locator(".strip-cursors").inner_text()


def test_a_scoring_by_an_earlier_mapping_is_marked(
    page: Page, site: RecordedSite, scoring: dict[str, Any]
) -> None:
    other = site.upload("turned.csv")
    site.confirm(other)
    made = site.score(other, epsilon=0.1)
    mapping = site.ask("GET", f"/recordings/{other}")["mapping"]
    mapping["channels"]["beta"]["sign"] *= -1
    body = {"mapping": mapping, "remember": False}
    site.ask("PUT", f"/recordings/{other}/mapping", json=body)
    page.goto(f"{site.http}/#/recordings/{other}")
    chip = page.locator(".chip", has_text="earlier mapping")
    expect(chip).to_have_attribute("title", re.compile("in sideslip"))
    both = f"{made['id']},{scoring['recording']}:{scoring['id']}"
    page.goto(f"{site.http}/#/recordings/{other}?compare={both}")
    expect(page.locator(".compare-table thead")).to_contain_text("earlier mapping")
    expect(chip).to_have_count(1)


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


# Moving about


def test_keys_zoom_move_and_show_the_entire_recording(scored: Page) -> None:
    entire = window(scored)
    press(scored, "+", "+")
    start, end = window(scored)
    assert end - start == pytest.approx((entire[1] - entire[0]) / 4, abs=0.2)
    press(scored, "PageDown")
    assert window(scored)[0] > start
    press(scored, "l")
    assert window(scored) == entire


def test_a_wheel_zooms_where_the_pointer_is_and_a_drag_moves(scored: Page) -> None:
    box = scored.locator('.strip[data-key="Ny"] canvas').bounding_box()
    assert box is not None
    x, y = box["x"] + GUTTER + 0.5 * (box["width"] - GUTTER), box["y"] + 20
    scored.mouse.move(x, y)
    scored.mouse.wheel(0, -800)
    wait_until(scored, "!document.querySelector('.strip-interval').textContent.startsWith('0.0 to')")
    start, end = window(scored)
    assert (start + end) / 2 == pytest.approx(15.05, abs=0.3)
    scored.mouse.down()
    scored.mouse.move(x - 200, y, steps=4)
    scored.mouse.up()
    redrawn(scored)
    assert window(scored)[0] > start


def test_a_narrower_window_asks_for_finer_tiles(scored: Page) -> None:
    scored.set_viewport_size({"width": 420, "height": 800})  # fewer pixels than samples
    scored.reload()
    drawn(scored)
    with scored.expect_request("**/tiles?*") as asked:
        press(scored, "+", "+", "+", "+")
    query = dict(part.split("=") for part in asked.value.url.split("?")[1].split("&"))
    assert float(query["end"]) - float(query["start"]) < 6


def test_next_goes_from_event_to_event(scored: Page, scoring: dict[str, Any]) -> None:
    begins = [stretch["start"] for stretch in scoring["stretches"]]
    alert, crossing = (scoring["stretches"][1][key] for key in ("alerts", "crossing"))
    cursor = scored.locator(".strip-cursors")
    for t in (begins[0], begins[1], alert[0][0]):
        press(scored, "n")
        expect(cursor).to_contain_text(f"cursor {t:.3f} s")
    start, end = window(scored)
    assert start <= begins[1] <= crossing["t"] <= end
    press(scored, "p")
    expect(cursor).to_contain_text(f"cursor {begins[1]:.3f} s")
    scored.locator(".event", has_text="exceeds its limit").get_by_role("button").click()
    expect(cursor).to_contain_text(f"cursor {crossing['t']:.3f} s")


def test_the_cursor_reads_the_values_there(
    scored: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    press(scored, "n", "n", "n")
    at = round(scoring["stretches"][1]["alerts"][0][0] / scoring["dt"])
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


# Notes


def test_notes_and_markers_are_set_changed_and_deleted(
    scored: Page, site: RecordedSite, recording: str
) -> None:
    expect(scored.get_by_role("button", name="Add the note")).to_be_disabled()
    press(scored, "n", "m")
    notes = scored.locator(".note")
    expect(notes).to_contain_text(["marker 1"])
    text = scored.get_by_role("textbox", name="text of the note")
    press(scored, "a", "n", "b")
    text.fill("gust from the left")
    scored.get_by_role("button", name="Add the note").click()
    expect(notes).to_have_count(2)
    expect(scored.locator(".lane-item", has_text="gust")).to_be_visible()
    scored.get_by_role("button", name="Edit: gust from the left").click()
    editor = notes.locator("input")
    editor.fill("gust from the right")
    editor.press("Enter")
    expect(notes).to_contain_text(["marker 1", "gust from the right"])
    markers = site.ask("GET", f"/recordings/{recording}/markers")
    assert [(marker["kind"], marker["text"]) for marker in markers] == [
        ("marker", "marker 1"),
        ("note", "gust from the right"),
    ]
    assert markers[1]["end"] > markers[1]["t"]
    for name in ("marker 1", "gust from the right"):
        scored.get_by_role("button", name=f"Delete: {name}").click()
    expect(notes).to_have_count(0)


# Out of the page


def test_report_and_exports_are_links_that_work(scored: Page, site: RecordedSite) -> None:
    links = {
        name: scored.get_by_role("link", name=name, exact=True).get_attribute("href")
        for name in ("Report", "CSV", "Parquet", "MAT")
    }
    for name, address in links.items():
        answer = scored.request.get(f"{site.http}{address}")
        assert answer.ok, name
        assert len(answer.body()) > 1000


def test_replay_flies_the_recording(
    scored: Page, recording: str, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors += SCENE
    scored.evaluate("localStorage.setItem('forewarn.scene', 'hidden')")
    scored.get_by_role("button", name="Replay").click()
    scored.locator('[data-flight="open"]').wait_for()
    flights = site.ask("GET", "/flights")
    assert flights[0]["source"]["recording"] == recording
    site.ask("DELETE", f"/flights/{flights[0]['id']}")


# Side by side


def test_scorings_are_compared_and_laid_over_each_other(
    page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    other = site.upload("second recorder.csv")
    site.confirm(other)
    theirs = site.score(other, epsilon=0.3)
    page.goto(f"{site.http}/#/recordings/{recording}?compare={scoring['id']}")
    expect(page.locator(".compare-table thead th")).to_have_count(2)
    page.get_by_label("Add a scoring of").select_option(other)
    expect(page.get_by_role("button", name="Add it")).to_be_enabled()
    page.get_by_role("button", name="Add it").click()
    page.wait_for_url(f"**compare={scoring['id']},{other}:{theirs['id']}")
    expect(page.locator(".compare-table thead th")).to_have_count(3)
    expect(page.locator(".compare-table tbody tr")).to_have_count(3)
    drawn(page)
    expect(page.locator(".overlay-key")).to_contain_text("t = 0 at")
    assert pixels(page, "Ny", "trace") > 100
    assert pixels(page, "Ny", "forecast") > 100
    page.get_by_label("moment that over begins at").select_option("1")
    expect(page.locator(".lane-item", has_text="B manoeuvre 2")).to_be_visible()
    page.get_by_role("button", name="Leave B out").click()
    expect(page.locator(".compare-table thead th")).to_have_count(2)


# The parts


def test_manoeuvres_of_one_recording_are_matched_by_time_and_of_others_by_order(
    scored: Page,
) -> None:
    rows = scored.evaluate("""async () => {
        const { rowsOf } = await import("/js/recordings/compare/table.js");
        const scoring = (recording, ...times) =>
            ({ recording, manoeuvres: times.map(([start, end]) => ({ start, end })) });
        return rowsOf([
            scoring("a", [0, 10], [20, 30]),
            scoring("a", [21, 29], [40, 50]),
            scoring("b", [100, 110]),
        ]);
    }""")
    assert rows == [[0, -1, 0], [1, 0, -1], [-1, 1, -1]]


def test_a_window_stays_within_its_recording(scored: Page) -> None:
    seen = scored.evaluate("""async () => {
        const { createTimeWindow } = await import("/js/charts/recorded/time_window.js");
        const made = createTimeWindow({ start: 100, end: 36100, least: 1 });
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
        act("showAll");
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
        const { previewTiles } = await import("/js/charts/recorded/preview_tiles.js");
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
