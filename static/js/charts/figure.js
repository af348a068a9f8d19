/**
 * Figures of datasets, monitors and campaigns: axes, series, rules, a key and a caption, declared as data.
 *
 * createFigure({title, words, label, x, y, series, rules}) -> figure, figure.rules: [{move(value, text)}]
 *     x, y: {label, domain, ticks, format}.   label: for screen readers.   words: below the key
 *     series: [{look, line [[x, y]], band [[x, low, high]], bars [[x0, x1, y0, y1]], mark, marks [[x, y]], words}]
 *       look: a class;   marks: the line's points by default; words: in the key; one with words only explains another
 *     rules: [{x | y, look, words}]     a line across
 * drawnFigure(svg, title, words)    as the server drew it
 * UNIT_SHARE, EPSILON   axes from 0 to 1.   SPARE   of an axis above its greatest value
 */

import { h, piecesOf, svg } from "../lib/dom.js";
import { figure as number, percent } from "../lib/numbers.js";
import { roundStep, roundTicks } from "./value_axis.js";

const FROM_0_TO_1 = { domain: [0, 1], ticks: [0, 0.2, 0.4, 0.6, 0.8, 1] };
export const UNIT_SHARE = { ...FROM_0_TO_1, format: (value) => percent(value, 0) };
export const EPSILON = { ...FROM_0_TO_1, label: "epsilon, the accepted miss rate" };
export const SPARE = 1.12;
const [WIDTH, HEIGHT] = [600, 310];
const PLOT = { left: 62, right: WIDTH - 16, top: 14, bottom: HEIGHT - 48 };
const SHAPES = {
  circle: "M-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0",
  square: "M-3.2 -3.2h6.4v6.4h-6.4z",
  triangle: "M0 -4.2L4.2 3.4H-4.2z",
  diamond: "M0 -4.6L4.6 0L0 4.6L-4.6 0z",
  cross: "M-4 -4L4 4M-4 4L4 -4",
  plus: "M-4.5 0H4.5M0 -4.5V4.5",
  star: "M-4.5 0H4.5M0 -4.5V4.5M-3.2 -3.2L3.2 3.2M-3.2 3.2L3.2 -3.2",
};

let figures = 0;

