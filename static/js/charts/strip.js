/**
 * Draws one strip: bands, limits, forecast, traces, exceedances, moments, cursors, value axis.
 *
 * createStrip(canvas, strip) -> Sheet with draw(frame), see layout.js
 *
 * Frame  what all strips of a chart share in one turn
 *   x(t) -> place in the plot;   width [px], step: seconds a pixel, first: column of the left edge, wall [ms]
 *   ticks {times, step} of the grid [s];   cursor, marks {a, b} [s];   alertAbove
 *   flags [{key | null, t, word, colour}]  moments marked
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
import { createStripFrame, SPARSE } from "./strip_frame.js";
import { holdsOf } from "./strips.js";
import { drawBeyond, drawEnvelope, drawForecast, drawSafeBand, drawTrace } from "./trace.js";

/**
 * fill: hatch or token.   all: on every strip, not only on the risk's; said: its word too.
 * sign: where the word does not fit in `least` px or more.   level: the word is never upright
 */
const BANDS = {
  gap: { fill: "band", alpha: 0.22, all: true, said: true },
  thinned: { fill: "stale", alpha: 0.5, all: true, said: true },
  stale: { fill: "stale", all: true, said: true },
  invalid: { fill: "band", alpha: 0.5, all: true },
  unassessed: { fill: "band", alpha: 0.25, all: true },
  withdrawn: { fill: "band", alpha: 0.3, sign: "✕", least: 6 },
  between: { fill: "band", alpha: 0.1, level: true },
  warming: { fill: "warming" },
  alert: { fill: "alert", sign: "▲" },
};
const OUTER = 12; // px, middle of the words of alerts

export function createStrip(canvas, strip) {
  const face = createStripFrame(canvas, strip);
  const { pen, y } = face;
  const out = new Float64Array(2);
  let lastSign = -Infinity; // where the last one is, so that a crowd stays legible

  function draw(frame) {
    const seen = extremes(frame);
    strip.axis.fit(...seen, frame.wall);
    face.begin(frame);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, frame.width, face.height);
    pen.clip();
    const safe = frame.safe?.channels[strip.key];
    if (safe) for (const start of frame.safe.starts) drawSafeBand(face, { t: frame.safe.t, ...safe }, start, frame, strip.isTall ? frame.safe.word : "", strip.limits?.[0]);
    if (strip.forecast !== null) drawLead(frame);
    const ahead = frame.ahead?.channels[strip.key];
    if (ahead) drawEnvelope(face, { t: frame.ahead.t, word: frame.ahead.word, ...ahead }, frame);
    for (const band of frame.bands) drawBand(band);
    lastSign = -Infinity;
    for (const band of frame.bands) drawWord(band, frame.width); // no word may hide the trace
    face.thresholds(frame);
    const [first] = frame.parts;
    if (first && strip.forecast !== null)
      drawForecast(face, first.cells, first.cells.series(strip.forecast), frame, frame.errors?.[strip.key]);
    for (const part of frame.parts) drawPart(part, frame);
    if (first && isOver(seen)) {
      const read = first.cells.series(strip.key);
      for (const held of holdsOf(strip))
        if (held.limits !== null) drawBeyond(face, first.cells, read, held);
    }
    face.flags(frame);
    face.line(frame.x(frame.now), face.palette.dim, [], 1);
    face.cursors(frame);
    pen.restore();
  }

  /** Least and greatest value in view, of traces and forecasts. */
  function extremes({ parts, ahead }) {
    let [low, high] = [Infinity, -Infinity];
    const band = ahead?.channels[strip.key];
    if (band) [low, high] = [Math.min(...band.low), Math.max(...band.high)];
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

  function drawPart({ cells, colour, dashed = false, quiet, withdrawn = false }, frame) {
    const read = cells.series(strip.key);
    const trace = (look) => drawTrace(face, cells, read, { colour, dashed, ...look });
    if (strip.risk && withdrawn) {
      drawTrace(face, cells, cells.series("withdrawn"), { colour: "stale", dashed });
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
      face.clipped(quiet.boxes, false, () => {
        pen.globalAlpha = quiet.alpha;
        trace({ colour: quiet.colour });
      });
      face.clipped(quiet.boxes, true, trace);
    }
  }

  function drawLead({ x, now, lead }) {
    const [x0, x1] = [x(now), x(now + lead)];
    if (!(x1 > x0)) return;
    pen.globalAlpha = 0.16;
    pen.fillStyle = face.palette.forecast;
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
    const middle = (x0 + x1) / 2;
    if (x1 - x0 > 52) face.word(`+${leadSeconds(lead, 2)} s`, middle, 9, face.palette.forecast);
  }

  function drawBand({ x0, x1, kind }) {
    const { fill, alpha = 1, all = false } = BANDS[kind];
    if (!strip.risk && kind === "alert" && strip.limits !== null) {
      pen.fillStyle = face.palette.alert; // a bar: compare the alert with the exceedance below it
      pen.fillRect(x0, 0, x1 - x0, 4);
    }
    if (!strip.risk && !all) return;
    pen.globalAlpha = alpha;
    pen.fillStyle = face.hatches[fill] ?? face.palette[fill];
    pen.fillRect(x0, 0, x1 - x0, face.height);
    pen.globalAlpha = 1;
  }

  function drawWord({ x0, x1, kind, word }, width) {
    const { said = false, level = false, sign, least = 0 } = BANDS[kind];
    if (!strip.risk && !said) return;
    const [left, right] = [Math.max(0, x0), Math.min(width, x1)];
    const [room, middle] = [right - left, (left + right) / 2];
    const long = face.wide(word) + 2;
    const colour = kind === "alert" ? face.palette.alert : face.palette.text;
    const height = kind === "alert" ? OUTER : face.height / 2;
    if (long <= room) face.word(word, middle, height, colour);
    else if (level) return;
    else if (long <= face.height && room >= 18) face.upright(word, middle, colour);
    else if (sign && room >= least && middle - lastSign >= SPARSE) {
      face.word(sign, middle, height, colour);
      lastSign = middle;
    }
  }

  return Object.assign(face, { draw });
}
