/**
 * Draws one strip of a flight: bands, limits, forecast, trace, exceedances, cursors, value axis.
 *
 * Exports
 *   createStripCanvas(canvas, strip) -> {draw(frame), resize(width, height, ratio), setPalette(p), axis}
 *
 * @typedef {object} Strip  what a strip shows
 * @property {number} series  of the ring buffer
 * @property {number | null} forecast  series of the forecast, or null
 * @property {number | null} limit  magnitude not to be exceeded, or null
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
 * @property {{key: string | null, t: number, word: string, colour?: string}[]} flags  moments that are marked
 * @property {object | null} ahead  what is forecast of the rest of the card, see ahead.js
 * @property {number} alertAbove @property {number} cursor @property {{a: number, b: number}} marks [s]
 */

import { leadSeconds } from "../../lib/numbers.js";
import { createStripFrame, GUTTER, SPARSE } from "../strip_frame.js";
import { createAheadBand } from "./ahead.js";
import { createForecast } from "./forecast.js";
import { createTrace } from "./trace.js";

const OF_THE_RISK = new Set(["alert", "warming", "invalid", "unassessed"]); // words that stand once, on its strip

export function createStripCanvas(canvas, strip) {
  const face = createStripFrame(canvas, strip);
  const { pen, y, word } = face;
  const out = new Float64Array(2);
  const axis = strip.axis;
  const drawTrace = createTrace(face, strip.series);
  const drawForecast = strip.forecast === null ? () => {} : createForecast(face, strip.forecast);
  const ahead = createAheadBand(face, strip.key);
  let lastMark = -Infinity; // where the last mark stands, so that a crowd stays legible

  function draw(frame) {
    fitAxis(frame);
    face.begin(frame.ticks, frame.x, frame.width);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, frame.width, face.height);
    pen.clip();
    if (strip.forecast !== null) drawLead(frame);
    ahead.draw(frame);
    for (const band of frame.bands) drawBand(band);
    lastMark = -Infinity;
    for (const band of frame.bands) drawWord(band); // under the trace, which no word may hide
    const held = heldOf(strip);
    face.thresholds(frame.alertAbove, frame.width, held?.map(({ limit, from, to }) => ({ limit, left: frame.x(from), right: frame.x(to) })));
    drawForecast(frame);
    drawTraces(frame);
    for (const { limit, from, to } of held ?? [{ limit: strip.limit, from: -Infinity, to: Infinity }]) {
      if (limit !== null) drawExceedances(frame, Math.fround(limit), from, to);
    }
    face.flags(frame);
    face.line(frame.x(frame.now), face.palette.dim, [], 1);
    face.cursors(frame);
    pen.restore();
    face.labels(frame.alertAbove);
  }

  function fitAxis({ ring, visible, wall, ahead: given }) {
    let [low, high] = ahead.extent(given) ?? [Infinity, -Infinity];
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
    if (x1 - x0 > 52) word(`+${leadSeconds(frame.lead, 2)} s`, (x0 + x1) / 2, 9, face.palette.forecast);
  }

  function drawBand({ x0, x1, kind }) {
    if ((kind === "alert" || kind === "warming") && !strip.risk) {
      if (kind !== "alert" || strip.limit === null) return;
      pen.fillStyle = face.palette.alert; // on limited channels a bar: compare the alert with the exceedance
      pen.fillRect(x0, 0, x1 - x0, 4);
      return;
    }
    if (kind === "thinned") {
      pen.globalAlpha = 0.5;
      pen.fillStyle = face.hatches.stale;
      pen.fillRect(x0, 0, x1 - x0, face.height);
      pen.globalAlpha = 1;
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
    if (OF_THE_RISK.has(kind) && !strip.risk) return;
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

  /** Grey where the monitor assessed nothing. */
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

  /** Fills the trace beyond a limit where that held, and marks each exceedance at the edge: up or down. */
  function drawExceedances({ ring, visible, samplePx }, limit, since, until) {
    const { n, x, from, to } = visible;
    if (n === 0 || !ring.extent(strip.series, from[0], to[n - 1], out)) return;
    if (out[1] < limit && out[0] > -limit) return;
    pen.fillStyle = face.palette.alert;
    const wide = Math.max(1.5, visible.sparse ? samplePx + 0.5 : 1.5);
    const seen = [false, false];
    const marked = [-Infinity, -Infinity];
    for (let i = 0; i < n; i++) {
      const holds = ring.time(from[i]) > since && ring.time(from[i]) <= until;
      const known = holds && ring.extent(strip.series, from[i], to[i], out);
      const over = [known && out[1] >= limit, known && out[0] <= -limit];
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

  return { draw, resize: face.resize, setPalette: face.setPalette, axis };
}

/** What held from which time to which [s], after it changed; null where one limit always did. */
function heldOf({ held }) {
  return held?.map(({ limit, from }, k) => ({ limit, from, to: held[k + 1]?.from ?? Infinity })) ?? null;
}

function isSilent(kind) {
  return kind === "invalid" || kind === "unassessed";
}
