/**
 * Parts of every figure of datasets and monitors: a title with a key, and an axis of shares.
 *
 * Exports
 *   framed(title, plot, key, words) -> <figure>
 *   keyOf([mark, words], ...) -> element     a line for each mark
 *   barKey(plot, safe, unsafe) -> element   the key of stacked bars: a line of words for each
 *   sample(name, mark) -> [svg]              a line of a key: class name, mark "cross", "circle", ...
 *   UNIT_SHARE   the axis of a share from 0 to 1.   SPARE   of an axis above its greatest value
 */

import { h, svg } from "../lib/dom.js";
import { percent } from "../lib/numbers.js";
import { SHAPES } from "./plot.js";

export const UNIT_SHARE = {
  domain: [0, 1],
  format: (value) => percent(value, 0),
  ticks: [0, 0.2, 0.4, 0.6, 0.8, 1],
};
export const SPARE = 1.12;

export function framed(title, plot, key, words) {
  const caption = h(
    "figcaption",
    {},
    h("span", { class: "figure-title" }, title),
    key,
    words ? h("p", { class: "hint" }, words) : null,
  );
  return h("figure", { class: "figure-block" }, caption, plot);
}

export function keyOf(...entries) {
  return h(
    "span",
    { class: "figure-key" },
    entries.map(([draw, words]) =>
      h(
        "span",
        {},
        svg("svg", { viewBox: "0 0 34 14", class: "key-mark", "aria-hidden": "true" }, draw),
        words,
      ),
    ),
  );
}

export function barKey(plot, safe, unsafe) {
  const bar = (name, fill) =>
    svg("rect", { x: 6, y: 2, width: 22, height: 11, class: name, ...fill });
  return keyOf(
    [bar("plot-safe-bar"), safe],
    [bar("plot-unsafe-bar", { fill: plot.hatched }), unsafe],
  );
}

export function sample(name, mark) {
  const parts = [svg("path", { d: "M1 7H33", class: `plot-line ${name}` })];
  if (mark) parts.push(svg("path", { d: SHAPES[mark], transform: "translate(17 7)", class: `plot-mark ${name}` }));
  return parts;
}
