"""Strips, timeline, gauge and tone in a real Chromium, fed by hand and drawn at a given clock."""

import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.chromium import wait_until

GUTTER = 46

Open = Callable[..., Page]


@pytest.fixture
def strips(page: Page, origin: str) -> Open:
    """Open the strips with a query; feed and draw through `harness`."""

    def opened(query: str = "seconds=20") -> Page:
        page.goto(f"{origin}/browser/strip_harness.html?{query}")
        wait_until(page, "window.harness")
        return page

    return opened


def run(page: Page, script: str) -> Any:
    """Run statements with `h` as the harness; the last one may `return`."""
    return page.evaluate(f"(() => {{ const h = window.harness; {script} }})()")


def readout(page: Page, key: str, part: str = "value") -> str:
    return page.locator(f'.strip[data-key="{key}"] .readout-{part}').inner_text()


def plot_width(page: Page) -> float:
    return (
        page.evaluate("document.querySelector('.strip canvas').width / devicePixelRatio") - GUTTER
    )


# The ring buffer


def test_extents_and_flags_equal_brute_force_after_wrapping(strips: Open) -> None:
    wrong = run(
        strips(),
        """
        const ring = h.createRingBuffer({ series: 2, capacity: 8192 });
        let seed = 7;
        const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
        const kept = [];
        for (let i = 0; i < 21011; i++) {
          const row = [random() < 0.02 ? NaN : Math.fround(random() - 0.5), Math.fround(random())];
          const flags = random() < 0.001 ? 1 + Math.floor(4 * random()) : 0;
          ring.push(i / 50, row, flags);
          kept.push([row, flags]);
        }
        const out = new Float64Array(2);
        let wrong = 0;
        for (let trial = 0; trial < 400; trial++) {
          const first = ring.first();
          const from = first + Math.floor(random() * (ring.count() - first));
          const to = from + 1 + Math.floor(random() ** 3 * (ring.count() - from - 1));
          for (const s of [0, 1]) {
            const known = kept.slice(from, to).filter(([row]) => !Number.isNaN(row[s]));
            const values = known.map(([row]) => row[s]);
            const any = ring.extent(s, from, to, out);
            if (any !== values.length > 0) wrong += 1;
            if (any && out[0] !== Math.min(...values)) wrong += 1;
            if (any && out[1] !== Math.max(...values)) wrong += 1;
          }
          const flags = kept.slice(from, to).reduce((all, [, f]) => all | f, 0);
          if (ring.flags(from, to) !== flags) wrong += 1;
          const t = kept.length / 50 * random();
          let after = first;
          while (after < ring.count() && after / 50 < t) after += 1;
          if (ring.after(t) !== after) wrong += 1;
        }
        return [wrong, ring.first(), ring.count(), ring.capacity];
        """,
    )
    assert wrong == [0, 21011 - 8192, 21011, 8192]


def test_a_time_that_does_not_rise_is_not_stored(strips: Open) -> None:
    page = strips()
    assert run(page, "return h.feed(0, 1, 1000)") == 50
    assert run(page, "return h.feed(0, 1, 1000)") == 0
    assert run(page, "return h.chart.push({ ...h.frame(2), t: NaN }, 1000)") == 0
    assert run(page, "return h.chart.ring.count()") == 50


# What is drawn


def test_the_trace_ends_at_the_newest_sample_and_not_beyond(strips: Open) -> None:
    page = strips("seconds=20&lead=2")
    left, right = run(
        page, "h.feed(0, 10, 1000); h.draw(1000); return h.pixels('p', 'trace').slice(1)"
    )
    step = 20 / plot_width(page)
    assert right - GUTTER == pytest.approx(plot_width(page) - 2 / step, abs=3)
    assert left - GUTTER == pytest.approx(plot_width(page) - 12 / step, abs=3)


def test_the_strips_move_on_when_samples_stop(strips: Open) -> None:
    page = strips()
    fresh = run(page, "h.feed(0, 15, 1000); h.draw(1000); return h.pixels('p', 'trace')[2]")
    assert readout(page, "p") != ""
    late = run(page, "h.draw(6000); return h.pixels('p', 'trace')[2]")
    assert fresh - late == pytest.approx(5 * plot_width(page) / 20, abs=2)


