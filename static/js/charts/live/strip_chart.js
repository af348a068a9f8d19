/**
 * Strip charts of a flight: every channel and the risk, above one time axis.
 *
 * Exports
 *   createStripChart(host, options) -> StripChart
 *
 * options
 *   channels     [{key, symbol, unit, label, limit | null}], in the order of a frame's `y`
 *   alertAbove, lead [s], dt [s]       as the flight's hello says
 *   seconds 60   default width of the live window   history 180000   samples kept
 *   order        keys from top to bottom, "risk" among them; default: limited channels, others, risk
 *   forecasts    keys whose forecast is drawn; default: the limited channels
 *   riskScale "sqrt" | "linear"     spacing of 0..1; sqrt keeps small risks apart
 *   timeline     one to share with other charts
 *   onExceedance({key, symbol, t, value})    a channel exceeds its limit (once, until acknowledged and over)
 *   autostart true                  false: nothing is drawn until update() is called
 *
 * StripChart
 *   push(frame | frames, wall)      {t, y, p_value, alert, state, y_hat, seq}; y by channel order;
 *                                   y_hat likewise, or by key. Returns how many were stored.
 *   insert(frames, complete)        earlier samples, where the trace jumps; complete: the sample after them follows
 *   setState({state, reason})       when it changes without a sample ("stale" by the server's clock)
 *   setFlight({alertAbove, lead, dt, staleAfter}), setTransport({playing, speed})
 *   setHeld([{t, limits}])          which limits by key held for samples after t [s], null for all, since the flight began
 *   latch([{channel, t, value, over, acknowledged}], seq)    exceedances up to sample seq, which came before it did
 *   setLimits(channels, t)          new limits for samples after t [s]: null for none or unknown
 *   clear()                         after a seek, a loop, or for another flight
 *   setCursor(t), setWindow(a, b), goLive(), setMark("a" | "b", t)
 *   values(t) -> {key: number}      of the nearest sample; NaN where missing or in a gap
 *   exceedances() -> [{key, t, value}], acknowledge()    latched until acknowledged and over
 *   flag({key, t, word, colour})    marks a moment in a channel's strip, or in all where key is null, for as
 *                                   long as the chart is there; colour "alert" unless given
 *   update(wall) -> ms              draw now (if anything changed); returns the time it took
 *   ahead                           what is forecast of the rest of a test card, see ahead.js; null while that is not known
 *   newest                          time of the newest sample that is drawn [s]; null for none
 *   timeline, ring                  the parts, see their files
 *   destroy()
 *
 * Frame times must rise: a frame at or before the newest is not stored. A jump in t is drawn as a gap;
 * a jump in seq (frames the server left out for display) joins the trace above a hatched bar.
 */

import { addDrawer } from "../../lib/draw_loop.js";
import { attachControls } from "../input.js";
import { layOut } from "../layout.js";
import { readPalette, watchTheme } from "../palette.js";
import { stripState } from "../readout.js";
import { GUTTER } from "../strip_frame.js";
import { limitedFirst, stripOf } from "../strips.js";
import { createTimeAxis, timeTicks } from "../time_axis.js";
import { aheadOf, isCurrent } from "./ahead.js";
import { bandsOf } from "./bands.js";
import { createIntake } from "./intake.js";
import { createReadings } from "./readings.js";
import { createRingBuffer } from "./ring_buffer.js";
import { createStripCanvas } from "./strip_canvas.js";
import { createTimeline } from "./timeline.js";
import { createVisibleSamples } from "./visible_samples.js";

const READOUT_EVERY = 200; // ms; faster digits cannot be read
const ARIA_EVERY = 1000; // ms
const CHANGES = 200; // of a limit that are drawn where they held, the newest

