/**
 * Draws one strip: bands, limits, forecast, traces, exceedances, moments, cursors, value axis.
 *
 * createStrip(canvas, strip) -> Sheet with draw(frame), see layout.js
 *
 * Frame  what all strips of a chart share in one turn
 *   x(t) -> place in the plot [units];   width [units], step: seconds a unit, wall [ms]
 *   columns, pitch, first: pixels of the canvas across the plot, units each, and how many are left of it since time zero
 *   revision: changes with the traces that were drawn; until: place before which cells do not change [units]
 *   picture: changes with all that was drawn left of `until`
 *   ticks {times, step} of the grid [s];   cursor, marks {a, b} [s];   alertAbove
 *   flags [{key | null, t, word, colour, cuts}]  moments marked; cuts: the value jumps there, the aircraft does not
 *   parts [Part]  one for each recording laid over;   bands [{x0, x1, kind of BANDS, word}]
 *   now  [s], NaN in a recording;   lead  of forecasts [s]
 *   safe  {t, channels: {key: {low, high}}, starts: [s], word} | null: where simulated safe flights are, see simulated.js
 *   errors  {key: {low, high}} | null: of the forecast
 *   ahead  {t: [s], word, channels: {key: {low, high, predicted}}} | null: a band of values, such as a forecast
 *
 * Part
 *   cells  see trace.js;   colour, dashed
 *   quiet {boxes: [{x0, x1}], colour, alpha}  how and where the trace of a channel is drawn while nothing is assessed
 *   withdrawn  whether the risk is red above the alert level, and grey where the series "withdrawn" has it
 */

import { isBeyond } from "../lib/limits.js";
import { leadSeconds } from "../lib/numbers.js";
import { BAR, createStripFrame, SPARSE } from "./strip_frame.js";
import { holdsOf } from "./strips.js";
import { breaksAt, drawBeyond, drawEnvelope, drawForecast, drawSafeBand, drawTrace, pieceOf, spanOf } from "./trace.js";

/**
 * fill: hatch or token.   all: on every strip, not only on the risk's; said: its word too.
 * sign: where the word does not fit in `least` px or more.   level: the word is never upright
 */
const BANDS = {
  gap: { fill: "band", alpha: 0.22, all: true, said: true },
  thinned: { fill: "stale", alpha: 0.5, all: true, said: true },
  stale: { fill: "stale", all: true, said: true },
  late: { fill: "stale", alpha: 0.5, all: true, said: true },
  invalid: { fill: "band", alpha: 0.5, all: true },
  unassessed: { fill: "band", alpha: 0.25, all: true },
  withdrawn: { fill: "band", alpha: 0.3, sign: "✕", least: 6 },
  between: { fill: "band", alpha: 0.1, level: true },
  warming: { fill: "warming" },
  alert: { fill: "alert", sign: "▲" },
};
const BEFORE = 8; // units left of its place that a cell is drawn, at most

