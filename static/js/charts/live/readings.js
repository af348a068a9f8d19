/**
 * Numbers and words of a flight's strips: readouts, tool bar, text for screen readers.
 *
 * Exports
 *   createReadings(strips, {rowOf, bar}, {ring, timeline, flight, intake}) -> Readings
 *
 * Readings
 *   show(view, state, age)    state: "ok", "stale", "none", ... of the newest sample; age: its [s]
 *   describe(state, age)      age: in words
 *   valueAt(strip, t)         of the nearest sample; NaN where missing or in a gap
 */

import { put } from "../../lib/dom.js";
import { figure } from "../../lib/numbers.js";
import { magnitudeIn, quantity } from "../../lib/units.js";
import { createReadout, cursorsText, STATE_WORDS } from "../readout.js";

const FAR = 3000; // samples
const UNASSESSED = ["invalid", "not_assessed", "not_applicable", "limits_unknown"];

export function createReadings(strips, { rowOf, bar }, { ring, timeline, flight, intake }) {
  const readouts = strips.map((strip, k) => createReadout(rowOf[k].readout, strip));

  function show(view, state, age) {
    const last = ring.count() - 1;
    const cursor = timeline.cursorAt(view);
    const { a, b } = timeline.marks;
    strips.forEach((strip, k) => {
      const i = state === "stale" ? lastKnown(strip) : last;
      readouts[k].show({
        state,
        age: i < 0 ? NaN : age + ring.time(last) - ring.time(i),
        alert: strip.risk && intake.status.alert,
        value: i < 0 ? NaN : ring.value(strip.series, i),
        forecast: last < 0 || strip.forecast === null ? NaN : ring.value(strip.forecast, last),
        lead: flight.lead,
        a: Number.isNaN(a) ? undefined : valueAt(strip, a),
        b: Number.isNaN(b) ? undefined : valueAt(strip, b),
        cursor: Number.isNaN(cursor) ? undefined : valueAt(strip, cursor),
        exceeded: intake.exceedances.get(strip.key) ?? null,
      });
    });
    showBar(view, state, cursor);
  }

  /** The newest sample that has a value, -1 where none is near. */
  function lastKnown({ series }) {
    const newest = ring.count() - 1;
    for (let i = newest; i >= Math.max(ring.first(), newest - FAR); i--) {
      if (Number.isFinite(ring.value(series, i))) return i;
    }
    return -1;
  }

  function showBar(view, state, cursor) {
    const behind = view.now - (view.end - flight.lead);
    const mode = modeOf(view, state);
    put(bar.mode, mode === "none" ? "NO DATA" : mode.toUpperCase());
    bar.mode.dataset.mode = mode;
    const late = !view.live && behind > 0.05 ? `, ${behind.toFixed(1)} s behind` : "";
    put(bar.interval, `${intervalText(view.end - view.start)}${late}`);
    put(bar.values, cursorsText(timeline.marks, cursor));
  }

  /** Mode of the window: green only while it follows arriving data. */
  function modeOf(view, state) {
    if (ring.count() === 0) return "none";
    if (!view.live) return "held";
    if (state === "stale") return "stale";
    return timeline.playing ? "following" : "paused";
  }

  function valueAt(strip, t) {
    const i = ring.nearest(t);
    if (i < 0 || Math.abs(ring.time(i) - t) > 1.5 * flight.dt) return NaN;
    return ring.value(strip.series, i);
  }

  function describe(state, age) {
    const last = ring.count() - 1;
    strips.forEach((strip, k) => {
      const withdrawn = strip.risk && UNASSESSED.includes(state);
      const known = last >= 0 && !withdrawn;
      const value = known ? ring.value(strip.series, last) : NaN;
      const words = { state, age, value, alert: strip.risk && intake.status.alert && known && state !== "stale" };
      const text = description(strip, words, flight.alertAbove, intake.exceedances.get(strip.key));
      rowOf[k].canvas.setAttribute("aria-label", text);
    });
  }

  return { show, describe, valueAt };
}

function description(strip, { state, age, value, alert }, alertAbove, exceedance) {
  const { risk, label, symbol, limit } = strip;
  const name = risk ? "risk, higher is worse" : `${label} ${symbol}`;
  const reading = Number.isFinite(value) ? quantity(strip, value) : "no value";
  const word = (STATE_WORDS[state] ?? state).toLowerCase();
  const last = state === "stale" && Number.isFinite(value) ? "last value " : "";
  const parts = [`${name}: ${last}${reading}`, state === "stale" ? `${word} for ${age}` : word];
  if (alert) parts.push("alert");
  if (risk && Number.isFinite(alertAbove)) parts.push(`alerts above ${figure(alertAbove)}`);
  if (limit !== null) parts.push(`limit ±${magnitudeIn(strip, limit)}`);
  if (exceedance) parts.push(`limit exceeded at ${exceedance.t.toFixed(2)} s`);
  return parts.join(", ");
}

function intervalText(seconds) {
  if (seconds >= 120) return `${(seconds / 60).toFixed(1)} min`;
  return `${seconds < 10 ? seconds.toFixed(2) : seconds.toFixed(0)} s`;
}
