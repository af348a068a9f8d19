/**
 * Draws one strip of a flight: bands, limits, forecast, trace, exceedances, cursors, value axis.
 *
 * Exports
 *   createStripCanvas(canvas, strip) -> {draw(frame), resize(width, height, ratio), setPalette(p), axis}
 *
 * @typedef {object} Strip  what a strip shows
 * @property {number} series  of the ring buffer
 * @property {number | null} forecast  series of the forecast, or null
 * @property {number | null} limit  magnitude that must not be reached, or null
 * @property {object} axis  value axis
 * @property {boolean} risk  whether this is the risk strip
 *
 * @typedef {object} Frame  what all strips of a chart share in one turn
 * @property {object} ring @property {object} visible @property {number} wall
 * @property {number} step  seconds a pixel   @property {number} first  column of the left edge
 * @property {number} width  of the plot [px]   @property {(t: number) => number} x  place in the plot
 * @property {number} now @property {number} lead  [s] @property {number} samplePx
 * @property {{x0: number, x1: number, kind: string, word: string}[]} bands
 * @property {number[]} ticks  times of the vertical grid [s]
 * @property {number} epsilon @property {number} cursor @property {{a: number, b: number}} marks [s]
 */

import { createStripFrame, GUTTER, SPARSE } from "../strip_frame.js";
import { GAP } from "./ring_buffer.js";

const OF_THE_RISK = new Set(["alert", "warming", "invalid", "unassessed"]); // words said once, on its strip
const DASH = 9; // px of a dash and its space in a column-wise trace

