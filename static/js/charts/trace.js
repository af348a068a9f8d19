/**
 * Draws one series of the cells in view: traces, what lies beyond a limit, forecasts, bands of values.
 *
 * Traces, exceedances and forecasts are drawn between two places {from, to}: a strip keeps what it drew, and what is
 * drawn piece by piece must be what is drawn at once. So a dash belongs to its time, and a mark to the REACH before it.
 *
 * drawTrace(face, cells, read, {colour, dashed, breaks}, piece)     a line, or an area between the extremes; dashed:
 *     every third piece is left out, as a sign besides colour.   breaks: cells that no line joins to the one before
 * breaksAt({n, x, sparse}, places, pitch) -> breaks     the cells that begin at, or hold, these places [units]
 * drawBeyond(face, cells, read, {from, to, limits}, piece)  fills the trace beyond limits where they held,
 *     and marks where exceedances begin, after SPARSE without one
 * drawForecast(face, cells, read, {step, now, lead, x, breaks}, piece, error)    what a cell forecasts is drawn
 *     `lead` later: dashed, and bold in the future, with the interval of its error {low, high} if given
 * pieceOf({first, pitch}, from, to) -> piece {from, to, origin}     from..to: places [units]
 * spanOf(face, cells, read, after) -> [top, bottom] | null     heights of the cells right of a place
 * drawSafeBand(face, {t, low, high}, start, {x, width}, word)     where simulated safe flights are, from a start [s]
 * drawEnvelope(face, {t, low, high, predicted, word}, {x, now, width})     a band of values by time [s]
 *     predicted: time of an exceedance [s], or null
 *
 * Cells  samples in view, the same for all series; a cell is one sample while there is room for each, else a
 *   column of pixels or a tile with the samples in it
 *   n, x  place in the plot [units], wide  of a cell [units], t(i)  where it begins [s]
 *   cut  whether nothing is known between a cell and the one before
 *   sparse  whether lines join the cells; else they are about a pixel wide
 *   series(key) -> Read: (i, out) -> bool, range(key, out) -> bool     least and greatest value into out; false for none
 */

import { isBeyond } from "../lib/limits.js";
import { SPARSE, triangle } from "./strip_frame.js";

const HALF = 0.9; // px, half of a trace's thickness
const DASH = 9; // units of a dash and its space
const DRAWN = 6;
const REACH = SPARSE + 8; // units, at most, that a mark depends on before it, or a cell is drawn beyond its place
const NONE = new Set();
const out = new Float64Array(2);
let tops = new Float32Array(0);
let bottoms = tops;

export function pieceOf({ first, pitch }, from, to) {
  return { from, to, origin: first * pitch };
}

/** Cells first..end-1 that are seen in a piece, drawn `shift` later. */
function cellsIn({ n, x }, { from, to }, shift = 0) {
  return [Math.max(0, placeOf(n, x, from - REACH - shift) - 1), Math.min(n, placeOf(n, x, to + REACH - shift) + 1)];
}

function placeOf(n, x, wanted) {
  let [low, high] = [0, n];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (x[middle] < wanted) low = middle + 1;
    else high = middle;
  }
  return low;
}

export function breaksAt({ n, x, sparse }, places, pitch) {
  return new Set(places.map((at) => placeOf(n, x, at - (sparse ? 0.01 : pitch / 2))));
}

export function drawTrace(face, cells, read, { colour, dashed = false, breaks = NONE }, piece) {
  face.pen.strokeStyle = face.pen.fillStyle = face.palette[colour];
  if (cells.sparse) strokeLine(face, cells, read, dashed, breaks, piece);
  else fillArea(face, cells, read, dashed, breaks, piece);
}

function strokeLine({ pen, y }, cells, read, dashed, breaks, piece) {
  const { x, cut } = cells;
  const [first, end] = cellsIn(cells, piece);
  pen.lineWidth = 2 * HALF;
  pen.lineJoin = "bevel";
  let drawing = false;
  let before = 0; // height of the cell before
  pen.beginPath();
  for (let i = first; i < end; i++) {
    drawing &&= !cut[i] && !breaks.has(i);
    if (!read(i, out)) {
      drawing = false;
      continue;
    }
    const [bottom, top] = [y(out[0]), y(out[1])];
    if (!drawing) pen.moveTo(x[i] - HALF, bottom); // a lone sample is a dot
    if (dashed && drawing) dashTo(pen, x[i - 1], before, x[i], bottom, piece.origin);
    else pen.lineTo(x[i], bottom);
    if (top !== bottom) pen.lineTo(x[i], top);
    before = top;
    drawing = true;
  }
  pen.stroke();
}