def test_stale_data_shows_a_growing_hatch_the_word_and_no_number(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 15, 1000); h.draw(1000)")
    grey = [
        run(page, f"h.draw({wall}); return h.pixels('p', 'stale')[0]")
        for wall in (1200, 4000, 7000)
    ]
    assert grey[1] > grey[0] + 200
    assert grey[2] > 1.7 * grey[1]
    for key in ("Ny", "p", "risk"):
        assert readout(page, key) == ""
        assert readout(page, key, "state") == "STALE"
    assert page.locator(".strip-toolbar .chip").inner_text() == "STALE"


def test_a_paused_flight_is_not_stale(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 15, 1000); h.chart.setTransport({ playing: false }, 1000); h.draw(60000)")
    assert re.fullmatch(r"−?\d+\.\d{3}", readout(page, "p"))
    assert page.locator(".strip-toolbar .chip").inner_text() == "PAUSED"
    run(page, "h.chart.setTransport({ playing: true }, 60000); h.draw(60100)")
    assert readout(page, "p") != ""
    run(page, "h.draw(65000)")
    assert readout(page, "p", "state") == "STALE"


def test_missing_samples_leave_a_gap_in_the_trace(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    whole, broken, inside = run(
        page,
        """
        h.feed(0, 20, 1000, { growth: 0 }); h.draw(1000);
        const whole = h.pixels('p', 'trace')[0];
        h.chart.clear();
        h.feed(0, 8, 1000, { growth: 0 }); h.feed(12, 20, 1000, { growth: 0 }); h.draw(1000);
        return [whole, h.pixels('p', 'trace')[0], String(h.chart.values(10).p)];
        """,
    )
    assert broken < 0.9 * whole
    assert inside == "NaN"


def test_one_missing_sample_in_an_hour_is_still_marked(strips: Open) -> None:
    page = strips("dt=0.1")
    count = "h.timeline.setWindow(0, 3000); h.draw(1000); return h.pixels('risk', 'band', 90)[0]"
    whole = run(page, "h.feed(0, 3000, 1000);" + count)
    broken = run(
        page, "h.chart.clear(); h.feed(0, 1500, 1000); h.feed(1500.2, 3000, 1000);" + count
    )
    assert broken > whole


def test_missing_values_break_the_trace_of_their_channel_only(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    p, r = run(
        page,
        """
        const frames = [];
        for (let k = 0; k < 1000; k++) frames.push(h.frame(k / 50, { growth: 0 }));
        h.chart.push(frames, 1000); h.draw(1000);
        const before = ['p', 'r'].map((key) => h.pixels(key, 'trace')[0]);
        h.chart.clear();
        const missing = [null, NaN, undefined];
        frames.slice(300, 700).forEach((frame, k) => { frame.y[1] = missing[k % 3]; });
        h.chart.push(frames, 1000); h.draw(1000);
        return ['p', 'r'].map((key, i) => h.pixels(key, 'trace')[0] / before[i]);
        """,
    )
    assert p < 0.8
    assert r == pytest.approx(1, abs=0.02)


def test_invalid_samples_stand_in_a_grey_band_with_the_word(strips: Open) -> None:
    page = strips()
    ground = "return h.pixels('p', 'panel', 2)[0]"
    before = run(page, "h.feed(0, 15, 1000); h.feed(15, 18, 1000); h.draw(1000);" + ground)
    run(page, "h.chart.clear(); h.feed(0, 15, 1000); h.feed(15, 18, 1000, { state: 'invalid' })")
    covered = run(page, "h.draw(1001);" + ground)
    assert before - covered > 0.8 * 3 / 20 * before
    assert readout(page, "risk", "state") == "INVALID"
    assert readout(page, "risk") == ""


def test_a_measured_value_stands_where_only_the_risk_is_withdrawn(strips: Open) -> None:
    page = strips()
    colour = "getComputedStyle(document.querySelector('[data-key=p] .readout-value')).color"
    run(page, "h.feed(0, 15, 1000); h.draw(1000)")
    white = page.evaluate(colour)
    run(page, "h.chart.clear(); h.feed(0, 15, 1000, { state: 'invalid' }); h.draw(1200)")
    assert page.evaluate(colour) != white
    assert re.fullmatch(r"−?\d\.\d{3}", readout(page, "Ny"))
    expect(page.locator('.strip[data-key="Ny"] .readout-state')).to_be_hidden()
    run(
        page,
        """
        const frame = h.frame(15, { state: 'invalid' });
        frame.y[1] = null;
        h.chart.push(frame, 1200);
        h.draw(1400);
        """,
    )
    assert readout(page, "p") == "–"
    assert re.fullmatch(r"−?\d\.\d{3}", readout(page, "r"))


def test_between_manoeuvres_the_word_is_not_assessed_and_stands_once(strips: Open) -> None:
    page = strips()
    words = run(
        page,
        """
        const words = [];
        const write = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
          words.push(text);
          return write.call(this, text, ...at);
        };
        h.feed(0, 15, 1000, { state: 'invalid', reason: 'between manoeuvres' });
        h.draw(1000);
        return words;
        """,
    )
    assert words.count("NOT ASSESSED") == 1
    assert "INVALID" not in words
    assert readout(page, "risk", "state") == "NOT ASSESSED"
    assert page.locator("#gauge .gauge-word").text_content() == "NOT ASSESSED"
    run(page, "h.feed(15, 15.2, 1000, { state: 'invalid', reason: 'unlike training' })")
    run(page, "h.draw(1200)")
    assert readout(page, "risk", "state") == "INVALID"
    assert page.locator("#gauge .gauge-word").text_content() == "INVALID"


def test_zero_is_not_on_an_axis_that_does_not_include_it(strips: Open) -> None:
    words = run(
        strips(),
        """
        const words = [];
        const write = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
          if (this.canvas.closest('[data-key="beta"]')) words.push(text);
          return write.call(this, text, ...at);
        };
        for (let k = 0; k < 900; k++) {
          const frame = h.frame(k / 50);
          frame.y[0] -= 1.5;
          h.chart.push(frame, 1000);
        }
        for (const wall of [1000, 2000, 7000, 8000]) {
          words.length = 0;
          h.draw(wall);
        }
        return words;
        """,
    )
    assert any(word.startswith("−1.") for word in words)
    assert "0" not in words


def test_the_guarantee_is_said_only_while_it_stands(strips: Open) -> None:
    texts = run(
        strips(),
        """
        const element = document.createElement('div');
        const tone = { start() {}, stop() {} };
        const panel = h.createAlarmPanel(element, { tone, acknowledge: null });
        panel.describe({ epsilon: 0.1, lead: 0.5, limits: [] });
        return [
          { state: 'ok', reason: '' },
          { state: 'invalid', reason: 'unlike training' },
          { state: 'invalid', reason: 'between manoeuvres' },
          { state: 'ok', reason: '' },
        ].map((now) => {
          panel.setState(now);
          return element.querySelector('.alarm-calm').textContent;
        });
        """,
    )
    assert "at most 10 % get no alert" in texts[0]
    assert texts[1].endswith("The guarantee is withdrawn: unlike training")
    assert texts[2].endswith("No guarantee between manoeuvres: nothing is assessed there.")
    assert texts[3] == texts[0]


# Words and numbers of a recording


def test_an_outcome_that_is_not_known_is_never_green(strips: Open) -> None:
    page = strips()
    unseen = run(page, "return h.outcomeOf('unseen')")
    assert (unseen["mark"], unseen["word"], unseen["level"]) == ("◇", "NOT ALL SEEN", "caution")
    other = run(page, "return h.outcomeOf('seen_by_half')")
    assert (other["word"], other["level"]) == ("SEEN BY HALF", "caution")
    right = "return h.validityWords({ validity: { valid: true }, outcome: 'unseen' }).level"
    assert run(page, right) == "caution"


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("0,05", ["0.05"]),
        ("0.05 0,1; .2", ["0.05", "0.1", ".2"]),
        ("0.1,0.2, 0.3", ["0.1", "0.2", "0.3"]),
        ("", []),
    ],
)
def test_a_comma_is_a_decimal_mark(strips: Open, text: str, numbers: list[str]) -> None:
    page = strips()
    assert page.evaluate("(text) => harness.decimals(text)", text) == numbers
    assert page.evaluate("() => [harness.decimal('-1,5'), harness.decimal('−2')]") == [-1.5, -2]
    assert page.evaluate("() => String(harness.decimal('1,5 s'))") == "NaN"


