/**
 * A flight under way: its stream drives strips, gauge, alarm line, events, status and transport.
 *
 * Exports
 *   showLiveFlight(element, {id, api, over}) -> {close()}
 *     over(reason)    the flight is not under way any more
 */

import { createStripChart } from "../charts/live/strip_chart.js";
import { createTimeline } from "../charts/live/timeline.js";
import { shownState } from "../charts/readout.js";
import { reason } from "../lib/api.js";
import { h, put } from "../lib/dom.js";
import { addDrawer } from "../lib/draw_loop.js";
import { createEventList } from "../lib/event_list.js";
import { formatTime, riskText } from "../lib/numbers.js";
import { askToConfirm, state as stateOf } from "../lib/view_states.js";
import { createAlarmPanel } from "./alarm_panel.js";
import { createConnection } from "./connection.js";
import { alertText, createFlightPanels, limitsOf, sourceText, windowOf } from "./panels.js";
import { createReplayNotes } from "./replay_notes.js";
import { createRiskGauge } from "./risk_gauge.js";
import { createSceneFrame } from "./scene_frame.js";
import { bindShortcuts, createShortcutList } from "./shortcuts.js";
import { createSourceHistory } from "./source_history.js";
import { createStatusStrip } from "./status_strip.js";
import { bindMuteButton, createTone } from "./tone.js";
import { createTransportBar } from "./transport_bar.js";

const STATUS_EVERY = 200; // ms
const HELD = 1500; // ms
const FETCHING = 1000; // ms that the past of a point that was sought may take to come
const alerts = (frame) => frame.state === "ok" && frame.alert === true;
const LOST = "connection lost";
const tone = createTone(); // one for the page: a browser lets it sound once it was touched