/** A line whose dashes belong to their time. */
function dashTo(pen, x0, y0, x1, y1, origin) {
  const slope = (y1 - y0) / (x1 - x0);
  for (let x = x0; x < x1; ) {
    const phase = phaseOf(x + origin);
    const next = Math.min(x1, x + Math.max(0.01, (phase < DRAWN ? DRAWN : DASH) - phase));
    if (phase < DRAWN) pen.lineTo(next, y0 + slope * (next - x0));
    else pen.moveTo(next, y0 + slope * (next - x0));
    x = next;
  }
}

/** The area between the cells' extremes, half a line wider: four times faster than a stroke. */
function fillArea({ pen, y }, cells, read, dashed, breaks, piece) {
  const { n, x, cut } = cells;
  const [first, end] = cellsIn(cells, piece);
  if (tops.length < n) [tops, bottoms] = [new Float32Array(2 * n), new Float32Array(2 * n)];
  let begin = -1; // first cell of the unbroken piece
  let above = 0; // extremes of the cell before
  let below = 0;
  for (let i = first; i < end; i++) {
    const known = !breaks.has(i) && !(dashed && phaseOf(x[i] + piece.origin) >= DRAWN) && read(i, out);
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
  if (begin >= 0) fillPiece(pen, x, begin, end);
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

const phaseOf = (place) => ((place % DASH) + DASH) % DASH;

export function drawBeyond(face, cells, read, { from, to, limits }, piece) {
  const { pen, y } = face;
  const { x, wide, t } = cells;
  const [first, end] = cellsIn(cells, piece);
  const stored = limits.map(Math.fround); // in the precision of samples: the limit itself counts
  const isAlways = from === -Infinity && to === Infinity;
  const last = [-Infinity, -Infinity]; // exceedance of either side
  const none = [false, false];
  pen.fillStyle = face.palette.alert;
  for (let i = first; i < end; i++) {
    const known = (isAlways || (t(i) > from && t(i) <= to)) && read(i, out);
    const over = known && (out[0] <= stored[0] || out[1] >= stored[1]) ? isBeyond(stored, out[0], out[1]) : none;
    for (let side = 1; side >= 0; side--) {
      if (!over[side]) continue;
      const [edge, peak] = [y(limits[side]), y(out[side])];
      pen.fillRect(x[i] - wide / 2, Math.min(edge, peak), wide, Math.abs(edge - peak) + 1);
      if (x[i] - last[side] >= SPARSE && (i > 0 || x[i] >= 0)) triangle(pen, x[i], side === 1, face.height);
      last[side] = x[i];
    }
  }
}

export function drawForecast(face, cells, read, { step, now, lead, x, breaks }, piece, error) {
  const { pen } = face;
  const shift = lead / step;
  const [first, end] = cellsIn(cells, piece, shift);
  if (error) fillInterval(x(now));
  pen.strokeStyle = face.palette.forecast;
  pen.lineWidth = 1.4;
  strokePart(-Infinity, x(now), true);
  pen.lineWidth = 3;
  pen.setLineDash(shift > 24 ? [7, 4] : [3, 2]);
  strokePart(x(now), Infinity, false);
  pen.setLineDash([]);

  /** Of the forecasts of the future. */
  function fillInterval(left) {
    const future = [];
    for (let i = first; i < end; i++) {
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

  /** Strokes the part with left < x <= right. */
  function strokePart(left, right, dashed) {
    const { n, x: places, cut } = cells;
    let drawing = false;
    let before = 0; // height of the cell before
    pen.beginPath();
    for (let i = first; i < end; i++) {
      const at = places[i] + shift;
      if (at > right) break;
      if (at <= left && !(i + 1 < n && places[i + 1] + shift > left)) continue;
      if (!read(i, out)) {
        drawing = false;
        continue;
      }
      const middle = face.y((out[0] + out[1]) / 2);
      if (!drawing || cut[i] || breaks.has(i)) pen.moveTo(at, middle);
      else if (dashed) dashTo(pen, places[i - 1] + shift, before, at, middle, piece.origin);
      else pen.lineTo(at, middle);
      before = middle;
      drawing = true;
    }
    pen.stroke();
  }
}

export function spanOf({ y }, { n, x }, read, after) {
  let [top, bottom] = [Infinity, -Infinity];
  for (let i = n - 1; i >= 0 && x[i] > after; i--) {
    if (!read(i, out)) continue;
    [top, bottom] = [Math.min(top, y(out[1])), Math.max(bottom, y(out[0]))];
  }
  return top <= bottom ? [top, bottom] : null;
}

export function drawSafeBand(face, { t, low, high }, start, { x, width }, word) {
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
  const height = face.free(face.height, [[y(Math.max(...high)), y(Math.min(...low))]]);
  if (Number.isNaN(height)) return;
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  pen.fillStyle = palette.dim;
  pen.fillText(word, from, height);
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
  const height = word === "" ? NaN : face.free(0.7 * face.height, [[y(Math.max(...high)), y(Math.min(...low))]]);
  if (end - x(now) > face.wide(word) && Number.isFinite(height)) face.word(word, (x(now) + end) / 2, height, palette.forecast);
}
