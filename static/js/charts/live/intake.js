/**
 * Puts a flight's frames into the ring buffer: their flags, the newest state, and the exceedances,
 * each latched until it is acknowledged and over.
 *
 * createIntake({ring, channels, strips, dt, onExceedance}) -> Intake     strips: series in the order channels, risk, forecasts
 *   push(frames) -> how many were stored;   insert(frames, complete)    earlier ones; complete: the sample after them follows
 *   status -> {state, alert}          of the newest frame, or as set by setStatus
 *   exceedances -> Map of key -> {t, value, over}     the first exceedance and the peak since; over: it is in progress
 *   acknowledge()                     forgets those that are over; one in progress stays until it is over
 *   restore([{channel, t, value, over, acknowledged}], seq)    latched up to sample seq, as the server has them
 */

import { stripState } from "../../lib/states.js";
import { holdsOf, isBeyond } from "../strips.js";
import { BROKEN, FLAG } from "./ring_buffer.js";

const NO_DATA = { state: "none", alert: false };

export function createIntake({ ring, channels, strips, dt, onExceedance }) {
  const placeOf = new Map(channels.map(({ key }, k) => [key, k]));
  const measured = strips.filter(({ risk }) => !risk);
  const forecasting = measured.filter(({ forecast }) => forecast !== null);
  const row = new Float64Array(channels.length + 1 + forecasting.length);
  const exceedances = new Map();
  let status = NO_DATA;
  let seq = null;
  let latchedTo = -1; // newest sample whose exceedances were restored

  function push(frames) {
    const before = ring.count();
    for (const frame of frames) store(frame);
    return ring.count() - before;
  }

  /** Values of a frame as the ring buffer holds them; the same array each time. */
  function rowOf(frame) {
    for (let k = 0; k < channels.length; k++) row[k] = number(frame.y[k]);
    row[channels.length] = frame.state === "ok" ? number(frame.p_value) : NaN;
    forecasting.forEach(({ key }, k) => {
      row[channels.length + 1 + k] = number(frame.y_hat?.[placeOf.get(key)] ?? frame.y_hat?.[key]);
    });
    return row;
  }

  function store(frame) {
    const stored = ring.push(frame.t, rowOf(frame), flagsOf(frame));
    status = { state: stripState(frame), alert: frame.alert === true && frame.state === "ok" };
    if (!stored) return;
    seq = frame.seq ?? null;
    if (seq !== null && seq <= latchedTo) return;
    for (const strip of measured) {
      const value = row[placeOf.get(strip.key)];
      const limits = limitsAt(strip, frame.t);
      if (limits === null || Number.isNaN(value)) continue;
      if (isBeyond(limits, value).includes(true)) latch(strip, frame.t, value);
      else release(strip.key);
    }
  }

  function insert(frames, complete) {
    const at = ring.after(frames[0].t);
    const end = at < ring.count() ? ring.time(at) : Infinity;
    const fits = frames.filter(({ t }) => t < end);
    if (fits.length === 0) return;
    let before = at > ring.first() ? ring.time(at - 1) : -Infinity;
    const rows = fits.map((frame) => {
      const flags = stateFlags(frame) | gapFlag(before, frame.t);
      before = frame.t;
      return { t: frame.t, row: Float64Array.from(rowOf(frame)), flags };
    });
    const follows = at < ring.count() ? ring.flags(at, at + 1) & ~BROKEN : 0;
    if (!ring.insert(at, rows, follows | (complete ? gapFlag(before, end) : FLAG.thinned))) return;
    if (end === Infinity) seq = fits.at(-1).seq ?? null;
    for (const frame of fits) latchEarlier(frame);
  }

  /** An exceedance that this page had missed, and that was over before the newest sample. */
  function latchEarlier(frame) {
    if (frame.seq <= latchedTo) return;
    for (const strip of measured) {
      const [value, limits] = [number(frame.y[placeOf.get(strip.key)]), limitsAt(strip, frame.t)];
      if (limits === null || exceedances.has(strip.key)) continue;
      if (!isBeyond(limits, value).includes(true)) continue;
      latch(strip, frame.t, value);
      release(strip.key);
    }
  }

  function gapFlag(before, t) {
    return Number.isFinite(before) && Number.isFinite(t) && t - before > 1.5 * dt ? FLAG.gap : 0;
  }

  function flagsOf(frame) {
    const n = ring.count();
    const thinned = n > 0 && seq !== null && frame.seq != null && frame.seq > seq + 1;
    return stateFlags(frame) | (thinned ? FLAG.thinned : n > 0 ? gapFlag(ring.time(n - 1), frame.t) : 0);
  }

  function stateFlags(frame) {
    const alert = frame.alert === true && frame.state === "ok" ? FLAG.alert : 0;
    return (FLAG[stripState(frame)] ?? 0) | alert;
  }

  function latch({ key, symbol }, t, value) {
    const latched = exceedances.get(key);
    if (latched === undefined) onExceedance?.({ key, symbol, t, value });
    const isPeak = latched === undefined || Math.abs(value) > Math.abs(latched.value);
    const peak = isPeak ? value : latched.value;
    exceedances.set(key, { t, acknowledged: false, ...latched, value: peak, over: true });
  }

  function release(key) {
    const latched = exceedances.get(key);
    if (latched?.acknowledged) exceedances.delete(key);
    else if (latched) latched.over = false;
  }

  function acknowledge() {
    for (const [key, latched] of exceedances) {
      if (latched.over) latched.acknowledged = true;
      else exceedances.delete(key);
    }
  }

  /** Latched up to a sample; frames up to that one latch and release nothing. */
  function restore(given, until) {
    latchedTo = until;
    const known = new Set(exceedances.keys());
    exceedances.clear();
    for (const { channel: key, t, value, over, acknowledged } of given) {
      const { symbol } = strips.find((strip) => strip.key === key) ?? { symbol: key };
      if (!known.has(key)) onExceedance?.({ key, symbol, t, value });
      exceedances.set(key, { t, value, over, acknowledged });
    }
  }

  return {
    push,
    insert,
    exceedances,
    acknowledge,
    restore,
    get status() {
      return status;
    },
    setStatus: (given) => {
      status = given;
    },
    clear: () => {
      exceedances.clear();
      status = NO_DATA;
      seq = null;
      latchedTo = -1;
    },
  };
}

/** Limits that held for a sample of t [s]. */
function limitsAt(strip, t) {
  return holdsOf(strip).findLast(({ from }) => t > from)?.limits ?? null;
}

function number(value) {
  return typeof value === "number" ? value : NaN;
}
