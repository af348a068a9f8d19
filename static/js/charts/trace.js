/**
 * Draws one series of the cells in view: traces, what lies beyond a limit, forecasts, bands of values.
 *
 * drawTrace(face, cells, read, {colour, dashed})     a line, or an area between the extremes; dashed:
 *     every third piece is left out, as a sign besides colour
 * drawBeyond(face, cells, read, {from, to, limits})  fills the trace beyond limits where they held,
 *     and marks where each exceedance begins
 * drawForecast(face, cells, read, {step, first, now, lead, x})    what a cell forecasts is drawn
 *     `lead` later: dashed, and bold in the future, with the interval of its error {low, high} if given
 * drawSafeBand(face, {t, low, high}, start, {x, width}, word, floor)     where simulated safe flights are, from a start [s]
 *     floor: value that the word stays above
 * drawEnvelope(face, {t, low, high, predicted, word}, {x, now, width})     a band of values by time [s]
 *     predicted: time of an exceedance [s], or null
 *
 * Cells  samples in view, the same for all series; a cell is one sample while there is room for each, else a
 *   pixel column or a tile with the samples in it
 *   n, x  place in the plot [px], wide  of a cell [px], t(i)  where it begins [s]
 *   cut  whether nothing is known between a cell and the one before
 *   sparse  whether lines join the cells; else they are about a pixel wide
 *   series(key) -> Read: (i, out) -> bool, range(key, out) -> bool     least and greatest value into out; false for none
 */

import { isBeyond } from "../lib/limits.js";
import { SPARSE } from "./strip_frame.js";

const HALF = 0.9; // px, half of a trace's thickness
const DASH = 9; // px of a dash and its space
const DRAWN = 6;
const out = new Float64Array(2);
let tops = new Float32Array(0);
let bottoms = tops;

export function drawTrace(face, cells, read, { colour, dashed = false }) {
  face.pen.strokeStyle = face.pen.fillStyle = face.palette[colour];
  if (cells.sparse) strokeLine(face, cells, read, dashed);
  else fillArea(face, cells, read, dashed);
}

function strokeLine({ pen, y }, { n, x, cut }, read, dashed) {
  pen.lineWidth = 2 * HALF;
  pen.lineJoin = "bevel";
  if (dashed) pen.setLineDash([DRAWN, DASH - DRAWN]);
  let drawing = false;
  pen.beginPath();
  for (let i = 0; i < n; i++) {
    if (!read(i, out)) {
      drawing = false;
      continue;
    }
    const [bottom, top] = [y(out[0]), y(out[1])];
    if (!drawing || cut[i]) pen.moveTo(x[i] - HALF, bottom); // a lone sample is a dot
    pen.lineTo(x[i], bottom);
    if (top !== bottom) pen.lineTo(x[i], top);
    drawing = true;
  }
  pen.stroke();
  pen.setLineDash([]);
}

/** The area between the cells' extremes, half a line wider: four times faster than a stroke. */
function fillArea({ pen, y }, { n, x, cut }, read, dashed) {
  if (tops.length < n) [tops, bottoms] = [new Float32Array(2 * n), new Float32Array(2 * n)];
  let begin = -1; // first cell of the unbroken piece
  let above = 0; // extremes of the cell before
  let below = 0;
  for (let i = 0; i < n; i++) {
    const known = !(dashed && isSpace(x[i])) && read(i, out);
    if (begin >= 0 && (!known || cut[i])) {
      fillPiece(pen, x, begin, i);
      begin = -1;
    }
    if (!known) continue;
    const top = y(out[1]) - HALF;
    const bottom = y(out[0]) + HALF;
    // reach the neighbour, so that a step stays thick
    tops[i] = begin >= 0 && below < top ? below - 2 * HALF : top;
    bottoms[i] = begin >= 0 && above > bottom ? above + 2 * HALF : bottom;
    above = top;
    below = bottom;
    if (begin < 0) begin = i;
  }
  if (begin >= 0) fillPiece(pen, x, begin, n);
}

function fillPiece(pen, x, begin, end) {
  pen.beginPath();
  pen.moveTo(x[begin] - 0.5, tops[begin]);
  for (let i = begin; i < end; i++) pen.lineTo(x[i], tops[i]);
  pen.lineTo(x[end - 1] + 0.5, tops[end - 1]);
  pen.lineTo(x[end - 1] + 0.5, bottoms[end - 1]);
  for (let i = end - 1; i >= begin; i--) pen.lineTo(x[i], bottoms[i]);
  pen.lineTo(x[begin] - 0.5, bottoms[begin]);
  pen.fill();
}

function isSpace(column) {
  return ((Math.floor(column) % DASH) + DASH) % DASH >= DRAWN;
}

