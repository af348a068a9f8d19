"""What the live strips draw of a flight, fed by hand and drawn at a given clock."""

import json
import re

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.chromium import wait_until
from tests.browser.strips import GUTTER, Open, plot_width, readout, run


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


def test_stale_data_shows_a_growing_hatch_the_word_and_what_was_last_measured(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 15, 1000); h.draw(1000)")
    run(page, "h.chart.push({ ...h.frame(15), y: [NaN, NaN, NaN, NaN, NaN, NaN] }, 1000)")
    keys = ("Ny", "p")
    came = [readout(page, key) for key in keys]
    grey = [
        run(page, f"h.draw({wall}); return h.pixels('p', 'stale')[0]")
        for wall in (1200, 4000, 7000)
    ]
    assert grey[1] > grey[0] + 200
    assert grey[2] > 1.7 * grey[1]
    for key, value in zip(keys, came, strict=True):
        assert readout(page, key) == value
        assert readout(page, key, "state") == "STALE"
        assert readout(page, key, "detail") == "last value, 6.0 s old"
        assert page.locator(f'.strip[data-key="{key}"] .readout[data-last]').count() == 1
    risk = page.locator('.strip[data-key="risk"]')
    assert readout(page, "risk", "state") == "STALE"
    assert not re.search(r"\d", risk.locator(".readout").inner_text())
    described = risk.locator("canvas").get_attribute("aria-label")
    assert described is not None
    assert "no value, stale" in described
    assert page.locator(".strip-toolbar .chip").inner_text() == "STALE"


def test_a_cut_link_is_stale_at_once_before_the_first_sample_and_later(strips: Open) -> None:
    page = strips()

    def words() -> list[str]:
        states = [readout(page, key, "state") for key in ("Ny", "risk")]
        return [*states, page.locator(".strip-toolbar .chip").inner_text()]

    run(page, "h.draw(1000)")
    assert words() == ["NO DATA"] * 3
    run(page, "h.chart.setLinked(false); h.draw(2100)")
    assert words() == ["STALE"] * 3
    described = page.locator('.strip[data-key="p"] canvas').get_attribute("aria-label")
    assert described is not None
    assert "no value, stale" in described
    run(page, "h.chart.setLinked(true); h.feed(0, 15, 2200); h.draw(2201)")
    assert words() == ["", "", "FOLLOWING"]
    run(page, "h.chart.setLinked(false); h.draw(2202)")
    assert words() == ["STALE"] * 3


def test_a_page_that_opens_is_given_a_second_before_it_calls_anything_stale(strips: Open) -> None:
    page = strips()
    run(page, "h.timeline.begin(1000); h.feed(0, 1, 1000); h.draw(1900)")
    assert readout(page, "p", "state") == ""
    run(page, "h.draw(2100)")
    assert readout(page, "p", "state") == "STALE"


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
        h.feed(0, 15, 1000, { state: 'invalid', cause: 'between_manoeuvres' });
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
    for k, word in enumerate(("NOT APPLICABLE", "LIMITS UNKNOWN")):
        cause = word.lower().replace(" ", "_")
        about = f"{{ state: 'invalid', reason: 'why', cause: '{cause}' }}"
        wall = 1500 + 300 * k
        run(page, f"h.feed({15.2 + k}, {16.2 + k}, {wall}, {about}); h.draw({wall})")
        assert readout(page, "risk", "state") == word
        assert page.locator("#gauge .gauge-word").text_content() == word


def test_zero_is_not_on_an_axis_that_does_not_include_it(strips: Open) -> None:
    words = run(
        strips(),
        """
        const words = [];
        const write = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
          const isLabel = this.textAlign === 'right';
          if (isLabel && this.canvas.closest('[data-key="beta"]')) words.push(text);
          return write.call(this, text, ...at);
        };
        for (let k = 0; k < 900; k++) {
          const frame = h.frame(k / 50);
          frame.y[0] -= 1.5;
          h.chart.push(frame, 1000);
        }
        for (const wall of [1000, 2000, 7000, 8000]) {
          const before = words.length;
          h.draw(wall);
          if (words.length > before) words.splice(0, before); // the axis changed
        }
        return words;
        """,
    )
    assert any(word.startswith("−1.") for word in words)
    assert "0" not in words


