/**
 * Common parts of all strips: background, grid, thresholds, labels, cursors, the value axis.
 *
 * createStripFrame(canvas, strip) -> a Sheet of layout.js with     strip: see strips.js
 *   y(value) -> px
 *   begin({ticks, x, width, alertAbove}, from)       clears, and draws the grid right of a place and, where it changed, the gutter
 *   wide(text) -> px of a word with its plate
 *   word(text, x, middle, colour), upright(text, x, middle, colour)     text on a plate
 *   free(wanted, spans [[top, bottom]]) -> middle of a word on no limit line and outside of spans, as near as possible
 *     to `wanted`; NaN where it fits nowhere
 *   longest() -> {middle, room}    the widest space between limit lines
 *   line(x, colour, dash, thick), cursors({x, cursor, marks})
 *   flagWords({flags, x, width}) -> [{text, colour, left, middle, right, height}]     moments: [{key | null, t, word, colour, thin}];
 *                                    key null: of all channels, with its word on the risk strip
 *   flags({flags, x, width}, words)
 *   thresholds({x, width, alertAbove})    limits where they held, or the alert level
 * triangle(pen, x, up, height)     at the top or the bottom of a strip
 * stacked([{left, right [px], colour}], rows)    the most urgent first, each with its row; one that would overlap
 *     moves a row down; without a free row it goes into the last, below the others
 * tickText(value, axis)    as fine as the axis' ticks
 * SPARSE  px between marks of the same kind.   BAR
 */

import { figure } from "../lib/numbers.js";
import { createSheet, GUTTER } from "./layout.js";
import { holdsOf } from "./strips.js";
import { axisTicks } from "./value_axis.js";

export const SPARSE = 22;
export const BAR = 4; // px, height of an alert at the top of a limited channel
const FIRST_ROW = 24; // px, middle of the topmost row of words
const ROW = 18;
const URGENT = ["alert", "caution", "text"]; // colours of words, the most urgent first
const PAD = 5; // px above and below the range
const WORD = 18; // px, height of a word's plate, with a pixel above and below
const MOST_WIDTHS = 100; // words whose width is kept

