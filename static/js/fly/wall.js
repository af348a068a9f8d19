/**
 * Wall mode: the state, the limiting channels, gauge, scene and clock fill the screen, to be read from across the room.
 *
 * The address carries it (`?wall`), so that a link opens it. Sizes are in static/wall.css: on a 55-inch screen the state
 * has at least 40 minutes of arc at 5 m, every other text at least 16.
 *
 * createWall(element, view, address, tone) -> Wall     element: of the parts that are shown here only.   view: of the flight
 *     address: see ../lib/address.js.   tone: null where none sounds
 *   keys           {key: act}
 *   button         opens it
 *   show({words: [state, beside], level, mode, name, utc, t, channels, y, sensor, latched, why, widest})     drawn only while it is open
 *     mode: where the samples come from, as on the status strip.   name: of flight and monitor.   y: of the newest sample by channel, null while none is
 *     current.   sensor: of the newest frame.   latched: the exceedances that the strips show.   why, widest: see withoutLimits of flight_monitors.js
 *   close()        the view ends
 * limitRows(channels, y, latched, widest) -> [{channel, value, exceeded, margin}]     of the MOST limited channels nearest to
 *     their limits, or furthest beyond; margin: 1 at the limit.   value: NaN for none.   exceeded: the latched one, or null
 *     widest: limits by key in place of the channels' own, beyond which alone a channel is given; null for none
 */

import { secondsText } from "../lib/clock.js";
import { button, formatted, h, put } from "../lib/dom.js";
import { isBeyond, limitsOf, limitText, marginOf, withLimits } from "../lib/limits.js";
import { magnitudeIn, quantity, sensorPeak, sensorText } from "../lib/numbers.js";
import { soundWords } from "./alarms/tone.js";
import { showMode } from "./status_strip.js";

const MOST = 3;
const LETTERS = 8; // of a name
const ROOM = 1.25; // of a bar, in limits
const NAME = "wall";

export function createWall(element, view, address, tone = null) {
  const word = h("p.wall-state");
  const source = h("strong.wall-mode");
  const sound = h("strong.wall-sound");
  const called = h("span.wall-flight");
  const beside = h("span");
  const clock = h("p.wall-clock");
  const without = h("li.wall-why", { hidden: true });
  const list = h("ol.wall-limits", { "aria-label": "Channels nearest to their limits" }, without);
  const life = new AbortController();
  element.append(h("div.wall-head", word, h("p.wall-beside", beside, called)), h("p.wall-source", source, sound), clock, list);
  document.addEventListener("fullscreenchange", followScreen, { signal: life.signal });
  let rows = [];
  let last = null; // shown when it is opened
  if (tone !== null) life.signal.addEventListener("abort", tone.subscribe(showSound));
  showSound();
  set(address.get(NAME) !== null);
  address.follow(NAME, (text) => open(text !== null));

  const isOpen = () => !element.hidden;

  function set(open) {
    element.hidden = !open;
    view.toggleAttribute("data-wall", open);
    if (open && last !== null) draw(last);
  }

  function turn(wanted) {
    if (wanted === isOpen()) return;
    address.set(NAME, wanted ? "" : null);
    address.write();
    open(wanted);
  }

  function open(wanted) {
    set(wanted);
    if (wanted) document.documentElement.requestFullscreen?.().catch(() => {}); // refused: it fills the window
    else if (document.fullscreenElement) document.exitFullscreen();
  }

  /** Escape leaves a full screen without a key for the page. */
  function followScreen() {
    if (document.fullscreenElement === null) turn(false);
  }

  /** Only where an alarm would not be heard. */
  function showSound() {
    const state = tone?.state ?? "on";
    put(sound, state === "on" ? "" : soundWords(tone));
  }

  function draw({ words: [state, also = ""], level, mode, name = "", utc = null, t = null, channels = [], y = null, sensor = {}, latched = [], why = "", widest = null }) {
    element.dataset.level = level;
    showMode(source, mode);
    put(called, name);
    put(word, state);
    put(beside, also);
    put(clock, [utc && `${utc.toISOString().slice(11, 19)} UTC`, t !== null && secondsText(t)].filter(Boolean).join(" · "));
    const nearest = limitRows(channels, y, latched, widest);
    without.hidden = why === "";
    put(without, `◆ ${why}`);
    const keys = nearest.map(({ channel }) => channel.key).join();
    if (keys !== list.dataset.keys) {
      rows = nearest.map(({ channel }) => rowOf(channel));
      list.replaceChildren(without, ...rows.map((row) => row.item));
      list.dataset.keys = keys;
    }
    nearest.forEach((reading, k) => rows[k].show({ ...reading, sensor: sensor[reading.channel.key] }));
  }

  return {
    keys: { w: () => turn(!isOpen()), Escape: () => turn(false) },
    button: button("Wall", () => turn(true), { class: "button button-small", title: "Full screen, to be read from across the room (key W); Escape leaves it" }),
    show: (now) => {
      last = now;
      if (isOpen()) draw(now);
    },
    close: () => life.abort(),
  };
}