def test_the_trace_of_invalid_samples_is_grey(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    rightmost = "h.draw(1000); return h.pixels('p', 'trace')[2]"
    valid = run(page, "h.feed(0, 12, 1000); h.feed(12, 18, 1000);" + rightmost)
    run(page, "h.chart.clear(); h.feed(0, 12, 1000); h.feed(12, 18, 1000, { state: 'invalid' })")
    assert run(page, rightmost) < valid - 0.2 * plot_width(page)
    assert run(page, "return h.pixels('p', 'dim', 60)[2]") > valid - 3


def test_no_line_is_drawn_over_frames_left_out_for_display(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    known, joined, inside = run(
        page,
        """
        const left = (frames) => frames.filter(({ t }) => t < 8 || t >= 12);
        const all = Array.from({ length: 1000 }, (_, k) => ({ ...h.frame(k / 50), seq: k }));
        h.chart.push(left(all), 1000); h.draw(1000);
        const known = h.pixels('p', 'trace')[0];
        const inside = String(h.chart.values(10).p);
        h.chart.clear();
        h.chart.push(all, 1000); h.draw(1000);
        return [known, h.pixels('p', 'trace')[0], inside];
        """,
    )
    assert known < 0.9 * joined
    assert inside == "NaN"


def test_samples_left_out_for_display_are_told_from_missing_ones(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    thinned, missing = run(
        page,
        """
        const left = (seq) => [...Array(1000).keys()].filter((k) => k < 400 || k >= 600)
          .map((k) => ({ ...h.frame(k / 50), seq: seq(k) }));
        const shown = [];
        for (const seq of [(k) => k, (k) => (k < 400 ? k : k - 200)]) {
          h.chart.clear();
          h.chart.push(left(seq), 1000); h.draw(1000);
          shown.push(h.pixels('p', 'text')[0]);
        }
        return shown;
        """,
    )
    assert thinned > missing > 0, "the word SKIPPED is longer than GAP"


def test_samples_that_come_later_are_drawn_where_they_belong(strips: Open) -> None:
    page = strips("seconds=20&lead=0")
    whole, broken, partly, filled = run(
        page,
        """
        const all = Array.from({ length: 1000 }, (_, k) => ({ ...h.frame(k / 50), seq: k }));
        const drawn = () => { h.draw(1000); return h.pixels('p', 'trace')[0]; };
        h.chart.push(all, 1000);
        const whole = drawn();
        h.chart.clear();
        h.chart.push(all.slice(100, 400), 1000); h.chart.push(all.slice(600), 1000);
        const broken = drawn();
        h.chart.insert(all.slice(400, 500), false);
        const partly = [drawn(), h.chart.ring.flags(400, 401)];
        h.chart.insert(all.slice(500, 600), true);
        h.chart.insert(all.slice(0, 100), true);
        return [whole, broken, partly, [drawn(), h.chart.ring.flags(0, 1000) & 20]];
        """,
    )
    assert broken < partly[0] < whole
    assert partly[1] & 16, "more is missing"
    assert filled == [whole, 0]


def test_the_forecast_reaches_past_the_newest_sample_by_the_lead(strips: Open) -> None:
    page = strips("seconds=20&lead=2")
    right = run(page, "h.feed(0, 10, 1000); h.draw(1000); return h.pixels('Ny', 'forecast', 60)[2]")
    now = run(page, "return h.pixels('Ny', 'trace')[2]")
    assert right - now == pytest.approx(2 * plot_width(page) / 20, abs=8)
    assert readout(page, "Ny", "detail").startswith("in 2.00 s")


def test_a_latched_exceedance_of_either_sign_is_shown(strips: Open) -> None:
    page = strips()
    for value in (0.7, -0.7):
        latched = {"channel": "Ny", "t": 0.8, "value": value}
        run(page, f"h.chart.latch([{json.dumps(latched)}]); h.chart.push(h.frame(2)); h.draw(1000)")
        assert readout(page, "Ny", "badge") == "LIMIT"
        peak = "▲ 0.80 s, peak 0.700 g" if value > 0 else "▼ 0.80 s, peak −0.700 g"
        assert readout(page, "Ny", "latch") == peak
        worse = json.dumps(latched | {"recorded": value + 0.2})
        run(page, f"h.chart.latch([{worse}]); h.draw(1100)")
        sensor = f"{value + 0.2:.3f} g".replace("-", "−")
        assert readout(page, "Ny", "latch") == f"{peak} from trim, sensor {sensor}"
        passed = json.dumps(latched | {"skipped": True})
        run(page, f"h.chart.latch([{passed}]); h.draw(1200)")
        assert readout(page, "Ny", "badge") == "LIMIT"
        assert readout(page, "Ny", "latch").endswith("exceeded, values skipped")
    run(page, "h.chart.latch([]); h.draw(1300)")
    assert not page.locator('.strip[data-key="Ny"] .readout-latch').is_visible()


@pytest.mark.parametrize("value", [0.5, -0.5])
def test_a_value_at_its_limit_is_drawn_as_beyond_it(value: float, strips: Open) -> None:
    page = strips()
    run(
        page,
        f"""
        for (let k = 0; k < 100; k++) {{
          const frame = h.frame(k / 50);
          frame.y[3] = k === 40 ? {value} : 0.99 * {value};
          h.chart.push(frame, 1000);
        }}
        h.draw(1000);
        """,
    )
    assert run(page, "return h.pixels('Ny', 'alert')[0]") > 20


def test_who_joins_late_shows_the_limits_that_held(strips: Open) -> None:
    page = strips()
    run(
        page,
        """
        const held = [[null, 0.5], [1, 0.3], [2, null]];
        h.chart.setLimits(h.CHANNELS, held.map(([t, Ny]) => ({ t, limits: Ny && { Ny } })));
        for (let k = 20; k < 130; k++) {
          const frame = { ...h.frame(k / 50), seq: k };
          frame.y[3] = k < 60 ? 0.4 : k < 90 ? 0.8 : 0.1;
          h.chart.push(frame, 1000);
        }
        h.draw(1000);
        """,
    )
    assert run(page, "return h.pixels('Ny', 'limit')[0]") > 100
    assert run(page, "return h.pixels('Ny', 'alert')[0]") > 20


def test_an_exceedance_as_recorded_alone_is_marked_in_its_strip(strips: Open) -> None:
    page = strips()
    red = "return h.pixels('Ny', 'alert')[0]"
    assert run(page, f"h.feed(0, 4, 1000, {{ growth: 0 }}); h.draw(1000); {red}") < 20
    flag = "h.chart.flag({ key: 'Ny', t: 2, word: 'LIMIT AS RECORDED' }); h.draw(1001);"
    assert run(page, f"{flag} {red}") > 100


@pytest.mark.parametrize("rate", [20, 200], ids=["line", "area"])
def test_a_change_of_trim_is_drawn_as_no_motion(strips: Open, rate: int) -> None:
    def drawn(cuts: str) -> int:
        """Pixels of the trace and of a flag in its colour."""
        flag = f"{{ key: 'p', t: 10, word: '', thin: true, colour: 'trace', cuts: {cuts} }}"
        return run(
            strips(f"seconds=20&dt={1 / rate}"),
            f"""const y = (t) => [0, t < 10 ? 0.3 : 0, 0, 0, 0, 0];
            const at = (k) => ({{ ...h.frame(k / {rate}), y: y(k / {rate}), y_hat: null }});
            h.chart.push(Array.from({{ length: {18 * rate} }}, (_, k) => at(k)), 1000);
            h.chart.flag({flag});
            h.draw(1000);
            return h.pixels('p', 'trace')[0]""",
        )

    assert drawn("true") < drawn("false") - 2


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


def test_the_window_holds_the_planned_manoeuvre_and_what_went_before(strips: Open) -> None:
    seconds = run(
        strips(),
        """
        return import('/static/js/fly/panels.js').then(({ windowOf }) => [
          { duration: 10, planned_s: 6, lead: 0.5 },
          { duration: null, planned_s: 6, lead: 0.5 },
          { duration: null, planned_s: 1, lead: 0.5 },
          { duration: null, planned_s: null, lead: 0.5 },
          { duration: null, planned_s: 90, lead: 0.5 },
        ].map(windowOf));
        """,
    )
    assert seconds == [10.5, 12.5, 5, 60, 60]


def test_the_risk_by_a_second_monitor_is_dashed_in_the_same_strip(strips: Open) -> None:
    page = strips("seconds=20&beside=other")
    drawn = run(
        page,
        """
        const shown = (display) => {
          h.chart.clear();
          const frames = Array.from({ length: 500 }, (_, k) => ({ ...h.frame(0.02 * k), display }));
          h.chart.push(frames, 1000);
          h.draw(1000);
          return h.pixels('risk', 'forecast')[0];
        };
        const beside = (state) => [{ state, p_value: 0.7 }];
        return [beside("ok"), beside("stale"), undefined].map(shown);
        """,
    )
    assert drawn[0] > 100
    assert drawn[1] == drawn[2] == 0
    label = page.locator('.strip[data-key="risk"] .readout-label')
    assert label.text_content() == "dashed: other"
