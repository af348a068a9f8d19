/**
 * Strip charts of a flight: every channel and the risk, above one time axis.
 *
 * Exports
 *   createStripChart(host, options) -> StripChart
 *
 * options
 *   channels     [{key, symbol, unit, label, limit | null}], in the order of a frame's `y`
 *   epsilon, lead [s], dt [s]       as the flight's hello says
 *   seconds 60   default width of the live window   history 180000   samples kept
 *   order        keys from top to bottom, "risk" among them; default: limited channels, others, risk
 *   forecasts    keys whose forecast is drawn; default: the limited channels
 *   riskScale "sqrt" | "linear"     spacing of 0..1; sqrt keeps small risks apart
 *   timeline     one to share with other charts
 *   onExceedance({key, symbol, t, value})    a channel has reached its limit (once, until acknowledged)
 *   autostart true                  false: nothing is drawn until update() is called
 *
 * StripChart
 *   push(frame | frames, wall)      {t, y, p_value, alert, state, y_hat, seq}; y by channel order;
 *                                   y_hat likewise, or by key. Returns how many were stored.
 *   setState({state, reason})       when it changes without a sample ("stale" by the server's clock)
 *   setFlight({epsilon, lead, dt, staleAfter}), setTransport({playing, speed})
 *   clear()                         after a seek, a loop, or for another flight
 *   setCursor(t), setWindow(a, b), goLive(), setMark("a" | "b", t)
 *   values(t) -> {key: number}      of the nearest sample; NaN where missing or in a gap
 *   exceedances() -> [{key, t, value}], acknowledge()    latched until acknowledged
 *   update(wall) -> ms              draw now (if anything changed); returns the time it took
 *   timeline, ring                  the parts, see their files
 *   destroy()
 *
 * Frame times must rise: a frame at or before the newest is not stored. A jump in t is drawn as a gap;
 * a jump in seq (frames the server left out for display) joins the trace above a hatched bar.
 */

import { addDrawer } from "../../lib/draw_loop.js";
import { formatTime, formatValue } from "../../lib/numbers.js";
import { attachInput } from "../input.js";
import { layOut } from "../layout.js";
import { readPalette, watchTheme } from "../palette.js";
import { createReadout, shownState, STATE_WORDS } from "../readout.js";
import { GUTTER } from "../strip_frame.js";
import { createTimeAxis, timeTicks } from "../time_axis.js";
import { createRiskAxis, createValueAxis } from "../value_axis.js";
import {
  ALERT,
  createRingBuffer,
  GAP,
  INVALID,
  THINNED,
  UNASSESSED,
  WARMING_UP,
} from "./ring_buffer.js";
import { createStripCanvas } from "./strip_canvas.js";
import { createTimeline } from "./timeline.js";
import { createVisibleSamples } from "./visible_samples.js";

const READOUT_EVERY = 200; // ms; faster digits cannot be read
const ARIA_EVERY = 1000; // ms
const RISK = { key: "risk", symbol: "risk", unit: "", label: "higher is worse", limit: null };