export function createStripFrame(canvas, strip) {
  const axis = strip.axis;
  const tools = { y, begin, word, wide, upright, free, longest, line, cursors, flagWords, flags, thresholds };
  const own = Object.assign(createSheet(canvas), tools);
  const { pen } = own;
  const drawn = { low: NaN, high: NaN, step: NaN, limits: null, alertAbove: NaN }; // in the gutter
  const widths = new Map(); // of words
  let levels = []; // of the grid
  let [base, slope] = [0, 0]; // of the axis [px]

  function y(value) {
    const place = base - slope * (strip.risk ? axis.share(value) : value);
    return place < -40 ? -40 : place > own.height + 40 ? own.height + 40 : place;
  }

  function begin({ ticks, x, width, alertAbove }, from) {
    const { low, high, step } = axis;
    const room = own.height - 2 * PAD;
    slope = strip.risk ? room : room / (high - low);
    base = own.height - PAD + (strip.risk ? 0 : low * slope);
    const now = { low, high, step, limits: strip.limits, alertAbove };
    if (own.isFresh || Object.keys(now).some((name) => !Object.is(now[name], drawn[name]))) {
      if (own.isFresh) widths.clear();
      own.clear();
      labels(alertAbove);
      levels = axisTicks(axis).map((value) => Math.round(y(value)));
      Object.assign(drawn, now);
    } else {
      own.clearPlot(from);
    }
    pen.fillStyle = own.palette.grid;
    for (const at of ticks.times.map(x)) if (at > from - 2) pen.fillRect(Math.max(from, whole(at)), 0, 1, own.height);
    for (const level of levels) pen.fillRect(from, level, width - from, 1);
    pen.fillRect(from, own.height - 1, width - from, 1);
  }

  /** At a whole column: lines move with the traces. */
  function whole(x) {
    return Math.round(x * own.ratio) / own.ratio;
  }

  const lines = () => (strip.risk ? [drawn.alertAbove] : holdsOf(strip).flatMap(({ limits }) => limits ?? [])).filter(Number.isFinite).map(y);

  function free(wanted, spans = []) {
    const bar = strip.risk || strip.limits === null ? [] : [[0, BAR]];
    const taken = [...lines().map((at) => [at, at]), ...bar, ...spans].map(([top, bottom]) => [top - WORD / 2, bottom + WORD / 2]);
    const fits = (at) => at >= WORD / 2 && at <= own.height - WORD / 2 && !taken.some(([top, bottom]) => at > top && at < bottom);
    const near = [wanted, WORD / 2, own.height - WORD / 2, ...taken.flat()].filter(fits);
    return near.reduce((best, at) => (Math.abs(at - wanted) < Math.abs(best - wanted) ? at : best), near[0] ?? NaN);
  }

  function longest() {
    const edges = [0, ...lines().sort((a, b) => a - b), own.height];
    const rooms = edges.slice(1).map((end, k) => ({ middle: (end + edges[k]) / 2, room: end - edges[k] }));
    return rooms.reduce((best, each) => (each.room > best.room ? each : best));
  }

  function upright(text, x, middle, colour) {
    pen.save();
    pen.translate(x, middle);
    pen.rotate(-Math.PI / 2);
    word(text, 0, 0, colour);
    pen.restore();
  }

  function wide(text) {
    if (!widths.has(text)) {
      if (widths.size > MOST_WIDTHS) widths.clear();
      pen.font = `700 12px ${own.palette.font}`;
      widths.set(text, pen.measureText(text).width + 8);
    }
    return widths.get(text);
  }

  /** Text on a plate of the panel's colour, legible over any hatch. */
  function word(text, x, middle, colour) {
    const half = wide(text) / 2;
    pen.font = `700 12px ${own.palette.font}`;
    pen.globalAlpha = 0.85;
    pen.fillStyle = own.palette.panel;
    pen.fillRect(x - half, middle - 8, 2 * half, 16);
    pen.globalAlpha = 1;
    pen.fillStyle = colour;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(text, x, middle + 0.5);
  }

  function cursors({ x, cursor, marks }) {
    line(x(cursor), own.palette.cursor, [2, 2], 1);
    line(x(marks.a), own.palette["mark-a"], [7, 3], 1.5);
    line(x(marks.b), own.palette["mark-b"], [7, 3], 1.5);
  }

  function flagWords({ flags: given, x, width }) {
    const labels = given.filter(({ key, t }) => (key === strip.key || (key === null && strip.risk)) && x(t) >= 0 && x(t) <= width).map(({ t, word: text, colour = "alert" }) => {
      const half = wide(text) / 2;
      const middle = Math.min(Math.max(x(t), half), Math.max(width - half, half));
      return { text, colour, middle, left: middle - half, right: middle + half };
    });
    const rows = Math.max(1, Math.floor((own.height - FIRST_ROW + ROW / 2) / ROW));
    return stacked(labels, rows).map((label) => ({ ...label, height: FIRST_ROW + ROW * label.row }));
  }

  /** An exceedance as recorded: the value drawn does not show it. */
  function flags({ flags: given, x, width }, words) {
    for (const { key, t, colour = "alert", thin = false } of given) {
      const at = x(t);
      if ((key !== null && key !== strip.key) || at < 0 || at > width) continue;
      const ink = own.palette[colour];
      line(at, ink, key === null ? [] : [4, 3], thin ? 1 : key === null ? 2.5 : 1.5);
      pen.fillStyle = ink;
      if (!thin) triangle(pen, at, true, own.height);
    }
    for (const { text, middle, colour, height } of words.toReversed()) word(text, middle, height, own.palette[colour]);
  }

  function line(x, colour, dash, thick) {
    if (!Number.isFinite(x)) return;
    pen.strokeStyle = colour;
    pen.lineWidth = thick;
    pen.setLineDash(dash);
    pen.beginPath();
    pen.moveTo(whole(x) + 0.5, 0);
    pen.lineTo(whole(x) + 0.5, own.height);
    pen.stroke();
    pen.setLineDash([]);
  }

  function thresholds({ x, width, alertAbove }) {
    if (strip.risk) {
      if (Number.isFinite(alertAbove)) threshold(alertAbove, 0, width, null);
      return;
    }
    for (const { from, to, limits } of holdsOf(strip)) {
      const [left, right] = [Math.max(0, x(from)), Math.min(width, x(to))];
      if (limits === null || left >= right) continue;
      limits.forEach((limit, side) => {
        if (Number.isFinite(limit)) threshold(limit, left, right - left, side);
      });
    }
  }

  /** side: of a limit, 0 where it is the least value; beyond it the ground is shaded. */
  function threshold(value, left, width, side) {
    const at = Math.round(y(value));
    pen.fillStyle = strip.risk ? own.palette.epsilon : own.palette.limit;
    pen.globalAlpha = 0.07;
    if (side === 0) pen.fillRect(left, at, width, own.height - at);
    if (side === 1) pen.fillRect(left, 0, width, at);
    pen.globalAlpha = 1;
    pen.fillRect(left, at - 0.75, width, 1.5);
  }

  function labels(alertAbove) {
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const taken = [];
    const label = (value, texts, colour, weight = "") => {
      const at = Math.min(own.height - 7, Math.max(7, y(value)));
      if (taken.some((other) => Math.abs(other - at) < 15)) return;
      taken.push(at);
      pen.font = `${weight} 12px ${own.palette.font}`.trim();
      pen.fillStyle = colour;
      pen.fillText(fitting(texts, value * axis.factor), -6, at);
    };
    if (strip.risk) {
      if (Number.isFinite(alertAbove))
        label(alertAbove, [figure(alertAbove, 2)], own.palette.epsilon, "700");
      for (const value of [0, 1, 0.5, 0.1]) label(value, [String(value)], own.palette.dim);
      return;
    }
    const levels = [...(strip.limits ?? [])].reverse().filter(Number.isFinite);
    for (const level of levels)
      label(level, [4, 3, 2].map((digits) => signed(level * axis.factor, digits)), own.palette.limit, "700");
    const isZero = (value) => Math.abs(value) < axis.step / 2;
    const ticks = axisTicks(axis);
    if (ticks.some(isZero)) label(0, ["0"], own.palette.dim);
    for (const value of ticks
      .filter((value) => !isZero(value))
      .sort((a, b) => Math.abs(b) - Math.abs(a)))
      label(value, [tickText(value, axis)], own.palette.dim);
  }

  /** The first text that fits the gutter: fewer digits, then thousands and millions. */
  function fitting(texts, value) {
    const scaled = [{ factor: 1e3, prefix: "k" }, { factor: 1e6, prefix: "M" }].filter(({ factor }) => Math.abs(value) >= factor);
    const all = [...texts, ...scaled.map(({ factor, prefix }) => signed(value / factor, 3) + prefix)];
    return all.find((text) => pen.measureText(text).width <= GUTTER - 6) ?? all.at(-1);
  }

  return own;
}

export function triangle(pen, x, up, height) {
  const base = up ? 14 : height - 14;
  pen.beginPath();
  pen.moveTo(x, up ? 3 : height - 3);
  pen.lineTo(x - 7, base);
  pen.lineTo(x + 7, base);
  pen.fill();
}

function signed(value, digits) {
  return `${value < 0 ? "−" : "+"}${figure(Math.abs(value), digits)}`;
}

export function tickText(value, { factor, step }) {
  const shown = step * factor;
  const places = Math.min(6, Math.max(0, Math.ceil(-Math.log10(shown) - 1e-9)));
  const text = Math.abs(value * factor).toFixed(places);
  return value * factor < -shown / 1000 ? `−${text}` : text;
}

export function stacked(labels, rows) {
  const rank = ({ colour }) => URGENT.indexOf(colour);
  const placed = [];
  for (const label of [...labels].sort((a, b) => rank(a) - rank(b))) {
    const meets = (other) => other.left < label.right && label.left < other.right;
    const isFree = (row) => !placed.some((other) => other.row === row && meets(other));
    const free = Array.from({ length: rows }, (_, row) => row).find(isFree);
    placed.push({ ...label, row: free ?? rows - 1 });
  }
  return placed;
}
