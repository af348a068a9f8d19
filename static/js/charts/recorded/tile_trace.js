/**
 * Draws least and greatest values as one trace: bins as an area while they are narrow, else a line.
 *
 * Exports
 *   drawTiles(pen, y, {x, low, high, from, to, cut, dense, dashed})
 *     y(value) -> px; x: (n,) px of each bin; from, to: bins to draw; cut: (n,) whether the trace breaks
 *     before a bin; dense: bins are about a pixel wide; dashed: leaves out every third piece, as a sign besides colour
 *   drawBeyond(pen, y, {x, low, high, from, to, wide}, limit, mark)
 *     fills the area beyond +-limit; mark(x, up) is called where an exceedance begins
 */

import { SPARSE } from "../strip_frame.js";

const HALF = 0.9; // px, half of the trace's thickness
const DASH = 9; // px of a dash and its space
const DRAWN = 6;

export function drawTiles(pen, y, tiles) {
  if (tiles.dense) fillArea(pen, y, tiles);
  else strokeLine(pen, y, tiles);
}

function strokeLine(pen, y, { x, low, high, from, to, cut, dashed }) {
  pen.lineWidth = 2 * HALF;
  pen.lineJoin = "bevel";
  if (dashed) pen.setLineDash([DRAWN, DASH - DRAWN]);
  pen.beginPath();
  let drawing = false;
  for (let i = from; i < to; i++) {
    if (Number.isNaN(low[i])) {
      drawing = false;
      continue;
    }
    const [top, bottom] = [y(high[i]), y(low[i])];
    if (!drawing || cut[i]) pen.moveTo(x[i] - HALF, bottom); // a lone sample is a dot
    pen.lineTo(x[i], bottom);
    if (top !== bottom) pen.lineTo(x[i], top);
    drawing = true;
  }
  pen.stroke();
  pen.setLineDash([]);
}

/** The area between the extremes, reaching the neighbour's, so that a step stays thick. */
function fillArea(pen, y, { x, low, high, from, to, cut, dashed }) {
  let tops = [];
  let [above, below] = [NaN, NaN];
  let begin = -1;
  for (let i = from; i <= to; i++) {
    const left = dashed && ((Math.floor(x[i]) % DASH) + DASH) % DASH >= DRAWN;
    const missing = i === to || left || Number.isNaN(low[i]);
    if (missing || cut[i]) {
      if (begin >= 0) fillPiece(pen, x, begin, tops);
      [tops, begin, above, below] = [[], -1, NaN, NaN];
      if (missing) continue;
    }
    const [top, bottom] = [y(high[i]) - HALF, y(low[i]) + HALF];
    tops.push([below < top ? below - 2 * HALF : top, above > bottom ? above + 2 * HALF : bottom]);
    [above, below] = [top, bottom];
    if (begin < 0) begin = i;
  }
}

function fillPiece(pen, x, begin, edges) {
  const end = begin + edges.length;
  pen.beginPath();
  pen.moveTo(x[begin] - 0.5, edges[0][0]);
  for (let i = begin; i < end; i++) pen.lineTo(x[i], edges[i - begin][0]);
  pen.lineTo(x[end - 1] + 0.5, edges.at(-1)[0]);
  pen.lineTo(x[end - 1] + 0.5, edges.at(-1)[1]);
  for (let i = end - 1; i >= begin; i--) pen.lineTo(x[i], edges[i - begin][1]);
  pen.lineTo(x[begin] - 0.5, edges[0][1]);
  pen.fill();
}

export function drawBeyond(pen, y, { x, low, high, from, to, wide }, limit, mark) {
  const seen = [false, false];
  const marked = [-Infinity, -Infinity];
  const edge = Math.fround(limit); // in the tiles' precision: the limit itself counts
  for (let i = from; i < to; i++) {
    const over = [high[i] >= edge, low[i] <= -edge];
    for (const side of [0, 1]) {
      if (over[side]) {
        const at = y(side === 0 ? limit : -limit);
        const peak = y(side === 0 ? high[i] : low[i]);
        pen.fillRect(x[i] - wide / 2, Math.min(at, peak), wide, Math.abs(at - peak) + 1);
        if (!seen[side] && x[i] - marked[side] >= SPARSE) {
          mark(x[i], side === 0);
          marked[side] = x[i];
        }
      }
      seen[side] = over[side];
    }
  }
}
