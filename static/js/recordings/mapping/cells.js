/**
 * Parts of a row of a mapping.
 *
 * Exports
 *   cell(part, words, ...content) -> element     words: shown where the table has no head
 *   channelCell(symbol, ...words) -> element
 *   confidence({confidence 0..1, reasons}) -> element     of a proposal: a bar, a word, the reasons on request
 *   setByYou() -> element     of a row that was edited
 */

import { h } from "../../lib/dom.js";

const WORDS = [
  [0.9, "high", "ok"],
  [0.6, "medium", "off"],
  [0, "low: check", "caution"],
];

export function cell(part, words, ...content) {
  return h("div", { class: `map-cell map-${part}` }, words && h("span", { class: "map-label" }, words), content);
}

export function channelCell(symbol, ...words) {
  return cell("channel", null, h("span", { class: "map-symbol" }, symbol), h("span", {}, words));
}

export function confidence({ confidence: share, reasons }) {
  const [, word, level] = WORDS.find(([least]) => share >= least);
  const percent = `${Math.round(100 * share)} %`;
  const bar = h("span", { style: `width: ${percent}` });
  const head = [
    h("span", { class: "confidence-bar", "data-level": level, "aria-hidden": true }, bar),
    h("span", { class: "confidence-word", "data-level": level }, word),
    h("span", { class: "dim" }, percent),
  ];
  if (!reasons.length) return h("div", { class: "confidence" }, head);
  return h(
    "details",
    { class: "confidence" },
    h("summary", {}, head, h("span", { class: "confidence-why" }, "why")),
    h("ul", { class: "reasons" }, reasons.map((reason) => h("li", {}, reason))),
  );
}

export const setByYou = () => h("span", { class: "dim" }, "set by you");
