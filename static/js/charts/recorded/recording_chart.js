/**
 * Strips of a whole recording: channels, limits, risk, manoeuvres, markers; from tiles, at any zoom.
 *
 * Between manoeuvres a trace is faint, since nothing is assessed there. Withdrawn risk is grey with
 * the word INVALID; a second recording laid over the first is dashed, in another colour.
 *
 * createRecordingChart(host, options) -> RecordingChart
 *     channels    [Channel], see ../strips.js
 *     order       keys from top to bottom; default: limited channels, margin, risk, others
 *     sources     one or two: [{load(start, end, bins) -> Promise<tiles>, start, end, dt, offset, manoeuvres}]
 *                 start, end: in the chart's time, which is the recording's own less `offset` [s];
 *                 manoeuvres: [{start, end, withdrawn}] of its manoeuvres in the chart's time, or null
 *     held        [{start, end, limits}]    limits by key in force from start to end, null if unknown;
 *                 by default the channels' own
 *     exceeded    keys of channels that exceeded a limit: their strips are never hidden
 *     flags       [{key, t, word}]    moments that are marked in a channel's strip
 *     simulated, starts, address, panels     see ../strip_chart.js
 *     chosen(item)      a manoeuvre or marker of the lane was pressed
 *     went(event)       the reader asked for an event; by default its time is brought into view
 *
 * RecordingChart
 *   setLane([{id, row, start, end | null, text, short, mark, level, title, quiet}])     row: 0 is the top one
 *     short: used where the text does not fit; mark: sign of the level, besides its colour; quiet: only a bar, no button
 *   setEvents([{t, ...}])       that the keys N and P step through
 *   show(start, end), setCursor(t), setMarking(bool)   marking: a drag sets A and B
 *   window, destroy(), cross      cross: see ../strip_chart.js
 */

import { createAddress, keepWindow } from "../../lib/address.js";
import { reason } from "../../lib/api.js";
import { intervalText } from "../../lib/clock.js";
import { button, h } from "../../lib/dom.js";
import { limitsByKey, widest } from "../../lib/limits.js";
import { durationText, formatValue, shownIn } from "../../lib/numbers.js";
import { layOut, stripArrangement } from "../layout.js";
import { NOTHING, rangeText } from "../readings.js";
import { createStripChart } from "../strip_chart.js";
import { arranged, hasMargin, isSummary, limitedFirst, MARGIN, marginAt, stripOf } from "../strips.js";
import { createTimeWindow } from "../time_window.js";
import { bandsOf, between, cellsOf } from "./cells.js";
import { createOverviewBar } from "./overview_bar.js";
import { createTileCache } from "./tiles.js";

const SCALE = { narrowAfter: 400, spare: 1 }; // ms until an axis narrows to what is in view: a link shows the same
const EDGE = 0.03; // share of the window; an event nearer to its edge is moved inside
const ROW = 1.625; // rem
const THIN = 16; // px a manoeuvre below which only its bar is seen
const COLOURS = ["trace", "forecast"];
const FAINT = 0.5;

export function createRecordingChart(host, options) {
  const { sources, label = "Recording" } = options;
  const start = Math.min(...sources.map((source) => source.start));
  const end = Math.max(...sources.map((source) => source.end));
  const dt = Math.min(...sources.map((source) => source.dt));
  const width = Math.max(end - start, 1e-3);
  const timeWindow = createTimeWindow({ width, least: Math.min(width, 20 * dt), start, end: start + width });
  const { address = createAddress(), exceeded = [] } = options;
  keepWindow(address, timeWindow);
  const order = options.order ?? usualOrder(options.channels);
  const strips = arranged(
    order.map((key) => withHeld(stripOf(key, options.channels, SCALE), options.held)),
  );
  const arrangement = stripArrangement(address, strips);
  arrangement.force(exceeded);
  const layout = layOut(host, strips, label, arrangement);
  const { lane: laneHost, overview, fail } = layOutMore(host, layout);
  const lane = createEventLane(laneHost, { chosen: (item) => options.chosen?.(item) });
  const source = createSource(sources, { ...options, strips, timeWindow, dt, end, fail });
  const key = order.includes("risk") ? "risk" : strips[0].key;
  const bar = createOverviewBar(overview, stripOf(key, options.channels, SCALE), {
    timeWindow,
    start,
    end,
    entire: source.entire,
    manoeuvres: sources[0].manoeuvres ?? [],
  });
  const chart = createStripChart(host, {
    ...options,
    scale: SCALE,
    strips,
    source,
    layout,
    address,
    extras: [bar, lane],
    steps: { back: () => go(-1), next: () => go(1) },
  });
  let events = [];

  /** To the event after or before the cursor. */
  function go(direction) {
    const from = timeWindow.pinned;
    const here = Number.isFinite(from) ? from : -direction * Infinity;
    const later = (event) => direction * (event.t - here) > 1e-6;
    const event = direction > 0 ? events.find(later) : events.findLast(later);
    if (event === undefined) return;
    if (options.went) options.went(event);
    else setCursor(event.t);
  }

  function setCursor(t) {
    timeWindow.setHover(null);
    timeWindow.setCursor(t);
    const view = timeWindow.view();
    const width = view.end - view.start;
    if (t < view.start + EDGE * width || t > view.end - EDGE * width) {
      timeWindow.setWindow(t - width / 2, t + width / 2);
    }
  }

  return {
    window: timeWindow,
    cross: chart.cross,
    editor: chart.editor,
    setCursor,
    setLane: (items) => {
      lane.show(items);
      chart.measure(); // a row more leaves the strips less room
    },
    setEvents: (given) => {
      events = [...given].sort((a, b) => a.t - b.t);
    },
    show: (from, to) => {
      timeWindow.keepPlace();
      timeWindow.setWindow(from, to);
    },
    setMarking: chart.setMarking,
    destroy: () => {
      source.close();
      chart.destroy();
    },
  };
}

