/**
 * A flight in progress: its stream drives strips, gauge, alarm line, events, status and transport.
 *
 * showLiveFlight(element, {id, api, over, recorded}) -> {close()}     over(reason): the flight has ended
 *     recorded: {Socket, beside} of a flight that is played from a file: its socket, and what replaces
 *     the scene; null for a flight of the server
 */

import { createAddress } from "../lib/address.js";
import { reason } from "../lib/api.js";
import { secondsText, setZero } from "../lib/clock.js";
import { askToConfirm, button, h, put, state as stateOf } from "../lib/dom.js";
import { addDrawer } from "../lib/draw_loop.js";
import { createEventList } from "../lib/event_list.js";
import { exceededWords, withLimits } from "../lib/limits.js";
import { sentence } from "../lib/monitors.js";
import { counted } from "../lib/numbers.js";
import { createAlarmPanel } from "./alarms/alarm_panel.js";
import { createFlightMarkers, markerNote } from "./alarms/flight_markers.js";
import { bindMuteButton, createTone } from "./alarms/tone.js";
import { createAssessmentDisplay } from "./assessment/assessment_display.js";
import { createFlightLimits, limitsNote } from "./flight_limits.js";
import { alertLevel, createSetLine, inUse, useNote, withoutLimits } from "./flight_monitors.js";
import { isStale, LEVEL_OF, levelOf, partsOf, staleText, textOf } from "./headline.js";
import { acknowledgementOf, alertText, createFlightPanels, liveZero, recordedFlag, sourceText } from "./panels.js";
import { createFollowing } from "./playback/following.js";
import { createReplayNotes } from "./playback/replay_notes.js";
import { createTransportBar } from "./playback/transport_bar.js";
import { createSceneFrame } from "./scene/scene_frame.js";
import { bindShortcuts, openShortcuts } from "./shortcuts.js";
import { createBackfill } from "./source/backfill.js";
import { createConnection, SCREEN } from "./source/connection.js";
import { createLivePanel, trimNotes } from "./source/live_panel.js";
import { createSourceAddress } from "./source/source_address.js";
import { createStatusStrip } from "./status_strip.js";
import { createTestCard } from "./test_card.js";
import { createWall } from "./wall.js";

const STATUS_EVERY = 200; // ms
const SOON = 2; // s
export const tone = createTone(); // one for the page: a browser lets it sound after the first touch

const NO_DATA = "NO DATA. The scene begins with the first sample.";
const LOGGED_OUT = "◆ The login has expired. Nothing shown is live: reload the page to log in again.";

