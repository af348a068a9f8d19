/**
 * Strips of a whole recording: channels, limits, risk, manoeuvres, markers; from tiles, at any zoom.
 *
 * Exports
 *   createRecordingChart(host, options) -> RecordingChart
 *
 * options
 *   channels    [{key, symbol, unit, label, limit | null}]      order    keys from top to bottom
 *   sources     one or two: [{load(start, end, bins) -> Promise<tiles>, start, end, dt, offset, manoeuvres}]
 *               start, end: in the chart's time, which is the recording's own less `offset` [s];
 *               manoeuvres: [{start, end, withdrawn}] of its manoeuvres in the chart's time, or null
 *   held        [{start, end, limits}]    limits by key in force from start to end, null if unknown;
 *               by default the channels' own
 *   alertAbove     of the risk strip, which is there where it is in `order`
 *   label       for screen readers
 *   flags       [{key, t, word}]    moments that are marked in a channel's strip
 *   key         of the recording: a redraw, as in other units, keeps its window and cursors
 *   chosen(item)      a manoeuvre or marker of the lane was pressed
 *   went(event)       the reader asked for an event; by default its time is brought into view
 *
 * RecordingChart
 *   setLane(items), setEvents([{t, ...}])    for the lane, see event_lane.js
 *   go(direction)               to the next (1) or the last (-1) event, from the cursor
 *   show(start, end), showAll(), setCursor(t), setMarking(bool)   marking: a drag sets A and B
 *   reload()                    forgets the tiles: the sources have new ones
 *   window, update(wall), destroy()
 */

import { reason } from "../../lib/api.js";
import { addDrawer } from "../../lib/draw_loop.js";
import { attachControls, attachMarking } from "../input.js";
import { readPalette, watchTheme } from "../palette.js";
import { GUTTER } from "../strip_frame.js";
import { stripOf } from "../strips.js";
import { createTimeAxis, timeTicks } from "../time_axis.js";
import { createEventLane } from "./event_lane.js";
import { layOutRecording } from "./layout.js";
import { createOverviewBar } from "./overview_bar.js";
import { createReadings } from "./readings.js";
import { bandsOf } from "./tile_bands.js";
import { createTileStrip, pieceOf } from "./tile_strip.js";
import { createTileCache } from "./tiles.js";
import { createTimeWindow } from "./time_window.js";

const DESCRIBED_EVERY = 1000; // ms
const NARROW_AFTER = 400; // ms until an axis that is too wide narrows
const EDGE = 0.03; // share of the window; an event nearer to its edge is moved inside