export function drawBeyond(face, { n, x, wide, t }, read, { from, to, limits }) {
  const { pen, y } = face;
  const stored = limits.map(Math.fround); // in the precision of samples: the limit itself counts
  const isAlways = from === -Infinity && to === Infinity;
  const seen = [false, false];
  const marked = [-Infinity, -Infinity];
  const none = [false, false];
  pen.fillStyle = face.palette.alert;
  for (let i = 0; i < n; i++) {
    const known = (isAlways || (t(i) > from && t(i) <= to)) && read(i, out);
    const over = known && (out[0] <= stored[0] || out[1] >= stored[1]) ? isBeyond(stored, out[0], out[1]) : none;
    for (let side = 1; side >= 0; side--) {
      if (over[side]) {
        const [edge, peak] = [y(limits[side]), y(out[side])];
        pen.fillRect(x[i] - wide / 2, Math.min(edge, peak), wide, Math.abs(edge - peak) + 1);
        if (!seen[side] && x[i] - marked[side] >= SPARSE) {
          face.triangle(x[i], side === 1);
          marked[side] = x[i];
        }
      }
      seen[side] = over[side];
    }
  }
}

export function drawForecast(face, cells, read, { step, first, now, lead, x }, error) {
  const { pen } = face;
  const shift = lead / step;
  if (error) fillInterval(x(now));
  pen.strokeStyle = face.palette.forecast;
  pen.lineWidth = 1.4;
  if (cells.sparse && cells.n > 1) pen.setLineDash([6, 4]);
  strokePart(-Infinity, x(now), !cells.sparse);
  pen.lineWidth = 3;
  pen.setLineDash(shift > 24 ? [7, 4] : [3, 2]);
  strokePart(x(now), Infinity, false);
  pen.setLineDash([]);

  /** Of the forecasts of the future. */
  function fillInterval(left) {
    const future = [];
    for (let i = 0; i < cells.n; i++) {
      const at = cells.x[i] + shift;
      if (at > left && read(i, out)) future.push([at, face.y(out[1] + error.high), face.y(out[0] + error.low)]);
    }
    if (future.length === 0) return;
    pen.beginPath();
    for (const [at, top] of future) pen.lineTo(at, top);
    for (const [at, , bottom] of future.reverse()) pen.lineTo(at, bottom);
    pen.globalAlpha = 0.28;
    pen.fillStyle = face.palette.forecast;
    pen.fill();
    pen.globalAlpha = 1;
  }

  /** Strokes the part with left < x <= right; dashed by leaving out columns where `skipping`. */
  function strokePart(left, right, skipping) {
    const { n, x: places, cut } = cells;
    let drawing = false;
    pen.beginPath();
    for (let i = 0; i < n; i++) {
      const at = places[i] + shift;
      if (at > right) break;
      if (at <= left && !(i + 1 < n && places[i + 1] + shift > left)) continue;
      if ((skipping && isSpace(Math.floor(places[i]) + first)) || !read(i, out)) {
        drawing = false;
        continue;
      }
      if (cut[i]) drawing = false;
      const middle = face.y((out[0] + out[1]) / 2);
      if (drawing) pen.lineTo(at, middle);
      else pen.moveTo(at, middle);
      drawing = true;
    }
    pen.stroke();
  }
}

export function drawSafeBand(face, { t, low, high }, start, { x, width }, word, floor = -Infinity) {
  const { pen, y, palette } = face;
  const [left, right] = [x(start + t[0]), x(start + t.at(-1))];
  if (right < 0 || left > width) return;
  pen.beginPath();
  for (let k = 0; k < t.length; k++) pen.lineTo(x(start + t[k]), y(high[k]));
  for (let k = t.length - 1; k >= 0; k--) pen.lineTo(x(start + t[k]), y(low[k]));
  pen.closePath();
  pen.globalAlpha = 0.2;
  pen.fillStyle = palette.band;
  pen.fill();
  pen.globalAlpha = 0.6;
  pen.lineWidth = 1;
  pen.strokeStyle = palette.band;
  pen.stroke();
  pen.globalAlpha = 1;
  pen.font = `12px ${palette.font}`;
  const from = Math.max(0, left) + 4;
  if (word === "" || from + pen.measureText(word).width > Math.min(right, width)) return;
  pen.textAlign = "left";
  pen.textBaseline = "bottom";
  pen.fillStyle = palette.dim;
  pen.fillText(word, from, Math.min(face.height, y(floor)) - 3); // the trace is drawn over it
}

export function drawEnvelope(face, { t, low, high, predicted = null, word }, { x, now, width }) {
  const { pen, y, palette } = face;
  const end = Math.min(x(t.at(-1)), width);
  pen.beginPath();
  for (let k = 0; k < t.length; k++) pen.lineTo(x(t[k]), y(high[k]));
  for (let k = t.length - 1; k >= 0; k--) pen.lineTo(x(t[k]), y(low[k]));
  pen.closePath();
  pen.globalAlpha = 0.28;
  pen.fillStyle = palette.forecast;
  pen.fill();
  pen.globalAlpha = 1;
  pen.strokeStyle = palette.forecast;
  pen.lineWidth = 1.2;
  pen.stroke();
  if (predicted !== null) face.line(x(predicted), palette.alert, [4, 3], 2);
  if (end - x(now) > face.wide(word))
    face.word(word, (x(now) + end) / 2, 0.7 * face.height, palette.forecast);
}
