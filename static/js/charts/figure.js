/**
 * Figures of datasets, monitors and campaigns: axes, series, rules, a key and a caption, declared as data.
 *
 * createFigure({title, words, label, x, y, height, series, rules}) -> figure, figure.rules: [{move(value, text)}]
 *     x, y: axes of createPlot.   label: for screen readers.   words: below the key
 *     series: [{look, line [[x, y]], band [[x, low, high]], bars [[x0, x1, y0, y1]], mark, marks [[x, y]], words}]
 *       look: a class;   marks: the line's points by default; words: in the key; one with words only explains another
 *     rules: [{x | y, look, words}]     a line across
 * drawnFigure(svg, title, words)    as the server drew it
 * UNIT_SHARE, EPSILON   axes from 0 to 1.   SPARE   of an axis above its greatest value
 *
 * createPlot({x: {label, domain, format}, y: {...}, label, width, height}) -> Plot     label: for screen readers
 *   svg, x(value), y(value)           the element; values to pixels
 *   line(points, class), band(points [[x, low, high]], class), bar(x0, x1, y0, y1, class), marks(points, shape of SHAPES, class)
 *   vertical(x, class, text), horizontal(y, class, text)    a line across with its words; {move(value, text)}
 *   fillOf(class)                     of a bar: that of unsafe ones is hatched
 */

import { h, piecesOf, svg } from "../lib/dom.js";
import { figure, percent } from "../lib/numbers.js";
import { roundStep, roundTicks } from "./value_axis.js";

const FROM_0_TO_1 = { domain: [0, 1], ticks: [0, 0.2, 0.4, 0.6, 0.8, 1] };
export const UNIT_SHARE = { ...FROM_0_TO_1, format: (value) => percent(value, 0) };
export const EPSILON = { ...FROM_0_TO_1, label: "epsilon, the accepted miss rate" };
export const SPARE = 1.12;
const HEIGHT = 310;
const MARGIN = { left: 62, right: 16, top: 14, bottom: 48 };
const SHAPES = {
  circle: "M-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0",
  square: "M-3.2 -3.2h6.4v6.4h-6.4z",
  triangle: "M0 -4.2L4.2 3.4H-4.2z",
  diamond: "M0 -4.6L4.6 0L0 4.6L-4.6 0z",
  cross: "M-4 -4L4 4M-4 4L4 -4",
  plus: "M-4.5 0H4.5M0 -4.5V4.5",
  star: "M-4.5 0H4.5M0 -4.5V4.5M-3.2 -3.2L3.2 3.2M-3.2 3.2L3.2 -3.2",
};

export function createFigure({ title, words = "", label, x, y, height = HEIGHT, series, rules = [] }) {
  const plot = createPlot({ x, y, label, height });
  for (const { look, line = [], band, bars = [], mark, marks = line } of series) {
    if (band) plot.band(band, look);
    for (const bar of bars.filter(([, , low, high]) => high > low)) plot.bar(...bar, look);
    if (line.length) plot.line(line, look);
    if (mark) plot.marks(marks, mark, look);
  }
  const drawn = rules.map(({ x: at, y: level, look, words: text = "" }) =>
    at === undefined ? plot.horizontal(level, look, text) : plot.vertical(at, look, text),
  );
  const key = series.filter((entry) => entry.words).map((entry) => h("span", sample(entry, plot), entry.words));
  const figure = framed(title, plot.svg, h("span.figure-key", key), words);
  figure.rules = drawn;
  return figure;
}

function framed(title, drawing, key, words) {
  const caption = h("figcaption", h("span.figure-title", title), key, words && h("p.hint", words));
  return h("figure.figure-block", caption, drawing);
}

export function drawnFigure(drawing, title, words) {
  const holder = h("div");
  holder.innerHTML = drawing;
  return framed(title, holder, null, words);
}

/** A line of a key. */
function sample({ look, mark, line, bars }, plot) {
  return svg(
    "svg.key-mark",
    { viewBox: "0 0 34 14", "aria-hidden": "true" },
    bars && svg("rect", { x: 6, y: 2, width: 22, height: 11, class: look, fill: plot.fillOf(look) }),
    !bars && (line || !mark) && svg("path", { d: "M1 7H33", class: `plot-line ${look}` }),
    mark && svg("path", { d: SHAPES[mark], class: `plot-mark ${look}`, transform: "translate(17 7)" }),
  );
}

let plots = 0;

