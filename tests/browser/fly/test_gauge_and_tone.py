"""The gauge, the alarm line and the tone, fed by hand."""

from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.chromium import wait_until
from tests.browser.strips import Open, run


def test_the_guarantee_is_shown_only_while_it_stands(strips: Open) -> None:
    texts = run(
        strips(),
        """
        const element = document.createElement('div');
        const tone = { start() {}, stop() {} };
        const panel = h.createAlarmPanel(element, { tone, acknowledge: null });
        panel.show({ flight: { epsilon: 0.1, lead: 0.5, limits: [], warnings: [] } });
        return [
          { state: 'ok', reason: '' },
          { state: 'invalid', reason: 'unlike training' },
          { state: 'invalid', cause: 'between_manoeuvres' },
          { state: 'ok', reason: '' },
          { state: 'stale', reason: 'no sample came for 1 s' },
        ].map((now) => {
          panel.show({ assessment: now });
          return element.querySelector('.alarm-calm').textContent;
        });
        """,
    )
    assert "At most 10 % of failing flights get no alert" in texts[0]
    assert texts[1].endswith("The guarantee is withdrawn: unlike training")
    assert texts[2].endswith("No guarantee between manoeuvres: nothing is assessed there.")
    assert texts[3] == texts[0]
    assert "No guarantee without current samples" in texts[4]


def test_warnings_come_before_cautions_each_with_its_own_tone(strips: Open) -> None:
    seen = run(
        strips(),
        """
        return (async () => {
        const element = document.createElement('div');
        const heard = [];
        const hear = (what) => () => heard.push(what);
        const tone = { start: hear('warning'), stop() {}, caution: hear('caution') };
        const acknowledged = [];
        const acknowledge = async (alarm) => {
          acknowledged.push(alarm.number);
          return { ...alarm, acknowledged: 'now', by: 'FTE' };
        };
        const panel = h.createAlarmPanel(element, { tone, acknowledge });
        panel.show({ flight: { epsilon: 0.1, lead: 0.5, limits: [], channels: [], warnings: [] } });
        const about = { t: 1, p_value: 0.5, reason: 'late', acknowledged: null, by: null };
        const alarm = (number, kind, level) => ({ number, kind, level, ...about });
        const banner = element.querySelector('.alarm-banner');
        const seen = [];
        const word = () => banner.textContent.split(' at ')[0];
        const level = () => (banner.hidden ? '' : banner.dataset.level);
        const note = () => seen.push([level(), word(), panel.open()]);
        panel.onAlarm(alarm(1, 'risk', 'warning'));
        panel.onAlarm(alarm(2, 'stale', 'caution'));
        note();
        await panel.acknowledgeAll();
        note();
        panel.onAlarm(alarm(2, 'stale', 'caution'));
        panel.onAlarm(alarm(3, 'invalid', 'caution'));
        note();
        await panel.acknowledgeAll();
        note();
        const differs = (one, k) => one === 'caution' || one !== heard[k - 1];
        return { seen, acknowledged, heard: heard.filter(differs) };
        })();
        """,
    )
    assert [word for _, word, _ in seen["seen"][:3]] == ["ALERT", "STALE", "INVALID"]
    assert [level for level, _, _ in seen["seen"]] == ["alert", "caution", "caution", ""]
    assert [n for _, _, n in seen["seen"]] == [1, 0, 0, 0]
    assert seen["acknowledged"] == [1, 2, 3]
    assert seen["heard"] == ["warning", "caution", "caution"]


def test_a_banner_of_several_alarms_says_how_many_and_when_the_first_was(strips: Open) -> None:
    told = run(
        strips(),
        """
        const element = document.createElement('div');
        const panel = h.createAlarmPanel(element, { tone: { start() {}, stop() {} } });
        const channels = [{ key: 'Ny', symbol: 'N_y', unit: 'g', display_unit: 'g',
          display_factor: 1, display_decimals: 2 }];
        panel.show({ flight: { epsilon: 0.1, lead: 0.5, limits: [], channels, warnings: [] } });
        const about = { p_value: null, level: 'warning', acknowledged: null, by: null };
        const exceedance = { channel: 'Ny', value: 0.6, limit: 0.5, judged: 'both' };
        panel.onAlarm({ ...about, number: 1, kind: 'risk', t: 1.4 });
        panel.onAlarm({ ...about, number: 2, kind: 'limit', t: 1.65, exceedance });
        panel.onAlarm({ ...about, number: 3, kind: 'limit', t: 2.7, exceedance });
        return element.querySelector('.alarm-text').textContent;
        """,
    )
    assert told.startswith("LIMIT EXCEEDED first at 1.65 s, 2 alarms: ")
    assert told.endswith("1 more alarm")