export function createRecordingChart(host, options) {
  const { sources, alertAbove = NaN } = options;
  const start = Math.min(...sources.map((source) => source.start));
  const end = Math.max(...sources.map((source) => source.end));
  const dt = Math.min(...sources.map((source) => source.dt));
  const manoeuvres = sources.map((source) => source.manoeuvres ?? null);
  const anyManoeuvres = manoeuvres.includes(null) ? null : manoeuvres.flat();
  const timeWindow = createTimeWindow({
    start,
    end,
    least: Math.min(end - start, 20 * dt),
    key: options.key,
  });
  const strips = options.order.map((key) =>
    withHeld(stripOf(key, options.channels, { narrowAfter: NARROW_AFTER }), options.held),
  );
  const layout = layOutRecording(host, strips, options.label ?? "Recording");
  const { rowOf } = layout;
  const lane = createEventLane(layout.lane, { chosen: (item) => options.chosen?.(item) });
  const readings = createReadings(strips, layout, { timeWindow, alertAbove, manoeuvres });
  const canvases = strips.map((strip, k) => createTileStrip(rowOf[k].canvas, strip));
  const timeAxis = createTimeAxis(layout.axis);
  const overview = createOverviewBar(layout.overview, {
    timeWindow,
    start,
    end,
    key: options.order.includes("risk") ? "risk" : strips[0].key,
  });
  const caches = sources.map((source) =>
    createTileCache({
      ...source,
      arrived: changed,
      failed: (error) => layout.fail(reason(error), readAgain),
    }),
  );
  const drawn = { revision: -1, look: -1, described: -1e9, news: -1 };
  let events = [];
  let look = 0; // counts what changes the look: tiles, size, theme, manoeuvres
  let plot = 1;
  let measured = false;

  function changed() {
    look += 1;
  }

  function readAgain() {
    caches.forEach((cache) => cache.retry());
    changed();
  }

  function measure() {
    const ratio = devicePixelRatio || 1;
    const fit = (part, canvas) => {
      const { width, height } = canvas.parentElement.getBoundingClientRect();
      part.resize(width, height, ratio);
      return width;
    };
    const widths = canvases.map((canvas, k) => fit(canvas, rowOf[k].canvas));
    fit(timeAxis, layout.axis);
    fit(overview, layout.overview);
    plot = Math.max(16, Math.floor(widths[0]) - GUTTER);
    measured = widths[0] > 0;
    if (measured) setPalette(); // colours exist only on the page
  }

  function setPalette() {
    const palette = readPalette(host);
    for (const part of [...canvases, timeAxis, overview]) part.setPalette(palette);
    changed();
  }

  function update(wall = performance.now()) {
    if (!measured) measure();
    if (!measured) return;
    const moving = strips.some(({ axis }) => axis.moving || axis.roomy);
    const view = timeWindow.view();
    const sets = caches.map((cache) => cache.best(view, plot));
    if (timeWindow.revision !== drawn.revision || look !== drawn.look || moving) {
      Object.assign(drawn, { revision: timeWindow.revision, look });
      for (const cache of caches) cache.want(view, plot);
      draw(view, sets, wall);
      readings.show(sets);
    }
    const now = drawn.revision + drawn.look; // both only grow
    if (now === drawn.news || wall - drawn.described < DESCRIBED_EVERY) return;
    Object.assign(drawn, { news: now, described: wall });
    readings.describe(sets);
  }

  function draw(view, sets, wall) {
    const step = (view.end - view.start) / plot;
    const x = (t) => (t - view.start) / step;
    const traces = sets.map((set, k) =>
      pieceOf({ set, manoeuvres: manoeuvres[k] }, { view, x, step }),
    );
    const ticks = timeTicks(view.start, view.end, plot);
    const frame = {
      traces,
      x,
      width: plot,
      bands: bandsOf(traces[0], manoeuvres[0], x, anyManoeuvres),
      ticks: ticks.times,
      alertAbove,
      cursor: timeWindow.cursorAt(view),
      marks: timeWindow.marks,
      flags: options.flags ?? [],
      wall,
    };
    for (const canvas of canvases) canvas.draw(frame);
    timeAxis.draw(frame, ticks);
    overview.draw({ set: caches[0].entire(), manoeuvres: manoeuvres[0] ?? [], alertAbove, view });
    lane.place(view);
  }

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

  attachControls(host, layout, timeWindow, {
    view: () => timeWindow.view(),
    plotWidth: () => plot,
    dt: () => dt,
    newest: () => end,
    wall: () => 0,
  });
  bindSteps(host, layout.bar, go);
  const marking = attachMarking(layout.rows, timeWindow, { left: () => GUTTER, width: () => plot });
  const resizing = new ResizeObserver(() => {
    measured = false;
    update();
  });
  resizing.observe(host);
  const unwatch = watchTheme(host, () => {
    setPalette();
    update(); // printing does not wait for a frame
  });
  const stop = addDrawer(update);

  return {
    window: timeWindow,
    setLane: (items) => {
      lane.show(items);
      measured = false; // a row more leaves the strips less room
    },
    setEvents: (given) => {
      events = [...given].sort((a, b) => a.t - b.t);
    },
    go,
    show: (from, to) => timeWindow.setWindow(from, to),
    showAll: () => timeWindow.showAll(),
    setCursor,
    setMarking: marking.set,
    reload: () => {
      caches.forEach((cache) => cache.clear());
      changed();
    },
    update,
    destroy: () => {
      stop();
      unwatch();
      resizing.disconnect();
      caches.forEach((cache) => cache.close());
      host.replaceChildren();
    },
  };
}

/** From event to event, by the tool bar and the keys N and P. */
function bindSteps(host, bar, go) {
  bar.on("next", () => go(1));
  bar.on("back", () => go(-1));
  host.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== host) return;
    const direction = { n: 1, p: -1 }[event.key.toLowerCase()];
    if (direction === undefined) return;
    event.preventDefault();
    go(direction);
  });
}

/** A strip with its limits by time, where these were not always the channel's own. */
function withHeld(strip, held) {
  if (strip.risk || !held) return strip;
  const each = held.map(({ start, end, limits }) => ({ from: start, to: end, limit: limits?.[strip.key] ?? null }));
  strip.axis.setLimit(Math.max(...each.map(({ limit }) => limit ?? 0)) || strip.limit);
  return { ...strip, held: each };
}