export function createStripChart(host, options) {
  const { channels, seconds = 60, history = 180_000, riskScale = "sqrt" } = options;
  const flight = { epsilon: options.epsilon ?? NaN, lead: options.lead ?? 0, dt: options.dt ?? 0.02 };
  const timeline = options.timeline ?? createTimeline({ seconds });
  timeline.setFlight({ lead: flight.lead, dt: flight.dt });
  const strips = arrange(options);
  const forecasting = strips.filter((strip) => strip.forecast !== null);
  const ring = createRingBuffer({
    series: channels.length + 1 + forecasting.length,
    capacity: history,
  });
  const row = new Float64Array(channels.length + 1 + forecasting.length);
  const visible = createVisibleSamples();
  const { rows, rowOf, axis, bar } = layOut(host, strips);
  const canvases = strips.map((strip, k) => createStripCanvas(rowOf[k].canvas, strip));
  const readouts = strips.map((strip, k) => createReadout(rowOf[k].readout, strip));
  const timeAxis = createTimeAxis(axis);
  const exceeded = new Map();
  const drawn = { column: NaN, count: -1, revision: -1, look: -1,
    stale: "", news: "", readouts: -1e9, aria: -1e9 };
  let status = { state: "none", alert: false };
  let seq = null;
  let look = 0; // counts what changes the look: size, theme, limits
  let plot = 1;
  let wall = performance.now();
  let measured = false;

  function arrange({ order, forecasts }) {
    const limited = channels.filter((channel) => channel.limit != null).map(({ key }) => key);
    const others = channels.filter((channel) => channel.limit == null).map(({ key }) => key);
    const shown = order ?? [...limited, ...others, "risk"];
    const wished = forecasts ?? limited;
    let next = channels.length + 1;
    return shown.map((key) => {
      const series = key === "risk" ? channels.length : channels.findIndex((c) => c.key === key);
      if (series < 0) throw new Error(`strip ${key} is not a channel of this flight`);
      const channel = key === "risk" ? RISK : channels[series];
      const limit = channel.limit ?? null;
      const forecast = key !== "risk" && wished.includes(key) ? next++ : null;
      const valueAxis = key === "risk" ? createRiskAxis(riskScale) : createValueAxis({ limit });
      return { ...channel, limit, series, forecast, axis: valueAxis, risk: key === "risk" };
    });
  }

  function push(given, at = performance.now()) {
    const frames = Array.isArray(given) ? given : [given];
    const before = ring.count();
    for (const frame of frames) store(frame);
    if (ring.count() > before) timeline.observe(ring.time(ring.count() - 1), at);
    return ring.count() - before;
  }

  function store(frame) {
    for (let k = 0; k < channels.length; k++) row[k] = number(frame.y[k]);
    row[channels.length] = frame.state === "ok" ? number(frame.p_value) : NaN;
    for (const { forecast, series, key } of forecasting) {
      row[forecast] = number(frame.y_hat?.[series] ?? frame.y_hat?.[key]);
    }
    const stored = ring.push(frame.t, row, flagsOf(frame));
    status = { state: shownState(frame), alert: frame.alert === true && frame.state === "ok" };
    if (!stored) return;
    seq = frame.seq ?? null;
    for (const { key, symbol, series, limit } of strips) {
      if (limit !== null && Math.abs(row[series]) >= limit) exceed(key, symbol, frame.t, row[series]);
    }
  }

  function flagsOf(frame) {
    const n = ring.count();
    const thinned = n > 0 && seq !== null && frame.seq != null && frame.seq > seq + 1;
    const missing = n > 0 && !thinned && frame.t - ring.time(n - 1) > 1.5 * flight.dt;
    const state = shownState(frame);
    return (
      (state === "invalid" ? INVALID : 0) |
      (state === "not_assessed" ? UNASSESSED : 0) |
      (frame.state === "warming_up" ? WARMING_UP : 0) |
      (frame.alert === true && frame.state === "ok" ? ALERT : 0) |
      (missing ? GAP : 0) |
      (thinned ? THINNED : 0)
    );
  }

  function exceed(key, symbol, t, value) {
    const known = exceeded.get(key);
    if (known === undefined) options.onExceedance?.({ key, symbol, t, value });
    if (known === undefined || Math.abs(value) > Math.abs(known.value)) {
      exceeded.set(key, { t: known?.t ?? t, value });
    }
  }

  function measure() {
    const ratio = devicePixelRatio || 1;
    const boxes = rowOf.map(({ canvas }) => canvas.parentElement.getBoundingClientRect());
    plot = Math.max(16, Math.floor(boxes[0].width) - GUTTER);
    canvases.forEach((canvas, k) => canvas.resize(boxes[k].width, boxes[k].height, ratio));
    const below = axis.parentElement.getBoundingClientRect();
    timeAxis.resize(below.width, below.height, ratio);
    look += 1;
    measured = boxes[0].width > 0;
  }

  function dress() {
    const palette = readPalette(host);
    for (const canvas of [...canvases, timeAxis]) canvas.setPalette(palette);
    look += 1;
  }

  function frameOf(view) {
    const step = (view.end - view.start) / plot;
    const first = Math.round(view.end / step) - plot; // whole columns: the trace does not shimmer
    const start = first * step;
    const x = (t) => (t - start) / step;
    const { marks } = timeline;
    const { dt, lead, epsilon } = flight;
    const cursor = timeline.cursorAt(view);
    return { ring, visible, wall, step, first, start, width: plot, x, now: view.now, lead, epsilon,
      cursor, marks, samplePx: dt / step, bands: [], ticks: [] };
  }

  function bandsOf(frame) {
    const { samplePx } = frame;
    const newest = ring.count() > 0 ? frame.x(ring.time(ring.count() - 1)) + samplePx : 0;
    const now = Math.max(newest, frame.x(frame.now));
    const named = (runs, kind, word) => runs.map((run) => ({ ...run, kind, word }));
    const bands = [
      ...named(visible.gaps(samplePx), "gap", "GAP"),
      ...named(visible.runs(THINNED, samplePx, now), "thinned", ""),
      ...named(visible.runs(WARMING_UP, samplePx, now), "warming", "WARMING UP"),
      ...named(visible.runs(UNASSESSED, samplePx, now), "unassessed", "NOT ASSESSED"),
      ...named(visible.runs(INVALID, samplePx, now), "invalid", "INVALID"),
      ...named(visible.runs(ALERT, samplePx, now), "alert", "ALERT"),
    ];
    if (ring.count() === 0) {
      bands.push({ x0: 0, x1: frame.width, kind: "stale", word: "NO DATA" });
    } else if (isStale()) {
      const x1 = Math.max(now, newest + 2);
      bands.push({ x0: newest, x1, kind: "stale", word: `STALE ${ageText()}` });
    }
    return bands;
  }

  const isStale = () => ring.count() > 0 && (timeline.stale(wall) || status.state === "stale");
  const ageText = () => `${Math.max(0, timeline.age(wall)).toFixed(1)} s`;

  function update(at = performance.now()) {
    const begin = performance.now();
    wall = at;
    if (!measured) measure();
    if (!measured) return 0;
    const view = timeline.view(wall);
    const frame = frameOf(view);
    const stale = isStale() ? ageText() : "";
    const same =
      frame.first === drawn.column && ring.count() === drawn.count && look === drawn.look &&
      timeline.revision === drawn.revision && stale === drawn.stale &&
      !strips.some((strip) => strip.axis.moving);
    const news = `${stateNow()} ${status.alert} ${exceeded.size}`;
    const moved = timeline.revision !== drawn.revision || look !== drawn.look || news !== drawn.news;
    drawn.news = news; // a change of state is shown at once, digits five times a second
    if (!same) {
      const extra = Math.ceil(frame.lead / frame.step) + 1;
      visible.scan(ring, frame.start, frame.step, plot, extra);
      const ticks = timeTicks(frame.start, frame.start + plot * frame.step, plot);
      frame.ticks = ticks.times;
      frame.bands = bandsOf(frame);
      for (const canvas of canvases) canvas.draw(frame);
      timeAxis.draw(frame, ticks);
      Object.assign(drawn, { column: frame.first, count: ring.count(), look, stale });
      drawn.revision = timeline.revision;
    }
    if (moved || wall - drawn.readouts >= READOUT_EVERY) showReadings(view);
    if (wall - drawn.aria >= ARIA_EVERY) describe();
    return performance.now() - begin;
  }

  function stateNow() {
    if (ring.count() === 0) return "none";
    if (isStale()) return "stale";
    return status.state;
  }

  function showReadings(view) {
    drawn.readouts = wall;
    const last = ring.count() - 1;
    const state = stateNow();
    const cursor = timeline.cursorAt(view);
    const { a, b } = timeline.marks;
    strips.forEach((strip, k) => {
      readouts[k].show({
        state,
        alert: strip.risk && status.alert,
        value: last < 0 ? NaN : ring.value(strip.series, last),
        forecast: last < 0 || strip.forecast === null ? NaN : ring.value(strip.forecast, last),
        lead: flight.lead,
        a: Number.isNaN(a) ? undefined : valueAt(strip, a),
        b: Number.isNaN(b) ? undefined : valueAt(strip, b),
        cursor: Number.isNaN(cursor) ? undefined : valueAt(strip, cursor),
        exceeded: exceeded.get(strip.key) ?? null,
      });
    });
    showBar(view, cursor);
  }

  function showBar(view, cursor) {
    const { a, b } = timeline.marks;
    const behind = view.now - (view.end - flight.lead);
    const mode = modeOf(view);
    set(bar.mode, mode === "none" ? "NO DATA" : mode.toUpperCase());
    bar.mode.dataset.mode = mode;
    const late = !view.live && behind > 0.05 ? `, ${behind.toFixed(1)} s behind` : "";
    set(bar.span, `${formatSpan(view.end - view.start)}${late}`);
    const parts = [];
    if (!Number.isNaN(a)) parts.push(`A ${formatTime(a, 0.001)} s`);
    if (!Number.isNaN(b)) parts.push(`B ${formatTime(b, 0.001)} s`);
    if (parts.length === 2) parts.push(`Δt ${formatValue(b - a)} s`);
    if (parts.length === 0 && !Number.isNaN(cursor)) parts.push(`cursor ${formatTime(cursor, 0.001)} s`);
    set(bar.values, parts.join("   "));
  }

  /** What the window shows: green only while it follows data that arrive. */
  function modeOf(view) {
    if (ring.count() === 0) return "none";
    if (!view.live) return "held";
    if (isStale()) return "stale";
    return timeline.playing ? "live" : "paused";
  }

  function valueAt(strip, t) {
    const i = ring.nearest(t);
    if (i < 0 || Math.abs(ring.time(i) - t) > 1.5 * flight.dt) return NaN;
    return ring.value(strip.series, i);
  }

  function describe() {
    drawn.aria = wall;
    const last = ring.count() - 1;
    const state = stateNow();
    strips.forEach((strip, k) => {
      const name = strip.risk ? "risk, higher is worse" : `${strip.label} ${strip.symbol}`;
      const silent = state === "invalid" || state === "not_assessed";
      const known = last >= 0 && state !== "stale" && !(strip.risk && silent);
      const value = known ? ring.value(strip.series, last) : NaN;
      const parts = [`${name}: ${Number.isFinite(value) ? `${formatValue(value)} ${strip.unit}`.trim() : "no value"}`];
      parts.push((STATE_WORDS[state] ?? state).toLowerCase());
      if (state === "stale") parts[1] += ` for ${ageText()}`;
      if (strip.risk && status.alert && known) parts.push("alert");
      if (strip.risk && Number.isFinite(flight.epsilon)) parts.push(`alerts above ${flight.epsilon}`);
      if (strip.limit !== null) parts.push(`limit ±${strip.limit} ${strip.unit}`);
      const latch = exceeded.get(strip.key);
      if (latch) parts.push(`limit reached at ${latch.t.toFixed(2)} s`);
      rowOf[k].canvas.setAttribute("aria-label", parts.join(", "));
    });
  }

  const input = attachInput(host, rows, timeline, {
    view: () => timeline.view(wall),
    plotLeft: () => GUTTER,
    plotWidth: () => plot,
    dt: () => flight.dt,
    newest: () => (ring.count() > 0 ? ring.time(ring.count() - 1) : NaN),
    wall: () => wall,
  });
  bar.on("a", () => input.mark("a"));
  bar.on("b", () => input.mark("b"));
  bar.on("clear", () => timeline.clearMarks());
  bar.on("in", () => input.zoom(0.5));
  bar.on("out", () => input.zoom(2));
  bar.on("live", () => timeline.goLive());

  const resizing = new ResizeObserver(() => {
    measured = false;
    if (options.autostart !== false) update();
  });
  resizing.observe(host);
  const unwatch = watchTheme(host, () => {
    dress();
    update(wall);
  });
  dress();
  const stop = options.autostart === false ? () => {} : addDrawer(update);

  return {
    timeline,
    ring,
    push,
    update,
    setState: (given) => {
      status = { state: shownState(given), alert: false };
      look += 1;
    },
    setFlight: (given) => {
      Object.assign(flight, given);
      timeline.setFlight(given);
      look += 1;
    },
    setTransport: (transport, at) => timeline.setTransport(transport, at),
    clear: () => {
      ring.clear();
      timeline.reset();
      exceeded.clear();
      status = { state: "none", alert: false };
      seq = null;
      look += 1;
    },
    setCursor: (t) => timeline.setCursor(t),
    setMark: (name, t) => timeline.setMark(name, t),
    setWindow: (start, end) => timeline.setWindow(start, end),
    goLive: () => timeline.goLive(),
    values: (t) => Object.fromEntries(strips.map((strip) => [strip.key, valueAt(strip, t)])),
    exceedances: () => [...exceeded].map(([key, { t, value }]) => ({ key, t, value })),
    acknowledge: () => {
      exceeded.clear();
      look += 1;
    },
    destroy: () => {
      stop();
      unwatch();
      resizing.disconnect();
      host.replaceChildren();
    },
  };
}

function number(value) {
  return typeof value === "number" ? value : NaN;
}

function set(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function formatSpan(seconds) {
  if (seconds >= 120) return `${(seconds / 60).toFixed(1)} min`;
  return `${seconds < 10 ? seconds.toFixed(2) : seconds.toFixed(0)} s`;
}