function createPlot({ x, y, label, width = 600, height = HEIGHT }) {
  const id = `hatch-${++plots}`;
  const right = width - MARGIN.right;
  const bottom = height - MARGIN.bottom;
  const toX = scale(x.domain, MARGIN.left, right);
  const toY = scale(y.domain, bottom, MARGIN.top);
  const clip = svg("rect", {
    x: MARGIN.left,
    y: MARGIN.top - 6,
    width: right - MARGIN.left + 6,
    height: bottom - MARGIN.top + 7,
  });
  const tile = { width: 6, height: 6, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" };
  const ground = svg("rect.plot-hatch-ground", { width: 6, height: 6 });
  const hatch = svg("pattern", { id, ...tile }, ground, svg("rect.plot-hatch", { width: 2.5, height: 6 }));
  const layer = svg("g", { "clip-path": `url(#${id}-clip)` });
  const notes = svg("g");
  const element = svg(
    "svg.plot",
    { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label },
    svg("defs", svg("clipPath", { id: `${id}-clip` }, clip), hatch),
    axes(),
    layer,
    notes,
  );

  function axes() {
    const parts = [];
    for (const value of x.ticks ?? ticksOf(x.domain, 7)) {
      parts.push(path(`M${toX(value)} ${MARGIN.top}V${bottom}`, "plot-grid"));
      parts.push(text(toX(value), bottom + 18, (x.format ?? figure)(value), "middle"));
    }
    for (const value of y.ticks ?? ticksOf(y.domain, 5)) {
      parts.push(path(`M${MARGIN.left} ${toY(value)}H${right}`, "plot-grid"));
      parts.push(text(MARGIN.left - 8, toY(value) + 4, (y.format ?? figure)(value), "end"));
    }
    const middle = (MARGIN.top + bottom) / 2;
    parts.push(path(`M${MARGIN.left} ${MARGIN.top}V${bottom}H${right}`, "plot-axis"));
    parts.push(text((MARGIN.left + right) / 2, height - 8, x.label, "middle", "plot-label"));
    const upright = text(0, 0, y.label, "middle", "plot-label");
    upright.setAttribute("transform", `translate(14 ${middle}) rotate(-90)`);
    return [...parts, upright];
  }

  function across(vertical, value, name, words) {
    const line = path("", `plot-rule ${name}`);
    const label = text(0, 0, "", "start", `plot-rule-text ${name}`);
    notes.append(line, label);
    const move = (at, newWords = words) => {
      label.textContent = newWords ?? "";
      if (vertical) {
        const px = toX(at);
        line.setAttribute("d", `M${px} ${MARGIN.top}V${bottom}`);
        const left = px > width * 0.7;
        place(label, px + (left ? -6 : 6), MARGIN.top + 10, left ? "end" : "start");
      } else {
        line.setAttribute("d", `M${MARGIN.left} ${toY(at)}H${right}`);
        const below = toY(at) < MARGIN.top + 20;
        const early = name.includes("plot-level"); // a rising curve leaves room at the left
        const px = early ? MARGIN.left + 6 : right - 4;
        place(label, px, toY(at) + (below ? 15 : -6), early ? "start" : "end");
      }
    };
    move(value);
    return { move };
  }

  const fillOf = (name) => (name.includes("plot-unsafe-bar") ? `url(#${id})` : null);
  const drawn = (child) => {
    layer.append(child);
    return child;
  };
  return {
    svg: element,
    x: toX,
    y: toY,
    fillOf,
    line: (points, name) => drawn(path(trace(points, toX, toY), `plot-line ${name}`)),
    band: (points, name) => drawn(path(outline(points, toX, toY), `plot-band ${name}`)),
    bar: (x0, x1, y0, y1, name) =>
      drawn(
        svg("rect", {
          x: toX(x0) + 0.5,
          y: toY(y1),
          width: Math.max(toX(x1) - toX(x0) - 1, 1),
          height: Math.max(toY(y0) - toY(y1), 0),
          class: name,
          fill: fillOf(name),
        }),
      ),
    marks: (points, shape, name) => {
      for (const [px, py] of points) {
        const transform = `translate(${toX(px)} ${toY(py)})`;
        drawn(svg("path", { d: SHAPES[shape], class: `plot-mark ${name}`, transform }));
      }
    },
    vertical: (value, name, words) => across(true, value, name, words),
    horizontal: (value, name, words) => across(false, value, name, words),
  };
}

const ticksOf = ([low, high], about) => roundTicks(low, high, roundStep((high - low) / about));

function scale([low, high], from, to) {
  return (value) => Math.round(10 * (from + ((value - low) / (high - low)) * (to - from))) / 10;
}

function trace(points, toX, toY) {
  let pen = "M";
  return points
    .map(([px, py]) => {
      if (py === null || Number.isNaN(py)) {
        pen = "M";
        return "";
      }
      const step = `${pen}${toX(px)} ${toY(py)}`;
      pen = "L";
      return step;
    })
    .join("");
}

function outline(points, toX, toY) {
  const upper = points.map(([px, , high]) => `${toX(px)} ${toY(high)}`);
  const lower = points.map(([px, low]) => `${toX(px)} ${toY(low)}`).reverse();
  return points.length ? `M${[...upper, ...lower].join("L")}Z` : "";
}

function path(d, name) {
  return svg("path", { d, class: name });
}

function text(px, py, words, anchor, name = "plot-tick") {
  const pieces = piecesOf(String(words)).flatMap(([base, index]) =>
    index
      ? [
          svg("tspan", { class: "plot-symbol" }, base),
          svg("tspan", { dy: 4, "font-size": "75%" }, index),
          svg("tspan", { dy: -4 }, "\u200b"),
        ]
      : [base],
  );
  return svg("text", { x: px, y: py, "text-anchor": anchor, class: name }, pieces);
}

function place(element, px, py, anchor) {
  element.setAttribute("x", px);
  element.setAttribute("y", py);
  element.setAttribute("text-anchor", anchor);
}