function limitRows(channels, y, latched, widest = null) {
  const all = (widest === null ? channels : withLimits(channels, widest)).map((channel, k) => {
    const limits = limitsOf(channel);
    const value = y?.[k] ?? NaN;
    const exceeded = latched.find(({ channel: key }) => key === channel.key) ?? null;
    const marginAt = (at) => (limits === null || !Number.isFinite(at) ? -Infinity : marginOf(limits, channel.rest ?? 0, at)[1]);
    return { channel, k, limits, value, exceeded, margin: marginAt(value), worst: Math.max(marginAt(value), marginAt(exceeded?.value)) };
  });
  const limited = all.filter(({ limits, worst }) => limits !== null && (widest === null || worst >= 1));
  const nearest = limited.sort((a, b) => b.worst - a.worst || a.k - b.k).slice(0, MOST);
  return nearest.sort((a, b) => a.k - b.k);
}

/** Names of channels often differ at their ends. */
function shortened(symbol) {
  return symbol.length <= LETTERS ? symbol : `${symbol.slice(0, LETTERS / 2)}…${symbol.slice(1 - LETTERS / 2)}`;
}

function rowOf(channel) {
  const value = h("span.wall-value");
  const words = h("span.wall-limit");
  const bar = h("span.wall-bar");
  const item = h("li.wall-row", h("span.wall-name", { title: channel.label }, formatted(shortened(channel.symbol))), value, h("span.wall-track", bar), words);
  let shown = "";

  function show({ channel: now, value: at, exceeded, margin: fromTrim, sensor }) {
    const known = Number.isFinite(at);
    const limits = limitsOf(now);
    const hasSensor = known && sensor !== undefined;
    const margin = Math.max(fromTrim, hasSensor ? marginOf(limits, now.rest ?? 0, sensor)[1] : 0);
    const current = known ? `${margin >= 1 ? "▲ " : ""}${quantity(now, at)}` : "–";
    const basis = hasSensor ? sensorText(now, sensor) : "";
    const limit = exceeded && magnitudeIn(now, limits[isBeyond(limits, exceeded.value)[0] ? 0 : 1]);
    const peak = exceeded && (exceeded.skipped ? "SKIPPED" : quantity(now, exceeded.value));
    put(value, exceeded ? `▲ ${peak}` : current); // the peak is the state; the current value is not
    const of = exceeded && (exceeded.skipped ? "values beyond it were skipped" : `peak${sensorPeak(now, exceeded)}`);
    const text = exceeded ? `${of}, limit ${limit}${known ? `; now ${current} ${basis}` : ""}` : `limit ${limitText(now, limits)} ${basis}`;
    if (text !== shown) words.replaceChildren(formatted(text.replace(/(?<=\d) (?=\S)/g, "\u00a0")));
    shown = text;
    item.toggleAttribute("data-over", known && margin >= 1);
    item.toggleAttribute("data-exceeded", exceeded !== null);
    bar.style.width = known ? `${(100 * Math.min(ROOM, Math.max(0, margin))) / ROOM}%` : "0";
  }

  return { item, show };
}
