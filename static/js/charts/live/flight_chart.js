/**
 * Strip charts of a flight: every channel and the risk, from a ring buffer that follows the flight.
 *
 * Frame times must rise: a frame at or before the newest is not stored. A jump in t is drawn as a gap;
 * a jump in seq (frames the server left out for display) as SKIPPED.
 *
 * createFlightChart(host, options) -> FlightChart
 *     channels     [Channel], see ../strips.js, in the order of a frame's `y`
 *     alertAbove, lead [s], dt [s]       as the flight's hello says
 *     seconds 60   default width of the live window   history 180000   samples kept
 *     order        keys from top to bottom, "risk" among them; default: limited channels, others, margin, risk
 *     forecasts    keys whose forecast is drawn; default: the limited channels, and the margin
 *     beside       name of the first monitor for display, whose risk is drawn dashed; default: none
 *     timeline     one to share with other charts
 *     late []      [{start, end}], where the display was stale in flight [s]
 *     autostart true                  false: nothing is drawn until update() is called
 *     address, panels, simulated, starts      see ../strip_chart.js
 *
 * FlightChart
 *   push(frames, wall)              [{t, y, p_value, alert, state, y_hat, seq, ahead}]; y and y_hat by channel order
 *   insert(frames, complete)        earlier samples; complete: the sample after them follows
 *   setState({state, cause})        when it changes without a sample ("stale" by the server's clock)
 *   setLinked(isLinked)             whether the server is heard; STALE where it is not, also before the first sample
 *   setLimits(channels, [{t, limits}])      limits in force; and which, by key, held for samples after t [s], null for all,
 *                                   where they changed
 *   latch([{channel, t, value}])    the exceedances that the strips show: start and largest value
 *   values(t) -> {key: number}      of the nearest sample; NaN where missing or in a gap
 *   flag({key, t, word, colour "alert"})    marks a moment in a channel's strip, or in all where key is null
 *   ahead                           forecast of the rest of a test card; null while it is not known:
 *     {made, t: [s], channels: {key: {low, high, predicted, possible}}, peak, why}
 *     made: time of the sample it was made by [s].   peak: {mean, low, high}, shares of the limit, of
 *     monitors that forecast only the peak, without t and channels.   why: reason without a forecast
 *   cross, editor                   see ../strip_chart.js
 *   newest                          time of the newest sample that is drawn [s]; null for none
 *
 * aheadOf(known, frames, newest) -> ahead | null    of the newest frame that has one, else the known one while it is current
 * isCurrent(ahead, t)    whether it was made by the sample at t [s] or shortly before
 */

import { createAddress } from "../../lib/address.js";
import { secondsText } from "../../lib/clock.js";
import { limitsByKey, limitsOf, widest } from "../../lib/limits.js";
import { leadSeconds, quantity, reading, sensorText } from "../../lib/numbers.js";
import { STATE_WORDS, stripState, WITHDRAWN } from "../../lib/states.js";
import { layOut, stripArrangement } from "../layout.js";
import { createStripChart } from "../strip_chart.js";
import { arranged, hasMargin, isSummary, limitedFirst, MARGIN, marginAt, single, stripOf } from "../strips.js";
import { bandsOf, createCells } from "./cells.js";
import { createIntake } from "./intake.js";
import { BROKEN, createRingBuffer } from "./ring_buffer.js";
import { createTimeline } from "./timeline.js";

const CHANGES = 200; // of a limit that are drawn where they held, the newest
const FAR = 3000; // samples in which the last value is looked for
const AHEAD = "90 % forecast to the end of the card";
const BESIDE = "risk beside";
const OLDEST = 0.25; // s of flight that a forecast is shown for
const UNASSESSED = ["stale", "invalid", "not_assessed", ...WITHDRAWN];

export function aheadOf(known, frames, newest) {
  const frame = frames.findLast(({ ahead }) => ahead);
  const ahead = frame ? { made: frame.t, ...frame.ahead } : known;
  if (newest === undefined || newest.state !== "ok") return null;
  return isCurrent(ahead, newest.t) ? ahead : null;
}

export function isCurrent(ahead, t) {
  const age = ahead === null ? NaN : t - ahead.made;
  return age >= -1e-6 && age <= OLDEST + 1e-6;
}

