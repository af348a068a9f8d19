/**
 * Draws one strip of a recording from its tiles: a measured channel, or the risk.
 *
 * Between manoeuvres a trace is faint, since nothing is assessed there. Withdrawn risk is grey with the word
 * INVALID; a second recording laid over the first is dashed, in another colour.
 *
 * Exports
 *   createTileStrip(canvas, strip) -> {draw(frame), resize(width, height, ratio), setPalette(p)}
 *     strip: {key, axis, limit, risk, held}    held: [{from, to, limit}] limits in force, instead of `limit`
 *     frame: {traces: [Piece | null], x, width, bands, ticks, alertAbove, cursor, marks, flags, wall}
 *   pieceOf({set, manoeuvres}, {view, x, step}) -> Piece | null    the bins of a set in the window, once
 *     for all strips; manoeuvres: [{start, end}] of its manoeuvres, or null for all bins
 */

import { createStripFrame } from "../strip_frame.js";
import { drawBeyond, drawTiles } from "./tile_trace.js";

const FAINT = 0.5;
const DENSE = 0.9; // px a bin below which bins are drawn as an area
const COLOURS = ["trace", "forecast"];

export function createTileStrip(canvas, strip) {
  const face = createStripFrame(canvas, strip);
  const { pen, y } = face;

  function draw(frame) {
    const pieces = frame.traces.map(
      (piece) => piece && { ...piece, ...piece.set.series(strip.key) },
    );
    fitAxis(pieces, frame.wall);
    face.begin(frame.ticks, frame.x, frame.width);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, frame.width, face.height);
    pen.clip();
    for (const band of frame.bands) drawBand(band);
    for (const band of frame.bands) drawWord(band, frame.width);
    const held = strip.held?.map(({ from, to, limit }) => ({ limit, left: frame.x(from), right: frame.x(to) })) ?? null;
    face.thresholds(frame.alertAbove, frame.width, held);
    pieces.forEach((piece, k) => piece && drawTrace(piece, frame, k));
    pen.fillStyle = face.palette.alert;
    for (const { from, to, limit } of strip.held ?? [{ from: -Infinity, to: Infinity, limit: strip.limit }]) {
      if (limit !== null && pieces[0]) drawBeyond(pen, y, during(pieces[0], from, to), limit, face.triangle);
    }
    face.flags(frame);
    face.cursors(frame);
    pen.restore();
    face.labels(frame.alertAbove);
  }

  function fitAxis(pieces, wall) {
    let [low, high] = [Infinity, -Infinity];
    for (const piece of pieces.filter(Boolean)) {
      for (let i = piece.from; i < piece.to; i++) {
        if (piece.low[i] < low) low = piece.low[i];
        if (piece.high[i] > high) high = piece.high[i];
      }
    }
    strip.axis.fit(low, high, wall);
  }

  function drawTrace(piece, frame, k) {
    const dashed = k > 0;
    const colour = face.palette[COLOURS[k]];
    if (strip.risk) {
      drawRisk(piece, frame, colour, dashed);
      return;
    }
    pen.strokeStyle = pen.fillStyle = colour;
    if (piece.manoeuvres === null || k > 0) {
      drawTiles(pen, y, { ...piece, dashed });
      return;
    }
    clipped(piece.manoeuvres, frame, false, () => {
      pen.globalAlpha = FAINT;
      drawTiles(pen, y, piece);
    });
    clipped(piece.manoeuvres, frame, true, () => drawTiles(pen, y, piece));
  }

  function drawRisk(piece, frame, colour, dashed) {
    const withdrawn = { ...piece, ...piece.set.series("withdrawn"), dashed };
    pen.strokeStyle = pen.fillStyle = face.palette.stale;
    drawTiles(pen, y, withdrawn);
    pen.strokeStyle = pen.fillStyle = colour;
    drawTiles(pen, y, { ...piece, dashed });
    if (!Number.isFinite(frame.alertAbove) || dashed) return;
    pen.save(); // above alertAbove the risk is red
    pen.beginPath();
    pen.rect(0, 0, frame.width, y(frame.alertAbove));
    pen.clip();
    pen.strokeStyle = pen.fillStyle = face.palette.alert;
    drawTiles(pen, y, piece);
    pen.restore();
  }

  /** Draws inside of the manoeuvres only, or only outside of them. */
  function clipped(manoeuvres, { x, width }, inside, act) {
    pen.save();
    pen.beginPath();
    if (!inside) pen.rect(0, 0, width, face.height);
    for (const { start, end } of manoeuvres) {
      const [x0, x1] = [Math.max(-2, x(start)), Math.min(width + 2, x(end))];
      if (x1 > x0) pen.rect(x0, 0, x1 - x0, face.height);
    }
    pen.clip("evenodd");
    act();
    pen.restore();
  }

  function drawBand({ x0, x1, kind }) {
    if (kind === "alert" && !strip.risk) {
      if (strip.limit === null) return;
      pen.fillStyle = face.palette.alert; // a bar: compare the alert with the exceedance below it
      pen.fillRect(x0, 0, x1 - x0, 4);
      return;
    }
    if (!strip.risk && kind !== "gap") return;
    pen.globalAlpha = { gap: 0.22, invalid: 0.3, between: 0.1 }[kind] ?? 1;
    pen.fillStyle = face.hatches[kind] ?? face.palette.band;
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
  }

  function drawWord({ x0, x1, kind, word }, width) {
    if (!word || (!strip.risk && kind !== "gap")) return;
    const [left, right] = [Math.max(0, x0), Math.min(width, x1)];
    pen.font = `700 12px ${face.palette.font}`;
    const long = pen.measureText(word).width + 10;
    const colour = kind === "alert" ? face.palette.alert : face.palette.text;
    const middle = (left + right) / 2;
    const height = kind === "alert" ? 12 : face.height / 2;
    if (long <= right - left) face.word(word, middle, height, colour);
    else if (kind === "between") return;
    else if (long <= face.height && right - left >= 18) face.upright(word, middle, colour);
    else if (kind === "alert") face.word("▲", middle, 12, colour);
    else if (kind === "invalid" && right - left >= 6) face.word("✕", middle, height, colour);
  }

  return { draw, resize: face.resize, setPalette: face.setPalette };
}

