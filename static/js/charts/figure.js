/**
 * Figures of datasets, monitors and campaigns: axes, series, rules, a key and a caption, declared as data.
 *
 * createFigure({title, words, label, x, y, height, series, rules}) -> figure, figure.rules: [{move(value, text)}]
 *     x, y: axes of plot.js.   label: for screen readers.   words: below the key
 *     series: [{look, line [[x, y]], band [[x, low, high]], mark, marks [[x, y]], words}]     look: a class;
 *       marks: the line's points by default; words: in the key; one with words only explains another
 *     rules: [{x | y, look, words}]     a line across
 * keyOf([mark, words], ...)    a line for each mark;   barKey(plot, safe, unsafe)   of stacked bars
 * sample(look, mark, hasLine) -> [svg]     a line of a key; mark "cross", "circle", ...
 * UNIT_SHARE, EPSILON   axes from 0 to 1.   SPARE   of an axis above its greatest value
 */

import { h, svg } from "../lib/dom.js";
import { percent } from "../lib/numbers.js";
import { createPlot, SHAPES } from "./plot.js";

const FROM_0_TO_1 = { domain: [0, 1], ticks: [0, 0.2, 0.4, 0.6, 0.8, 1] };
export const UNIT_SHARE = { ...FROM_0_TO_1, format: (value) => percent(value, 0) };
export const EPSILON = { ...FROM_0_TO_1, label: "epsilon, the accepted miss rate" };
export const SPARE = 1.12;

export function createFigure({ title, words, label, x, y, height, series, rules = [] }) {
  const plot = createPlot({ x, y, label, height });
  for (const { look, line = [], band, mark, marks = line } of series) {
    if (band) plot.band(band, look);
    if (line.length) plot.line(line, look);
    if (mark) plot.marks(marks, mark, look);
  }
  const drawn = rules.map(({ x: at, y: level, look, words: text = "" }) =>
    at === undefined ? plot.horizontal(level, look, text) : plot.vertical(at, look, text),
  );
  const explained = series.filter((entry) => entry.words);
  const key = keyOf(...explained.map(({ look, mark, line, words: text }) => [sample(look, mark, line || !mark), text]));
  const figure = framed(title, plot.svg, key, words);
  figure.rules = drawn;
  return figure;
}

export function framed(title, plot, key, words) {
  const caption = h("figcaption", h("span.figure-title", title), key, words && h("p.hint", words));
  return h("figure.figure-block", caption, plot);
}

export function keyOf(...entries) {
  const lines = entries.map(([drawn, words]) =>
    h("span", {}, svg("svg", { viewBox: "0 0 34 14", class: "key-mark", "aria-hidden": "true" }, drawn), words),
  );
  return h("span", { class: "figure-key" }, lines);
}

export function barKey(plot, safe, unsafe) {
  const bar = (look, fill) => svg("rect", { x: 6, y: 2, width: 22, height: 11, class: look, ...fill });
  return keyOf([bar("plot-safe-bar"), safe], [bar("plot-unsafe-bar", { fill: plot.hatched }), unsafe]);
}

export function sample(look, mark, hasLine = true) {
  return [
    hasLine && svg("path", { d: "M1 7H33", class: `plot-line ${look}` }),
    mark && svg("path", { d: SHAPES[mark], class: `plot-mark ${look}`, transform: "translate(17 7)" }),
  ];
}
