/**
 * Draws one strip: bands, limits, forecast, trace, exceedances, cursors, value axis.
 *
 * Exports
 *   GUTTER  width of the value axis left of the plot [px]
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

import { GAP } from "./ring_buffer.js";
import { hatch } from "./palette.js";
import { axisTicks } from "./value_axis.js";

export const GUTTER = 46;
const PAD = 5; // px above and below the range
const SPARSE = 22; // px between marks of the same kind
const DASH = 9; // px of a dash and its space in a column-wise trace

export function createStripCanvas(canvas, strip) {
  const pen = canvas.getContext("2d", { alpha: false });
  const out = new Float64Array(2);
  const axis = strip.axis;
  let width = 0;
  let height = 0;
  let ratio = 1;
  let palette = {};
  let hatches = {};
  let tops = new Float32Array(0);
  let bottoms = tops;
  let lastMark = -Infinity; // where the last mark stands, so that a crowd stays legible

  const y = (value) => {
    const place = height - PAD - axis.share(value) * (height - 2 * PAD);
    return Math.min(height + 40, Math.max(-40, place));
  };

  function resize(newWidth, newHeight, newRatio) {
    [width, height, ratio] = [newWidth, newHeight, newRatio];
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }

  function setPalette(given) {
    palette = given;
    hatches = Object.fromEntries(
      ["stale", "alert", "warming"].map((name) => [name, hatch(pen, name, palette)]),
    );
  }

  function draw(frame) {
    fitAxis(frame);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, width, height);
    pen.translate(GUTTER, 0);
    drawGrid(frame);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, frame.width, height);
    pen.clip();
    if (strip.forecast !== null) drawLead(frame);
    for (const band of frame.bands) drawBand(band);
    lastMark = -Infinity;
    for (const band of frame.bands) drawWord(band); // under the trace, which no word may hide
    drawThresholds(frame);
    if (strip.forecast !== null) drawForecast(frame);
    drawTrace(frame);
    if (strip.limit !== null) drawExceedances(frame);
    drawCursors(frame);
    pen.restore();
    drawAxis(frame);
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

  function drawGrid(frame) {
    pen.fillStyle = palette.grid;
    for (const t of frame.ticks) pen.fillRect(Math.round(frame.x(t)), 0, 1, height);
    for (const value of axisTicks(axis)) pen.fillRect(0, Math.round(y(value)), frame.width, 1);
    pen.fillRect(0, height - 1, frame.width, 1);
  }

  function drawLead(frame) {
    const x0 = frame.x(frame.now);
    const x1 = frame.x(frame.now + frame.lead);
    if (!(x1 > x0)) return;
    pen.globalAlpha = 0.16;
    pen.fillStyle = palette.forecast;
    pen.fillRect(x0, 0, x1 - x0, height);
    pen.globalAlpha = 1;
    if (x1 - x0 > 52) word(`+${frame.lead.toFixed(2)} s`, (x0 + x1) / 2, 9, palette.forecast);
  }

  function drawBand({ x0, x1, kind }) {
    if ((kind === "alert" || kind === "warming") && !strip.risk) {
      if (kind !== "alert" || strip.limit === null) return;
      pen.fillStyle = palette.alert; // on limited channels a bar: compare the alert with the crossing
      pen.fillRect(x0, 0, x1 - x0, 4);
      return;
    }
    if (kind === "thinned") {
      pen.fillStyle = hatches.stale;
      pen.fillRect(x0, height - 5, x1 - x0, 4);
      return;
    }
    if (kind === "gap" || kind === "invalid") {
      pen.globalAlpha = kind === "gap" ? 0.22 : 0.5;
      pen.fillStyle = palette.band;
    } else {
      pen.fillStyle = hatches[kind];
    }
    pen.fillRect(x0, 0, x1 - x0, height);
    pen.globalAlpha = 1;
  }

  function drawWord({ x0, x1, kind, word: text }) {
    if ((kind === "alert" || kind === "warming") && !strip.risk) return;
    if (kind === "thinned") return;
    const left = Math.max(0, x0);
    const right = Math.min(width - GUTTER, x1);
    pen.font = `700 12px ${palette.font}`;
    const long = pen.measureText(text).width + 10;
    const colour = kind === "alert" ? palette.alert : palette.text;
    const middle = (left + right) / 2;
    if (long <= right - left) word(text, middle, kind === "alert" ? 12 : height / 2, colour);
    else if (long <= height && right - left >= 18) upright(text, middle, colour);
    else if (kind === "alert" && middle - lastMark >= SPARSE) {
      word("▲", middle, 12, colour);
      lastMark = middle;
    }
  }

  function upright(text, x, colour) {
    pen.save();
    pen.translate(x, height / 2);
    pen.rotate(-Math.PI / 2);
    word(text, 0, 0, colour);
    pen.restore();
  }

  /** Text on a plate of the panel's colour, so that it reads over any hatch. */
  function word(text, x, middle, colour) {
    pen.font = `700 12px ${palette.font}`;
    const half = pen.measureText(text).width / 2 + 4;
    pen.globalAlpha = 0.85;
    pen.fillStyle = palette.panel;
    pen.fillRect(x - half, middle - 8, 2 * half, 16);
    pen.globalAlpha = 1;
    pen.fillStyle = colour;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(text, x, middle + 0.5);
  }

  function drawThresholds(frame) {
    const colour = strip.risk ? palette.epsilon : palette.limit;
    for (const value of thresholds(frame)) {
      const at = Math.round(y(value));
      const outside = value < 0 ? height - at : at;
      pen.globalAlpha = 0.07;
      pen.fillStyle = colour;
      if (!strip.risk) pen.fillRect(0, value < 0 ? at : 0, frame.width, outside);
      pen.globalAlpha = 1;
      pen.fillRect(0, at - 0.75, frame.width, 1.5);
    }
  }

  function thresholds(frame) {
    if (strip.risk) return Number.isFinite(frame.epsilon) ? [frame.epsilon] : [];
    return strip.limit === null ? [] : [strip.limit, -strip.limit];
  }

  function drawTrace(frame) {
    pen.strokeStyle = pen.fillStyle = palette.trace;
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
    pen.strokeStyle = palette.forecast;
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
    pen.fillStyle = palette.alert;
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
            triangle(x[i], side === 0);
            marked[side] = x[i];
          }
        }
        seen[side] = over[side];
      }
    }
  }

  function triangle(x, up) {
    const base = up ? 14 : height - 14;
    pen.beginPath();
    pen.moveTo(x, up ? 3 : height - 3);
    pen.lineTo(x - 7, base);
    pen.lineTo(x + 7, base);
    pen.fill();
  }

  function drawCursors(frame) {
    line(frame.x(frame.now), palette.dim, [], 1);
    line(frame.x(frame.cursor), palette.cursor, [2, 2], 1);
    line(frame.x(frame.marks.a), palette["mark-a"], [7, 3], 1.5);
    line(frame.x(frame.marks.b), palette["mark-b"], [7, 3], 1.5);
  }

  function line(x, colour, dash, thick) {
    if (!Number.isFinite(x)) return;
    pen.strokeStyle = colour;
    pen.lineWidth = thick;
    pen.setLineDash(dash);
    pen.beginPath();
    pen.moveTo(Math.round(x) + 0.5, 0);
    pen.lineTo(Math.round(x) + 0.5, height);
    pen.stroke();
    pen.setLineDash([]);
  }

  function drawAxis(frame) {
    pen.font = `12px ${palette.font}`;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const taken = [];
    const label = (value, text, colour, weight = "") => {
      const at = Math.min(height - 7, Math.max(7, y(value)));
      if (taken.some((other) => Math.abs(other - at) < 15)) return;
      taken.push(at);
      pen.font = `${weight} 12px ${palette.font}`.trim();
      pen.fillStyle = colour;
      pen.fillText(text, -6, at);
    };
    if (strip.risk) {
      if (Number.isFinite(frame.epsilon)) label(frame.epsilon, `ε ${frame.epsilon}`, palette.epsilon, "700");
      for (const value of [0, 1, 0.5, 0.1]) label(value, String(value), palette.dim);
      return;
    }
    for (const value of thresholds(frame)) label(value, signed(value), palette.limit, "700");
    const ticks = axisTicks(axis).filter((value) => Math.abs(value) > axis.step / 2);
    label(0, "0", palette.dim);
    for (const value of ticks.sort((a, b) => Math.abs(b) - Math.abs(a))) label(value, round(value, axis.step), palette.dim);
  }

  return { draw, resize, setPalette, axis };
}

function signed(value) {
  return `${value < 0 ? "−" : "+"}${Math.abs(value)}`;
}

function round(value, step) {
  const places = Math.min(6, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)));
  const text = Math.abs(value).toFixed(places);
  return value < -step / 1000 ? `−${text}` : text;
}