function usualOrder(channels) {
  const { limited, others } = limitedFirst(channels);
  return [...limited, ...(hasMargin(channels) ? [MARGIN] : []), "risk", ...others];
}

/** A strip with its limits by time, where these were not always the channel's own. */
function withHeld(strip, given) {
  if (isSummary(strip) || !given) return strip;
  const held = given.map(({ start, end, limits }) => ({
    from: start - 1e-9, // a sample at the start is judged by them, one at the end is not
    to: end - 1e-9,
    limits: limitsByKey(limits, strip.key),
  }));
  strip.axis.setLimits(widest(held.map(({ limits }) => limits)) ?? strip.limits);
  return { ...strip, held };
}

/** Lane, overview, and an error with a way to read again. */
function layOutMore(host, { rows, axis, bar }) {
  const lane = h("div", {});
  const overview = h("canvas", { "aria-hidden": true });
  const failure = h("div", { class: "chart-failure", role: "alert", hidden: true });
  const plot = h("div", { class: "strip-plot" }, overview);
  host.classList.add("recording-chart");
  rows.before(lane);
  axis.closest(".strip-axis").after(h("div", { class: "strip-axis overview" }, plot), failure);
  bar.mode.hidden = true;

  function fail(words, again) {
    const retry = () => {
      failure.hidden = true;
      again();
    };
    const retryButton = button("Read again", retry, { class: "button button-small" });
    failure.replaceChildren(h("span", {}, words), retryButton);
    failure.hidden = false;
  }

  return { lane, overview, fail };
}

/** Tiles as a source of strip_chart.js. */
function createSource(sources, { strips, timeWindow, dt, end, alertAbove = NaN, flags = [], fail }) {
  const isMargined = strips.some(({ key }) => key === MARGIN);
  const loading = ({ load, offset = 0 }) => (isMargined ? async (...asked) => withMargin(await load(...asked), strips, offset) : load);
  const caches = sources.map((source) => createTileCache({ ...source, load: loading(source), arrived: changed, failed }));
  const all = sources.some(({ manoeuvres }) => !manoeuvres)
    ? null
    : sources.flatMap(({ manoeuvres }) => manoeuvres);
  const own = sources[0].manoeuvres ?? null; // of the recording that bands are drawn of
  let sets = caches.map(() => null); // as drawn
  let trails = null; // tiles of the cross plots' trails
  let turn = 0; // counts what arrives
  let revision = 0; // counts changes of what is drawn

  function changed() {
    turn += 1;
  }

  function failed(error) {
    fail(reason(error), () => {
      [...caches, trails].forEach((cache) => cache?.retry());
      changed();
    });
  }

  function read(window) {
    const { view, columns, x } = window;
    for (const cache of caches) cache.want(view, columns);
    const before = sets;
    sets = caches.map((cache) => cache.best(view, columns));
    if (sets.some((set, k) => set !== before[k])) revision += 1;
    const cells = sets.map((set, k) => cellsOf(set, sources[k].manoeuvres ?? null, window));
    const parts = cells.map((each, k) => ({
      cells: each,
      colour: COLOURS[k],
      dashed: k > 0,
      quiet: { boxes: k > 0 ? [] : between(own, x), colour: COLOURS[k], alpha: FAINT },
      withdrawn: true,
    }));
    return {
      parts: parts.filter((part) => part.cells !== null),
      bands: bandsOf(cells[0], own, x, all),
      revision,
      until: Infinity,
      now: NaN,
      lead: 0,
      ahead: null,
      tip: view.end,
      trail,
      word: "",
    };
  }

  /** From its own tiles: as fine as the samples, whatever the window shows. */
  function trail(keys, from, to, visit) {
    const view = { start: from, end: to };
    const pixels = Math.ceil((to - from) / dt) + 1;
    trails ??= createTileCache({ ...sources[0], load: loading(sources[0]), arrived: changed, failed });
    trails.want(view, pixels);
    trails.best(view, pixels)?.visit(keys, view, visit);
  }

  function valuesAt({ key }, t) {
    return sets.map((set) => set?.valueAt(key, t) ?? NOTHING);
  }

  function reading(strip, view, cursor) {
    const pinned = Number.isFinite(cursor);
    const inView = () => sets.map((set) => set?.rangeOf(strip.key, view) ?? NOTHING);
    const values = pinned ? valuesAt(strip, cursor) : inView();
    const silent = pinned && strip.risk && own !== null && !Number.isFinite(values[0].low);
    return { values, at: pinned ? "cursor" : "view", word: silent ? wordAt(cursor) : "" };
  }

  /** Why the risk strip has no number here. */
  function wordAt(t) {
    const manoeuvre = own.find(({ start, end }) => t >= start && t <= end);
    if (!manoeuvre) return "not assessed";
    const silent = manoeuvre.silent?.find(({ start, end }) => t >= start && t < end);
    const { withdrawn } = manoeuvre;
    return silent?.word ?? (withdrawn !== null && t >= withdrawn ? "INVALID" : "");
  }

  function bar({ start, end }) {
    const seconds = end - start;
    const length = seconds < 120 ? `${formatValue(seconds)} s` : durationText(seconds);
    const interval = `${intervalText(start, end, 0.1)} (${length})`;
    return { mode: null, interval };
  }

  function describe(strip) {
    const range = rangeText(strip, sets[0]?.rangeOf(strip.key, timeWindow.view()) ?? NOTHING);
    const { unit } = shownIn(strip);
    const parts = [range === "–" ? "no value in view" : `${range} ${unit} in view`];
    if (strip.risk && own?.some(({ withdrawn }) => withdrawn !== null))
      parts.push("withdrawn where invalid");
    return parts;
  }

  return {
    time: timeWindow,
    dt,
    alertAbove,
    flags,
    follows: false,
    newest: () => end,
    begin: () => {},
    stamp: () => turn,
    news: () => turn,
    read,
    reading,
    valuesAt,
    bar,
    describe,
    entire: () => caches[0].entire(),
    close: () => [...caches, trails].forEach((cache) => cache?.close()),
  };
}