export function createStripCanvas(canvas, strip) {
  const face = createStripFrame(canvas, strip);
  const { pen, y, word } = face;
  const out = new Float64Array(2);
  const axis = strip.axis;
  let tops = new Float32Array(0);
  let bottoms = tops;
  let lastMark = -Infinity; // where the last mark stands, so that a crowd stays legible

  function draw(frame) {
    fitAxis(frame);
    face.begin(frame.ticks, frame.x, frame.width);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, frame.width, face.height);
    pen.clip();
    if (strip.forecast !== null) drawLead(frame);
    for (const band of frame.bands) drawBand(band);
    lastMark = -Infinity;
    for (const band of frame.bands) drawWord(band); // under the trace, which no word may hide
    face.thresholds(frame.epsilon, frame.width);
    if (strip.forecast !== null) drawForecast(frame);
    drawTraces(frame);
    if (strip.limit !== null) drawExceedances(frame);
    drawCursors(frame);
    pen.restore();
    face.labels(frame.epsilon);
  }

  function fitAxis({ ring, visible, wall }) {
    let low = Infinity;
    let high = -Infinity;
    if (visible.n > 0) {
      const from = visible.from[0];
      const to = visible.to[visible.n - 1];
      for (const series of [strip.series, strip.forecast]) {
        if (series === null || !ring.extent(series, from, to, out)) continue;
        low = Math.min(low, out[0]);
        high = Math.max(high, out[1]);
      }
    }
    axis.fit(low, high, wall);
  }

  function drawLead(frame) {
    const x0 = frame.x(frame.now);
    const x1 = frame.x(frame.now + frame.lead);
    if (!(x1 > x0)) return;
    pen.globalAlpha = 0.16;
    pen.fillStyle = face.palette.forecast;
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
    if (x1 - x0 > 52) word(`+${frame.lead.toFixed(2)} s`, (x0 + x1) / 2, 9, face.palette.forecast);
  }

  function drawBand({ x0, x1, kind }) {
    if ((kind === "alert" || kind === "warming") && !strip.risk) {
      if (kind !== "alert" || strip.limit === null) return;
      pen.fillStyle = face.palette.alert; // on limited channels a bar: compare the alert with the crossing
      pen.fillRect(x0, 0, x1 - x0, 4);
      return;
    }
    if (kind === "thinned") {
      pen.fillStyle = face.hatches.stale;
      pen.fillRect(x0, face.height - 5, x1 - x0, 4);
      return;
    }
    if (kind === "gap" || isSilent(kind)) {
      pen.globalAlpha = { gap: 0.22, invalid: 0.5 }[kind] ?? 0.25;
      pen.fillStyle = face.palette.band;
    } else {
      pen.fillStyle = face.hatches[kind];
    }
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
  }

  function drawWord({ x0, x1, kind, word: text }) {
    if (kind === "thinned" || (OF_THE_RISK.has(kind) && !strip.risk)) return;
    const left = Math.max(0, x0);
    const right = Math.min(face.width - GUTTER, x1);
    pen.font = `700 12px ${face.palette.font}`;
    const long = pen.measureText(text).width + 10;
    const colour = kind === "alert" ? face.palette.alert : face.palette.text;
    const middle = (left + right) / 2;
    if (long <= right - left) word(text, middle, kind === "alert" ? 12 : face.height / 2, colour);
    else if (long <= face.height && right - left >= 18) face.upright(text, middle, colour);
    else if (kind === "alert" && middle - lastMark >= SPARSE) {
      word("▲", middle, 12, colour);
      lastMark = middle;
    }
  }

  /** Grey where the monitor said nothing. */
  function drawTraces(frame) {
    const silent = frame.bands.filter(({ kind }) => isSilent(kind));
    if (silent.length === 0) {
      drawTrace(frame, face.palette.trace);
      return;
    }
    const within = (colour, inverted) => {
      pen.save();
      pen.beginPath();
      if (inverted) pen.rect(0, 0, frame.width, face.height);
      for (const { x0, x1 } of silent) pen.rect(x0, 0, x1 - x0, face.height);
      pen.clip("evenodd");
      drawTrace(frame, colour);
      pen.restore();
    };
    within(face.palette.trace, true);
    within(face.palette.dim, false);
  }

  function drawTrace(frame, colour) {
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = 1.8;
    pen.lineJoin = "bevel";
    if (frame.visible.sparse) traceSamples(frame);
    else traceColumns(frame);
  }

  function traceSamples({ ring, visible }) {
    const { n, x, from, flags } = visible;
    let drawing = false;
    pen.beginPath();
    for (let i = 0; i < n; i++) {
      const value = ring.value(strip.series, from[i]);
      if (Number.isNaN(value)) {
        drawing = false;
        continue;
      }
      const at = y(value);
      if (!drawing || (flags[i] & GAP) !== 0) pen.moveTo(x[i] - 0.9, at); // a lone sample is a dot
      pen.lineTo(x[i], at);
      drawing = true;
    }
    pen.stroke();
  }

  /** The area between the columns' extremes, half a line wider: four times faster than a stroke. */
  function traceColumns({ ring, visible }) {
    const { n, x, from, to, flags } = visible;
    if (tops.length < n) [tops, bottoms] = [new Float32Array(2 * n), new Float32Array(2 * n)];
    let begin = -1; // first cell of the unbroken piece
    let [above, below] = [0, 0]; // extremes of the cell before
    for (let i = 0; i < n; i++) {
      const known = ring.extent(strip.series, from[i], to[i], out);
      if (begin >= 0 && (!known || (flags[i] & GAP) !== 0)) {
        fillPiece(x, begin, i);
        begin = -1;
      }
      if (!known) continue;
      const [top, bottom] = [y(out[1]) - 0.9, y(out[0]) + 0.9];
      tops[i] = begin >= 0 && below < top ? below - 1.8 : top; // reach the neighbour: a step stays thick
      bottoms[i] = begin >= 0 && above > bottom ? above + 1.8 : bottom;
      [above, below] = [top, bottom];
      if (begin < 0) begin = i;
    }
    if (begin >= 0) fillPiece(x, begin, n);
  }

  function fillPiece(x, begin, end) {
    pen.beginPath();
    pen.moveTo(x[begin] - 0.5, tops[begin]);
    for (let i = begin; i < end; i++) pen.lineTo(x[i], tops[i]);
    pen.lineTo(x[end - 1] + 0.5, tops[end - 1]);
    pen.lineTo(x[end - 1] + 0.5, bottoms[end - 1]);
    for (let i = end - 1; i >= begin; i--) pen.lineTo(x[i], bottoms[i]);
    pen.lineTo(x[begin] - 0.5, bottoms[begin]);
    pen.fill();
  }

  /** The forecast made at t stands at t + lead: dashed, bold where it lies in the future. */
  function drawForecast(frame) {
    const { visible, step } = frame;
    const shift = frame.lead / step;
    const nowX = frame.x(frame.now);
    pen.strokeStyle = face.palette.forecast;
    pen.lineWidth = 1.4;
    if (visible.sparse && visible.n > 1) pen.setLineDash([6, 4]);
    stretch(frame, shift, -Infinity, nowX, !visible.sparse);
    pen.lineWidth = 3;
    pen.setLineDash(shift > 24 ? [7, 4] : [3, 2]);
    stretch(frame, shift, nowX, Infinity, false);
    pen.setLineDash([]);
  }

  /** Strokes the part of the forecast with left < x <= right; dashed by leaving out columns. */
  function stretch({ ring, visible, first }, shift, left, right, skipping) {
    const { n, x, from, to, flags } = visible;
    let drawing = false;
    pen.beginPath();
    for (let i = 0; i < n; i++) {
      const at = x[i] + shift;
      if (at > right) break;
      if (at <= left && !(i + 1 < n && x[i + 1] + shift > left)) continue;
      const skip = skipping && (((Math.floor(x[i]) + first) % DASH) + DASH) % DASH >= 6;
      if (skip || !ring.extent(strip.forecast, from[i], to[i], out)) {
        drawing = false;
        continue;
      }
      if ((flags[i] & GAP) !== 0) drawing = false;
      const middle = y((out[0] + out[1]) / 2);
      if (drawing) pen.lineTo(at, middle);
      else pen.moveTo(at, middle);
      drawing = true;
    }
    pen.stroke();
  }

  /** Fills the trace beyond a limit, and marks each exceedance at the edge: up or down. */
  function drawExceedances({ ring, visible, samplePx }) {
    const limit = Math.fround(strip.limit);
    const { n, x, from, to } = visible;
    if (n === 0 || !ring.extent(strip.series, from[0], to[n - 1], out)) return;
    if (out[1] < limit && out[0] > -limit) return;
    pen.fillStyle = face.palette.alert;
    const wide = Math.max(1.5, visible.sparse ? samplePx + 0.5 : 1.5);
    const seen = [false, false];
    const marked = [-Infinity, -Infinity];
    for (let i = 0; i < n; i++) {
      const found = ring.extent(strip.series, from[i], to[i], out);
      const over = [found && out[1] >= limit, found && out[0] <= -limit];
      for (const side of [0, 1]) {
        if (over[side]) {
          const edge = y(side === 0 ? limit : -limit);
          const peak = y(side === 0 ? out[1] : out[0]);
          pen.fillRect(x[i] - wide / 2, Math.min(edge, peak), wide, Math.abs(edge - peak) + 1);
          if (!seen[side] && x[i] - marked[side] >= SPARSE) {
            face.triangle(x[i], side === 0);
            marked[side] = x[i];
          }
        }
        seen[side] = over[side];
      }
    }
  }

  function drawCursors(frame) {
    face.line(frame.x(frame.now), face.palette.dim, [], 1);
    face.line(frame.x(frame.cursor), face.palette.cursor, [2, 2], 1);
    face.line(frame.x(frame.marks.a), face.palette["mark-a"], [7, 3], 1.5);
    face.line(frame.x(frame.marks.b), face.palette["mark-b"], [7, 3], 1.5);
  }

  return { draw, resize: face.resize, setPalette: face.setPalette, axis };
}

function isSilent(kind) {
  return kind === "invalid" || kind === "unassessed";
}