def test_a_mapping_that_was_changed_names_what_differs(strips: Open) -> None:
    changed = run(
        strips(),
        """
        const source = { signal: 'a', unit: 'rad', sign: 1, offset: 0, derivation: '' };
        const mapping = (channels, t = 's') => ({ channels, times: { all: { signal: t } } });
        const now = mapping({ p: source, r: source });
        return [
          h.changedChannels(mapping({ r: { unit: 'rad', signal: 'a' }, p: source }), now),
          h.changedChannels(mapping({ p: { ...source, sign: -1 } }), now),
          h.changedChannels(mapping({ p: source, r: source }, 'clock'), now),
        ];
        """,
    )
    assert changed == [[], ["p", "r"], ["time"]]


def test_the_trace_of_invalid_samples_is_grey(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    rightmost = "h.draw(1000); return h.pixels('p', 'trace')[2]"
    valid = run(page, "h.feed(0, 12, 1000); h.feed(12, 18, 1000);" + rightmost)
    run(page, "h.chart.clear(); h.feed(0, 12, 1000); h.feed(12, 18, 1000, { state: 'invalid' })")
    assert run(page, rightmost) < valid - 0.2 * plot_width(page)
    assert run(page, "return h.pixels('p', 'dim', 60)[2]") > valid - 3


def test_frames_left_out_for_display_are_not_a_gap(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    thinned, gaps = run(
        page,
        """
        const frames = [];
        for (let k = 0; k < 1000; k += 10) frames.push({ ...h.frame(k / 50), seq: k });
        h.chart.push(frames, 1000); h.draw(1000);
        const joined = h.pixels('p', 'trace')[0];
        h.chart.clear();
        h.chart.push(frames.map((frame, k) => ({ ...frame, seq: k })), 1000); h.draw(1000);
        return [joined, h.pixels('p', 'trace')[0]];
        """,
    )
    assert thinned > 3 * gaps


def test_the_forecast_reaches_past_the_newest_sample_by_the_lead(strips: Open) -> None:
    page = strips("seconds=20&lead=2")
    right = run(page, "h.feed(0, 10, 1000); h.draw(1000); return h.pixels('Ny', 'forecast', 60)[2]")
    now = run(page, "return h.pixels('Ny', 'trace')[2]")
    assert right - now == pytest.approx(2 * plot_width(page) / 20, abs=8)
    assert readout(page, "Ny", "detail").startswith("in 2.00 s")


def test_an_exceedance_of_either_sign_is_latched_until_acknowledged(strips: Open) -> None:
    page = strips()
    for value in (0.5, -0.5):
        run(
            page,
            f"""
            h.chart.clear();
            for (let k = 0; k < 100; k++) {{
              const frame = h.frame(k / 50);
              frame.y[3] = k === 40 ? {value} : 0.99 * {value};
              h.chart.push(frame, 1000);
            }}
            h.draw(1000);
            """,
        )
        assert run(page, "return h.chart.exceedances()") == [
            {"key": "Ny", "t": 0.8, "value": value}
        ]
        assert readout(page, "Ny", "badge") == "LIMIT"
        assert readout(page, "Ny", "latch")[0] == ("▲" if value > 0 else "▼")
        assert run(page, "return h.pixels('Ny', 'alert')[0]") > 20
    run(page, "h.chart.acknowledge(); h.draw(1300)")
    assert run(page, "return h.chart.exceedances()") == []
    assert not page.locator('.strip[data-key="Ny"] .readout-latch').is_visible()


def test_alerts_are_hatched_on_the_risk_strip_and_named(strips: Open) -> None:
    page = strips()
    calm = run(page, "h.feed(0, 1, 1000); h.draw(1000); return h.pixels('risk', 'alert', 90)[0]")
    run(page, "h.feed(1, 19.2, 1000, { growth: 0.5 }); h.draw(1000)")
    assert run(page, "return h.pixels('risk', 'alert', 90)[0]") > calm + 300
    assert readout(page, "risk", "badge") == "ALERT"


def test_the_picture_is_sharp_on_a_dense_screen_and_follows_the_window(
    browser: Browser, origin: str
) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 720}, device_scale_factor=2)
    page = context.new_page()
    page.goto(f"{origin}/browser/strip_harness.html")
    wait_until(page, "window.harness")
    run(page, "h.feed(0, 10, 1000); h.draw(1000)")
    shape = "const c = document.querySelector('.strip canvas'); return [c.width, c.clientWidth]"
    device, css = run(page, shape)
    assert device == pytest.approx(2 * css, abs=2)
    page.set_viewport_size({"width": 900, "height": 720})
    wait_until(page, f"document.querySelector('.strip canvas').clientWidth < {css}")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    run(page, "h.draw(1100)")
    device, css = run(page, shape)
    assert device == pytest.approx(2 * css, abs=2)
    context.close()