/** Tiles with the margin as one more channel; its least value in a bin may be a little too low. */
function withMargin(answer, strips, offset) {
  const margins = answer.t.map((t, k) =>
    marginAt(strips, t - offset, ({ key }) => ({ low: answer.channels[key]?.low[k] ?? NaN, high: answer.channels[key]?.high[k] ?? NaN })),
  );
  const [low, high] = ["low", "high"].map((end) => margins.map((margin) => margin[end]));
  return { ...answer, channels: { ...answer.channels, [MARGIN]: { low, high } } };
}

/** Above the strips: manoeuvres with their outcome, markers and notes. chosen(item): one was pressed. */
function createEventLane(element, { chosen }) {
  const plot = h("div", { class: "lane-plot" });
  element.classList.add("event-lane");
  element.append(plot);
  let parts = [];

  function show(items) {
    parts = items.map((item) => ({ item, element: elementOf(item) }));
    plot.replaceChildren(...parts.map((part) => part.element));
    const rows = Math.max(0, ...items.map(({ row }) => row + 1));
    element.hidden = rows === 0;
    plot.style.height = `${rows * ROW}rem`;
  }

  function elementOf(item) {
    const words = h(
      "span.lane-words",
      h("span.lane-mark", { "aria-hidden": true }, item.mark ?? ""),
      h("span.lane-long", item.text.split(/(?=, )/).map((part) => h("span.lane-part", part))), // each is seen whole, or not
      item.short && h("span.lane-short", item.short),
    );
    words.classList.toggle("lane-fits", Boolean(item.short));
    const attributes = {
      class: item.end === null ? "lane-item lane-flag" : "lane-item",
      "data-level": item.level,
      "data-item": item.id,
      title: item.title,
      style: `top: ${item.row * ROW}rem`,
    };
    if (item.quiet) return h("span", attributes, words);
    const label = `${item.title ?? item.text}. Show it.`;
    const press = () => chosen(item); // by key: from the tables and lists that name the same
    return h("button", { type: "button", tabindex: -1, ...attributes, "aria-label": label, onclick: press }, words);
  }

  function draw({ view: { start, end } }) {
    const share = (t) => (100 * (t - start)) / (end - start);
    const thin = (100 * THIN) / Math.max(1, plot.clientWidth);
    for (const { item, element: part } of parts) {
      const [from, to] = [share(item.start), share(item.end ?? item.start)];
      part.hidden = to < 0 || from > 100;
      if (part.hidden) continue;
      const left = Math.max(0, from);
      part.style.left = `${left}%`;
      part.style.width = item.end === null ? "" : `${Math.min(100, to) - left}%`;
      part.toggleAttribute("data-thin", item.end !== null && to - from < thin);
      part.toggleAttribute("data-cut-left", from < -0.01);
      part.toggleAttribute("data-cut-right", to > 100.01);
    }
  }

  return { show, draw };
}