def test_the_line_of_a_withdrawn_monitor_gives_the_cause_that_holds_now(strips: Open) -> None:
    told = run(
        strips(),
        """
        const element = document.createElement('div');
        const tone = { start() {}, stop() {}, caution() {} };
        const panel = h.createAlarmPanel(element, { tone });
        const line = () => element.querySelector('.alarm-text').textContent;
        panel.onAlarm({ number: 1, kind: 'invalid', t: 2, p_value: null, level: 'caution',
          acknowledged: null, by: null, reason: 'outside training', cause: null });
        const lines = [line()];
        for (const now of [
          { state: 'invalid', reason: 'Ny is missing' },
          { state: 'invalid', reason: 'x', cause: 'between_manoeuvres' },
        ]) {
          panel.show({ assessment: now });
          lines.push(line());
        }
        return lines;
        """,
    )
    assert [line.split(": ")[1] for line in told] == [
        "outside training",
        "Ny is missing",
        "outside training",
    ]


@pytest.mark.parametrize(
    ("reading", "word"),
    [
        ({"state": "ok", "p_value": 0.034, "epsilon": 0.1, "alert": False}, ""),
        ({"state": "ok", "p_value": 0.34, "epsilon": 0.1, "alert": True}, ""),
        ({"state": "warming_up", "p_value": None, "epsilon": 0.1, "alert": None}, "WARMING UP"),
        ({"state": "warming_up", "cause": "rest", "p_value": None, "alert": None}, "WARMING UP"),
        ({"state": "warming_up", "cause": "ready", "p_value": None, "alert": None}, "NOT ASSESSED"),
        ({"state": "stale", "p_value": None, "epsilon": 0.1, "alert": None}, "STALE"),
        ({"state": "invalid", "p_value": None, "epsilon": 0.1, "alert": None}, "INVALID"),
        ({"state": "ok", "p_value": None, "epsilon": 0.1, "alert": None}, "INVALID"),
        ({"state": None, "epsilon": None}, "NO DATA"),
    ],
)
def test_the_gauge_has_a_number_where_assessed_and_a_word_elsewhere(
    strips: Open, reading: dict[str, Any], word: str
) -> None:
    page = strips()
    page.evaluate("(reading) => harness.gauge.update(reading)", reading)
    gauge = page.locator("#gauge")
    assert gauge.locator(".gauge-word").text_content() == word
    assessed = word == ""
    number = gauge.locator(".gauge-number").text_content()
    assert number == (str(reading["p_value"]) if assessed else "")
    spoken = gauge.get_by_role("img").get_attribute("aria-label") or ""
    assert spoken.startswith(f"risk {number}, higher is worse" if assessed else "risk not assessed")
    hatched = gauge.locator('path[stroke$="-grey)"]').get_attribute("visibility")
    assert hatched == ("hidden" if assessed else "visible")
    expect(gauge.get_by_text("risk (higher is worse)")).to_be_visible()


def test_an_alert_and_every_state_without_a_risk_have_a_shape_of_their_own(strips: Open) -> None:
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
    assert shapes[0] == ""
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
          const tone = h.createTone({ Context });
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