def test_hours_of_samples_leave_memory_flat(strips: Open) -> None:
    page = strips()
    session = page.context.new_cdp_session(page)

    def heap_after(hour: int) -> float:
        run(
            page,
            f"""
            for (let t = 3600 * {hour}; t < 3600 * ({hour} + 1); t += 20) {{
              h.feed(t, t + 20, 1000 * t);
              h.draw(1000 * (t + 20));
            }}
            """,
        )
        session.send("HeapProfiler.collectGarbage")
        used = session.send("Runtime.getHeapUsage")
        return (used["usedSize"] + used["backingStorageSize"]) / 1e6

    sizes = [heap_after(hour) for hour in range(3)]
    assert run(page, "return h.chart.ring.first()") > 300_000
    assert sizes[2] - sizes[1] < 0.3


# Axis and clock


def test_the_value_axis_widens_at_once_and_narrows_only_after_a_while(strips: Open) -> None:
    ranges = run(
        strips(),
        """
        const axis = h.createValueAxis({});
        const seen = [];
        const fit = (size, wall) => {
          axis.fit(-size, size, wall);
          seen.push([axis.low, axis.high]);
        };
        fit(1, 0); fit(1.02, 1000); fit(0.9, 2000);
        fit(0.1, 3000); fit(0.1, 6000); fit(0.1, 7500); fit(0.1, 9000);
        return seen;
        """,
    )
    first = ranges[0]
    assert first[0] <= -1.02
    assert first[1] >= 1.02
    assert all(later == first for later in ranges[1:5])
    assert ranges[6][1] < 0.3