export function createFlightChart(host, options) {
  const { channels, seconds = 60, history = 180_000, address = createAddress() } = options;
  const { alertAbove = NaN, lead = 0, dt = 0.02, late = [] } = options;
  const timeline = options.timeline ?? createTimeline({ seconds, lead, dt });
  const strips = arrange(options);
  const forecasts = strips.map(({ forecast }) => forecast).filter((key) => key !== null);
  const beside = strips.map((strip) => strip.beside).filter((key) => key !== null);
  const keys = [...channels.map(({ key }) => key), "risk", MARGIN, ...forecasts, ...beside];
  const seriesOf = new Map(keys.map((key, series) => [key, series]));
  const ring = createRingBuffer({ series: keys.length, capacity: history });
  const intake = createIntake({ ring, channels, strips, dt });
  const source = createSource({ strips, ring, seriesOf, intake, timeline, alertAbove, lead, dt, late });
  const arrangement = stripArrangement(address, strips);
  const layout = layOut(host, strips, "Strip charts", arrangement);
  const chart = createStripChart(host, { ...options, address, strips, source, layout });
  const { redraw } = chart;

  function push(given, wall = performance.now()) {
    const frames = Array.isArray(given) ? given : [given];
    const stored = intake.push(frames);
    source.setAhead(aheadOf(source.ahead, frames, frames.at(-1)));
    if (stored > 0) timeline.observe(source.newest(), wall);
    return stored;
  }

  function setLimits(given, held = []) {
    for (const strip of strips.filter((each) => !isSummary(each))) {
      const channel = given.find(({ key }) => key === strip.key);
      strip.limits = channel === undefined ? null : limitsOf(channel);
      strip.rest = channel?.rest;
      const each = held.slice(-CHANGES).map(({ t, limits }) => ({ from: t ?? -Infinity, limits: limitsByKey(limits, strip.key) }));
      const changes = each.filter(({ limits }, k) => k === 0 || !isSame(limits, each[k - 1].limits));
      strip.held = changes.length === 0 ? null : until(changes);
      strip.axis.setLimits(widest([strip.limits, ...changes.map(({ limits }) => limits)]));
    }
    redraw();
  }

  return {
    timeline,
    ring,
    cross: chart.cross,
    editor: chart.editor,
    trail: source.trail,
    push,
    setLimits,
    update: chart.update,
    destroy: chart.destroy,
    insert: (frames, complete) => {
      intake.insert(frames, complete);
      redraw();
    },
    get newest() {
      return ring.count() > 0 ? source.newest() : null;
    },
    get ahead() {
      return source.aheadNow();
    },
    setState: (given) => {
      intake.setStatus({ state: stripState(given), alert: false });
      redraw();
    },
    setLinked: (isLinked) => {
      source.isLinked = isLinked;
      redraw();
    },
    latch: (given) => {
      source.latched = given;
      arrangement.force(given.map(({ channel }) => channel));
      redraw();
    },
    setTransport: timeline.setTransport,
    clear: () => {
      ring.clear();
      for (const strip of strips) strip.held = null;
      timeline.reset();
      intake.clear();
      source.setAhead(null);
      redraw();
    },
    setCursor: timeline.setCursor,
    setWindow: timeline.setWindow,
    values: (t) => Object.fromEntries(strips.map((strip) => [strip.key, source.valuesAt(strip, t)[0].low])),
    flag: (given) => {
      const isThere = ({ key, t, word }) => key === given.key && t === given.t && word === given.word;
      if (source.flags.some(isThere)) return;
      source.flags.push(given);
      redraw();
    },
  };
}

function arrange({ channels, order, forecasts, beside }) {
  const { limited, others } = limitedFirst(channels);
  const margin = hasMargin(channels) ? [MARGIN] : [];
  const wanted = forecasts ?? [...limited, ...margin];
  const strips = (order ?? [...limited, ...others, ...margin, "risk"]).map((key) => {
    const strip = stripOf(key, channels);
    if (strip.risk && beside) return { ...strip, beside: BESIDE, label: `dashed: ${beside}` };
    return wanted.includes(key) && !strip.risk ? { ...strip, forecast: `${key} forecast` } : strip;
  });
  return arranged(strips);
}