export function showLiveFlight(element, { id, api, over, recorded = null }) {
  const path = `/flights/${encodeURIComponent(id)}`;
  const viewAddress = createAddress();
  const panels = createFlightPanels(element, viewAddress);
  const sound = panels.alone === null ? tone : createTone({ Context: null }); // the first window sounds
  const status = createStatusStrip(panels.status);
  const events = createEventList(panels.events, { go });
  const alarm = createAlarmPanel(panels.alarm, {
    tone: sound,
    acknowledge: ({ id: number }) => api.post(`${path}/alarms/${number}/acknowledge`, {}),
  });
  const transport = createTransportBar(panels.transport, {
    act: steer,
    end: recorded ? null : () => askToConfirm("End this flight?", "Its record is kept. You can fly it again.", "End flight", () => api.post(`${path}/end`, {})),
  });
  const following = createFollowing(panels.transport, { lead: () => steer("lead") });
  const markers = createFlightMarkers(
    { buttons: panels.calls, events: panels.events, last: panels.marker, refused: panels.refused, entry: panels.entry },
    { set: (marker) => api.post(`${path}/markers`, marker), now: () => timeNow(), heard: ({ kind }) => sound.caution(kind), unheard: () => sound.caution() },
  );
  const limits = createFlightLimits(panels.limits, { api, path });
  const card = createTestCard(panels.card);
  const setLine = createSetLine(panels.monitors);
  panels.transport.prepend(panels.calls);
  const scene = recorded ? besideRecording(panels.scene, recorded.beside) : createSceneFrame(panels.scene, id, viewAddress);
  const wallView = createWall(panels.wall, panels.view, viewAddress, sound);
  const keys = { ...transport.keys, ...wallView.keys, k: alarm.acknowledgeAll, t: () => notes?.write(), v: scene.nextCamera, g: () => source?.begin() };
  const life = new AbortController();
  bindControls(panels.status, { keys, markers, wallView, sound }, life.signal);
  life.signal.addEventListener("abort", addDrawer(show));
  const raised = new Set();
  const trims = new Set(); // changes that are listed
  let hello = null; // set together with display
  let display = null;
  let described = { mode: "", source: "–", monitor: ["–"] }; // for the status strip
  let notes = null; // of a replayed recording
  let source = null; // of a live flight
  let address = null;
  let resumed = 0; // restarts of the server during the flight
  let playback = { playing: true, speed: 1 }; // as the transport has it
  let shown = { text: "", wall: 0 }; // link and headline, and when they were last drawn
  let isStored = true; // by the last heartbeat
  let decided = null; // the server's headline
  let resets = 0; // of the strips
  let alarmed = -Infinity; // time of the newest alarm of a live source, which may come before its sample [s]
  let cautioned = false; // about stale samples, which only this page knows

  const timeNow = () => display?.newest?.t ?? null;
  const seqNow = () => display.newest?.seq ?? -1;
  const backfill = createBackfill({ api, path, insert: (frames, complete) => display.chart.insert(frames, complete) });
  element.dataset.flight = "connecting";
  panels.strips.append(stateOf("loading", "Connecting to the flight", "The strips begin with its first sample."));

  const connection = createConnection(id, {
    hello: onHello,
    frames: (frames) => onFrames(frames, display.onFrames(withForecast(frames))),
    state: (assessment) => display.setAssessment(assessment),
    status: onStatus,
    alarm: onAlarm,
    marker: onMarker,
    transport: onTransport,
    screens: onScreens,
    live: onLive,
    limits: onLimits,
    monitor: onMonitor,
    heartbeat: onHeartbeat,
    reset: onReset,
    gap: backfill.need,
    link: onLink,
    over,
  }, recorded ?? {});

  function onHello(message, again) {
    hello = Object.assign(hello ?? {}, message); // one object, which the display reads too
    const { state, reason: why, cause } = hello;
    if (!again) {
      display = createAssessmentDisplay(panels, { hello, api, path, alarm, events, address: viewAddress });
      if (hello.source.kind === "recording") showNotes();
      if (hello.source.kind === "journal") showFlownMarkers(hello.source.flight_id);
      if (hello.live) {
        showSource();
        display.timeline.setAge((wall) => connection.figures(wall).age);
      }
    }
    if (hello.head < seqNow()) forgetFrom(hello.head);
    describe();
    showLimits(hello.limits);
    onTransport(hello.transport);
    if (hello.live) onLive(hello.live);
    showTrims(hello.trims);
    display.setAssessment({ state, reason: why, cause }, true);
    showEventsUntil(hello.transport.position);
    hello.alarms.forEach(onAlarm);
    markers.offer(hello.marker_kinds);
    hello.markers.forEach(onMarker);
    onStatus(hello);
    if (!again) return;
    const when = `${hello.server_time.slice(11, 19)} UTC`;
    const restarts = hello.live?.resumed ?? 0;
    if (restarts > resumed) events.add({ t: timeNow(), text: `server restarted, reconnected ${when}; the flight continues, and its source must too`, level: "caution" });
    else events.add({ t: null, text: `reconnected ${when}` });
    resumed = restarts;
    scene.wake();
    display.resume();
  }

  /** The alarm authority, on the status strip and in the words of alarms. */
  function describe() {
    const { channels, epsilon, lead, warnings, mode, validity, no_rest: noRest } = hello;
    setLine.show(hello);
    card.show(hello);
    described = { mode, source: sourceText(hello.source, hello.name), monitor: inUse(hello), noRest, warnings, validity };
    alarm.show({ flight: { epsilon, alertAbove: alertLevel(hello), guarantee: hello.guarantee, lead, warnings, limits: exceededWords(withLimits(channels, hello.monitors[0].limits)), channels } });
  }

  /** Samples that the killed server had not stored are gone: the source must send them again. */
  function forgetFrom(head) {
    const n = seqNow() - head;
    events.add({ t: null, text: `${counted(n, "sample")} shown, not stored when the server was killed: the source must send again`, level: "caution" });
    backfill.clear();
    display.forget();
  }

  function onStatus(headline) {
    decided = headline;
    display.setHeadline(headline);
    display.chart.latch(headline.latched);
    showHidden();
  }

  /** The forecast of the newest sample, as hello has it: a paused flight sends no other. */
  function withForecast(frames) {
    const newest = frames.find(({ seq }) => seq === hello.head);
    if (newest !== undefined && hello.ahead !== null) newest.ahead ??= hello.ahead;
    return frames;
  }

  function onFrames(frames, newest) {
    scene.show(newest, hello);
    if (newest === null) return;
    address?.show({ isWaiting: false });
    source?.show({ why: newest.reason });
    showEventsUntil(newest.t);
    notes?.moved(newest.t);
  }

  /** Events later than the time shown are set apart. */
  function showEventsUntil(t) {
    if (hello.transport.seekable) events.showUntil(t);
  }

  async function onReset({ seq, t, since, held }) {
    const mine = ++resets;
    backfill.clear();
    backfill.hold();
    hello.held = held;
    showEventsUntil(t);
    const newest = await display.restart(t, () => display.chart.setLimits(hello.channels, hello.held));
    if (mine === resets) {
      backfill.need(since, seq - 1);
      backfill.release();
    }
    transport.arrived();
    onFrames([], newest);
  }

  function onAlarm(raisedAlarm) {
    const { number, t, level, kind, acknowledged } = raisedAlarm;
    if (hello.live) alarmed = Math.max(alarmed, t);
    const fresh = !raised.has(number);
    raised.add(number);
    alarm.onAlarm(raisedAlarm);
    const event = { t, text: alertText(raisedAlarm, alertLevel(hello), hello.channels), level: LEVEL_OF[level], seen: kind === "limit" };
    note({ event: fresh && event, flag: recordedFlag(raisedAlarm) });
    if (acknowledged) events.add(acknowledgementOf(raisedAlarm, hello.mode === "live"));
  }

  function onMarker(marker) {
    if (markers.onMarker(marker)) note(markerNote(marker));
    showHidden();
  }

  /** Of the flight that is replayed as it was shown. */
  async function showFlownMarkers(flown) {
    const markers = await api.get(`/flights/${encodeURIComponent(flown)}/markers`).catch(() => []);
    for (const marker of markers) note(markerNote(marker));
  }

  function note({ event, flag }) {
    if (event) events.add(event);
    if (flag) display.chart.flag(flag);
    markEvents();
  }

  /** New limits from the next sample on, set by hand or by the flight condition. */
  function onLimits({ limits: inForce, channels }) {
    hello.channels = channels;
    if (inForce !== null) {
      const before = hello.held.length > 0 ? hello.held : [{ t: null, limits: hello.monitors[0].limits }];
      hello.held = [...before, { t: inForce.since, limits: inForce.limits }];
    }
    showLimits(inForce);
    if (inForce === null) return; // a seek to before the first limits
    note(limitsNote(inForce));
  }

  /** Another monitor of the set from the next sample on, or none. */
  function onMonitor({ held, type: _, ...authority }) {
    Object.assign(hello, authority);
    hello.held = [...hello.held, held];
    describe();
    display.useAuthority();
    showLimits(null);
    note({ event: useNote(hello, held.t), flag: null });
  }

  function showLimits(inForce) {
    display.chart.setLimits(hello.channels, hello.held);
    limits.show(inForce, hello.channels, hello.monitor_set);
  }

  function onHeartbeat({ problem, lost }) {
    if ((problem === "") === isStored) return;
    isStored = problem === "";
    const text = isStored ? `recording resumed; samples lost: ${lost}` : `not recorded: ${problem}`;
    events.add({ t: timeNow(), text, level: "caution" });
  }

  function showSource() {
    resumed = hello.live.resumed;
    address = createSourceAddress(panels.address, id);
    address.describe(hello);
    address.show({ isWaiting: hello.head < 0 });
    panels.calls.after(panels.live);
    source = createLivePanel(
      { line: panels.live, problem: panels.problem },
      { begin: () => api.post(`${path}/manoeuvre`), accept: (sender) => api.post(`${path}/sender`, { sender }), address: address.toggle, events, note },
    );
  }

  const manoeuvres = () => hello.live?.begun ?? hello.begun ?? [];

  function onLive(live) {
    hello.live = live;
    setZero(...liveZero(live));
    if (panels.problem.hidden && live.problem !== "") sound.caution();
    source.show({ live, lead: hello.lead });
    alarm.show({ doubts: live.doubts });
    showTrims(live.trims);
    address.describe({ ...hello, live });
  }

  function showTrims(given) {
    const fresh = (given ?? []).filter(({ t, channel }) => !trims.has(`${t} ${channel}`));
    fresh.forEach(({ t, channel }) => trims.add(`${t} ${channel}`));
    trimNotes(fresh, hello.channels).forEach(note);
  }

  function steer(action, value = null) {
    return api.post(`${path}/transport`, { action, value, screen: SCREEN });
  }

  function onScreens(message) {
    following.show(message);
    transport.show(playback, following.isFollowing);
  }

  /** Why this screen is not where the replay is. */
  function behind(wall) {
    if (connection.link !== "open") return "no connection";
    const [t, { timeline }] = [timeNow(), display];
    const at = playback.playing ? t : playback.position;
    const { start, end } = timeline.view(wall);
    if (t === null) return "no sample yet";
    if (Math.abs(t - at) > 1.5 * hello.dt) return `shows ${secondsText(t)}, the replay is at ${secondsText(at)}`;
    if (t < start || t > end) return `its window shows ${secondsText(start)} to ${secondsText(end)}, the replay is at ${secondsText(t)}`;
    const { latency } = connection.figures(wall);
    return playback.playing && latency > 1000 * hello.stale_after ? `${(latency / 1000).toFixed(1)} s late` : "";
  }

  function onTransport(message) {
    playback = message;
    display.timeline.setTransport(message);
    transport.show(message, following.isFollowing);
  }

  function onLink(link) {
    element.dataset.flight = link;
    const isLinked = link === "open";
    transport.setUsable(isLinked);
    source?.show({ isLinked });
    address?.show({ isLinked });
    alarm.show({ isLinked });
    display?.setLinked(isLinked);
    if (link === "lost") display?.lose();
    showHidden();
    if (link !== "lost" || display === null) return;
    events.add({ t: timeNow(), text: connection.loggedOut ? "the login has expired" : "connection to the server lost", level: "caution" });
  }

  function showNotes() {
    const { source } = hello;
    const fail = (error) => events.add({ t: null, text: `notes could not be read: ${reason(error)}`, level: "caution" });
    notes = createReplayNotes({ api, source, now: () => transport.t, add: events.add, marked: markEvents, fail });
    panels.events.append(notes.element);
  }

  /** Alarm line and title follow the headline. The page itself sounds the caution of stale samples. */
  function follow(headline, cause) {
    alarm.show({ headline });
    const words = levelOf(headline) === "ok" ? "" : `${textOf(headline, cause)} – `;
    const title = `${words}${hello.name} – Forewarn`;
    if (document.title !== title) document.title = title;
    const alone = isStale(headline) && !isStale(decided) && playback.playing;
    if (alone && !cautioned) sound.caution("stale");
    cautioned = alone;
  }

  /** The scene does not know that the link is lost: a cover keeps it from passing as current. */
  function coverScene(headline, wall) {
    const lost = connection.link === "lost";
    const stale = isStale(headline);
    const blank = headline?.status === "no_data" && hello.mode === "live";
    panels.lost.hidden = !lost && !stale && !blank;
    panels.lost.toggleAttribute("data-calm", blank);
    panels.lost.toggleAttribute("data-lost", lost);
    const words = lost ? (connection.loggedOut ? LOGGED_OUT : lostText(connection.retryIn(wall))) : blank ? NO_DATA : coverText(display?.cause, connection.figures(wall).age);
    if (panels.lost.textContent === words) return;
    const cut = words.indexOf(". ") + 1;
    panels.lost.replaceChildren(h("strong", words.slice(0, cut)), h("span", words.slice(cut))); // the wall has room for the first
  }

  function markEvents() {
    const alerts = events.times("alert").map((t) => ({ t, level: "alert" }));
    transport.mark([...alerts, ...(notes?.times() ?? [])]);
  }

  function go(t) {
    if (transport.steers()) transport.seek(t);
    else display?.chart.setWindow(t - 5, t + 5);
    display?.chart.setCursor(t);
  }

  /** A hidden page draws nothing, but keeps its title current. */
  function showHidden() {
    if (document.hidden) show(performance.now());
  }

  /** Gauge, link, status, title, alarm line and scene change in one update. */
  function show(wall) {
    const condition = display?.refresh(wall) ?? null;
    const headline = condition && { ...condition, call: markers.show(condition.call ?? null) };
    transport.moved(timeOf(display?.chart.newest ?? null));
    if (hello?.transport.seekable) following.draw(behind(wall));
    const text = `${connection.link} ${headline === null ? "" : textOf(headline, display.withdrawal)}`;
    if (text === shown.text && wall - shown.wall < STATUS_EVERY) return;
    shown = { text, wall };
    coverScene(headline, wall);
    if (headline !== null) {
      follow(headline, display.withdrawal);
      source?.show({ isStale: isStale(headline) });
      card.draw({ frame: display.newest, begun: manoeuvres(), condition: hello.live?.condition ?? null, ring: display.chart.ring, stale: isStale(headline) });
      alarm.show({ stale: isStale(headline) ? staleText(display.cause, display.timeline.age(wall)) : "" });
    }
    const figures = connection.figures(wall);
    showWall(headline, figures.utc);
    status.update({
      ...described,
      link: connection.link,
      playing: playback.playing,
      live: true,
      recorded: recorded !== null,
      headline,
      cause: display?.withdrawal,
      staleAfter: display?.timeline.staleAfter ?? Infinity,
      figures: { ...figures, skipped: backfill.skipped },
    });
  }

  /** The clock is never behind an alarm: of the newest sample drawn [s], or an alarm shortly after it. */
  function timeOf(t) {
    return t !== null && alarmed > t && alarmed - t < SOON ? alarmed : t;
  }

  function showWall(headline, utc) {
    if (headline === null) return wallView.show({ words: [connection.link.toUpperCase()], level: "advisory", mode: described.mode, utc });
    const [state, beside] = partsOf(headline, display.withdrawal);
    const [word, since] = state.split(/ (?=first at )/); // one line
    const without = withoutLimits(hello);
    const reason = isStale(headline) ? staleText(display.cause, display.timeline.age(performance.now())) : without.why === "" ? display.reason : "";
    return wallView.show({
      words: [word, [since, beside, reason].filter(Boolean).join(" · ")],
      level: levelOf(headline),
      mode: hello.mode,
      name: [hello.name, described.monitor[0]].join(" · "),
      utc,
      t: timeOf(timeNow()),
      channels: hello.channels,
      y: isStale(headline) ? null : (display.newest?.y ?? null),
      sensor: display.newest?.sensor,
      latched: decided.latched ?? [],
      ...without,
    });
  }

  return {
    close: () => {
      wallView.close();
      connection.close();
      backfill.clear();
      alarm.close();
      life.abort();
      notes?.close();
      display?.close();
      scene.close();
      delete element.dataset.flight;
    },
  };
}

function besideRecording(element, beside) {
  element.setAttribute("aria-label", "What happens");
  element.replaceChildren(beside);
  const none = () => {};
  return { show: none, nextCamera: none, wake: none, close: none };
}

/** Keys, their list, and the mute button. */
function bindControls(element, { keys, markers, wallView, sound }, signal) {
  const open = () => openShortcuts(markers.shortcuts());
  const mute = h("button.button.button-small.mute", { type: "button" });
  const list = button([h("span.roomy", "Keys "), "?"], open, { class: "button button-small", title: "Keyboard shortcuts (key ?)", "aria-label": "Keys ?" });
  element.append(h("div.row.spread", wallView.button, mute, list));
  bindMuteButton(mute, sound, signal);
  bindShortcuts({ ...keys, m: () => mute.click(), "?": open }, markers.keys, signal);
}

function coverText(cause, age) {
  return `◆ STALE. ${sentence(staleText(cause, age))} The attitude shown here is out of date.`;
}

function lostText(seconds) {
  const when = seconds >= 1 ? `in ${seconds.toFixed(0)} s` : "now";
  return `◆ Connection lost. Nothing shown is live. The page reconnects by itself, next ${when}; if this continues, check that the server runs.`;
}