def test_limits_are_always_in_view(strips: Open) -> None:
    low, high = run(
        strips(),
        "const a = h.createValueAxis({ limit: 0.5 }); a.fit(0, 0.01, 0); return [a.low, a.high];",
    )
    assert low < -0.5
    assert high > 0.5


def test_the_live_edge_never_runs_backwards_over_jittered_arrivals(strips: Open) -> None:
    steps = run(
        strips(),
        """
        const timeline = h.createTimeline({});
        const edges = [];
        let [seed, wall] = [5, 0];
        for (let k = 0; k < 2000; k++) {
          seed = (seed * 16807) % 2147483647;
          wall = Math.max(wall, 1000 + 20 * k + Math.max(0, (seed / 2147483647) * 200 - 150));
          timeline.observe(k / 50, wall);
          edges.push(timeline.now(wall));
        }
        const steps = edges.slice(1).map((edge, k) => edge - edges[k]);
        return [Math.min(...steps), edges.at(-1)];
        """,
    )
    assert steps[0] >= 0
    assert steps[1] == pytest.approx(1999 / 50, abs=0.1)


# Cursors, zoom and pan


def test_arrow_keys_move_the_cursor_and_a_b_show_differences(strips: Open) -> None:
    page = strips("seconds=4")
    run(page, "h.feed(0, 10, 1000, { growth: 0.1 }); h.draw(1000)")
    page.locator("#strips").focus()
    page.keyboard.press("End")
    page.keyboard.press("a")
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("b")
    run(page, "h.draw(1000)")
    marks = run(page, "return h.timeline.marks")
    assert marks["a"] == pytest.approx(9.98)
    assert marks["a"] - marks["b"] == pytest.approx(11 * 0.02, abs=1e-6)
    assert "Δt −0.220 s" in page.locator(".strip-cursors").inner_text()
    a, b = (run(page, f"return h.chart.values(h.timeline.marks.{name}).p") for name in "ab")
    text = readout(page, "p", "detail").replace("−", "-")
    shown = [float(word) for word in re.findall(r"-?\d+\.\d+", text)]
    assert shown == pytest.approx([a, b, b - a], abs=6e-4)
    page.keyboard.press("c")
    assert run(page, "return Number.isNaN(h.timeline.marks.a)")