export function createStrip(canvas, strip) {
  const face = createStripFrame(canvas, strip);
  const { pen, y } = face;
  const kept = createKept(face, strip.axis);
  const out = new Float64Array(2);
  let lastSign = -Infinity; // where the last one is, so that a crowd stays legible

  function draw(frame) {
    const seen = extremes(frame);
    strip.axis.fit(...seen, frame.wall);
    const begin = kept.place(frame);
    face.begin(frame, begin);
    within(pen, begin, frame.width - begin, face.height, () => drawPlot(frame, begin, isOver(seen)));
  }

  function drawPlot(frame, begin, over) {
    const safe = frame.safe?.channels[strip.key];
    if (safe) for (const start of frame.safe.starts) drawSafeBand(face, { t: frame.safe.t, ...safe }, start, frame, strip.hasLegend ? frame.safe.word : "");
    if (strip.forecast !== null) drawLead(frame);
    const ahead = frame.ahead?.channels[strip.key];
    if (ahead) drawEnvelope(face, { t: frame.ahead.t, word: strip.hasLegend ? frame.ahead.word : "", ...ahead }, frame);
    for (const band of frame.bands) drawBand(band);
    lastSign = -Infinity;
    const flagged = face.flagWords(frame);
    const taken = flagged.map(({ left, right, height }) => ({ left, right, top: height - 8, bottom: height + 8 }));
    const [first, others] = [true, false].map((said) => frame.bands.filter(({ kind }) => Boolean(BANDS[kind].said) === said));
    for (const band of [...first, ...others]) drawWord(band, frame, taken); // no word may hide the trace
    face.thresholds(frame);
    kept.draw(frame, begin, (ink, piece) => drawCells(ink, frame, over, piece));
    if (strip.axis.beyond) face.word("OFF SCALE", frame.width - face.wide("OFF SCALE") / 2 - 4, face.height - 12, face.palette.text);
    face.flags(frame, flagged);
    face.line(frame.x(frame.now), face.palette.dim, [], 1);
    face.cursors(frame);
  }

  /** Least and greatest value in view, of traces, forecasts and safe flights. */
  function extremes({ parts, ahead, safe, x, width }) {
    let [low, high] = [Infinity, -Infinity];
    const band = ahead?.channels[strip.key];
    if (band) [low, high] = [Math.min(...band.low), Math.max(...band.high)];
    const flown = safe?.channels[strip.key];
    if (flown && safe.starts.some((start) => x(start + safe.t[0]) < width && x(start + safe.t.at(-1)) > 0))
      [low, high] = [Math.min(low, ...flown.low), Math.max(high, ...flown.high)];
    for (const { cells } of parts) {
      for (const key of [strip.key, strip.forecast]) {
        if (key === null || !cells.range(key, out)) continue;
        low = Math.min(low, out[0]);
        high = Math.max(high, out[1]);
      }
    }
    return [low, high];
  }

  /** @param {number[]} seen */
  function isOver([low, high]) {
    const tightest = holdsOf(strip).filter(({ limits }) => limits !== null);
    return tightest.some(({ limits }) => isBeyond(limits.map(Math.fround), low, high).includes(true));
  }

  function drawCells(ink, frame, over, piece) {
    const [first] = frame.parts;
    const breaks = first && breaksAt(first.cells, frame.flags.filter(({ key, cuts }) => cuts && key === strip.key).map(({ t }) => frame.x(t)), frame.pitch);
    if (first && strip.forecast !== null)
      drawForecast(ink, first.cells, first.cells.series(strip.forecast), { ...frame, breaks }, piece, frame.errors?.[strip.key]);
    for (const part of frame.parts) drawPart(ink, part, frame, breaks, piece);
    if (!first || !over) return;
    const read = first.cells.series(strip.key);
    for (const held of holdsOf(strip))
      if (held.limits !== null) drawBeyond(ink, first.cells, read, held, piece);
  }

  function drawPart(ink, { cells, colour, dashed = false, quiet, withdrawn = false }, frame, breaks, piece) {
    const { pen } = ink;
    const read = cells.series(strip.key);
    const trace = (look) => drawTrace(ink, cells, read, { colour, dashed, breaks, ...look }, piece);
    if (strip.beside !== null) drawTrace(ink, cells, cells.series(strip.beside), { colour: "forecast", dashed: true }, piece);
    if (strip.risk && withdrawn) {
      drawTrace(ink, cells, cells.series("withdrawn"), { colour: "stale", dashed }, piece);
      trace();
      if (!Number.isFinite(frame.alertAbove) || dashed) return;
      pen.save(); // above the alert level the risk is red
      pen.beginPath();
      pen.rect(0, 0, frame.width, y(frame.alertAbove));
      pen.clip();
      trace({ colour: "alert" });
      pen.restore();
    } else if (strip.risk || quiet.boxes.length === 0) {
      trace();
    } else {
      clipped(ink, quiet.boxes, false, () => {
        pen.globalAlpha = quiet.alpha;
        trace({ colour: quiet.colour });
      });
      clipped(ink, quiet.boxes, true, trace);
    }
  }

  function drawLead({ x, now, lead, step, parts: [first] }) {
    const [x0, x1] = [x(now), x(now + lead)];
    if (!(x1 > x0)) return;
    pen.globalAlpha = 0.16;
    pen.fillStyle = face.palette.forecast;
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
    const middle = (x0 + x1) / 2;
    if (x1 - x0 <= 52) return;
    const span = first && spanOf(face, first.cells, first.cells.series(strip.forecast), x(now) - lead / step);
    const height = face.free(0, span ? [span] : []);
    if (Number.isFinite(height)) face.word(`+${leadSeconds(lead, 2)} s`, middle, height, face.palette.forecast);
  }

  function drawBand({ x0, x1, kind }) {
    const { fill, alpha = 1, all = false } = BANDS[kind];
    if (!strip.risk && kind === "alert" && strip.limits !== null) {
      pen.fillStyle = face.palette.alert; // a bar: compare the alert with the exceedance below it
      pen.fillRect(x0, 0, x1 - x0, BAR);
    }
    if (!strip.risk && !all) return;
    pen.globalAlpha = alpha;
    pen.fillStyle = face.hatches[fill] ?? face.palette[fill];
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
  }

  /** taken: [{left, right, top, bottom}] of other words; this one is added. */
  function drawWord({ x0, x1, kind, word }, { width, alertAbove }, taken) {
    const { said = false, level = false, sign, least = 0 } = BANDS[kind];
    if (!strip.risk && !said) return;
    const [left, right] = [Math.max(0, x0), Math.min(width, x1)];
    const [room, middle] = [right - left, (left + right) / 2];
    const long = face.wide(word) + 2;
    const colour = kind === "alert" ? face.palette.alert : face.palette.text;
    const isAlert = kind === "alert"; // the risk is above its level then
    const beside = (half) => taken.filter((other) => other.left < middle + half && other.right > middle - half);
    const spans = beside(Math.min(long, room) / 2).map(({ top, bottom }) => [top, bottom]);
    const height = face.free(face.height / (isAlert ? 1 : 2), isAlert ? [...spans, [0, y(alertAbove)]] : spans);
    const between = face.longest();
    const take = (half, at, high) => taken.push({ left: middle - half, right: middle + half, top: at - high, bottom: at + high });
    if (long <= room && Number.isFinite(height)) {
      face.word(word, middle, height, colour);
      take(long / 2, height, 8);
    } else if (level) return;
    else if (!isAlert && long <= between.room && room >= 18 && beside(9).length === 0) {
      face.upright(word, middle, between.middle, colour);
      take(9, between.middle, long / 2);
    } else if (sign && room >= least && middle - lastSign >= SPARSE && Number.isFinite(height)) {
      face.word(sign, middle, height, colour);
      lastSign = middle;
    }
  }

  return Object.assign(face, { draw });
}