export function createStripChart(host, options) {
  const { channels, seconds = 60, history = 180_000 } = options;
  const flight = { alertAbove: options.alertAbove ?? NaN, lead: options.lead ?? 0, dt: options.dt ?? 0.02 };
  const timeline = options.timeline ?? createTimeline({ seconds });
  timeline.setFlight({ lead: flight.lead, dt: flight.dt });
  const strips = arrange(options);
  const forecasts = strips.filter(({ forecast }) => forecast !== null).length;
  const ring = createRingBuffer({ series: channels.length + 1 + forecasts, capacity: history });
  const { onExceedance } = options;
  const intake = createIntake({ ring, channels, strips, flight, onExceedance });
  const visible = createVisibleSamples();
  const layout = layOut(host, strips);
  const { rowOf, axis } = layout;
  const canvases = strips.map((strip, k) => createStripCanvas(rowOf[k].canvas, strip));
  const readings = createReadings(strips, layout, { ring, timeline, flight, intake });
  const timeAxis = createTimeAxis(axis);
  const drawn = { column: NaN, count: -1, revision: -1, look: -1,
    stale: "", news: "", readouts: -1e9, aria: -1e9 };
  const flags = [];
  let look = 0; // counts what changes the look: size, theme, limits
  let plot = 1;
  let wall = performance.now();
  let measured = false;
  let ahead = null; // current forecast of the rest of the card

  function push(given, at = performance.now()) {
    const frames = Array.isArray(given) ? given : [given];
    const stored = intake.push(frames);
    ahead = aheadOf(ahead, frames, frames.at(-1));
    if (ahead?.t.length) timeline.setRoom(ahead.t.at(-1) - ahead.made);
    if (stored > 0) timeline.observe(newest(), at);
    return stored;
  }

  function insert(frames, complete) {
    intake.insert(frames, complete);
    look += 1;
  }

  const newest = () => (ring.count() > 0 ? ring.time(ring.count() - 1) : NaN);
  const isStale = () =>
    ring.count() > 0 && (timeline.stale(wall) || intake.status.state === "stale");
  const ageText = () => `${Math.max(0, timeline.age(wall)).toFixed(1)} s`;

  function stateNow() {
    if (ring.count() === 0) return "none";
    return isStale() ? "stale" : intake.status.state;
  }

  const aheadNow = () => (stateNow() === "ok" && isCurrent(ahead, newest()) ? ahead : null);

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

  function setPalette() {
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
    const { dt, lead, alertAbove } = flight;
    const cursor = timeline.cursorAt(view);
    return { ring, visible, wall, step, first, start, width: plot, x, now: view.now, lead, alertAbove,
      cursor, marks, flags, ahead: aheadNow(), samplePx: dt / step, bands: [], ticks: [] };
  }

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
    const news = `${stateNow()} ${intake.status.alert} ${intake.exceedances.size}`;
    const moved = timeline.revision !== drawn.revision || look !== drawn.look || news !== drawn.news;
    drawn.news = news; // a change of state is shown at once, digits five times a second
    if (!same) draw(frame, stale);
    if (moved || wall - drawn.readouts >= READOUT_EVERY) {
      drawn.readouts = wall;
      readings.show(view, stateNow(), Math.max(0, timeline.age(wall)));
    }
    if (wall - drawn.aria >= ARIA_EVERY) {
      drawn.aria = wall;
      readings.describe(stateNow(), ageText());
    }
    return performance.now() - begin;
  }

  function draw(frame, stale) {
    const extra = Math.ceil(frame.lead / frame.step) + 1;
    visible.scan(ring, frame.start, frame.step, plot, extra);
    const ticks = timeTicks(frame.start, frame.start + plot * frame.step, plot);
    frame.ticks = ticks.times;
    frame.bands = bandsOf(frame, { newest: ring.count() > 0 ? newest() : null, staleFor: stale });
    for (const canvas of canvases) canvas.draw(frame);
    timeAxis.draw(frame, ticks);
    const { revision } = timeline;
    Object.assign(drawn, { column: frame.first, count: ring.count(), look, stale, revision });
  }

  attachControls(host, layout, timeline, {
    view: () => timeline.view(wall),
    plotWidth: () => plot,
    dt: () => flight.dt,
    newest,
    wall: () => wall,
  });

  const resizing = new ResizeObserver(() => {
    measured = false;
    if (options.autostart !== false) update();
  });
  resizing.observe(host);
  const unwatch = watchTheme(host, () => {
    setPalette();
    update(wall);
  });
  setPalette();
  const stop = options.autostart === false ? () => {} : addDrawer(update);

  return {
    timeline,
    ring,
    push,
    insert,
    update,
    get newest() {
      return ring.count() > 0 ? newest() : null;
    },
    get ahead() {
      return aheadNow();
    },
    setState: (given) => {
      intake.setStatus({ state: stripState(given), alert: false });
      look += 1;
    },
    setFlight: (given) => {
      Object.assign(flight, given);
      timeline.setFlight(given);
      look += 1;
    },
    setHeld: (held) => {
      for (const strip of strips) {
        if (strip.risk) continue;
        const each = held.map(({ t, limits }) => ({ from: t ?? -Infinity, limit: limits?.[strip.key] ?? null }));
        if (each.every(({ limit }) => limit === strip.limit)) continue;
        strip.held = each.filter(({ limit }, k) => k === 0 || limit !== each[k - 1].limit);
        strip.axis.setLimit(Math.max(...each.map(({ limit }) => limit ?? 0)) || null);
      }
      look += 1;
    },
    latch: (given, seq) => {
      intake.restore(given, seq);
      look += 1;
    },
    setLimits: (given, t) => {
      for (const strip of strips) {
        const limit = given.find(({ key }) => key === strip.key)?.limit ?? null;
        if (strip.risk || limit === strip.limit) continue;
        strip.held = [...(strip.held ?? [{ from: -Infinity, limit: strip.limit }]).slice(-CHANGES), { from: t, limit }];
        strip.limit = limit;
        strip.axis.setLimit(limit);
      }
      look += 1;
    },
    setTransport: (transport, at) => timeline.setTransport(transport, at),
    clear: () => {
      ring.clear();
      for (const strip of strips) strip.held = undefined;
      timeline.reset();
      intake.clear();
      ahead = null;
      look += 1;
    },
    setCursor: (t) => timeline.setCursor(t),
    setMark: (name, t) => timeline.setMark(name, t),
    setWindow: (start, end) => timeline.setWindow(start, end),
    goLive: () => timeline.goLive(),
    values: (t) => Object.fromEntries(strips.map((strip) => [strip.key, readings.valueAt(strip, t)])),
    exceedances: () => [...intake.exceedances].map(([key, { t, value }]) => ({ key, t, value })),
    acknowledge: () => {
      intake.acknowledge();
      look += 1;
    },
    flag: (given) => {
      if (flags.some(({ key, t, word }) => key === given.key && t === given.t && word === given.word)) return;
      flags.push(given);
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

/** Strips with their series in the ring buffer: channels, the risk, then the forecasts. */
function arrange({ channels, order, forecasts, riskScale }) {
  const { limited, others } = limitedFirst(channels);
  const wanted = forecasts ?? limited;
  let next = channels.length + 1;
  return (order ?? [...limited, ...others, "risk"]).map((key) => {
    const strip = stripOf(key, channels, { riskScale });
    const series = strip.risk ? channels.length : channels.findIndex((c) => c.key === key);
    const forecast = !strip.risk && wanted.includes(key) ? next++ : null;
    return { ...strip, series, forecast };
  });
}
