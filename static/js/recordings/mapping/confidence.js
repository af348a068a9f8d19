/**
 * The confidence of a proposal: a bar, a word, and the reasons on request.
 *
 * Exports
 *   confidence({confidence 0..1, reasons}) -> element     word: high, medium, or low
 */

import { h } from "../../lib/dom.js";

const WORDS = [
  [0.9, "high", "ok"],
  [0.6, "medium", "off"],
  [0, "low: check", "caution"],
];

export function confidence({ confidence: share, reasons }) {
  const [, word, level] = WORDS.find(([least]) => share >= least);
  const bar = h(
    "span",
    { class: "confidence-bar", "data-level": level, "aria-hidden": true },
    h("span", { style: `width: ${Math.round(100 * share)}%` }),
  );
  const words = h("span", { class: "confidence-word", "data-level": level }, word);
  const head = [bar, words, h("span", { class: "dim" }, `${Math.round(100 * share)} %`)];
  if (!reasons.length) return h("div", { class: "confidence" }, head);
  return h(
    "details",
    { class: "confidence" },
    h("summary", {}, head, h("span", { class: "confidence-why" }, "why")),
    h(
      "ul",
      { class: "reasons" },
      reasons.map((reason) => h("li", {}, reason)),
    ),
  );
}
