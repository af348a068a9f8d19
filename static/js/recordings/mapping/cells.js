/** Parts of a row of a mapping. */

import { h } from "../../lib/dom.js";

const WORDS = [[0.9, "high", "ok"], [0.6, "medium", "off"], [0, "low: check", "caution"]];

export function cell(part, words, ...content) {
  return h("div", { class: `map-cell map-${part}` }, words && h("span.map-label", words), content);
}

export function channelCell(symbol, ...words) {
  return cell("channel", null, h("span.map-symbol", symbol), h("span", words));
}

export function confidence({ confidence: share, reasons }) {
  const [, word, level] = WORDS.find(([least]) => share >= least);
  const percent = `${Math.round(100 * share)} %`;
  const bar = h("span", { style: `width: ${percent}` });
  const head = [
    h("span.confidence-bar", { "data-level": level, "aria-hidden": true }, bar),
    h("span.confidence-word", { "data-level": level }, word),
    h("span.dim", percent),
  ];
  if (!reasons.length) return h("div.confidence", head);
  const why = h("ul.reasons", reasons.map((reason) => h("li", reason)));
  return h("details.confidence", h("summary", head, h("span.confidence-why", "why")), why);
}

export const setByYou = () => h("span.dim", "set by you");