def test_every_strip_shows_its_values_at_the_cursors(strips: Open) -> None:
    page = strips("seconds=4")
    run(
        page,
        "h.feed(0, 10, 1000); h.chart.setMark('a', 8.2); h.chart.setMark('b', 9); h.draw(1000)",
    )
    for row in page.locator(".strip .readout-detail").all():
        assert re.fullmatch(r"A .+  B .+  Δ .+", row.inner_text())


def test_the_wheel_zooms_and_live_stays_live(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 30, 1000); h.draw(1000)")
    page.locator(".strip canvas").first.hover(position={"x": 200, "y": 20})
    page.mouse.wheel(0, -400)
    wait_until(page, "harness.timeline.view(1000).end - harness.timeline.view(1000).start < 15")
    seen = run(page, "return h.timeline.view(1000)")
    assert seen["live"]
    assert seen["end"] == pytest.approx(29.98 + 0.5)


def test_a_held_window_zooms_about_the_pointer(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 30, 1000); h.timeline.setWindow(5, 15); h.draw(1000)")
    page.locator(".strip canvas").first.hover(position={"x": GUTTER + 200, "y": 20})
    under = 5 + 10 * 200 / plot_width(page)
    page.mouse.wheel(0, -300)
    wait_until(page, "harness.timeline.view(1000).start > 5.01")
    seen = run(page, "return h.timeline.view(1000)")
    share = (under - seen["start"]) / (seen["end"] - seen["start"])
    assert share == pytest.approx(200 / plot_width(page), abs=0.01)


def test_dragging_holds_the_window_and_a_double_click_goes_live(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.draw(1000)")
    box = page.locator(".strip canvas").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 30, steps=5)
    page.mouse.up()
    seen = run(page, "h.draw(1000); return h.timeline.view(1000)")
    assert not seen["live"]
    assert seen["end"] == pytest.approx(59.98 + 0.5 - 100 * 20 / plot_width(page), abs=0.3)
    assert "s behind" in page.locator(".strip-interval").inner_text()
    page.mouse.dblclick(box["x"] + 300, box["y"] + 30)
    assert run(page, "return h.timeline.view(1000).live")


