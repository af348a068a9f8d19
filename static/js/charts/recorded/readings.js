/**
 * Numbers and words of a recording's chart: readouts, tool bar, text for screen readers.
 *
 * Exports
 *   createReadings(strips, {rowOf, bar}, {timeWindow, alertAbove, manoeuvres}) -> {show(sets), describe(sets)}
 *     sets: [TileSet | null] as drawn.   manoeuvres: [[{start, end, withdrawn}] | null] of each source
 */

import { h, put } from "../../lib/dom.js";
import { durationText, figure, formatTime, formatValue } from "../../lib/numbers.js";
import { magnitudeIn, reading, shownIn } from "../../lib/units.js";
import { cursorsText, symbolNodes } from "../readout.js";

const NOTHING = { low: NaN, high: NaN };

export function createReadings(strips, { rowOf, bar }, { timeWindow, alertAbove, manoeuvres }) {
  const readouts = strips.map((strip, k) => createTileReadout(rowOf[k].readout, strip));

  function show(sets) {
    const view = timeWindow.view();
    const cursor = timeWindow.cursorAt(view);
    const { a, b } = timeWindow.marks;
    const pinned = Number.isFinite(cursor);
    const mark = (key, t) => (Number.isFinite(t) ? (sets[0]?.valueAt(key, t) ?? NOTHING) : null);
    strips.forEach(({ key, risk }, n) => {
      const values = sets.map((set) => {
        if (set === null) return NOTHING;
        return pinned ? set.valueAt(key, cursor) : set.rangeOf(key, view);
      });
      readouts[n].show({
        values,
        at: pinned ? "cursor" : "view",
        a: mark(key, a),
        b: mark(key, b),
        words: pinned && risk ? riskWordAt(cursor, values[0]) : "",
      });
    });
    showBar(view, cursor);
  }

  /** Why the risk strip has no number here. */
  function riskWordAt(t, { low }) {
    if (Number.isFinite(low) || manoeuvres[0] === null) return "";
    const manoeuvre = manoeuvres[0].find(({ start, end }) => t >= start && t <= end);
    if (!manoeuvre) return "not assessed";
    const silent = manoeuvre.silent?.find(({ start, end }) => t >= start && t < end);
    return silent?.word ?? (manoeuvre.withdrawn !== null && t >= manoeuvre.withdrawn ? "INVALID" : "");
  }

  function showBar({ start, end }, cursor) {
    const seconds = end - start;
    const length = seconds < 120 ? `${formatValue(seconds)} s` : durationText(seconds);
    put(bar.interval, `${formatTime(start, 0.1)} to ${formatTime(end, 0.1)} (${length})`);
    put(bar.values, cursorsText(timeWindow.marks, cursor));
  }

  function describe(sets) {
    const view = timeWindow.view();
    const withdrawn = manoeuvres[0]?.some((manoeuvre) => manoeuvre.withdrawn !== null);
    strips.forEach((strip, n) => {
      const { key, risk, label, symbol, limit, held } = strip;
      const { unit } = shownIn(strip);
      const range = rangeText(strip, sets[0]?.rangeOf(key, view) ?? NOTHING);
      const name = risk ? "risk, higher is worse" : `${label} ${symbol}`;
      const parts = [`${name}: ${range === "–" ? "no value in view" : `${range} ${unit} in view`}`];
      if (risk && Number.isFinite(alertAbove)) parts.push(`alerts above ${figure(alertAbove)}`);
      if (risk && withdrawn) parts.push("withdrawn where invalid");
      const limits = held ? held.map(({ limit }) => limit) : [limit];
      for (const each of new Set(limits)) if (each !== null) parts.push(`limit ±${magnitudeIn(strip, each)}${held ? " in force" : ""}`);
      rowOf[n].canvas.setAttribute("aria-label", parts.join(", "));
    });
  }

  return { show, describe };
}

/**
 * The column at the right of a strip: the reading under the cursor, else the range.
 *
 * show({values: [{low, high}], at: "cursor" | "view", a, b, words})
 *   values: one for each recording laid over; a, b: {low, high} under the marks or null;
 *   words: in place of a missing value ("INVALID")
 */
function createTileReadout(element, strip) {
  const { symbol, label } = strip;
  element.classList.add("readout", "tile-readout");
  const value = h("span", { class: "tile-value" });
  const second = h("span", { class: "tile-value tile-second", hidden: true });
  const detail = h("div", { class: "readout-detail" });
  element.append(
    h(
      "div",
      { class: "readout-reading" },
      h("span", { class: "readout-symbol" }, symbolNodes(symbol)),
      h("span", { class: "tile-values" }, value, second),
      h("span", { class: "readout-unit" }, shownIn(strip).unit),
    ),
    h("div", { class: "readout-title" }, h("span", { class: "readout-label" }, label)),
    detail,
  );

  function show({ values, at, a, b, words }) {
    element.dataset.at = at;
    say(value, words || rangeText(strip, values[0]));
    value.toggleAttribute("data-words", Boolean(words));
    second.hidden = values.length < 2;
    if (values.length > 1) say(second, rangeText(strip, values[1]));
    put(detail, details(strip, a, b));
  }

  return { show };

  function say(part, text) {
    put(part, text);
    part.toggleAttribute("data-range", text.includes("…"));
  }
}

/** One number where the bin holds one, else its range. */
function rangeText(strip, range) {
  if (!range || !Number.isFinite(range.low)) return "–";
  const [low, high] = [reading(strip, range.low), reading(strip, range.high)];
  return low === high ? low : `${low} … ${high}`;
}

function details(strip, a, b) {
  const parts = [];
  if (a) parts.push(`A ${rangeText(strip, a)}`);
  if (b) parts.push(`B ${rangeText(strip, b)}`);
  if (a && b) {
    const middle = ({ low, high }) => (low + high) / 2;
    parts.push(`Δ ${reading(strip, middle(b) - middle(a))}`);
  }
  return parts.join("  ");
}