def test_a_link_is_open_until_the_first_missed_heartbeat(
    own_page: Page, origin: str, allowed_errors: list[str]
) -> None:
    allowed_errors.append("404 (File not found)")  # no server here tells the time
    page = own_page
    page.clock.install(time=0)
    page.clock.pause_at(1000)  # from here on time passes when told
    page.goto(f"{origin}/browser/strip_harness.html")
    page.evaluate(
        """async () => {
        const { createConnection } = await import('/static/js/fly/source/connection.js');
        class Scripted {
          static OPEN = 1;
          readyState = 0;
          constructor() { window.socket = this; }
          addEventListener(kind, listener) { this[kind] = listener; }
          close() {}
        }
        window.tell = (message) => window.socket.message({ data: JSON.stringify(message) });
        window.links = [];
        const link = (now) => window.links.push([now, performance.now()]);
        createConnection('flight', { link }, { Socket: Scripted });
        window.begin = performance.now();
        tell({ type: 'hello', head: -1, server_time: '2030-01-01T00:00:00Z' });
      }"""
    )
    beat = (
        "tell({ type: 'heartbeat', sent: performance.now(), server_time: '2030-01-01T00:00:00Z' })"
    )
    for k in range(1, 71):  # samples each 50 ms, heartbeats each second, until 3.5 s
        page.clock.run_for(50)
        page.evaluate("(k) => tell({ type: 'state', seq: k })", k)
        if k % 20 == 0:
            page.evaluate(beat)
    page.clock.run_for(1000)
    assert page.evaluate("links.map(([link]) => link)") == ["open"]
    page.clock.run_for(200)
    assert page.evaluate("links.map(([link]) => link)") == ["open", "silent"]
    page.evaluate(beat)
    assert page.evaluate("links.at(-1)[0]") == "open"


def test_credit_for_frames_is_given_back_a_quarter_at_a_time(
    own_page: Page, origin: str, allowed_errors: list[str]
) -> None:
    allowed_errors.append("404 (File not found)")  # no server here tells the time
    own_page.goto(f"{origin}/browser/strip_harness.html")
    given = own_page.evaluate(
        """async () => {
        const { createConnection } = await import('/static/js/fly/source/connection.js');
        const credits = [];
        let socket;
        class Scripted {
          static OPEN = 1;
          readyState = 1;
          constructor() { socket = this; }
          addEventListener(kind, listener) { this[kind] = listener; }
          send(text) {
            const message = JSON.parse(text);
            if (message.type === 'credit') credits.push(message.n);
          }
          close() {}
        }
        const connection = createConnection('flight', {}, { Socket: Scripted });
        const tell = (message) => socket.message({ data: JSON.stringify(message) });
        tell({ type: 'hello', head: -1, server_time: '2030-01-01T00:00:00Z' });
        const given = [];
        for (let seq = 0; seq < 9; seq += 1) {
          tell({ type: 'frames', conflated: 0, frames: [{ seq, sent: 0 }] });
          given.push(credits.length);
        }
        connection.close();
        return [credits, given];
      }"""
    )
    assert given == [[4, 4], [0, 0, 0, 1, 1, 1, 1, 2, 2]]


def test_skipped_samples_and_a_store_that_takes_nothing_are_said(strips: Open) -> None:
    told = run(
        strips(),
        """
        return (async () => {
        const { createStatusStrip } = await import('/static/js/fly/status_strip.js');
        const element = document.createElement('div');
        const figures = {
          age: 0, latency: 0, skipped: 1074, lost: 0, unwritten: 0, utc: null, problem: 'no disk',
        };
        createStatusStrip(element).update({
          mode: 'live', source: 'a file', monitor: [''], link: 'open', live: true, figures,
          headline: null,
        });
        const said = (item) => element.querySelector(`[data-item="${item}"]`);
        const [left, record] = ['skipped', 'record'].map(said);
        const words = [left, record].map((one) => one.querySelector('.status-value').textContent);
        const source = said('source').querySelector('.status-value').title; // it may be cut
        return [...words, record.dataset.level, record.title, source];
        })();
        """,
    )
    skipped = "skipped 1,074 samples (all recorded)"
    assert told == [skipped, "◆ STORE NOT WRITABLE", "caution", "No disk.", "a file"]


def test_the_bar_of_the_gauge_is_red_in_an_alert_and_never_calm_beside_a_warning(
    strips: Open,
) -> None:
    colours = run(
        strips(),
        """
        const bar = document.querySelector('.gauge-bar');
        return [[false, 'none'], [true, 'warning'], [false, 'warning']].map(([alert, level]) => {
          h.dial.update({ state: 'ok', p_value: 0.03, alert, alertAbove: 0.05 });
          h.dial.draw(performance.now(), { status: 'exceeding', level, beside: [] });
          return getComputedStyle(bar).stroke;
        });
        """,
    )
    assert colours[1] == colours[2] != colours[0]


