/**
 * The column at the right of a recording's strip: what it reads under the cursor, else its range.
 *
 * Exports
 *   createTileReadout(element, {symbol, label, unit}) -> {show(reading)}
 *     reading: {values: [{low, high}], at: "cursor" | "view", a, b, words}
 *       values: one for each recording laid over; a, b: {low, high} under the marks or null;
 *       words: stands in the value's place where there is none ("INVALID")
 */

import { h } from "../../lib/dom.js";
import { put } from "../../lib/panel_states.js";
import { formatValue, symbolNodes } from "../readout.js";

export function createTileReadout(element, { symbol, label, unit }) {
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
      h("span", { class: "readout-unit" }, unit),
    ),
    h("div", { class: "readout-title" }, h("span", { class: "readout-label" }, label)),
    detail,
  );

  function show({ values, at, a, b, words }) {
    element.dataset.at = at;
    say(value, words || rangeText(values[0]));
    value.toggleAttribute("data-words", Boolean(words));
    second.hidden = values.length < 2;
    if (values.length > 1) say(second, rangeText(values[1]));
    put(detail, details(a, b));
  }

  return { show };

  function say(part, text) {
    put(part, text);
    part.toggleAttribute("data-range", text.includes("…"));
  }
}

/** One number where the bin holds one, else its range. */
export function rangeText(range) {
  if (!range || !Number.isFinite(range.low)) return "–";
  const [low, high] = [formatValue(range.low), formatValue(range.high)];
  return low === high ? low : `${low} … ${high}`;
}

function details(a, b) {
  const parts = [];
  if (a) parts.push(`A ${rangeText(a)}`);
  if (b) parts.push(`B ${rangeText(b)}`);
  if (a && b) {
    const middle = ({ low, high }) => (low + high) / 2;
    parts.push(`Δ ${formatValue(middle(b) - middle(a))}`);
  }
  return parts.join("  ");
}