function isSame(limits, others) {
  return limits?.[0] === others?.[0] && limits?.[1] === others?.[1];
}

/** Each holds until the next. */
function until(changes) {
  return changes.map((change, k) => ({ ...change, to: changes[k + 1]?.from ?? Infinity }));
}

/** The ring buffer as a source of strip_chart.js. */
function createSource({ strips, ring, seriesOf, intake, timeline, alertAbove, lead, dt, late }) {
  const cells = createCells(ring, seriesOf);
  const flags = [];
  let wall = performance.now();
  let ahead = null; // current forecast of the rest of the card
  let errors = null; // of the forecast, by channel
  const source = {
    time: timeline,
    follows: true,
    isLinked: true,
    alertAbove,
    dt,
    flags,
    latched: [],
    newest,
    aheadNow,
    read,
    trail,
    valuesAt,
    reading: readingOf,
    bar,
    describe,
    begin: (at) => {
      wall = at;
    },
    stamp: () => `${ring.count()} ${staleWord()}`,
    news: () => `${state()} ${intake.status.alert} ${source.latched.length}`,
    get ahead() {
      return ahead;
    },
    setErrors: (given) => {
      errors = given;
    },
    setAhead: (given) => {
      ahead = given;
      if (ahead?.t.length) timeline.setRoom(ahead.t.at(-1) - ahead.made);
    },
  };

  function newest() {
    return ring.count() > 0 ? ring.time(ring.count() - 1) : NaN;
  }

  function isStale() {
    if (!source.isLinked) return true;
    return ring.count() > 0 && (timeline.stale(wall) || intake.status.state === "stale");
  }

  /** "STALE 1.2 s"; the age is left out before the first sample. Empty while not stale. */
  function staleWord(before = " ") {
    if (!isStale()) return "";
    const age = timeline.age(wall);
    return `STALE${Number.isNaN(age) ? "" : `${before}${Math.max(0, age).toFixed(1)} s`}`;
  }

  function state() {
    if (isStale()) return "stale";
    return ring.count() === 0 ? "none" : intake.status.state;
  }

  function aheadNow() {
    return state() === "ok" && isCurrent(ahead, newest()) ? ahead : null;
  }

  function read(window) {
    const { view, step, pitch, width, x } = window;
    const before = Math.ceil(lead / (step * pitch)) + 1;
    cells.scan(window, { before, dt });
    const where = { x, now: view.now, width, pitch, newest: newest(), samplePx: dt / step, late };
    const bands = bandsOf(cells, where, staleWord());
    const boxes = bands.filter(({ kind }) => kind === "invalid" || kind === "unassessed");
    const current = aheadNow();
    return {
      parts: [{ cells, colour: "trace", quiet: { boxes, colour: "dim", alpha: 1 } }],
      bands,
      revision: `${ring.revision} ${cells.sparse}`,
      until: Math.min(cells.until(), ...[view.now, current?.t[0]].map((t) => x(t ?? Infinity)).filter((at) => !Number.isNaN(at))),
      now: view.now,
      lead,
      ahead: current && { ...current, word: AHEAD },
      tip: view.live ? newest() : Math.min(view.end - lead, newest()),
      trail,
      word: ring.count() === 0 ? "NO DATA" : staleWord(),
    };
  }

  function trail(keys, from, to, visit) {
    const [x, y] = keys.map((key) => seriesOf.get(key));
    for (let i = ring.after(from); i < ring.count() && ring.time(i) <= to; i++) {
      const [across, up] = [ring.value(x, i), ring.value(y, i)];
      visit(ring.time(i), across, across, up, up, (ring.flags(i, i + 1) & BROKEN) !== 0);
    }
  }

  function valuesAt({ key }, t) {
    const i = ring.nearest(t);
    const known = i >= 0 && Math.abs(ring.time(i) - t) <= 1.5 * dt;
    return [single(known ? ring.value(seriesOf.get(key), i) : NaN)];
  }

  function readingOf(strip, view, cursor) {
    const series = seriesOf.get(strip.key);
    const [last, now] = [ring.count() - 1, state()];
    const i = now === "stale" ? lastKnown(series) : last;
    const value = i < 0 ? NaN : ring.value(series, i);
    const old = now === "stale" && Number.isFinite(value) && !strip.risk;
    const age = old ? Math.max(0, timeline.age(wall)) + ring.time(last) - ring.time(i) : NaN;
    return {
      values: [single(value)],
      word: isKnown(strip, now, value) ? "" : (STATE_WORDS[now] ?? now),
      state: WITHDRAWN.includes(now) ? "invalid" : now,
      last: old,
      alert: strip.risk && intake.status.alert,
      exceeded: latchedOf(strip),
      sensor: strip.risk ? undefined : intake.sensor[strip.key],
      before: old ? `last value, ${age.toFixed(1)} s old` : "",
      otherwise: Number.isFinite(cursor)
        ? `cursor ${reading(strip, valuesAt(strip, cursor)[0].low)}${besideText(strip, cursor)}`
        : [nearestText(strip, last), forecastText(strip, now, last)].filter(Boolean).join("  "),
    };
  }

  function latchedOf({ key }) {
    return source.latched.find(({ channel }) => channel === key) ?? null;
  }

  function isKnown({ risk }, now, value) {
    if (!risk) return now !== "stale" && now !== "none";
    return now === "ok" || (["warming_up", "paused"].includes(now) && Number.isFinite(value));
  }

  function forecastText(strip, now, last) {
    if (now !== "ok" || last < 0 || strip.forecast === null) return "";
    const value = ring.value(seriesOf.get(strip.forecast), last);
    if (!Number.isFinite(value)) return "";
    const error = errors?.[strip.key];
    const ends = error ? [value + error.low, value + error.high] : [value];
    return `in ${leadSeconds(lead, 2)} s ${ends.map((end) => reading(strip, end)).join(" … ")}`;
  }

  function besideText({ beside, ...strip }, t) {
    return beside === null ? "" : `, dashed ${reading(strip, valuesAt({ key: beside }, t)[0].low)}`;
  }

  /** Whose limit is the nearest. */
  function nearestText({ key }, last) {
    if (key !== MARGIN || last < 0) return "";
    const { nearest } = marginAt(strips, ring.time(last), (strip) => single(ring.value(seriesOf.get(strip.key), last)));
    return nearest === null ? "" : `of ${nearest.symbol}`;
  }

  /** The newest sample that has a value, -1 where none is near. */
  function lastKnown(series) {
    const last = ring.count() - 1;
    for (let i = last; i >= Math.max(ring.first(), last - FAR); i--) {
      if (Number.isFinite(ring.value(series, i))) return i;
    }
    return -1;
  }

  function bar(view) {
    const behind = view.now - (view.end - lead);
    const lag = !view.live && behind > 0.05 ? `, ${behind.toFixed(1)} s behind` : "";
    return { mode: modeOf(view), interval: `window ${intervalText(view.end - view.start)}${lag}` };
  }

  /** Green only while the window follows arriving data. */
  function modeOf(view) {
    const now = state();
    if (now === "none") return now;
    if (!view.live) return "held";
    if (now === "stale") return now;
    return timeline.playing ? "following" : "paused";
  }

  function describe(strip) {
    const [now, last] = [state(), ring.count() - 1];
    const known = last >= 0 && !(strip.risk && UNASSESSED.includes(now));
    const value = known ? ring.value(seriesOf.get(strip.key), last) : NaN;
    const words = Number.isFinite(value) ? quantity(strip, value) : "no value";
    const stale = now === "stale";
    const word = stale ? staleWord(" for ") : (STATE_WORDS[now] ?? now);
    const parts = [
      `${stale && Number.isFinite(value) ? "last value " : ""}${words}`,
      word.toLowerCase(),
    ];
    if (strip.risk && intake.status.alert && known && !stale) parts.push("alert");
    if (known && intake.sensor[strip.key] !== undefined) parts.push(sensorText(strip, intake.sensor[strip.key]));
    const exceedance = latchedOf(strip);
    if (exceedance) parts.push(`limit exceeded at ${secondsText(exceedance.t)}${exceedance.skipped ? ", values skipped" : ""}`);
    return parts;
  }

  return source;
}

function intervalText(seconds) {
  if (seconds >= 120) return `${(seconds / 60).toFixed(1)} min`;
  return `${seconds < 10 ? seconds.toFixed(2) : seconds.toFixed(0)} s`;
}