def test_a_click_pins_a_cursor_that_all_strips_share(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.timeline.setWindow(20, 40); h.draw(1000)")
    page.locator(".strip canvas").first.click(
        position={"x": GUTTER + plot_width(page) / 2, "y": 30}
    )
    page.mouse.move(5, 5)
    assert run(page, "return h.timeline.cursorAt(h.timeline.view(1000))") == pytest.approx(
        30, abs=0.1
    )
    run(page, "h.draw(1000)")
    for key in ("beta", "risk"):
        assert readout(page, key, "detail").startswith("cursor")


# Words for those who do not see the canvas


def test_every_canvas_says_its_value_and_state_once_a_second(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 5, 1000); h.draw(1000)")
    canvas = page.locator('.strip[data-key="Ny"] canvas')
    first = canvas.get_attribute("aria-label")
    assert first is not None
    assert re.fullmatch(r"lateral acceleration N_y: −?\d\.\d{3} g, ok, limit ±0\.5 g", first)
    run(page, "h.feed(5, 5.5, 1500); h.draw(1500)")
    assert canvas.get_attribute("aria-label") == first
    run(page, "h.draw(2600)")
    assert "stale for" in (canvas.get_attribute("aria-label") or "")
    assert page.locator("canvas:not([aria-label]):not([aria-hidden])").count() == 0


# The gauge


@pytest.mark.parametrize(
    ("reading", "word"),
    [
        ({"state": "ok", "p_value": 0.034, "epsilon": 0.1, "alert": False}, "OK"),
        ({"state": "ok", "p_value": 0.34, "epsilon": 0.1, "alert": True}, "ALERT"),
        ({"state": "warming_up", "p_value": None, "epsilon": 0.1, "alert": None}, "WARMING UP"),
        ({"state": "stale", "p_value": None, "epsilon": 0.1, "alert": None}, "STALE"),
        ({"state": "invalid", "p_value": None, "epsilon": 0.1, "alert": None}, "INVALID"),
        ({"state": "ok", "p_value": None, "epsilon": 0.1, "alert": None}, "INVALID"),
        ({"state": None, "epsilon": None}, "NO DATA"),
    ],
)
def test_the_gauge_has_a_word_and_a_number_only_where_assessed(
    strips: Open, reading: dict[str, Any], word: str
) -> None:
    page = strips()
    page.evaluate("(reading) => harness.gauge.update(reading)", reading)
    gauge = page.locator("#gauge")
    assert gauge.locator(".gauge-word").text_content() == word
    assessed = word in ("OK", "ALERT")
    number = gauge.locator(".gauge-number").text_content()
    assert number == (str(reading["p_value"]) if assessed else "")
    dial = gauge.locator("svg")
    assert dial.get_attribute("role") == ("meter" if assessed else "img")
    assert dial.get_attribute("aria-valuenow") == (number if assessed else None)
    hatched = gauge.locator('path[stroke$="-grey)"]').get_attribute("visibility")
    assert hatched == ("hidden" if assessed else "visible")
    expect(gauge.get_by_text("risk (higher is worse)")).to_be_visible()


def test_every_state_of_the_gauge_has_its_own_shape(strips: Open) -> None:
    page = strips()
    shapes = run(
        page,
        """
        return ['ok', 'alert', 'warming_up', 'stale', 'invalid', null].map((state) => {
          const alert = state === 'alert';
          h.gauge.update({ state: alert ? 'ok' : state, alert, p_value: 0.3, epsilon: 0.1 });
          return document.querySelector('.gauge-shape').getAttribute('d');
        });
        """,
    )
    assert len(set(shapes)) == 6


@pytest.mark.parametrize(
    ("risk", "epsilon", "text"),
    [
        (0.0341, 0.1, "0.034"),
        (0.341, 0.1, "0.34"),
        (0.1004, 0.1, "0.1004"),
        (0.0996, 0.1, "0.100"),
        (0.0504, 0.05, "0.0504"),
    ],
)
def test_rounding_never_puts_the_risk_on_the_wrong_side_of_epsilon(
    strips: Open, risk: float, epsilon: float, text: str
) -> None:
    shown = strips().evaluate("([r, e]) => harness.riskText(r, e)", [risk, epsilon])
    assert shown == text
    assert (float(shown) > epsilon) == (risk > epsilon)


def test_the_gauge_drops_its_number_by_itself_when_samples_stop(strips: Open) -> None:
    page = strips("auto&seconds=20")
    run(page, "h.feed(0, 1, performance.now() - 9000)")
    wait_until(page, "document.querySelector('.gauge-word').textContent === 'STALE'")
    assert page.locator(".gauge-number").text_content() == ""
    assert run(page, "return h.loopStats().turns") > 0


# The tone


def test_the_tone_is_blocked_until_the_page_is_touched_and_says_so(strips: Open) -> None:
    page = strips()
    mute = page.locator("#mute")
    assert "blocked" in mute.inner_text()
    mute.click()
    expect(mute).to_have_text("Sound on")
    mute.click()
    expect(mute).to_have_text("Muted")
    assert mute.get_attribute("aria-pressed") == "true"
    page.reload()
    expect(page.locator("#mute")).to_have_text("Muted")


def test_the_alert_sounds_again_and_again_until_stopped_unless_muted(strips: Open) -> None:
    loudest = """
        const render = async (muted) => {
          let context;
          const Context = class extends OfflineAudioContext {
            constructor() { super(1, 4 * 22050, 22050); context = this; }
          };
          const tone = h.createTone({ storage: null, Context });
          tone.setMuted(muted);
          tone.start();
          const samples = (await context.startRendering()).getChannelData(0);
          const second = (k) => Math.max(...samples.subarray(k * 22050, (k + 1) * 22050));
          return [second(0), second(3), tone.sounding, (tone.stop(), tone.sounding)];
        };
        return Promise.all([render(false), render(true)]);
    """
    heard, muted = run(strips(), loudest)
    assert heard[0] > 0.3
    assert heard[1] > 0.3
    assert heard[2:] == [True, False]
    assert muted[:2] == [0, 0]


# The style sheet

TEXTS = ["text", "dim", "link", "ok", "caution", "alert", "limit", "epsilon", "trace", "forecast"]
PAIRS = [(text, ground) for text in TEXTS for ground in ("page", "panel")] + [
    ("text", "raised"), ("dim", "raised"), ("on-alert", "alert-fill"),
    ("on-primary", "primary-fill"),
    ("panel", "mark-a"), ("panel", "mark-b"), ("panel", "cursor"),
]  # fmt: skip


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(first: str, second: str) -> float:
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def tokens(page: Page) -> dict[str, str]:
    names = {name for pair in PAIRS for name in pair} | {"control-line", "stale", "band", "grid"}
    return page.evaluate(
        """(names) => Object.fromEntries(names.map((name) => [name,
             getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim()]))""",
        sorted(names),
    )


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_text_contrast_meets_aa(strips: Open, theme: str) -> None:
    colours = tokens(strips(f"theme={theme}"))
    weak = {
        f"{text} on {ground}": round(contrast(colours[text], colours[ground]), 2)
        for text, ground in PAIRS
        if contrast(colours[text], colours[ground]) < 4.5
    }
    assert weak == {}
    assert contrast(colours["control-line"], colours["panel"]) >= 3


def test_paper_gets_the_light_theme_on_page_and_canvas(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 15, 1000); h.draw(1000)")
    dark = tokens(page)
    page.emulate_media(media="print")
    printed = tokens(page)
    wait_until(page, "harness.pixels('p', 'panel', 2)[0] > 10000")
    page.emulate_media(media="screen")
    page.evaluate("document.documentElement.dataset.theme = 'light'")
    assert tokens(page) == printed
    assert printed["panel"] == "#ffffff" != dark["panel"]


def test_nothing_overflows_on_a_small_screen_or_a_tablet(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 30, 1000, { growth: 0.5 }); h.chart.setMark('a', 25); h.draw(1000)")
    page.evaluate("document.querySelector('#alarm').hidden = false")
    overflow = """(({ scrollWidth, scrollHeight }) =>
        [innerWidth, innerHeight, scrollWidth, scrollHeight])(document.documentElement)"""
    width, height, scroll_width, scroll_height = page.evaluate(overflow)
    assert scroll_width <= width
    assert scroll_height <= height
    clipped = """[...document.querySelectorAll('.readout')]
        .filter((e) => e.scrollWidth > e.clientWidth || e.scrollHeight > e.clientHeight)
        .map((e) => e.parentElement.dataset.key)"""
    assert page.evaluate(clipped) == []
    page.set_viewport_size({"width": 820, "height": 1180})
    width, _, scroll_width, _ = page.evaluate(overflow)
    assert scroll_width <= width
    assert page.evaluate(clipped) == []