/**
 * What was drawn is kept. Traces that do not change any more lie on a separate canvas, which is moved by whole columns;
 * while nothing else changes, only what is right of them is redrawn.
 *
 * place(frame) -> where to begin to draw [units], 0 for the whole plot
 * draw(frame, begin, drawPiece)     drawPiece(face with the pen to use, piece)
 */
function createKept(face, axis) {
  if (!(face.canvas instanceof HTMLCanvasElement)) return { place: () => 0, draw: (frame, _, drawPiece) => drawPiece(face, pieceOf(frame, 0, frame.width)) };
  const canvas = document.createElement("canvas");
  const pen = canvas.getContext("2d");
  const ink = Object.create(face, { pen: { value: pen } });
  let shown = []; // what the plot depends on, left of the newest samples
  let drawn = []; // what the columns on the canvas depend on
  let left = 0; // column at the left edge, since time zero
  let [from, to] = [0, 0]; // columns on the canvas

  function place({ picture, pitch }) {
    const now = [picture, axis.low, axis.high];
    const isSame = now.every((value, k) => value === shown[k]);
    shown = now;
    return isSame ? (to - left) * pitch : 0;
  }

  function draw(frame, begin, drawPiece) {
    const { first, columns, pitch, width } = frame;
    if (begin === 0) {
      extend(frame, drawPiece);
      face.paste(canvas);
    }
    if (to === first + columns) return;
    const x = (to - first) * pitch;
    within(face.pen, x, width - x, face.height, () => drawPiece(face, pieceOf(frame, x, width)));
  }

  function extend(frame, drawPiece) {
    const { first, columns, pitch, until } = frame;
    const end = first + columns;
    const size = { width: columns, height: face.canvas.height };
    const now = [frame.revision, frame.step, axis.low, axis.high, ...Object.values(size)];
    if (to <= first || from >= end || now.some((value, k) => value !== drawn[k])) {
      if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
      pen.clearRect(0, 0, columns, canvas.height);
      from = to = first;
    } else if (left !== first) {
      pen.globalCompositeOperation = "copy";
      pen.drawImage(canvas, left - first, 0);
      pen.globalCompositeOperation = "source-over";
    }
    const settled = Math.min(end, Math.max(to, first + Math.floor((until - BEFORE) / pitch)));
    if (from > first) drawBetween(first, Math.min(from, end));
    if (settled > to) drawBetween(to, settled);
    [drawn, left, from, to] = [now, first, first, settled];

    function drawBetween(begin, stop) {
      const [x, wide] = [begin - first, stop - begin];
      within(pen, x, wide, canvas.height, () => {
        pen.scale(face.ratio, face.ratio);
        drawPiece(ink, pieceOf(frame, x * pitch, (x + wide) * pitch));
      });
    }
  }

  return { place, draw };
}

function within(pen, x, wide, height, act) {
  pen.save();
  pen.beginPath();
  pen.rect(x, 0, wide, height);
  pen.clip();
  act();
  pen.restore();
}

/** Draws within boxes [{x0, x1}] only, or outside of them only. */
function clipped({ pen, width, height }, boxes, inverted, act) {
  pen.save();
  pen.beginPath();
  if (inverted) pen.rect(0, 0, width, height);
  for (const { x0, x1 } of boxes) pen.rect(x0, 0, x1 - x0, height);
  pen.clip("evenodd");
  act();
  pen.restore();
}