export function showLiveFlight(element, { id, api, over }) {
  const path = `/flights/${encodeURIComponent(id)}`;
  const panels = createFlightPanels(element);
  const status = createStatusStrip(panels.status);
  const events = createEventList(panels.events, { go });
  const shortcuts = createShortcutList();
  const mute = h("button", { type: "button", class: "button button-small mute" });
  const list = h("button", { type: "button", class: "button button-small", title: "Keyboard shortcuts (key ?)", onclick: shortcuts.open }, "Keys ?");
  panels.status.append(h("div", { class: "row spread" }, mute, list), shortcuts.dialog);
  const alarm = createAlarmPanel(panels.alarm, {
    tone,
    acknowledge: ({ id: number }) => api.post(`${path}/alarms/${number}/acknowledge`, {}),
  });
  const transport = createTransportBar(panels.transport, {
    act: (action, value) => api.post(`${path}/transport`, { action, value: value ?? null }),
    end: () => askToConfirm("End this flight?", "Its record is kept, and it can be flown again.", "End flight", () => api.delete(path)),
  });
  const scene = createSceneFrame(panels.scene, id);
  let timeline = null; // these four come with hello
  let chart = null;
  let gauge = null;
  let hello = null;
  let history = null;
  let notes = null; // of a replayed recording
  let last = null; // newest frame, without which there is nothing to trust
  let lasting = null; // riskiest alert of late, and until when it stays on the gauge
  let said = { state: null, reason: "" };
  let steered = { playing: true, speed: 1 };
  let held = null; // frames that wait for what came before them in the source
  let turn = 0;
  let sought = 0;
  let origin = 0; // where the flight goes on from, until a sample says more [s]
  let drawing = false; // what lies before a point that was sought, not flown now
  const raised = new Set();

  const unbind = [
    bindMuteButton(mute, tone),
    addDrawer(refresh),
    bindShortcuts({
      ...transport.keys,
      k: alarm.acknowledgeAll,
      m: () => mute.click(),
      t: () => notes?.write(),
      "?": shortcuts.open,
    }),
  ];
  for (const kind of ["pointerdown", "keydown"]) {
    const touch = (event) => {
      if (!mute.contains(event.target)) tone.unlock();
    };
    addEventListener(kind, touch);
    unbind.push(() => removeEventListener(kind, touch));
  }
  element.dataset.flight = "connecting";
  panels.strips.append(stateOf("loading", "Connecting to the flight", "The strips begin with its first sample."));

  const connection = createConnection(id, {
    hello: greet,
    frames: (frames) => (held === null ? take(frames) : keep(frames)),
    state: ({ state, reason }) => assess({ state, reason }),
    alarm: (given) => notice(given),
    transport: steer,
    reset: restart,
    link: relink,
    over,
  });

  function greet(given, again) {
    hello = given;
    const { channels, epsilon, lead, dt } = given;
    if (!again) {
      timeline = createTimeline({ seconds: windowOf(given), staleAfter: given.stale_after });
      gauge = createRiskGauge(panels.gauge, { timeline });
      chart = createStripChart(panels.strips, { channels, epsilon, lead, dt, timeline, onExceedance: exceeded });
      history = createSourceHistory(api, path, given.transport);
      if (given.source.kind === "recording") annotate(given.source);
    }
    alarm.describe({ epsilon, lead, limits: limitsOf(channels) });
    steer(given.transport);
    assess({ state: given.state, reason: given.reason }, true);
    for (const one of given.alarms) notice(one);
    title();
    if (again) {
      events.add({ t: null, text: `connected again ${given.server_time.slice(11, 19)} UTC` });
      scene.wake();
      if (last !== null && said.state === last.state) {
        chart.push(last); // not a new sample: only its state, after the loss
        show(last);
      }
    }
  }

  function annotate(source) {
    const failed = (error) => events.add({ t: null, text: `notes could not be read: ${reason(error)}`, level: "caution" });
    const found = (event) => {
      events.add(event);
      markScrub();
    };
    notes = createReplayNotes({ api, source, now: () => last?.t ?? steered.position, found, fail: failed });
    panels.events.append(notes.element);
  }

  function take(frames) {
    if (frames.length === 0) return;
    chart.push(frames);
    last = frames.at(-1);
    for (const frame of frames) if (alerts(frame)) hold(frame);
    show(last);
    transport.moved(last.t);
  }

  function keep(frames) {
    held.push(...frames);
    const wall = performance.now();
    if (wall - sought < FETCHING) timeline.heard(wall);
  }

  function show(frame) {
    if (frame.state !== said.state || frame.reason !== said.reason) assess({ state: frame.state, reason: frame.reason });
    const shown = frame.state === "ok" && lasting !== null ? lasting.frame : frame;
    const note = shown === frame ? "" : `alert at ${formatTime(shown.t, 0.01)} s, now ${riskText(frame.p_value, hello.epsilon)}`;
    gauge.update({ ...shown, note, epsilon: hello.epsilon });
    alarm.setAlert(alerts(frame));
  }

  /** An alert may last one sample, too short for an eye: it stays on the gauge for a while, with the present risk below it. */
  function hold(frame) {
    const riskiest = lasting !== null && lasting.frame.p_value > frame.p_value ? lasting.frame : frame;
    lasting = { frame: riskiest, until: performance.now() + HELD };
    refreshed = 0;
  }

  /** What the monitor can say now; a word in place of a number where it can say nothing. */
  function assess({ state, reason }, quiet = false) {
    const changed = shownState({ state, reason }) !== shownState(said);
    said = { state, reason };
    alarm.setState(said);
    if (state !== "ok") {
      gauge.update({ state, reason, p_value: null, epsilon: hello.epsilon });
      chart?.setState({ state, reason });
      alarm.setAlert(false);
    }
    if (!changed || quiet) return;
    const t = last?.t ?? origin;
    const why = reason ? `: ${reason}` : "";
    events.add({ t, text: `monitor ${shownState(said).replace("_", " ")}${why}`, level: state === "ok" ? "" : "caution" });
  }

  function notice(given) {
    const fresh = !raised.has(given.number);
    raised.add(given.number);
    alarm.take(given);
    title();
    if (fresh) events.add({ t: given.t, text: alertText(given, hello.epsilon), level: "alert" });
    if (given.acknowledged) {
      events.add({ t: given.t, text: `acknowledged by ${given.by}` });
      chart?.acknowledge();
    }
    markScrub();
  }

  function exceeded({ key, symbol, t, value }) {
    const { limit } = hello.channels.find((channel) => channel.key === key);
    if (Math.abs(chart.values(t - hello.dt)[key]) >= limit) return; // acknowledged while beyond it
    events.add({ t, text: `${symbol} reached its limit: ${value.toFixed(3)}`, level: "caution", seen: drawing });
    markScrub();
  }

  function title() {
    document.title = `${alarm.open() > 0 ? "▲ ALERT – " : ""}${hello.name} – Forewarn`;
  }

  function markScrub() {
    const raised = events.times("alert").map((t) => ({ t, level: "alert" }));
    transport.mark([...raised, ...(notes?.times() ?? [])]);
  }

  function steer(given) {
    steered = given;
    timeline.setTransport(given);
    transport.show(given);
  }

  /** After a seek or a loop: clear, and draw what lies before the point in the source. */
  async function restart({ t }) {
    const mine = ++turn;
    last = null;
    origin = t;
    held = [];
    sought = performance.now();
    const before = await history.before(t);
    if (mine !== turn || chart === null) return;
    const frames = held;
    held = null;
    chart.clear();
    lasting = null;
    drawing = true;
    if (before.length > 0) chart.push(before);
    drawing = false;
    take(frames);
  }

  function relink(link) {
    element.dataset.flight = link;
    transport.setUsable(link === "open");
    alarm.setLinked(link === "open");
    panels.lost.hidden = link !== "lost";
    if (link !== "lost" || hello === null) return;
    gauge.update({ state: "stale", reason: LOST, epsilon: hello.epsilon });
    chart?.setState({ state: "stale", reason: LOST });
    said = { state: "stale", reason: LOST };
    alarm.setState(said);
    alarm.setAlert(false);
    events.add({ t: last?.t ?? null, text: "connection to the server lost", level: "caution" });
  }

  function go(t) {
    if (hello?.transport.seekable) transport.seek(t);
    else chart?.setWindow(t - 5, t + 5);
    chart?.setCursor(t);
  }

  let refreshed = 0;
  function refresh(wall) {
    if (wall - refreshed < STATUS_EVERY) return;
    refreshed = wall;
    if (connection.link === "lost") put(panels.lost, lostText(connection.retryIn(wall)));
    if (lasting !== null && wall > lasting.until) {
      lasting = null;
      if (last !== null) show(last);
    }
    const stale = timeline?.stale(wall) ?? false;
    status.update({
      source: hello === null ? "–" : sourceText(hello.source, hello.name),
      monitor: hello?.monitor.name ?? "–",
      validity: hello?.validity,
      link: connection.link,
      patience: timeline?.patience ?? Infinity,
      playing: steered.playing,
      live: true,
      state: stale ? "stale" : shownState(said),
      alert: !stale && (lasting !== null || last?.alert === true),
      figures: connection.figures(wall),
    });
  }

  return {
    close: () => {
      turn += 1;
      connection.close();
      alarm.close();
      for (const release of unbind) release();
      notes?.close();
      gauge?.destroy();
      chart?.destroy();
      scene.close();
      delete element.dataset.flight;
    },
  };
}

function lostText(seconds) {
  const when = seconds >= 1 ? `in ${seconds.toFixed(0)} s` : "now";
  return `▲ Connection lost. Nothing shown is live. The page connects again by itself, next ${when}; if that goes on, check that the server runs.`;
}