def test_the_alarm_line_is_never_calm_after_an_exceedance(strips: Open) -> None:
    code = """async (exceeded_t) => {
      const { createAlarmPanel } = await import("/static/js/fly/alarms/alarm_panel.js");
      const element = document.createElement("div");
      const panel = createAlarmPanel(element, { tone: { start() {}, stop() {} } });
      panel.show({ headline: { status: "exceeded", beside: [], exceeded_t } });
      const line = element.querySelector(".alarm-calm");
      return [line.textContent, line.hasAttribute("data-warned")];
    }"""
    page = strips()
    before = code.replace("panel.show({ headline", "({ headline")
    assert page.evaluate(before, None)[0].startswith("◆ Alarms not known yet.")
    words, is_warned = page.evaluate(code, 7.7)
    assert words.startswith("◆ LIMIT EXCEEDED first at 7.70 s, acknowledged.")
    assert is_warned
    words, is_warned = page.evaluate(code, None)
    assert words.startswith("No unacknowledged alarms.")
    assert not is_warned


def test_each_alarm_asks_for_its_own_callout(strips: Open) -> None:
    asked = run(
        strips(),
        """
        const asked = [];
        const ask = (word) => asked.push(word);
        const tone = { start: ask, stop() {}, caution: ask };
        const element = document.createElement('div');
        const panel = h.createAlarmPanel(element, { tone, acknowledge: null });
        const channels = [{ key: 'Ny', symbol: 'N_y', unit: 'g', display_unit: 'g',
          display_factor: 1, display_decimals: 2 }];
        panel.show({ flight: { epsilon: 0.1, lead: 0.5, limits: [], channels, warnings: [] } });
        const about = { t: 1, p_value: null, reason: 'late', acknowledged: null, by: null };
        const exceedance = { channel: 'Ny', value: 0.6, limit: 0.5, judged: 'both' };
        const raise = (number, kind, level) =>
          panel.onAlarm({ ...about, number, kind, level, exceedance });
        raise(1, 'stale', 'caution');
        raise(2, 'risk', 'warning');
        raise(3, 'limit', 'warning');
        return asked;
        """,
    )
    assert asked == ["stale", "alert", "limit"]


def test_a_word_follows_the_tone_only_where_the_voice_is_chosen(strips: Open) -> None:
    page = strips()
    render = """
        async ([voice, callout, act]) => {
          let context;
          const Context = class extends OfflineAudioContext {
            constructor() { super(1, 3 * 22050, 22050); context = this; }
          };
          const tone = harness.createTone({ Context });
          tone.setMuted(false);
          tone.setVoice(voice);
          while (voice && tone.hasWords === null) await new Promise(requestAnimationFrame);
          tone[act](callout);
          const samples = (await context.startRendering()).getChannelData(0);
          const after = act === 'start' ? 0.9 : 1.25;
          const loud = samples.subarray(after * 22050, (after + 0.25) * 22050);
          return [Math.max(...loud) > 0.1, tone.hasWords, tone.callout];
        }
    """
    for act, callout in (("start", "limit"), ("caution", "abort"), ("caution", "stale")):
        assert page.evaluate(render, [True, callout, act]) == [True, True, callout]
        assert page.evaluate(render, [False, callout, act])[0] is False
    assert page.evaluate(render, [True, "frozen", "caution"])[0] is False


def test_words_that_cannot_be_read_are_said_to_be_missing(
    strips: Open, allowed_errors: list[str]
) -> None:
    allowed_errors.append("voice/limit.wav")
    page = strips()
    page.route("**/voice/limit.wav", lambda route: route.abort())
    page.evaluate("harness.tone.setVoice(true)")
    page.locator("#strips").click()
    expect(page.locator("#mute")).to_have_text("Tone on, no voice")
    page.unroute("**/voice/limit.wav")
    page.evaluate("harness.tone.setVoice(true)")
    expect(page.locator("#mute")).to_have_text("Voice on")