export function createFigure({ title, words = "", label, x, y, series, rules = [] }) {
  const id = `hatch-${++figures}`;
  const toX = scale(x.domain, PLOT.left, PLOT.right);
  const toY = scale(y.domain, PLOT.bottom, PLOT.top);
  const fillOf = (look) => (look.includes("plot-unsafe-bar") ? `url(#${id})` : null);
  const drawn = rules.map((rule) => createRule(rule, toX, toY));
  const box = { x: PLOT.left, y: PLOT.top - 6, width: PLOT.right - PLOT.left + 6, height: PLOT.bottom - PLOT.top + 7 };
  const tile = { width: 6, height: 6, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" };
  const hatch = [svg("rect.plot-hatch-ground", { width: 6, height: 6 }), svg("rect.plot-hatch", { width: 2.5, height: 6 })];
  const drawing = svg(
    "svg.plot",
    { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label },
    svg("defs", svg("clipPath", { id: `${id}-clip` }, svg("rect", box)), svg("pattern", { id, ...tile }, hatch)),
    axes(x, y, toX, toY),
    svg("g", { "clip-path": `url(#${id}-clip)` }, series.flatMap(drawSeries)),
    svg("g", drawn.flatMap(({ parts }) => parts)),
  );
  const key = series.filter((entry) => entry.words).map((entry) => h("span", sample(entry, fillOf), entry.words));
  return Object.assign(framed(title, drawing, h("span.figure-key", key), words), { rules: drawn });

  function drawSeries({ look, line = [], band = null, bars = [], mark, marks = line }) {
    const place = ([px, py]) => `translate(${toX(px)} ${toY(py)})`;
    return [
      band && path(outline(band, toX, toY), `plot-band ${look}`),
      ...bars.filter(([, , low, high]) => high > low).map((bar) => drawBar(bar, look)),
      line.length > 0 && path(trace(line, toX, toY), `plot-line ${look}`),
      ...(mark ? marks : []).map((point) => svg("path", { d: SHAPES[mark], class: `plot-mark ${look}`, transform: place(point) })),
    ];
  }

  function drawBar([x0, x1, y0, y1], look) {
    const width = Math.max(toX(x1) - toX(x0) - 1, 1);
    return svg("rect", { x: toX(x0) + 0.5, y: toY(y1), width, height: Math.max(toY(y0) - toY(y1), 0), class: look, fill: fillOf(look) });
  }
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
function sample({ look, mark, line, bars }, fillOf) {
  return svg(
    "svg.key-mark",
    { viewBox: "0 0 34 14", "aria-hidden": "true" },
    bars && svg("rect", { x: 6, y: 2, width: 22, height: 11, class: look, fill: fillOf(look) }),
    !bars && (line || !mark) && svg("path", { d: "M1 7H33", class: `plot-line ${look}` }),
    mark && svg("path", { d: SHAPES[mark], class: `plot-mark ${look}`, transform: "translate(17 7)" }),
  );
}

function axes(x, y, toX, toY) {
  const { left, right, top, bottom } = PLOT;
  const upright = text(0, 0, y.label, "middle", "plot-label");
  upright.setAttribute("transform", `translate(14 ${(top + bottom) / 2}) rotate(-90)`);
  return [
    ...ticksOf(x, 7).flatMap((value) => [path(`M${toX(value)} ${top}V${bottom}`, "plot-grid"), text(toX(value), bottom + 18, (x.format ?? number)(value), "middle")]),
    ...ticksOf(y, 5).flatMap((value) => [path(`M${left} ${toY(value)}H${right}`, "plot-grid"), text(left - 8, toY(value) + 4, (y.format ?? number)(value), "end")]),
    path(`M${left} ${top}V${bottom}H${right}`, "plot-axis"),
    text((left + right) / 2, HEIGHT - 8, x.label, "middle", "plot-label"),
    upright,
  ];
}

function createRule({ x, y: level, look, words = "" }, toX, toY) {
  const line = path("", `plot-rule ${look}`);
  const label = text(0, 0, "", "start", `plot-rule-text ${look}`);
  move(x ?? level);
  return { parts: [line, label], move };

  function move(value, newWords = words) {
    label.textContent = newWords;
    if (x === undefined) moveLevel(toY(value));
    else moveUpright(toX(value));
  }

  function moveUpright(px) {
    const isLeft = px > WIDTH * 0.7;
    line.setAttribute("d", `M${px} ${PLOT.top}V${PLOT.bottom}`);
    place(label, px + (isLeft ? -6 : 6), PLOT.top + 10, isLeft ? "end" : "start");
  }

  function moveLevel(py) {
    const isEarly = look.includes("plot-level"); // a rising curve leaves room at the left
    line.setAttribute("d", `M${PLOT.left} ${py}H${PLOT.right}`);
    place(label, isEarly ? PLOT.left + 6 : PLOT.right - 4, py + (py < PLOT.top + 20 ? 15 : -6), isEarly ? "start" : "end");
  }
}

const ticksOf = ({ ticks, domain: [low, high] }, about) => ticks ?? roundTicks(low, high, roundStep((high - low) / about));

function scale([low, high], from, to) {
  return (value) => Math.round(10 * (from + ((value - low) / (high - low)) * (to - from))) / 10;
}

/** Broken where y is not known. */
function trace(points, toX, toY) {
  const isKnown = (k) => k >= 0 && points[k][1] !== null && !Number.isNaN(points[k][1]);
  return points.map(([px, py], k) => (isKnown(k) ? `${isKnown(k - 1) ? "L" : "M"}${toX(px)} ${toY(py)}` : "")).join("");
}

function outline(points, toX, toY) {
  const upper = points.map(([px, , high]) => `${toX(px)} ${toY(high)}`);
  const lower = points.map(([px, low]) => `${toX(px)} ${toY(low)}`).reverse();
  return points.length ? `M${[...upper, ...lower].join("L")}Z` : "";
}

const path = (d, name) => svg("path", { d, class: name });

function text(px, py, words, anchor, name = "plot-tick") {
  const symbolOf = (base, index) => [svg("tspan", { class: "plot-symbol" }, base), svg("tspan", { dy: 4, "font-size": "75%" }, index), svg("tspan", { dy: -4 }, "\u200b")];
  const pieces = piecesOf(String(words)).flatMap(([base, index]) => (index ? symbolOf(base, index) : [base]));
  return svg("text", { x: px, y: py, "text-anchor": anchor, class: name }, pieces);
}

function place(element, px, py, anchor) {
  element.setAttribute("x", px);
  element.setAttribute("y", py);
  element.setAttribute("text-anchor", anchor);
}
