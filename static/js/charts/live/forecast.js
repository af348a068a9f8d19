/**
 * Draws the forecast of a strip: dashed, and bold where it lies in the future.
 *
 * Exports
 *   createForecast(face, series) -> draw(frame)     face: of the strip's frame
 */

import { BROKEN } from "./ring_buffer.js";

const DASH = 9; // px of a dash and its space in a column-wise trace

export function createForecast(face, series) {
  const { pen, y } = face;
  const out = new Float64Array(2);

  /** The forecast made at t is drawn at t + lead: dashed; bold in the future. */
  function draw(frame) {
    const { visible, step } = frame;
    const shift = frame.lead / step;
    const nowX = frame.x(frame.now);
    pen.strokeStyle = face.palette.forecast;
    pen.lineWidth = 1.4;
    if (visible.sparse && visible.n > 1) pen.setLineDash([6, 4]);
    strokePart(frame, shift, -Infinity, nowX, !visible.sparse);
    pen.lineWidth = 3;
    pen.setLineDash(shift > 24 ? [7, 4] : [3, 2]);
    strokePart(frame, shift, nowX, Infinity, false);
    pen.setLineDash([]);
  }

  /** Strokes the part of the forecast with left < x <= right; dashed by leaving out columns. */
  function strokePart({ ring, visible, first }, shift, left, right, skipping) {
    const { n, x, from, to, flags } = visible;
    let drawing = false;
    pen.beginPath();
    for (let i = 0; i < n; i++) {
      const at = x[i] + shift;
      if (at > right) break;
      if (at <= left && !(i + 1 < n && x[i + 1] + shift > left)) continue;
      const skip = skipping && (((Math.floor(x[i]) + first) % DASH) + DASH) % DASH >= 6;
      if (skip || !ring.extent(series, from[i], to[i], out)) {
        drawing = false;
        continue;
      }
      if ((flags[i] & BROKEN) !== 0) drawing = false;
      const middle = y((out[0] + out[1]) / 2);
      if (drawing) pen.lineTo(at, middle);
      else pen.moveTo(at, middle);
      drawing = true;
    }
    pen.stroke();
  }

  return draw;
}
