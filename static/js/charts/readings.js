/**
 * Numbers and words beside the strips: readouts, tool bar, text for screen readers.
 *
 * A measured value is shown while data arrive, dim where the monitor does not assess it; the risk has
 * a number only where it was assessed, else a word. When samples stop, the last measured value stays, with its age.
 *
 * createReadings(strips, {rowOf, bar}, source) -> {show(view), describe()}     source: see strip_chart.js
 * rangeText(strip, range)    one number where low and high are read alike, else both
 *
 * Reading  of a strip, as the source gives it
 *   values      [{low, high}], one for each recording laid over
 *   at          "view" or "cursor": where a recording's values are; undefined in flight
 *   word        in place of the first value: "INVALID", "", ...
 *   state       of the newest sample: "ok", "invalid", ...; undefined in a recording
 *   last        whether the value is an old one, beside the word
 *   alert, exceeded     whether the risk alerts; {t, value, recorded, skipped} latched, or null
 *   sensor      value as recorded, where the trim makes it far from the one shown; else undefined
 *   before, otherwise   words before the values at A and B; words where neither is set
 */

import { secondsText } from "../lib/clock.js";
import { formatted, h, put } from "../lib/dom.js";
import { isBeyond, limitText } from "../lib/limits.js";
import { figure, formatValue, quantity, reading, sensorPeak, sensorText, shownIn } from "../lib/numbers.js";

const LONG = 6; // letters of a symbol
export const NOTHING = { low: NaN, high: NaN };

export function createReadings(strips, { rowOf, bar }, source) {
  const { time } = source;
  const readouts = strips.map((strip, k) => createReadout(rowOf[k].readout, strip, source.follows));

  function show(view) {
    const cursor = time.cursorAt(view);
    const { a, b } = time.marks;
    const at = (strip, t) => (Number.isFinite(t) ? (source.valuesAt(strip, t)[0] ?? NOTHING) : null);
    strips.forEach((strip, k) => {
      const marks = { a: at(strip, a), b: at(strip, b) };
      readouts[k].show({ ...source.reading(strip, view, cursor), ...marks });
    });
    const { mode, interval } = source.bar(view);
    bar.mode.hidden = mode === null;
    if (mode !== null) {
      put(bar.mode, mode === "none" ? "NO DATA" : mode.toUpperCase());
      bar.mode.dataset.mode = mode;
    }
    put(bar.interval, interval);
    put(bar.values, cursorsText(time.marks, cursor));
  }

  function describe() {
    strips.forEach((strip, k) => {
      const { risk, label, symbol, held, limits } = strip;
      const [first, ...more] = source.describe(strip);
      const parts = [`${risk ? "risk, higher is worse" : `${label} ${symbol}`}: ${first}`, ...more];
      if (risk && Number.isFinite(source.alertAbove))
        parts.push(`alerts above ${figure(source.alertAbove)}`);
      const changed = held !== null && !source.follows;
      const texts = (changed ? held.map((each) => each.limits) : [limits])
        .filter((each) => each !== null)
        .map((each) => `limit ${limitText(strip, each)}${changed ? " in force" : ""}`);
      parts.push(...new Set(texts));
      rowOf[k].canvas.setAttribute("aria-label", parts.join(", "));
    });
  }

  return { show, describe };
}

/** large: one value in large digits, with a state; else smaller ones, in which ranges fit. */
function createReadout(element, strip, large) {
  const value = h(large ? "span.readout-value" : "span.tile-value");
  const second = h("span.tile-value.tile-second", { hidden: true });
  const unit = h("span.readout-unit", shownIn(strip).unit);
  const state = h("span.readout-state", { hidden: !large });
  const badge = h("span.readout-badge", { hidden: true });
  const latch = h("div.readout-latch", { hidden: true });
  const sensor = h("div.readout-sensor", { hidden: true });
  const detail = h("div.readout-detail");
  const symbol = h("span.readout-symbol", { title: strip.label, "data-long": strip.symbol.length > LONG }, formatted(strip.symbol));
  let said = "";
  element.classList.toggle("tile-readout", !large);
  element.append(
    h("div.readout-reading", symbol, large ? value : h("span.tile-values", value, second), unit, state),
    h("div.readout-title", h("span.readout-label", strip.label), badge),
    latch,
    sensor,
    detail,
  );

  function show(now) {
    const known = now.word === "";
    element.toggleAttribute("data-last", now.last ?? false);
    if (large) {
      put(value, known || now.last ? rangeText(strip, now.values[0]) : "");
      unit.hidden = !known && !now.last;
      put(state, now.word);
      state.hidden = known;
      element.dataset.state = now.state;
    } else {
      element.dataset.at = now.at;
      say(value, now.word || rangeText(strip, now.values[0]));
      value.toggleAttribute("data-words", !known);
      second.hidden = now.values.length < 2;
      if (now.values.length > 1) say(second, rangeText(strip, now.values[1]));
    }
    showAlarm(now, known);
    sensor.hidden = now.sensor === undefined;
    if (!sensor.hidden) put(sensor, sensorText(strip, now.sensor));
    const text = details(strip, now);
    if (text !== said) detail.replaceChildren(text && formatted(text));
    said = text;
  }

  function showAlarm({ values, alert = false, exceeded = null, sensor = NaN }, known) {
    const limits = large && known && strip.limits !== null ? strip.limits.map(Math.fround) : null;
    const over = limits !== null && [values[0].low, sensor].some((value) => isBeyond(limits, value).includes(true));
    element.toggleAttribute("data-alert", known && alert);
    element.toggleAttribute("data-exceeded", exceeded !== null);
    element.toggleAttribute("data-over", over);
    latch.hidden = exceeded === null;
    badge.hidden = latch.hidden && !(known && alert);
    put(badge, latch.hidden ? "ALERT" : "LIMIT");
    if (exceeded === null) return;
    const peak = exceeded.skipped ? "exceeded, values skipped" : `peak ${quantity(strip, exceeded.value)}${sensorPeak(strip, exceeded)}`;
    put(latch, `${exceeded.value < 0 ? "▼" : "▲"} ${secondsText(exceeded.t)}, ${peak}`);
  }

  return { show };
}

function say(part, text) {
  put(part, text);
  part.toggleAttribute("data-range", text.includes("…"));
}

export function rangeText(strip, { low, high }) {
  if (!Number.isFinite(low)) return "–";
  const [least, greatest] = [reading(strip, low), reading(strip, high)];
  return least === greatest ? least : `${least} … ${greatest}`;
}

function details(strip, { a, b, before = "", otherwise = "" }) {
  const parts = [];
  if (a) parts.push(`A ${rangeText(strip, a)}`);
  if (b) parts.push(`B ${rangeText(strip, b)}`);
  const middle = ({ low, high }) => (low + high) / 2;
  if (a && b) parts.push(`Δ ${reading(strip, middle(b) - middle(a))}`);
  if (parts.length === 0) parts.push(otherwise);
  return [before, ...parts].filter(Boolean).join("  ");
}

function cursorsText({ a, b }, cursor) {
  const parts = [];
  if (Number.isFinite(a)) parts.push(`A ${secondsText(a, 0.001)}`);
  if (Number.isFinite(b)) parts.push(`B ${secondsText(b, 0.001)}`);
  if (parts.length === 2) parts.push(`Δt ${formatValue(b - a)} s`);
  if (parts.length === 0 && Number.isFinite(cursor))
    parts.push(`cursor ${secondsText(cursor, 0.001)}`);
  return parts.join("   ");
}