/** With one more bin on either side, so that the trace reaches the edges. */
export function pieceOf({ set, manoeuvres }, { view, x, step }) {
  if (set === null || set.n === 0) return null;
  const first = Math.floor((view.start - set.x0[0]) / set.step) - 1;
  const last = Math.ceil((view.end - set.x0[0]) / set.step) + 2;
  const [from, to] = [Math.max(0, first), Math.min(set.n, last)];
  if (to <= from) return null;
  const wide = Math.max(1.5, set.step / step + 0.5);
  const cut = cutsOf(set, manoeuvres, from, to);
  return { set, manoeuvres, x: set.at.map(x), from, to, wide, cut, dense: set.step / step < DENSE };
}

/** The bins of a piece that begin in an interval. */
function during(piece, start, end) {
  let [from, to] = [piece.from, piece.to];
  while (from < to && piece.set.x0[from] < start) from += 1;
  while (to > from && piece.set.x0[to - 1] >= end) to -= 1;
  return { ...piece, from, to };
}

/** Whether the trace breaks before a bin: each manoeuvre has its own trim. */
function cutsOf(set, manoeuvres, from, to) {
  const cut = new Uint8Array(set.n);
  for (const { start, end } of manoeuvres ?? []) {
    for (const edge of [start - 1e-9, end + 1e-9]) {
      let [low, high] = [from, to];
      while (low < high) {
        const middle = (low + high) >> 1;
        if (set.x0[middle] < edge) low = middle + 1;
        else high = middle;
      }
      if (low < to) cut[low] = 1;
    }
  }
  return cut;
}
